"""The command line. A command reads its options, calls the functions of the same name, and prints what came back.

With ``--json`` standard output holds exactly one JSON object; progress and errors go to standard error. Exit codes: 0
done, 1 a bug, 2 a wrong command line, 3 data or a value that cannot be used, 130 interrupted. Modules here import what
is heavy inside the commands, so that ``--help`` answers at once.
"""

from swashtwin.cli.app import app, main

__all__ = ["app", "main"]
