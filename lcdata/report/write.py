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
from lcdata.report import budget, compared, figures, tables, words
from lcdata.report.dependence import initial_errors, varies
from lcdata.report.gallery import Painter, worst_of_each
from lcdata.report.html import picture
from lcdata.report.page import Section, page
from lcdata.report.poses import poses_csv
from lcdata.report.shared_view import shares_in_view
from lcdata.report.showcase import Opener
from lcdata.report.theme import DARK, LIGHT

BUDGET, POSES, STARTS = "groundtruth-budget.png", "groundtruth.csv", "start.png"

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
        Path of index.html; tables (CSV, Markdown, LaTeX) and plots lie beside it.

    Raises:
        ReportError: There are no results to show.
    """
    results, notice = _current(dataset, recompute)
    return write_pages(dataset, results, Path(dataset.path) / REPORT, notice, progress, stored=True)


def write_pages(
    dataset: Dataset,
    results: Results,
    folder: Path,
    notice: str = "",
    progress: Progress | None = None,
    *,
    stored: bool = False,
) -> Path:
    """Make tables, plots and one HTML page of any trials on a data set.

    Args:
        dataset: The data set.
        results: One trial or more, against its present ground truth.
        folder: Where to.
        notice: What a reader must know first.
        progress: Called as parts are finished.
        stored: The trials are the data set's own results, where `lcdata review` finds them.

    Returns:
        Path of index.html.
    """
    runs = {run: list(trials) for run, trials in groupby(_hardest_first(results), lambda t: t.run)}
    total, done = sum(1 + len({t.method for t in trials}) for trials in runs.values()), 0

    def advance() -> None:
        nonlocal done
        done += 1
        if progress:
            progress("report", done, total)

    plots: dict[str, bytes] = {}
    sections = []
    shares = shares_in_view(dataset, sorted({p for t in results.trials for p in t.pair_ids}))
    opener = Opener.of(dataset, results.trials if stored else ())
    painter = Painter(dataset, worst_of_each(total - len(runs)))
    for run, trials in runs.items():
        spread = figures.distributions(trials)
        depends = figures.dependences(trials, shares)
        plots |= {f"{figure.kind}-{run}.png": figure.light for figure in (*spread, *depends)}
        advance()
        pictures = {}
        for method in dict.fromkeys(t.method for t in trials):
            pictures[method] = painter.exhibits([t for t in trials if t.method == method])
            advance()
        section = Section(
            trials=trials,
            summaries=[s for s in results.summaries if s.run == run],
            comparisons=[c for c in results.comparisons if c.run == run],
            plots=[figure.html for figure in spread],
            dependence=[figure.html for figure in depends],
            exhibits=pictures,
            version=dataset.info.groundtruth_version,
            shares=shares,
            opener=opener,
        )
        sections.append(section)
    return _write(dataset, results, folder, sections, plots, notice)


def _hardest_first(results: Results) -> list[TrialResult]:
    """Trials run by run, from the largest initial errors down."""
    return sorted(
        results.trials,
        key=lambda t: (
            math.isnan(t.init_rotation_deg),  # from guesses of one's own: last
            -np.nan_to_num(t.init_rotation_deg),
            -np.nan_to_num(t.init_translation_m),
            t.run,
        ),
    )


def _write(
    dataset: Dataset,
    results: Results,
    folder: Path,
    sections: Sequence[Section],
    plots: dict[str, bytes],
    notice: str,
) -> Path:
    """Put tables and page together, and write all files."""
    titles = {s.trials[0].run: words.run_title(s.trials) for s in sections}
    kind = "Simulated data" if dataset.info.simulated else "Recorded data"
    name = Path(dataset.path).resolve().name
    after = _starts(sections, plots)
    bars = ""
    if budget.known(dataset):
        plots[BUDGET] = budget.plot(dataset, LIGHT)
        alt = "Stacked bars: which source has which share of the variance, pose by pose"
        bars = picture(plots[BUDGET], budget.plot(dataset, DARK), alt)
    after += budget.section(dataset, bars)
    texts = {
        "results.csv": tables.trials_csv(results),
        "summary.csv": tables.summary_csv(results.summaries),
        "comparisons.csv": compared.table_csv(results.comparisons),
        "by_pose.csv": poses_csv(results.trials),
        "table.md": f"# {name} ({kind.lower()})\n\n"
        + tables.markdown(results.summaries, titles, compared.markdown(results.comparisons))
        + f"\n{budget.markdown(dataset)}",
        "table.tex": f"{tables.latex(results.summaries)}\n{compared.latex(results.comparisons)}\n"
        + budget.latex(dataset),
        "index.html": page(name, kind, words.data_set(dataset), sections, notice, after),
    }
    if BUDGET in plots:
        texts[POSES] = budget.poses_csv(dataset)
    drawn = (path for kind in figures.KINDS for path in folder.glob(f"{kind}-*.png"))
    for old in (*drawn, folder / STARTS, folder / BUDGET, folder / POSES):
        if old.name not in plots and old.name not in texts:
            old.unlink(missing_ok=True)
    for file, png in plots.items():
        write_bytes(folder / file, png)
    for file, text in texts.items():
        write_bytes(folder / file, text.encode())
    return folder / "index.html"


def _starts(sections: Sequence[Section], plots: dict[str, bytes]) -> str:
    """Section on errors over initial errors where several runs start from errors of their own."""
    trials = [t for section in sections for t in section.trials]
    if len(sections) < 2 or not varies(trials, initial_errors):
        return ""
    figure = figures.start_figure(trials, "All runs together. ")
    plots[STARTS] = figure.light
    return f"<section><h2>How far off a guess may be</h2>{figure.html}</section>"


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
