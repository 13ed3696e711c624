"""lcdata calibrate."""

from __future__ import annotations

from typing import Annotated

import typer

from lcdata.cli.common import (
    DatasetPath,
    Jobs,
    JsonFlag,
    Scheduler,
    counted,
    end_with,
    guarded,
    names,
    on_scheduler,
    print_json,
    progress_bar,
)

EXAMPLE = "lcdata calibrate dataset --methods projection,plk --trials 3"

Methods = Annotated[str, typer.Option(help="Method names, with commas.")]
InitRotation = Annotated[
    float, typer.Option(min=0, help="Error of the initial guess about each axis, deg.")
]
InitTranslation = Annotated[
    float, typer.Option(min=0, help="Error of the initial guess along each axis, m.")
]
Trials = Annotated[int, typer.Option(min=1, help="Initial guesses a pair.")]
Seed = Annotated[int, typer.Option(min=0, help="Same seed, same initial guesses.")]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="A method's parameter, METHOD.NAME=VALUE: nid.rounds=3, crlf.masks=FOLDER."
    ),
]
DEFAULT_METHODS = "projection,plk,cascade"


@guarded
def calibrate(
    dataset: DatasetPath,
    methods: Methods = DEFAULT_METHODS,
    settings: Set = None,
    init_rotation: InitRotation = 5.0,
    init_translation: InitTranslation = 0.5,
    init: Annotated[
        str,
        typer.Option(
            help="Where to start: the ground truth with that error (truth), a guess from the pair "
            "alone (auto), picks (`lcdata pick`), a CSV of matches u,v,x,y,z, calib.json or "
            "BAG_matches.json of direct_visual_lidar_calibration, or from nothing (none) with "
            "methods that can (crlf with masks)."
        ),
    ] = "truth",
    route: Annotated[str, typer.Option(help="Of --init auto: auto, edges or matching.")] = "auto",
    matcher: Annotated[
        str,
        typer.Option(help="Of --init auto: classical, or learned (needs the extra of that name)."),
    ] = "classical",
    rotate_camera: Annotated[
        int, typer.Option(help="Of --init auto: turn images before matching, 0, 90, 180, 270 deg.")
    ] = 0,
    rotate_lidar: Annotated[
        int, typer.Option(help="The same of the LiDAR's intensity images.")
    ] = 0,
    trials: Trials = 1,
    seed: Seed = 0,
    joint: Annotated[
        bool, typer.Option("--joint", help="Solve all pairs of an arm pose together.")
    ] = False,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    force: Annotated[bool, typer.Option("--force", help="Compute stored results again.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Run methods from perturbed initial guesses, given ones or none, and store the results."""
    from lcdata.calibrators.settings import configured
    from lcdata.dataset import Dataset
    from lcdata.errors import CalibrationError
    from lcdata.evaluation import run_trials, summary_lines
    from lcdata.evaluation.automatic import automatic_guesses, source_of
    from lcdata.evaluation.given import given_guesses

    chosen = configured(names(methods), settings or ())
    executor = on_scheduler(scheduler, jobs)
    opened = Dataset.open(dataset)
    source, initial = "", None
    group = "pose" if joint else "pair"
    how: dict[str, object] = {
        "route": route,
        "matcher": matcher,
        "rotate_camera": rotate_camera,
        "rotate_lidar": rotate_lidar,
    }
    if init != "auto" and (unused := source_of(how).removeprefix("auto")):
        raise CalibrationError(
            f"--init {init} does not match images ({unused[1:]})", "use it with --init auto"
        )
    if init == "auto":
        with progress_bar(quiet=as_json) as progress:
            found = automatic_guesses(
                opened, group=group, jobs=jobs, force=force, options=how, progress=progress
            )
        source, initial = found.source, found.initial
        for note in found.notes:
            typer.echo(f"lcdata: note: {note}", err=True)
    elif init not in ("truth", "none"):
        source, initial = given_guesses(
            opened, init, lambda words: typer.echo(f"lcdata: note: {words}", err=True)
        )
    given = {pair.pair_id for pair in opened.pairs} if initial is None else initial.keys()
    if left_out := len({pair.pair_id for pair in opened.pairs} - given):
        pairs = counted(left_out, "pair")
        typer.echo(f"lcdata: note: {pairs} without an initial guess left out", err=True)
    with progress_bar(quiet=as_json) as progress:
        results = run_trials(
            opened,
            chosen,
            init_rotation_deg=init_rotation,
            init_translation_m=init_translation,
            initial=initial,
            source=source,
            from_nothing=init == "none",
            trials=trials if init == "truth" else 1,
            seed=seed,
            group=group,
            jobs=jobs,
            executor=executor,
            force=force,
            progress=progress,
        )
    if as_json:
        print_json(results.to_dict())
    else:
        print("\n".join(summary_lines(results)))
    end_with(results.failures)
