"""Writing an FMU: a zip archive with the model description, the C sources and their binary."""

import hashlib
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

from swashtwin.foundation import InputError, SwashTwinError, atomic_write
from swashtwin.physics.fmu.c_numbers import require_exportable, write_numbers
from swashtwin.physics.fmu.model_description import (
    DESCRIPTION,
    Variable,
    describe_model,
    fmu_variables,
)
from swashtwin.physics.twin.model import Twin

COMPILE_TIMEOUT_S = 300.0
"""Time after which a compiler is given up; it takes about two seconds."""

_OPTIONS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden")

# Functions have their plain names in a shared library.
_DEFINITIONS = ("-DFMI2_OVERRIDE_FUNCTION_PREFIX",)

# Folder and suffix of binaries in an FMU, by the system: FMI 2.0 names those of x86 only.
_PLATFORMS = {
    "linux": ("linux64", ".so"),
    "darwin": ("darwin64", ".dylib"),
    "win32": ("win64", ".dll"),
}
_MACHINES = ("x86_64", "AMD64")

# Date of all members: two exports of the same twin are equal.
_DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class FMU:
    """What an exported FMU holds."""

    path: Path
    identifier: str
    """Model identifier, the name of its binary."""
    guid: str
    platform: str | None
    """Folder of its binary, such as ``"linux64"``; None if it holds sources only."""
    variables: tuple[Variable, ...]
    """Inputs and outputs."""


def export_fmu(twin: Twin, path: Path | str, *, sources_only: bool = False) -> FMU:
    """Write a twin as an FMU for co-simulation (FMI 2.0); return what it holds.

    The FMU simulates in C, without Python: its inputs are the speed, the discharge pressure and the
    severity of the fault, and they start at those of the twin. Its sources are in it, so that it
    can be built for another platform. An existing file is replaced.

    Parameters
    ----------
    sources_only : leave out the binary, so that no compiler is needed; the tool that reads the FMU
        must then compile it.

    Raises
    ------
    InputError
        The twin cannot run at its operating point, its fault is not one of swashtwin, or there is
        no C compiler.
    SwashTwinError
        The twin's equations do not converge, or the compiler fails.
    """
    path = Path(path)
    require_exportable(twin)
    command = None if sources_only else _find_compiler()
    twin.acceleration()  # which refuses a pump that cannot run

    sources = _read_sources()
    identifier = _identifier(twin)
    guid = _guid(twin, identifier, sources)
    header, numbers = write_numbers(twin, identifier, guid)
    sources |= {"pump_numbers.h": header.encode(), "pump_numbers.c": numbers.encode()}
    source_names = sorted(name for name in sources if name.endswith(".c"))
    description = describe_model(twin, identifier, guid, source_names)

    members = {
        "modelDescription.xml": ElementTree.tostring(
            description, encoding="utf-8", xml_declaration=True
        ),
        "documentation/index.html": _document(twin).encode(),
    }
    members |= {f"sources/{name}": content for name, content in sorted(sources.items())}
    folder = None
    if command is not None:
        folder, suffix = _PLATFORMS[sys.platform]
        members[f"binaries/{folder}/{identifier}{suffix}"] = _compile(command, sources)

    with atomic_write(path) as temporary:
        _write_archive(temporary, members)
    variables = tuple(variable for variable in fmu_variables(twin) if variable is not None)
    return FMU(path, identifier, guid, folder, variables)


def _find_compiler() -> list[str]:
    """Return the command of the C compiler: the variable CC, or cc."""
    if sys.platform not in _PLATFORMS or platform.machine() not in _MACHINES:
        raise InputError(
            f"FMI 2.0 has no place for a binary of {sys.platform} on {platform.machine()}.",
            field="sources_only",
            remedy="Write an FMU without one, with {sources_only}.",
        )

    text = os.environ.get("CC", "").strip() or "cc"
    if shutil.which(text) is not None:
        return [text]  # also a path with blanks or backslashes

    # CC may hold options too, such as "gcc -m64"
    command: list[str] = []
    with suppress(ValueError):  # a quote that does not end
        command = shlex.split(text)
    if not command or shutil.which(command[0]) is None:
        raise InputError(
            f"No C compiler: {text!r} is not on the PATH.",
            field="sources_only",
            remedy="Install one, name it in the environment variable CC, or write an FMU of "
            "sources with {sources_only}.",
        )
    return command


def _compile(command: list[str], sources: dict[str, bytes]) -> bytes:
    """Return the shared library of C sources."""
    with tempfile.TemporaryDirectory(prefix="swashtwin-fmu-") as folder:
        for name, content in sources.items():
            (Path(folder) / name).write_bytes(content)

        binary = Path(folder) / "binary"
        c_files = sorted(name for name in sources if name.endswith(".c"))
        arguments = [*command, *_OPTIONS, *_DEFINITIONS, "-o", binary.name, *c_files, "-lm"]
        try:
            finished = subprocess.run(
                arguments,
                cwd=folder,
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
                timeout=COMPILE_TIMEOUT_S,
            )
        except (OSError, subprocess.TimeoutExpired) as cause:
            raise _compile_error(command, str(cause)) from cause

        if finished.returncode or not binary.is_file():
            lines = [line for line in finished.stderr.splitlines() if "error" in line.lower()]
            reasons = lines or [f"exit code {finished.returncode}"]
            raise _compile_error(command, reasons[0])
        return binary.read_bytes()


def _compile_error(command: list[str], reason: str) -> SwashTwinError:
    return SwashTwinError(
        f"The C compiler {command[0]!r} failed: {reason.strip().rstrip('.')[:300]}.",
        field="sources_only",
        remedy="Name another one in the environment variable CC, or write an FMU of sources with "
        "{sources_only}.",
    )


def _read_sources() -> dict[str, bytes]:
    """Return the C files that all FMUs share, by name."""
    folder = files("swashtwin.physics.fmu") / "sources"
    return {
        file.name: file.read_bytes()
        for file in sorted(folder.iterdir(), key=lambda file: file.name)
        if file.name.endswith((".c", ".h"))
    }


def _identifier(twin: Twin) -> str:
    """Return a C identifier that tells FMUs of different pumps and faults apart."""
    fault = "healthy" if twin.fault is None else type(twin.fault).__name__
    name = re.sub(r"\W", "_", f"pump_{twin.pump.name}_{fault}", flags=re.ASCII)
    return name[:100]


def _guid(twin: Twin, identifier: str, sources: dict[str, bytes]) -> str:
    """Return an identifier of all that the FMU holds, which the binary checks."""
    digest = hashlib.sha256()
    for text in write_numbers(twin, identifier, ""):
        digest.update(text.encode())
    for content in sources.values():
        digest.update(content)
    return digest.hexdigest()[:32]


def _document(twin: Twin) -> str:
    """Return the page of documentation in the FMU."""
    from html import escape

    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(twin.pump.name)}</title></head><body>\n"
        f"<h1>{escape(repr(twin).strip('<>'))}</h1>\n<p>{escape(DESCRIPTION)}</p>\n"
        "<p>The folder sources holds the C99 code: compile all of its .c files to a shared library "
        "with FMI2_OVERRIDE_FUNCTION_PREFIX defined, for another platform.</p>\n"
        "</body></html>\n"
    )


def _write_archive(path: Path, members: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            member = zipfile.ZipInfo(name, _DATE)
            member.compress_type = zipfile.ZIP_DEFLATED
            # A regular file that its owner may write and all may read, and run if it is a binary.
            member.external_attr = (0o100755 if name.startswith("binaries/") else 0o100644) << 16
            archive.writestr(member, content)
