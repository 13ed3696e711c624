"""lcdata report."""

from __future__ import annotations

from lcdata.cli.common import DatasetPath, JsonFlag, guarded, print_json, progress_bar

EXAMPLE = "lcdata report dataset"


@guarded
def report(dataset: DatasetPath, as_json: JsonFlag = False) -> None:
    """Write tables, plots and one HTML page from stored results."""
    from lcdata.dataset import Dataset
    from lcdata.report import write_report

    with progress_bar(quiet=as_json) as progress:
        page = write_report(Dataset.open(dataset), progress=progress)
    if as_json:
        print_json({"report": page})
    else:
        print(page)
