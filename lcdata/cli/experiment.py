"""lcdata experiment: many trials by one file, each computed once."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from lcdata.cli.common import (
    Jobs,
    JsonFlag,
    Scheduler,
    end_with,
    guarded,
    on_scheduler,
    print_json,
    progress_bar,
)

EXAMPLES = {
    "run": "lcdata experiment run basin.yaml --jobs 4",
    "status": "lcdata experiment status basin.yaml",
    "report": "lcdata experiment report basin.yaml -o basin-report",
}

File = Annotated[Path, typer.Argument(help="Experiment file (YAML).", show_default=False)]

app = typer.Typer(
    name="experiment",
    help="Data sets, methods, sweeps and initial guesses in one file; a trial is computed once.",
    no_args_is_help=True,
    add_completion=False,
)


@app.command(epilog=f"Example:  {EXAMPLES['run']}")
@guarded
def run(
    file: File,
    jobs: Jobs = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Run trials again that gave no estimate.")
    ] = False,
    scheduler: Scheduler = None,
    as_json: JsonFlag = False,
) -> None:
    """Compute the trials that are missing, and print how the methods do."""
    from lcdata.evaluation import summary_lines
    from lcdata.evaluation.results import Results
    from lcdata.experiment import load_experiment, run_experiment

    experiment = load_experiment(file)
    executor = on_scheduler(scheduler, jobs)
    with progress_bar(quiet=as_json) as progress:
        found = run_experiment(
            experiment,
            jobs=jobs,
            executor=executor,
            retry_failed=retry_failed,
            progress=progress,
        )
    if as_json:
        print_json({name: results.to_dict() for name, results in found.items()})
    else:
        for name, results in found.items():
            for protocol in dict.fromkeys(t.run for t in results.trials):
                print(f"{name}, {protocol}")
                of_run = Results(tuple(t for t in results.trials if t.run == protocol))
                print("\n".join(f"  {line}" for line in summary_lines(of_run)))
    end_with([f"{name}: {text}" for name, r in found.items() for text in r.failures])


@app.command(epilog=f"Example:  {EXAMPLES['status']}")
@guarded
def status(file: File, as_json: JsonFlag = False) -> None:
    """Say how many trials have been computed."""
    from lcdata.experiment import load_experiment
    from lcdata.experiment import status as read_status

    experiment = load_experiment(file)
    rows = read_status(experiment)
    if as_json:
        print_json({"store": experiment.store, "methods": [dataclasses.asdict(r) for r in rows]})
        return
    width = max(len(f"{row.dataset} {row.method}") for row in rows)
    for row in rows:
        failed = f", {row.failed} failed" if row.failed else ""
        print(f"{f'{row.dataset} {row.method}':<{width}}  {row.done}/{row.trials} done{failed}")


@app.command(epilog=f"Example:  {EXAMPLES['report']}")
@guarded
def report(
    file: File,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder; default: the file's name with -report."),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Write tables, plots and a page for each data set from the trials that are there."""
    from lcdata.experiment import load_experiment, write_reports

    experiment = load_experiment(file)
    folder = out or file.with_name(f"{file.stem}-report")
    pages = write_reports(experiment, folder)
    if as_json:
        print_json({"reports": pages})
    else:
        print("\n".join(map(str, pages)))
