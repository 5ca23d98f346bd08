"""Commands that test the methods: the demo, the virtual rig and the studies."""

import typer

from swashtwin_bench.cli import rig, studies, watch_demo


def add_commands(app: typer.Typer) -> None:
    """Add ``demo``, ``bench ...`` and ``watch demo`` to the commands of swashtwin."""
    app.command("demo", rich_help_panel="Commands")(rig.demo)

    bench = typer.Typer(
        no_args_is_help=True, help="Test the methods on a virtual rig and on public data sets."
    )
    bench.command()(rig.rig)
    bench.command()(studies.study)
    app.add_typer(bench, name="bench", rich_help_panel="More commands")

    # The group is missing if the extra for monitoring is not installed.
    watch = next(group.typer_instance for group in app.registered_groups if group.name == "watch")
    if watch is not None:
        watch.command("demo")(watch_demo.demo)
