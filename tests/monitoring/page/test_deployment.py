"""The files in deploy/ name commands, options and metrics that exist."""

import json
import re
import shlex
import tomllib
from pathlib import Path

from starlette.testclient import TestClient

ROOT = Path(__file__).parents[3]
DEPLOY = ROOT / "deploy"


def metric_names(text: str) -> set[str]:
    return set(re.findall(r"^(swashtwin_\w+)(?:\{|\s)", text, re.MULTILINE))


def published_ports(compose_file: str) -> list[str]:
    return re.findall(r"^ +ports: (.*)$", compose_file, re.MULTILINE)


def image_arguments(instruction: str, dockerfile: str) -> list[str]:
    """Return the list behind an instruction that begins its line."""
    return json.loads(re.search(rf"^{instruction} (\[.*\])$", dockerfile, re.MULTILINE)[1])


def is_command(arguments: list[str]) -> bool:
    """Return whether `swashtwin` has this command, with a file as last argument."""
    import typer

    from swashtwin.cli import app

    command = typer.main.get_command(app)
    for name in arguments[:-1]:
        if name not in getattr(command, "commands", {}):
            return False
        command = command.commands[name]
    return any(parameter.param_type_name == "argument" for parameter in command.params)


def dashboard_queries() -> list[str]:
    dashboard = json.loads((DEPLOY / "grafana.json").read_text())
    queries = []
    for panel in dashboard["panels"]:
        queries += [target["expr"] for target in panel["targets"]]
    for variable in dashboard["templating"]["list"]:
        if variable["type"] == "query":
            queries.append(variable["query"])
    return queries


def test_every_metric_of_the_dashboard_is_one_of_the_page(reader: TestClient) -> None:
    # A panel whose metric was renamed is empty, which nobody takes for an error.
    names = set(re.findall(r"swashtwin_\w+", "\n".join(dashboard_queries())))

    assert len(names) > 10
    assert names <= metric_names(reader.get("/metrics").text)


def test_the_unit_starts_an_existing_command_and_not_as_root() -> None:
    text = (DEPLOY / "swashtwin-watch.service").read_text()
    entries = dict(re.findall(r"^([^#=\n][^=\n]*)=(.*)$", text, re.MULTILINE))

    program, *arguments = shlex.split(entries["ExecStart"])
    assert program.endswith("/bin/swashtwin")
    assert is_command(arguments)

    assert entries["User"] == "swashtwin"
    assert entries["NoNewPrivileges"] == "yes"


def test_the_image_starts_an_existing_command_and_not_as_root() -> None:
    text = (DEPLOY / "Dockerfile").read_text()

    assert image_arguments("ENTRYPOINT", text) == ["swashtwin"]
    assert is_command(image_arguments("CMD", text))

    # A number, since Kubernetes refuses a user's name when it requires one that is not root.
    assert re.search(r"^USER 10001", text, re.MULTILINE)


def test_every_file_that_the_image_copies_exists() -> None:
    text = (DEPLOY / "Dockerfile").read_text()

    for source in re.findall(r"^COPY (.*) /\S+$", text, re.MULTILINE):
        assert all((ROOT / name).exists() for name in source.split())


def test_the_page_of_the_container_is_reached_from_its_computer_alone() -> None:
    text = (DEPLOY / "compose.yaml").read_text()

    # Without an address Docker opens the port to all, past the firewall of the host.
    assert published_ports(text) == ['["127.0.0.1:8642:8642"]']
    assert "cap_drop: [ALL]" in text


def test_the_page_behind_the_proxy_trusts_the_address_of_the_proxy() -> None:
    text = (DEPLOY / "compose.proxy.yaml").read_text()
    proxy = text[text.index("  proxy:") :]

    # The page uses X-Forwarded-For from this address only, which a user enters as in the guide.
    address = re.search(r"ipv4_address: ([\d.]+)", proxy)[1]
    guide = (ROOT / "docs" / "how-to" / "watch-page.md").read_text()
    assert f'proxy = "{address}"' in guide

    assert "./Caddyfile:/etc/caddy/Caddyfile" in proxy
    # The port of the page itself is not among them.
    assert published_ports(text) == ['["443:443"]']


def test_the_lock_file_pins_all_that_a_plant_needs_by_hash() -> None:
    text = (ROOT / "requirements-plant.txt").read_text()
    pins = re.findall(
        r"^([A-Za-z0-9._-]+)(?:\[\w+\])?==\S+ \\\n    --hash=sha256:[0-9a-f]{64}",
        text,
        re.MULTILINE,
    )
    entries = re.findall(r"^[^\s#]", text, re.MULTILINE)
    assert len(pins) == len(entries), "each entry must have a version and a hash"

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    requirements = list(project["dependencies"])
    for extra in ("monitor", "mqtt", "postgresql", "readers"):
        requirements += project["optional-dependencies"][extra]
    names = {normalized(re.match(r"[\w.-]+", line)[0]) for line in requirements}
    assert names <= {normalized(pin) for pin in pins}

    # A plant does not train.
    assert not {"torch", "numba"} & set(pins)
    # Packages come from the index alone, not from an address in the file.
    assert "://" not in text


def normalized(package: str) -> str:
    """Return the name of a package as the index compares it."""
    return package.lower().replace("_", "-")
