"""Commands that ask whether the methods work: the demo, the virtual rig, fillers, and every study."""

from collections.abc import Callable, Mapping

import typer

from swashtwin_bench.cli import calibrating, paper, plans, questions, results, rig, watch_demo

BENCH: Mapping[str, Callable[..., None]] = {
    "rig": rig.rig,
    "augment": rig.augment,
    "paper": paper.paper,
    **{name: plans.plan_command(name) for name in plans.STUDIES},
    "alarms": questions.alarms,
    "calibration": questions.calibration,
    "confidence": questions.confidence,
    "public": questions.public,
    "run-to-failure": questions.run_to_failure,
    "severity": questions.severity,
    "wrong-twins": calibrating.wrong_twins,
    "zero-shot": questions.zero_shot,
    "report": results.report,
}
"""Commands of ``swashtwin bench``."""


def add_commands(app: typer.Typer) -> None:
    """Add ``demo``, ``bench ...`` and ``watch demo`` to the commands of swashtwin."""
    app.command("demo", rich_help_panel="Commands")(rig.demo)
    bench = typer.Typer(no_args_is_help=True, help="Ask whether the methods work: virtual rig, fillers, studies.")
    for name, function in BENCH.items():
        bench.command(name)(function)
    app.add_typer(bench, name="bench", rich_help_panel="More commands")
    watch = next(group.typer_instance for group in app.registered_groups if group.name == "watch")
    if watch is not None:
        watch.command("demo")(watch_demo.demo)
