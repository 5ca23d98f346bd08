"""The command line: a command reads options, calls a public function, and prints its result.

With ``--json`` standard output holds exactly one JSON object; progress and errors go to standard
error. Exit codes: 0 success, 1 a bug, 2 invalid command line, 3 invalid data or value, 4 no
verdict, 5 too few data, 130 interrupted. Modules here import heavy packages inside the commands, so
that ``--help`` answers at once. Other distributions add commands to it: see
`application.add_installed_commands`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
