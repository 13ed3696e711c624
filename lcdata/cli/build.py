"""lcdata build: the main job."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lcdata.cli.calibrate import (
    DEFAULT_METHODS,
    InitRotation,
    InitTranslation,
    Methods,
    Seed,
    Set,
    Trials,
)
from lcdata.cli.common import (
    Jobs,
    JsonFlag,
    counted,
    end_with,
    guarded,
    names,
    print_json,
    progress_bar,
)
from lcdata.errors import CalibrationError

EXAMPLE = "lcdata build recordings/ -o dataset"


@guarded
def build(
    recordings: Annotated[
        Path,
        typer.Argument(help="A bag or folder, or a folder of those.", show_default=False),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the data set.")] = Path(
        "dataset"
    ),
    rig: Annotated[
        Path | None, typer.Option(help="Rig file; default: rig.yaml in RECORDINGS or beside it.")
    ] = None,
    pairs_per_pose: Annotated[
        int | None, typer.Option(min=1, help="Pairs of each pose, spread evenly; default: all.")
    ] = None,
    methods: Methods = DEFAULT_METHODS,
    settings: Set = None,
    no_calibrate: Annotated[
        bool, typer.Option("--no-calibrate", help="Only package: no methods, report or review.")
    ] = False,
    init_rotation: InitRotation = 5.0,
    init_translation: InitTranslation = 0.5,
    trials: Trials = 1,
    seed: Seed = 0,
    jobs: Jobs = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace a data set of other recordings.")
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Make a data set with ground truth from recordings, run methods on it and show how they did.

    A build that was interrupted goes on where it stopped.
    """
    from lcdata.calibrators.settings import configured
    from lcdata.dataset import build as package

    # Before the packaging: a typing error must not cost it.
    chosen = configured(names(methods), settings or ())
    if not (chosen or no_calibrate):
        raise CalibrationError("no methods to run", "name one or more, or give --no-calibrate")
    with progress_bar(quiet=as_json) as progress:
        built = package(
            recordings,
            out,
            rig,
            pairs_per_pose=pairs_per_pose,
            force=force,
            progress=progress,
        )
        failures = list(built.failures)
        summary: dict[str, object] = {
            "dataset": out,
            "pairs": built.pairs,
            "poses": built.poses,
        }
        poses = counted(built.poses, "arm pose" if built.dataset.info.arm else "pose")
        lines = [f"{out}: {counted(built.pairs, 'pair')} at {poses}"]
        if not no_calibrate:
            from lcdata.evaluation import run_trials, summary_lines
            from lcdata.report import write_report
            from lcdata.review import save_review

            results = run_trials(
                built.dataset,
                chosen,
                init_rotation_deg=init_rotation,
                init_translation_m=init_translation,
                trials=trials,
                seed=seed,
                jobs=jobs,
                progress=progress,
            )
            page = write_report(built.dataset, progress=progress)
            review = out / "review.rrd"
            save_review(built.dataset, review, progress=progress)
            failures += results.failures
            summary |= {"results": results.to_dict(), "report": page, "review": review}
            lines += [*summary_lines(results), f"report: {page}", f"review: rerun {review}"]
    summary |= {"warnings": built.warnings, "failures": failures}
    if as_json:
        print_json(summary)
    else:
        print("\n".join(lines))
    for warning in built.warnings:
        typer.echo(f"lcdata: note: {warning}", err=True)
    end_with(failures)
