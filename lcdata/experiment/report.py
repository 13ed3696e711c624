"""The report of an experiment: for each data set the one that `lcdata report` writes."""

from __future__ import annotations

from pathlib import Path

from lcdata.errors import ExperimentError
from lcdata.experiment.checksums import Checksums
from lcdata.experiment.plan import Plan, counted
from lcdata.experiment.spec import Experiment
from lcdata.experiment.store import Store


def write_reports(experiment: Experiment, folder: Path) -> list[Path]:
    """Write tables, plots and a page for each data set, from the trials that are in the store.

    Args:
        experiment: The experiment.
        folder: Each data set gets a folder in it, by its name.

    Returns:
        Paths of the pages.

    Raises:
        ExperimentError: No trial has been computed.
        DatasetError: The folder cannot be written.
    """
    from lcdata.report.write import write_pages

    store = Store.open(experiment.store)
    plan = Plan.of(experiment, Checksums.read(store.folder))
    done = store.keys()
    pages = []
    for name, results in plan.results(store.read(plan.wanted)).items():
        if not results.trials:
            continue
        trials, made, _ = counted((t for t in plan.trials if t.dataset == name), done)
        notice = f"Experiment {experiment.path.name}."
        if made < trials:
            notice += f" {trials - made} of {trials} trials have not been run yet."
        pages.append(write_pages(plan.datasets[name], results, folder / name, notice))
    if not pages:
        raise ExperimentError(
            f"{experiment.path}: no trial has been computed yet",
            f"lcdata experiment run {experiment.path}",
        )
    return pages
