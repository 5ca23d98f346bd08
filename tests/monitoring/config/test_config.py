"""The configuration of a watch: what it specifies, and how a wrong entry is reported."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from saved_kinds import write_library

from swashtwin.foundation import SwashTwinError, rpm
from swashtwin.monitoring.config.config_file import load_watch_config, write_example
from swashtwin.monitoring.config.settings import FolderSource, LogChannel, MqttSource

SMALL = """
folder = "data"
[[machine]]
name = "pump-1"
[[source]]
kind = "folder"
path = "incoming"
"""

Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Return a function that writes a configuration and returns its path."""

    def write_text(text: str) -> Path:
        path = tmp_path / "watch.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write_text


def test_the_example_loads_as_written(tmp_path: Path) -> None:
    config = load_watch_config(write_example(tmp_path / "watch.toml"), {})

    assert [machine.name for machine in config.machines] == ["pump-1"]
    assert config.machines[0].speed == pytest.approx(rpm(1500))
    assert config.sources == (
        FolderSource(name="folder", path=tmp_path / "incoming", machine="pump-1"),
    )
    assert config.channels == (LogChannel(name="log"),)
    assert config.folder == tmp_path / "watch-data"
    assert not config.history


def test_every_entry_of_the_example_that_is_commented_out_loads_too(tmp_path: Path) -> None:
    path = write_example(tmp_path / "watch.toml")
    # Comments with an entry or a table; the others are sentences.
    text = re.sub(r"^# (.*(?:=|\[\[).*)$", r"\1", path.read_text(encoding="utf-8"), flags=re.M)
    path.write_text(text, encoding="utf-8")
    for name in ("model.safetensors", "prior.safetensors", "calibration.json"):
        (tmp_path / name).touch()
    write_library(tmp_path)

    # Both characters have a meaning in a URL.
    names = ("HISTORY_PASSWORD", "MQTT_PASSWORD", "WEBHOOK_TOKEN", "MAIL_PASSWORD")
    config = load_watch_config(path, dict.fromkeys(names, "p@ss/word"))

    assert [source.kind for source in config.sources] == ["folder", "mqtt", "http", "live"]
    assert [channel.kind for channel in config.channels] == ["log", "webhook", "mqtt", "email"]
    assert config.history_url == "postgresql://swashtwin:p%40ss%2Fword@db.example/swashtwin"
    mqtt = config.sources[1]
    assert isinstance(mqtt, MqttSource)
    assert mqtt.port == 8883
    assert mqtt.password.reveal() == "p@ss/word"

    # A log or a traceback may print the configuration.
    assert "p@ss" not in repr(config)
    assert "p%40" not in repr(config)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ("piston = '200'", "severity_limits: piston: .*200"),
        ("pistn = '200 um'", "severity_limits: pistn: .*'pistn'"),
        ("piston = '0 um'", "must be above zero"),
        ("normal = '200 um'", "has no severity: use a kind of fault"),
    ],
)
def test_a_limit_of_a_severity_is_checked_when_the_file_is_read(
    write: Write, tmp_path: Path, limits: str, message: str
) -> None:
    (tmp_path / "a.json").write_text("{}", encoding="utf-8")
    machine = (
        f"[[machine]]\nname='p'\npistons=9\ncalibration='a.json'\nseverity_limits = {{{limits}}}"
    )
    with pytest.raises(SwashTwinError, match=message):
        load_watch_config(write(SMALL + machine), {})


