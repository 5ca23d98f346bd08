"""The command line. A command reads its options, calls the functions of the same name, and prints
what came back.

With ``--json`` standard output holds exactly one JSON object; progress and errors go to standard
error. Exit codes: 0 done, 1 a bug, 2 a wrong command line, 3 data or a value that cannot be used,
130 interrupted. Modules here import what is heavy inside the commands, so that ``--help`` answers
at once. Other distributions add commands to it: see `application.add_installed_commands`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
