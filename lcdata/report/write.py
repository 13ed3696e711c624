"""Write the report of a data set."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from lcdata.dataset import Dataset
from lcdata.dataset.atomic import write_bytes
from lcdata.dataset.schema import REPORT
from lcdata.errors import ReportError
from lcdata.evaluation.results import Results, TrialResult, read_results
from lcdata.report import budget, compared, tables, words
from lcdata.report.distributions import ecdf_plot, start_plot, start_varies
from lcdata.report.gallery import exhibits
from lcdata.report.page import Section, captioned, page, picture
from lcdata.report.plots import DARK, LIGHT, Theme, box_plots
from lcdata.report.poses import poses_csv

BUDGET, POSES, STARTS = "groundtruth-budget.png", "groundtruth.csv", "start.png"

Draw = Callable[[Sequence[TrialResult], Theme], bytes]

PLOTS: dict[str, tuple[Draw, str, str]] = {
    "errors": (
        box_plots,
        "Box plots of rotation and translation errors by scenario and method",
        "Each dot is a trial; boxes are quartiles, whiskers 1.5 times their distance. The band is "
        "the ground truth's own uncertainty: methods whose medians differ by less are not ranked, "
        "≈.",
    ),
    "ecdf": (
        ecdf_plot,
        "Share of trials below an error, by method",
        "Share of all trials whose error is below a value, failed ones included: a curve that "
        "ends below 1 is of a method that gave no estimate in the rest. The band is the ground "
        "truth's own uncertainty.",
    ),
    "start": (
        start_plot,
        "Errors over initial errors, by method",
        "Errors over the initial error; lines go through medians. A failed trial is at the upper "
        "edge.",
    ),
}
"""Of each run: how it is drawn, what stands for it where it cannot be seen, and its caption."""

Progress = Callable[[str, int, int], None]
"""Called with the name of the stage, the number of finished parts and of all parts."""


def write_report(
    dataset: Dataset, *, recompute: bool = False, progress: Progress | None = None
) -> Path:
    """Make tables, plots and one HTML page from the stored results of a data set, in its folder.

    Results against another ground truth than the data set's own are named and left out, or
    measured again.

    Args:
        dataset: The data set.
        recompute: Measure stale estimates against the present ground truth.
        progress: Called as parts are finished.

    Returns:
        Path of index.html; results.csv, table.md, table.tex and plots lie beside it.

    Raises:
        ReportError: There are no results to show.
    """
    results, notice = _current(dataset, recompute)
    return write_pages(dataset, results, Path(dataset.path) / REPORT, notice, progress)


def write_pages(
    dataset: Dataset,
    results: Results,
    folder: Path,
    notice: str = "",
    progress: Progress | None = None,
) -> Path:
    """Make tables, plots and one HTML page of any trials on a data set.

    Args:
        dataset: The data set.
        results: One trial or more, against its present ground truth.
        folder: Where to.
        notice: What a reader must know first.
        progress: Called as parts are finished.

    Returns:
        Path of index.html.
    """
    hardest_first = sorted(
        results.trials,
        key=lambda t: (
            math.isnan(t.init_rotation_deg),  # from guesses of one's own: last
            -np.nan_to_num(t.init_rotation_deg),
            -np.nan_to_num(t.init_translation_m),
            t.run,
        ),
    )
    runs = {run: list(trials) for run, trials in groupby(hardest_first, key=lambda t: t.run)}
    total, done = sum(1 + len({t.method for t in trials}) for trials in runs.values()), 0

    def advance() -> None:
        nonlocal done
        done += 1
        if progress:
            progress("report", done, total)

    plots: dict[str, bytes] = {}
    sections = []
    for run, trials in runs.items():
        shown = []
        for kind, (draw, alt, caption) in PLOTS.items():
            if kind == "start" and not start_varies(trials):
                continue
            plots[f"{kind}-{run}.png"] = light = draw(trials, LIGHT)
            shown.append(captioned(light, draw(trials, DARK), alt, caption))
        advance()
        pictures = {}
        for method in dict.fromkeys(t.method for t in trials):
            pictures[method] = exhibits(dataset, [t for t in trials if t.method == method])
            advance()
        summaries = [s for s in results.summaries if s.run == run]
        comparisons = [c for c in results.comparisons if c.run == run]
        version = dataset.info.groundtruth_version
        sections.append(Section(trials, summaries, comparisons, shown, pictures, version))

    titles = {run: words.run_title(trials) for run, trials in runs.items()}
    kind = "Simulated data" if dataset.info.simulated else "Recorded data"
    name = Path(dataset.path).resolve().name
    bars = ""
    if budget.known(dataset):
        plots[BUDGET] = budget.plot(dataset, LIGHT)
        alt = "Stacked bars: which source has which share of the variance, pose by pose"
        bars = picture(plots[BUDGET], budget.plot(dataset, DARK), alt)
    parts = budget.section(dataset, bars)
    html = page(name, kind, words.data_set(dataset), sections, notice, _starts(runs, plots) + parts)
    files = {
        "results.csv": tables.trials_csv(results),
        "comparisons.csv": compared.table_csv(results.comparisons),
        "by_pose.csv": poses_csv(results.trials),
        "table.md": f"# {name} ({kind.lower()})\n\n"
        + tables.markdown(results.summaries, titles, compared.markdown(results.comparisons))
        + f"\n{budget.markdown(dataset)}",
        "table.tex": f"{tables.latex(results.summaries)}\n{compared.latex(results.comparisons)}\n"
        + budget.latex(dataset),
        "index.html": html,
    }
    if BUDGET in plots:
        files[POSES] = budget.poses_csv(dataset)
    drawn = (path for kind in PLOTS for path in folder.glob(f"{kind}-*.png"))
    for old in (*drawn, folder / STARTS, folder / BUDGET, folder / POSES):
        if old.name not in plots and old.name not in files:
            old.unlink(missing_ok=True)
    for file, png in plots.items():
        write_bytes(folder / file, png)
    for file, text in files.items():
        write_bytes(folder / file, text.encode())
    return folder / "index.html"


def _starts(runs: dict[str, list[TrialResult]], plots: dict[str, bytes]) -> str:
    """Section on errors over initial errors where several runs start from errors of their own."""
    trials = [t for of_run in runs.values() for t in of_run]
    if len(runs) < 2 or not start_varies(trials):
        return ""
    draw, alt, caption = PLOTS["start"]
    plots[STARTS] = light = draw(trials, LIGHT)
    figure = captioned(light, draw(trials, DARK), alt, f"All runs together. {caption}")
    return f'<h2>How far off a guess may be</h2><figure class="plot">{figure}</figure>'


def _current(dataset: Dataset, recompute: bool) -> tuple[Results, str]:
    """Results against the present ground truth, and what a reader must know about others."""
    everything = read_results(dataset)
    if not everything.trials:
        raise ReportError(
            f"{dataset.path} has no results", "run `lcdata calibrate` on the data set first"
        )
    current, stale = everything.split_stale(dataset)
    if not stale.trials:
        return current, ""
    stale_text = words.count(len(stale.trials), "stored trial")
    if recompute:
        measured, lost = everything.recomputed(dataset).split_stale(dataset)
        notice = (
            f"{stale_text} came from an older ground truth; the estimates are as they were, their "
            "errors were measured again against the present one, so that initial errors differ "
            "from the protocol's."
        )
        if lost.trials:
            notice += f" {words.count(len(lost.trials), 'trial')} of poses that are gone: left out."
        return measured, notice
    if not current.trials:
        raise ReportError(
            f"all results in {dataset.path} are against an older ground truth",
            "`lcdata report --update-results` measures them again, `lcdata calibrate` runs again",
        )
    return current, (
        f"{stale_text} against an older ground truth are stale and left out; "
        "`lcdata report --update-results` measures them again."
    )
