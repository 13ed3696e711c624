"""lcdata reproduce."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lcdata.cli.common import Jobs, JsonFlag, guarded, print_json, progress_bar

if TYPE_CHECKING:
    from lcdata.reproduce import Outcome

WIDEST = 400
"""Characters of a table's line."""

EXAMPLE = "lcdata reproduce plk-table1 --runs 1000 --set lines=12"


@guarded
def reproduce(
    experiment: Annotated[
        str | None,
        typer.Argument(help="Name of the experiment; without one they are listed."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for what it gives.")] = Path(
        "reproduced"
    ),
    runs: Annotated[
        int | None, typer.Option(min=1, help="Runs or scenes a case; default: the experiment's.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", help="NAME=VALUE, an option of the experiment; may be repeated."),
    ] = None,
    jobs: Jobs = None,
    as_json: JsonFlag = False,
) -> None:
    """Run a paper's experiment again and print its figures beside ours."""
    from lcdata.reproduce import EXPERIMENTS, find
    from lcdata.reproduce.experiment import Settings, checked_options
    from lcdata.reproduce.store import write_outcome

    if experiment is None:
        for name in EXPERIMENTS:
            found = find(name)
            print(f"{name:<14} {found.summary} ({found.source})")
            for option, meaning in found.options.items():
                print(f"{'':<14}   --set {option}=…  {meaning}")
        return
    found = find(experiment)
    options = checked_options(found, setting or [])
    settings = Settings(runs=runs, seed=seed, jobs=jobs, folder=out, options=options)
    with progress_bar(quiet=as_json) as progress:
        outcome = found.run(settings, progress)
    files = write_outcome(outcome, out)
    if as_json:
        print_json({"experiment": outcome.name, "values": outcome.values, "files": files})
        return
    _show(outcome)
    print(f"\n{', '.join(map(str, files))}")


def _show(outcome: Outcome) -> None:
    """Print the tables, each line whole: a folded cell cannot be searched for."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=WIDEST, highlight=False)
    console.print(f"{outcome.source}\n\n{outcome.protocol}\n", soft_wrap=True, markup=False)
    for table in outcome.tables:
        shown = Table(*table.header, title=table.title, title_justify="left")
        for row in table.rows:
            shown.add_row(*row)
        console.print(shown)
        if table.note:
            console.print(table.note, soft_wrap=True, markup=False)
