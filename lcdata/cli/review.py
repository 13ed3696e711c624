"""lcdata review."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from lcdata.cli.common import DatasetPath, JsonFlag, guarded, print_json, progress_bar
from lcdata.errors import ReportError

EXAMPLE = "lcdata review dataset"


@guarded
def review(
    dataset: DatasetPath,
    save: Annotated[
        Path | None, typer.Option("--save", help="Write this .rrd file, open no viewer.")
    ] = None,
    serve: Annotated[bool, typer.Option("--serve", help="Show it in a browser.")] = False,
    thin: Annotated[
        int | None,
        typer.Option(
            min=1, help="Keep every n-th LiDAR point; default: 8, of one pair up to 250000 points."
        ),
    ] = None,
    pair: Annotated[
        str | None,
        typer.Option(help="One pair only: coloured cloud, blended image, landscape of the NID."),
    ] = None,
    method: Annotated[
        str | None, typer.Option(help="With --pair: whose estimate; default: nid, or the first.")
    ] = None,
    reach_translation: Annotated[
        float | None,
        typer.Option(
            help="With --pair: half-width of the landscape in m; default: 0.2, at most 2."
        ),
    ] = None,
    reach_rotation: Annotated[
        float | None,
        typer.Option(help="With --pair: half-width in deg; default: 2, at most 45."),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Show data set and results in Rerun, on timelines `pair` and `stamp`; or one pair closely."""
    from lcdata.dataset import Dataset
    from lcdata.review import open_viewer, save_review
    from lcdata.review import serve as serve_review

    of_pair = {"method": method, "reach_m": reach_translation, "reach_deg": reach_rotation}
    given: dict[str, Any] = {name: value for name, value in of_pair.items() if value is not None}
    if given and pair is None:
        raise ReportError(
            "--method, --reach-translation and --reach-rotation are for one pair", "give --pair"
        )
    opened = Dataset.open(dataset)
    written = {}
    with progress_bar(quiet=as_json) as progress:
        if pair is None:
            path = save or opened.path / "review.rrd"
            save_review(opened, path, thin=thin or 8, progress=progress)
        else:
            from lcdata.review.one_pair import save_pair_review  # compiled kernels come with it

            path, figure = save_pair_review(
                opened, pair, save, thin=thin, progress=progress, **given
            )
            written["landscape"] = figure
    written["review"] = path
    if as_json:
        print_json(written)
    else:
        print(*(file for file in written.values() if file), sep="\n")
    if serve:
        serve_review(path)
    elif save is None and not as_json:
        open_viewer(path)
