"""The configuration of a watch: what it says, and how it says what is wrong."""

from pathlib import Path

import pytest

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


@pytest.fixture
def write(tmp_path: Path):
    def written(text: str) -> Path:
        path = tmp_path / "watch.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


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
    lines = path.read_text(encoding="utf-8").splitlines()
    entries = [
        line[2:] if line.startswith("# ") and ("=" in line or "[[" in line) else line
        for line in lines
    ]
    path.write_text("\n".join(entries), encoding="utf-8")
    for name in ("model.safetensors", "prior.safetensors", "calibration.json"):
        (tmp_path / name).touch()
    names = ("HISTORY_PASSWORD", "MQTT_PASSWORD", "WEBHOOK_TOKEN", "MAIL_PASSWORD")
    config = load_watch_config(path, dict.fromkeys(names, "p@ss/word"))
    assert [source.kind for source in config.sources] == ["folder", "mqtt", "http"]
    assert [channel.kind for channel in config.channels] == ["log", "webhook", "mqtt", "email"]
    assert config.history_url == "postgresql://swashtwin:p%40ss%2Fword@db.example/swashtwin"
    assert "p@ss" not in repr(config)
    assert "p%40" not in repr(config)
    mqtt = config.sources[1]
    assert isinstance(mqtt, MqttSource)
    assert (mqtt.port, mqtt.password.reveal()) == (8883, "p@ss/word")


@pytest.mark.parametrize(
    ("addition", "message"),
    [
        ("folder = ", "not valid TOML"),
        ("[alarm]\n", "no entry 'alarm'; did you mean 'alarms'?"),
        (
            "[[machine]]\nname='p'\nsped='1 rpm'",
            "number 2: there is no entry 'sped'; did you mean 'speed'",
        ),
        ("[[machine]]\nname='p'\nspeed=1500", "must be text in quotes"),
        ("[[machine]]\nname='p'\nspeed='-3 rpm'", "must be above 0 rad/s"),
        ("[[machine]]\nspeed='3 rpm'", "missing required field `name`"),
        ("[[machine]]\nname='pump-1'", "2 of .* have the name 'pump-1'"),
        ("[[machine]]\nname='../up'", "write it as '_up'"),
        ("[[machine]]\nname='p'\npump='nosuch'", "Unknown pump 'nosuch'"),
        ("[[machine]]\nname='p'\nmodel='m.safetensors'", "does not exist"),
        ("[[machine]]\nname='p'\ncalibration='m.json'", "specify pump or pistons too"),
        ("[[machine]]\nname='p'\npump='25scy14-1b'\npistons=9", "specify only one of the two"),
        ("[[machine]]\nname='p'\nchannels=['x', 'x']", "contains a name twice"),
        ("[[source]]\nkind='ftp'", "the kinds of a source are folder, mqtt, http"),
        ("[[source]]\nkind='folder'\npath='b'", "2 of .* have the name 'folder'"),
        ("[[source]]\nkind='folder'\nname='b'\npath='b'\nmachine='pump-2'", "machines are pump-1"),
        ("[[source]]\nkind='mqtt'\nhost='h'\ntopic='t'\npassword='clear'", "is written out"),
        (
            "[[source]]\nkind='mqtt'\nhost='h'\ntopic='t'\npassword='${NO_SUCH}'",
            "variable NO_SUCH, which is not set",
        ),
        ("[[source]]\nkind='mqtt'\nhost='h'\ntopic='t'\nport=99999", "65535"),
        ("[alarms]\nfalse_alarm_rate=2", "<= 0.5"),
        ("[page]\nhost='0.0.0.0'", "add users"),
        ("[page]\nhttps=1", "expected true or false"),
        ("[page]\nproxy='proxy.example'", "must be an IP address"),
        ("[[alarms]]\n", "alarms: expected a table, got a list"),
        ("[channel]\nkind='log'\npassword='clear'", "channel: expected a list, got a table"),
    ],
)
def test_a_wrong_entry_is_named_in_one_line(write, addition: str, message: str) -> None:
    with pytest.raises(SwashTwinError, match=message) as caught:
        load_watch_config(write(SMALL + addition), {})
    assert "\n" not in str(caught.value).strip()
    assert "watch.toml" in str(caught.value)
    assert "clear" not in str(caught.value)


def test_a_password_in_the_url_of_the_database_is_refused_and_not_shown(write) -> None:
    with pytest.raises(SwashTwinError, match="password is written out") as caught:
        load_watch_config(write('history = "postgresql://me:hunter2@db/x"\n' + SMALL), {})
    assert "hunter2" not in str(caught.value)


def test_beyond_loopback_users_are_needed(write, tmp_path: Path) -> None:
    for host in ("127.0.0.1", "localhost", "::1", "127.8.9.1"):
        assert load_watch_config(write(f"{SMALL}[page]\nhost='{host}'"), {}).page.host == host
    config = load_watch_config(write(f"{SMALL}[page]\nhost='0.0.0.0'\nusers='u.json'"), {})
    assert config.page.users == tmp_path / "u.json"


def test_a_file_without_machines_or_sources_says_what_to_add(write) -> None:
    with pytest.raises(SwashTwinError, match=r"add one with its name"):
        load_watch_config(write("folder='a'\n[[source]]\nkind='http'"), {})
    with pytest.raises(SwashTwinError, match=r"no \[\[source\]\]"):
        load_watch_config(write("folder='a'\n[[machine]]\nname='a'"), {})
