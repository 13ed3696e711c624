"""lcdata review."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lcdata.cli.common import (
    DatasetPath,
    JsonFlag,
    end_with,
    guarded,
    names,
    print_json,
    progress_bar,
)
from lcdata.errors import ReportError

if TYPE_CHECKING:
    from lcdata.dataset import Dataset
    from lcdata.review.live import Options

EXAMPLE = "lcdata review dataset --worst 20 --method plk"

Names = list[str] | None


@guarded
def review(
    dataset: DatasetPath,
    save: Annotated[
        Path | None, typer.Option("--save", help="Write this .rrd file, open no viewer.")
    ] = None,
    serve: Annotated[bool, typer.Option("--serve", help="Show it in a browser.")] = False,
    live: Annotated[
        bool, typer.Option("--live", help="Show trials as they are stored, until Ctrl-C.")
    ] = False,
    worst: Annotated[
        int | None,
        typer.Option(
            min=1, help="Only so many pairs, the worst first; compared, where they differ."
        ),
    ] = None,
    scenario: Annotated[Names, typer.Option(help="Only these scenarios, with commas.")] = None,
    pose: Annotated[Names, typer.Option(help="Only these poses, with commas.")] = None,
    pair: Annotated[
        Names,
        typer.Option(
            help="Only these pairs. One alone is shown closely: coloured cloud, blended image, "
            "landscape of the NID."
        ),
    ] = None,
    method: Annotated[
        Names,
        typer.Option(help="Only these methods, with commas; of one pair: whose estimate to show."),
    ] = None,
    run: Annotated[
        str | None, typer.Option(help="Results to show; default: the run that was written last.")
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(help="Compare with this run, results file, or other method: A and B."),
    ] = None,
    ground_truth: Annotated[
        tuple[str, str] | None,
        typer.Option(
            "--ground-truth",
            metavar="A B",
            help="Compare two versions of the ground truth; `first` and `present` do as well.",
        ),
    ] = None,
    points: Annotated[
        int | None,
        typer.Option(
            min=1, help="Points of a cloud; default: up to 30000, fewer where pairs are many."
        ),
    ] = None,
    thin: Annotated[
        int | None, typer.Option(min=1, help="Keep every n-th LiDAR point instead.")
    ] = None,
    reach_translation: Annotated[
        float | None,
        typer.Option(
            help="With one --pair: half-width of the landscape in m; default: 0.2, at most 2."
        ),
    ] = None,
    reach_rotation: Annotated[
        float | None,
        typer.Option(help="With one --pair: half-width in deg; default: 2, at most 45."),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Show data set and results in Rerun, on timelines `pair` and `stamp`; or one pair closely."""
    from lcdata.dataset import Dataset
    from lcdata.review import Selection, Wanted, open_viewer
    from lcdata.review import serve as serve_review

    selection = Selection(
        scenarios=_listed(scenario),
        poses=_listed(pose),
        pairs=_listed(pair),
        methods=_listed(method),
        worst=worst,
    )
    wanted = Wanted(selection, run, compare, ground_truth)
    of_pair = {"reach_m": reach_translation, "reach_deg": reach_rotation}
    given: dict[str, Any] = {name: value for name, value in of_pair.items() if value is not None}
    others = (run, compare, ground_truth, points, worst)
    closely = len(selection.pairs) == 1 and not live and all(o is None for o in others)
    if given and not closely:
        raise ReportError(
            "--reach-translation and --reach-rotation are for one pair", "give one --pair alone"
        )
    opened = Dataset.open(dataset)
    if live:
        from lcdata.review.live import Options

        _live(opened, Options(wanted, points, thin), save, serve, as_json)
        return
    failures: tuple[str, ...] = ()
    with progress_bar(quiet=as_json) as progress:
        if closely:
            path, written = _one_pair(opened, selection, save, thin, progress, given)
        else:
            from lcdata.review import save_review

            path = save or opened.path / "review.rrd"
            done = save_review(
                opened, path, wanted=wanted, points=points, thin=thin, progress=progress
            )
            failures = done.failures
            written = {"review": path, "pairs": done.pairs, "notes": done.notes}
            written["failures"] = failures
    if as_json:
        print_json(written)
    else:
        for note in written.get("notes", ()):
            typer.echo(f"lcdata: note: {note}", err=True)
        print(*(written[name] for name in ("landscape", "review") if written.get(name)), sep="\n")
    if serve:
        serve_review(path)
    elif save is None and not as_json:
        open_viewer(path)
    end_with(failures)


def _listed(given: Names) -> tuple[str, ...]:
    return tuple(name for text in given or () for name in names(text))


def _one_pair(
    dataset: Dataset, selection: Any, save: Path | None, thin: int | None, progress: Any, given: Any
) -> tuple[Path, dict[str, Any]]:
    from lcdata.review.one_pair import save_pair_review  # compiled kernels come with it
    from lcdata.review.selection import select_pairs

    (record,) = select_pairs(dataset, selection).pairs
    if len(selection.methods) > 1:
        raise ReportError("one pair shows the estimate of one method", "give one --method")
    path, figure = save_pair_review(
        dataset,
        record.pair_id,
        save,
        thin=thin,
        method=selection.methods[0] if selection.methods else None,
        progress=progress,
        **given,
    )
    return path, {"landscape": figure, "review": path}


def _live(
    dataset: Dataset, options: Options, save: Path | None, serve: bool, as_json: bool
) -> None:
    """Follow until Ctrl-C, or the end of the viewer."""
    from lcdata.review.live import follow
    from lcdata.review.live_viewer import hosted, into_file

    def tell(text: str) -> None:
        typer.echo(f"lcdata: {text}", err=True)

    name = dataset.path.resolve().name
    where: Any
    if save is not None and not serve:
        where = nullcontext((into_file(name, save), lambda: False))
    else:
        where = hosted(name, save, in_browser=serve)
    with ended_by_signal(), where as (recorder, ended), progress_bar(quiet=as_json) as progress:
        trials = follow(dataset, options, recorder, ended=ended, tell=tell, progress=progress)
    if as_json:
        print_json({"review": save, "trials": trials})
    elif save is not None:
        print(save)


@contextmanager
def ended_by_signal() -> Iterator[None]:
    """End by `kill` as by Ctrl-C: what was written so far is kept."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
