"""lcdata review."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lcdata.cli.common import DatasetPath, JsonFlag, guarded, print_json, progress_bar

EXAMPLE = "lcdata review dataset"


@guarded
def review(
    dataset: DatasetPath,
    save: Annotated[
        Path | None, typer.Option("--save", help="Write this .rrd file, open no viewer.")
    ] = None,
    serve: Annotated[bool, typer.Option("--serve", help="Show it in a browser.")] = False,
    thin: Annotated[int, typer.Option(min=1, help="Keep every n-th LiDAR point.")] = 8,
    as_json: JsonFlag = False,
) -> None:
    """Show data set and results in Rerun, on timelines `pair` and `stamp`."""
    from lcdata.dataset import Dataset
    from lcdata.review import open_viewer, save_review
    from lcdata.review import serve as serve_review

    opened = Dataset.open(dataset)
    path = save or opened.path / "review.rrd"
    with progress_bar(quiet=as_json) as progress:
        save_review(opened, path, thin=thin, progress=progress)
    if as_json:
        print_json({"review": path})
    else:
        print(path)
    if serve:
        serve_review(path)
    elif save is None and not as_json:
        open_viewer(path)