@pytest.mark.parametrize(
    ("addition", "message"),
    [
        # the file as a whole, and slips of the pen in names of entries
        ("folder = ", "not valid TOML"),
        ('[library]\npath = "C:\\Users\\me"', "write / between folders"),
        ("[alarm]\n", "no entry 'alarm'; did you mean 'alarms'?"),
        (
            "[[machine]]\nname='p'\nsped='1 rpm'",
            "number 2: there is no entry 'sped'; did you mean 'speed'",
        ),
        ("[[machine]]\nname='p'\npressure='9 MPa'", r"did you mean 'discharge_pressure'\?$"),
        ("[[machine]]\nname='p'\nhost='h'", r"there is no entry 'host'\.$"),
        # a number without a unit could be rpm or rad/s
        ("[[machine]]\nname='p'\nspeed=1500", "must be text in quotes"),
        ("[[machine]]\nname='p'\nspeed='-3 rpm'", "must be above 0 rad/s"),
        # names: files of the history and rows of the page are called by them
        ("[[machine]]\nspeed='3 rpm'", "the entry 'name' is missing"),
        ("[[machine]]\nname='pump-1'", "2 of .* have the name 'pump-1'"),
        ("[[machine]]\nname='../up'", "write it as '_up'"),
        # entries that name something which must exist, or exclude each other
        ("[[machine]]\nname='p'\npump='nosuch'", "Unknown pump 'nosuch'"),
        ("[[machine]]\nname='p'\nmodel='m.safetensors'", "does not exist"),
        ("[[machine]]\nname='p'\nlibrary='m.safetensors'", "library: the file .* does not exist"),
        # the file of the configuration is one of another kind
        ("[[machine]]\nname='p'\nlibrary='watch.toml'", "library: .* is an index of recordings"),
        (
            "[[machine]]\nname='p'\nseverity_limits = {piston = '200 um'}",
            "severity_limits needs a calibration",
        ),
        ("[[machine]]\nname='p'\ncalibration='m.json'", "specify pump or pistons too"),
        ("[[machine]]\nname='p'\npump='25scy14-1b'\npistons=9", "specify only one of the two"),
        ("[[machine]]\nname='p'\nchannels=['x', 'x']", "contains a name twice"),
        # sources; a source without a name is called by its kind, so `folder` is taken
        ("[[source]]\nkind='ftp'", "the kinds of a source are folder, mqtt, http"),
        ("[[source]]\nkind='folder'\npath='b'", "2 of .* have the name 'folder'"),
        ("[[source]]\nkind='folder'\nname='b'\npath='b'\nmachine='pump-2'", "machines are pump-1"),
        ("[[source]]\nkind='mqtt'\nhost='h'\ntopic='t'\nport=99999", "65535"),
        (
            "[[source]]\nkind='live'\ndevice='d'\nmachine='pump-1'\ninterval='5 s'",
            "interval = 5 s is shorter than length = 10 s",
        ),
        # a configuration is sent to others and kept under version control, a password must not be
        ("[[source]]\nkind='mqtt'\nhost='h'\ntopic='t'\npassword='clear'", "is written out"),
        (
            "[[source]]\nkind='mqtt'\nhost='h'\ntopic='t'\npassword='${NO_SUCH}'",
            "variable NO_SUCH, which is not set",
        ),
        # values out of their limits, and pages that would be open to all
        ("[alarms]\nfalse_alarm_rate=2", "<= 0.5"),
        ("[page]\nhost='0.0.0.0'", "add users"),
        ("[page]\nhttps=1", "expected true or false"),
        ("[page]\nproxy='proxy.example'", "must be an IP address"),
        # one bracket or two
        ("[[alarms]]\n", "alarms: expected a table, got a list"),
        ("[channel]\nkind='log'\npassword='clear'", "channel: expected a list, got a table"),
    ],
)
def test_a_wrong_entry_is_reported_in_one_line_that_names_the_file(
    write: Write, addition: str, message: str
) -> None:
    with pytest.raises(SwashTwinError, match=message) as caught:
        load_watch_config(write(SMALL + addition), {})

    report = str(caught.value)
    assert "\n" not in report.strip()
    assert "watch.toml" in report
    # the password of two of the cases
    assert "clear" not in report


def test_a_password_in_the_url_of_the_database_is_refused_and_not_shown(write: Write) -> None:
    path = write('history = "postgresql://me:hunter2@db/x"\n' + SMALL)

    with pytest.raises(SwashTwinError, match="password is written out") as caught:
        load_watch_config(path, {})

    assert "hunter2" not in str(caught.value)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.8.9.1"])
def test_a_page_for_this_computer_alone_needs_no_users(write: Write, host: str) -> None:
    config = load_watch_config(write(f"{SMALL}[page]\nhost='{host}'"), {})
    assert config.page.host == host


def test_a_page_for_other_computers_is_accepted_with_users(write: Write, tmp_path: Path) -> None:
    # Without users it is refused: see the cases of wrong entries.
    config = load_watch_config(write(f"{SMALL}[page]\nhost='0.0.0.0'\nusers='u.json'"), {})
    assert config.page.users == tmp_path / "u.json"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param(
            "folder='a'\n[[source]]\nkind='http'", "add one with its name", id="no machine"
        ),
        pytest.param("folder='a'\n[[machine]]\nname='a'", r"no \[\[source\]\]", id="no source"),
    ],
)
def test_a_file_without_machines_or_sources_is_refused_with_what_to_add(
    write: Write, text: str, message: str
) -> None:
    with pytest.raises(SwashTwinError, match=message):
        load_watch_config(write(text), {})
