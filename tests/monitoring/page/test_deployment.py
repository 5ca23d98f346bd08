"""The files in deploy/ name commands, options and metrics that there are."""

import json
import re
import shlex
import tomllib
from pathlib import Path

from starlette.testclient import TestClient

DEPLOY = Path(__file__).parents[3] / "deploy"
UNIT, DOCKERFILE, DASHBOARD = (
    DEPLOY / name for name in ("swashtwin-watch.service", "Dockerfile", "grafana.json")
)


def _metric_names(text: str) -> set[str]:
    return set(re.findall(r"^(swashtwin_\w+)(?:\{|\s)", text, re.MULTILINE))


def _is_command(words: list[str]) -> bool:
    """Whether `swashtwin` knows these words, the last of which is a file."""
    import typer

    from swashtwin.cli import app

    command = typer.main.get_command(app)
    for word in words[:-1]:
        if word not in getattr(command, "commands", {}):
            return False
        command = command.commands[word]
    return any(parameter.param_type_name == "argument" for parameter in command.params)


def test_every_metric_of_the_dashboard_is_one_of_the_page(reader: TestClient) -> None:
    dashboard = json.loads(DASHBOARD.read_text())
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    queries += [
        variable["query"]
        for variable in dashboard["templating"]["list"]
        if variable["type"] == "query"
    ]
    names = {name for query in queries for name in re.findall(r"swashtwin_\w+", query)}
    assert len(names) > 10
    assert names <= _metric_names(reader.get("/metrics").text)


def test_the_unit_starts_a_command_that_there_is_and_is_no_root() -> None:
    unit = dict(
        line.split("=", 1)
        for line in UNIT.read_text().splitlines()
        if "=" in line and line[0] != "#"
    )
    program, *words = shlex.split(unit["ExecStart"])
    assert program.endswith("/bin/swashtwin")
    assert _is_command(words)
    assert unit["User"] == "swashtwin"
    assert unit["NoNewPrivileges"] == "yes"


def test_the_image_starts_a_command_that_there_is_and_is_no_root() -> None:
    text = DOCKERFILE.read_text()
    command = json.loads(re.search(r"^CMD (\[.*\])$", text, re.MULTILINE)[1])
    assert json.loads(re.search(r"^ENTRYPOINT (\[.*\])$", text, re.MULTILINE)[1]) == ["swashtwin"]
    assert _is_command(command)
    assert re.search(r"^USER 10001", text, re.MULTILINE)
    for source in re.findall(r"^COPY (.*) /\S+$", text, re.MULTILINE):
        assert all((DEPLOY.parent / name).exists() for name in source.split())


def test_the_page_of_the_container_is_reached_from_its_computer_alone() -> None:
    text = (DEPLOY / "compose.yaml").read_text()
    assert re.findall(r"^ +ports: (.*)$", text, re.MULTILINE) == ['["127.0.0.1:8642:8642"]']
    assert "cap_drop: [ALL]" in text


def test_the_page_behind_the_proxy_believes_the_address_of_the_proxy() -> None:
    text = (DEPLOY / "compose.proxy.yaml").read_text()
    proxy = text[text.index("  proxy:") :]
    address = re.search(r"ipv4_address: ([\d.]+)", proxy)[1]
    guide = (DEPLOY.parent / "docs" / "how-to" / "watch-page.md").read_text()
    assert f'proxy = "{address}"' in guide
    assert "./Caddyfile:/etc/caddy/Caddyfile" in proxy
    assert re.findall(r"^ +ports: (.*)$", text, re.MULTILINE) == ['["443:443"]']


def test_the_lock_file_pins_all_that_a_plant_needs_by_hash() -> None:
    """``pip-compile`` with the options that the file's first lines state makes it again."""
    text = (DEPLOY.parent / "requirements-plant.txt").read_text()
    pins = re.findall(
        r"^([A-Za-z0-9._-]+)(?:\[\w+\])?==\S+ \\\n    --hash=sha256:[0-9a-f]{64}",
        text,
        re.MULTILINE,
    )
    assert len(pins) == len(re.findall(r"^[^\s#]", text, re.MULTILINE))
    project = tomllib.loads((DEPLOY.parent / "pyproject.toml").read_text())["project"]
    extras = (
        project["optional-dependencies"][name]
        for name in ("monitor", "mqtt", "postgresql", "readers")
    )
    stated = [line for lines in (project["dependencies"], *extras) for line in lines]
    names = {re.match(r"[\w.-]+", line)[0].lower().replace("_", "-") for line in stated}
    assert names <= {pin.lower().replace("_", "-") for pin in pins}
    assert not {"torch", "numba"} & set(pins)
    assert "://" not in text
