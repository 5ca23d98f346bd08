"""Commands as on Windows, as far as that can be tried elsewhere: run as a script with command lines
as arguments.

The package finds no module and no function that only POSIX has, and believes to run on Windows. A
file with a name that Windows refuses, or opened without its encoding, ends the script. There are no
symbolic links, and a file that this process has open can be neither removed nor replaced.
"""

import builtins
import os
import re
import shlex
import sys
import types
import warnings
from typing import Any

MODULES = {
    "crypt",
    "fcntl",
    "grp",
    "posix",
    "pty",
    "pwd",
    "resource",
    "syslog",
    "termios",
    "tty",
}
FUNCTIONS = {
    "os": "fork forkpty getuid geteuid getgid getegid getgroups getpgid setsid killpg kill wait3 wait4 WNOHANG "
    "nice uname sysconf sched_getaffinity sched_setaffinity statvfs fstatvfs mkfifo chown fchmod lchown getloadavg "
    "O_NONBLOCK O_CLOEXEC O_DIRECTORY O_NOFOLLOW O_SYNC pread pwrite posix_fadvise sendfile pipe2",
    "signal": "SIGKILL SIGHUP SIGALRM SIGUSR1 SIGCHLD alarm setitimer pause sigwait pthread_sigmask",
    "select": "poll epoll kqueue",
    "time": "tzset clock_gettime",
}


def _refuse_link(*arguments: object, **options: object) -> None:
    raise OSError("[WinError 1314] A required privilege is not held by the client")


REPLACED: dict[str, dict[str, object]] = {
    "os": {"name": "nt", "symlink": _refuse_link},
    "sys": {"platform": "win32"},
}
FORBIDDEN = re.compile(
    r'[<>:"|?*\x00-\x1f]|[. ]$|^(con|prn|aux|nul|com\d|lpt\d)(\.|$)', re.IGNORECASE
)


class _Module(types.ModuleType):
    """A module without what only POSIX has."""

    def __init__(self, name: str, real: types.ModuleType) -> None:
        super().__init__(name)
        self.__dict__["_real"] = real

    def __getattr__(self, name: str) -> Any:
        if name in FUNCTIONS.get(self.__name__, "").split():
            raise AttributeError(f"{self.__name__}.{name} is not there on Windows")
        return REPLACED.get(self.__name__, {}).get(name, getattr(self._real, name))


def _hide() -> None:
    real_import = builtins.__import__
    modules = {name: _Module(name, real_import(name)) for name in {*FUNCTIONS, *REPLACED}}

    def import_(name: str, globals: Any = None, *arguments: Any, **options: Any) -> Any:
        if (globals or {}).get("__name__", "").startswith("swashtwin"):
            if name.partition(".")[0] in MODULES:
                raise ImportError(f"{name} is not there on Windows")
            if name in modules:
                return modules[name]

        return real_import(name, globals, *arguments, **options)

    builtins.__import__ = import_


def _check_names(event: str, arguments: tuple[Any, ...]) -> None:
    if event not in ("open", "os.mkdir", "os.rename") or isinstance(arguments[0], int):
        return
    if event == "open" and not (isinstance(arguments[1], str) and set(arguments[1]) & set("wxa+")):
        return
    path = os.path.relpath(os.fsdecode(arguments[1 if event == "os.rename" else 0]))
    if not path.startswith("..") and any(
        FORBIDDEN.search(part) for part in path.split(os.sep) if part != "."
    ):
        raise RuntimeError(f"Windows takes no file {path!r}")


def _check_open_files(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuse to remove or replace a file that is open."""
    if event not in ("os.remove", "os.rename"):
        return
    paths = arguments[: 2 if event == "os.rename" else 1]
    open_files = [os.path.realpath(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd")]
    for path in paths:
        if os.path.realpath(os.fsdecode(path)) in open_files:
            raise PermissionError(13, "[WinError 32] The file is used by another process", path)


def main() -> None:
    """Run each argument as a command line of swashtwin, and end with the first exit code that is
    not 0.
    """
    warnings.filterwarnings("error", category=EncodingWarning, module="swashtwin")
    _hide()
    sys.addaudithook(_check_names)
    sys.addaudithook(_check_open_files)
    from typer.testing import CliRunner

    from swashtwin.cli import app
    from swashtwin.foundation import atomic_files

    if not atomic_files._IS_WINDOWS:
        raise RuntimeError("the platform was not hidden")
    for line in sys.argv[1:]:
        result = CliRunner().invoke(app, shlex.split(line))
        if result.exit_code:
            sys.exit(f"{line}\n{result.output}")


if __name__ == "__main__":
    main()
