"""Commands that ask whether the methods work: the demo, the virtual rig, and every study."""

import typer

from swashtwin_bench.cli import rig, studies, watch_demo


def add_commands(app: typer.Typer) -> None:
    """Add ``demo``, ``bench ...`` and ``watch demo`` to the commands of swashtwin."""
    app.command("demo", rich_help_panel="Commands")(rig.demo)
    bench = typer.Typer(
        no_args_is_help=True, help="Ask whether the methods work: virtual rig, studies."
    )
    for function in (rig.rig, studies.study):
        bench.command()(function)
    app.add_typer(bench, name="bench", rich_help_panel="More commands")
    watch = next(group.typer_instance for group in app.registered_groups if group.name == "watch")
    if watch is not None:
        watch.command("demo")(watch_demo.demo)
