"""lcdata report."""

from __future__ import annotations

from typing import Annotated

import typer

from lcdata.cli.common import DatasetPath, JsonFlag, guarded, print_json, progress_bar

EXAMPLE = "lcdata report dataset"


@guarded
def report(
    dataset: DatasetPath,
    update_results: Annotated[
        bool,
        typer.Option(
            "--update-results", help="First measure stale estimates against the present truth."
        ),
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Write tables, plots and one HTML page from stored results."""
    from lcdata.dataset import Dataset
    from lcdata.evaluation import update_results as update
    from lcdata.report import write_report

    opened = Dataset.open(dataset)
    if update_results:
        update(opened)
    with progress_bar(quiet=as_json) as progress:
        page = write_report(opened, progress=progress)
    if as_json:
        print_json({"report": page})
    else:
        print(page)
