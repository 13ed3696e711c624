"""The `lcdata` application, put together from one file a command."""

from __future__ import annotations

from typing import Annotated

import typer

from lcdata.cli import (
    arm,
    build,
    calibrate,
    experiment,
    groundtruth,
    handeye,
    import_,
    info,
    pick,
    report,
    reproduce,
    review,
    simulate,
    validate,
)

app = typer.Typer(
    name="lcdata",
    help="LiDAR-camera calibration data sets with ground truth from a robot arm.",
    epilog="Every command has --help with an example. Exit codes: 0 done, 1 error, 2 wrong usage, "
    "3 finished but some items failed.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from lcdata import __version__

        print(f"lcdata {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error (after any command).")
    ] = False,
) -> None:
    """Options that stand before a command."""


COMMANDS = (
    build,
    info,
    simulate,
    calibrate,
    groundtruth,
    handeye,
    report,
    review,
    pick,
    reproduce,
    validate,
)
for module in COMMANDS:
    name = module.__name__.rpartition(".")[2]
    app.command(name, epilog=f"Example:  {module.EXAMPLE}")(getattr(module, name))
app.add_typer(import_.app)
app.add_typer(arm.app)
app.add_typer(experiment.app)
