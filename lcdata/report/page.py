"""index.html: one page that needs no network and no other file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape

from lcdata.evaluation.comparison import Comparison
from lcdata.evaluation.metrics import ALL_SCENARIOS, Summary
from lcdata.evaluation.results import TrialResult
from lcdata.report import compared, failures, words
from lcdata.report.gallery import Exhibit
from lcdata.report.poses import pose_table
from lcdata.report.script import SCRIPT
from lcdata.report.showcase import Opener, showcase
from lcdata.report.style import STYLE
from lcdata.report.summary_table import summary_table
from lcdata.report.tables import error_text, percent
from lcdata.report.theme import DARK, LIGHT

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""The browser itself keeps the page from asking the network for anything."""

FILES = (
    ("results.csv", "every trial"),
    ("summary.csv", "the main table's numbers"),
    ("comparisons.csv", "methods two by two"),
    ("by_pose.csv", "each pose"),
    ("table.md", "all tables as Markdown"),
    ("table.tex", "as LaTeX (booktabs)"),
)
"""Beside the page."""


@dataclass(frozen=True)
class Section:
    """What the page shows of one run.

    Args:
        trials: Its trials.
        summaries: Their summaries.
        comparisons: Their methods two by two.
        plots: Figures, HTML: one that goes before the table, those that follow it.
        dependence: Figures on what errors depend on, HTML.
        exhibits: Trials with pictures, by method.
        version: Of the ground truth.
        shares: Share of the cloud in view, by pair.
        opener: Of trials, in Rerun.
    """

    trials: Sequence[TrialResult]
    summaries: Sequence[Summary]
    comparisons: Sequence[Comparison]
    plots: Sequence[str]
    dependence: Sequence[str]
    exhibits: dict[str, list[Exhibit]]
    version: str
    shares: Mapping[str, float]
    opener: Opener

    @property
    def overall(self) -> list[Summary]:
        """One summary a method, over everything."""
        whole = [s for s in self.summaries if s.scenario == ALL_SCENARIOS]
        return whole or list(self.summaries)

    @cached_property
    def methods(self) -> list[str]:
        """Methods in the order of their colours."""
        return list(dict.fromkeys(t.method for t in self.trials))

    def dot(self, method: str) -> str:
        """Coloured mark of a method."""
        index = self.methods.index(method)
        return f'<i class="dot" style="--c:{LIGHT.method(index)};--d:{DARK.method(index)}"></i>'


def page(
    name: str,
    kind: str,
    description: str,
    sections: Sequence[Section],
    notice: str,
    after: str = "",
) -> str:
    """The page.

    Args:
        name: Name of the data set.
        kind: What the data are, over the headline: simulated or recorded.
        description: What the data set is.
        sections: One a run, the most telling first.
        notice: What a reader must know first, stale results say; empty for nothing.
        after: Sections that follow those of the runs, HTML.
    """
    first = sections[0]
    notices = [notice, words.blunt_truth(_scenarios(first))]
    warning = "".join(f'<p class="warning">{escape(text)}</p>' for text in notices if text)
    body = "".join(_section(section) for section in sections)
    files = ", ".join(f'<a href="{file}">{file}</a> ({what})' for file, what in FILES)
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<title>{escape(name)}: calibration report</title>
<style>{STYLE}</style>
</head>
<body>
<main>
<header>
<div class="kind">{escape(kind)} · {escape(name)}</div>
<h1>{escape(words.headline(first.overall)).replace(" %", "&nbsp;%")}</h1>
<p>{escape(description)} {escape(words.own_uncertainty(_scenarios(first)))}</p>
{warning}
</header>
{body}
{after}
<h2>How to read this</h2>
<p>{escape(words.READING)}</p>
<footer>Written by lcdata from the stored results. Beside this page: {files}, and, where it is
known, groundtruth.csv (what each pose's ground truth owes its uncertainty to).</footer>
</main>
<script>{SCRIPT}</script>
</body>
</html>
"""


def _section(section: Section) -> str:
    depends = ""
    if section.dependence:
        depends = f"<h3>What the error depends on</h3>{''.join(section.dependence)}"
    return f"""
<section>
<h2>{escape(words.run_title(section.trials))}</h2>
<p class="note">{escape(words.protocol(section.trials, section.version))}</p>
<div class="cards">{"".join(_card(section, row) for row in section.overall)}</div>
{section.plots[0]}
{summary_table(section.summaries, section.comparisons, section.dot)}
{"".join(section.plots[1:])}
{pose_table(section.trials, section.dot, section.shares)}
{depends}
{compared.html(section.comparisons, section.dot)}
{showcase(section.exhibits, section.dot, section.opener)}
{failures.section(section.trials, section.dot)}
</section>
"""


def _scenarios(section: Section) -> list[Summary]:
    return [s for s in section.summaries if s.scenario != ALL_SCENARIOS]


def _card(section: Section, row: Summary) -> str:
    sigma = "no ground-truth uncertainty known"
    if math.isfinite(row.sigma_distance):
        sigma = (
            f"{row.sigma_distance:.1f} sigma of the ground truth; "
            f"{percent(row.explained_rate)} may be exact"
        )
    failed = f', <em class="bad">{row.failed} failed</em>' if row.failed else ""
    return (
        f'<div class="card"><span class="name">{section.dot(row.method)}{escape(row.method)}'
        f"</span><b>{percent(row.success_rate)}</b>"
        f"<span>of {words.count(row.trials, 'trial')} within 0.5° and 0.1 m{failed}</span>"
        f"<span>median {error_text(row.rotation_deg.median)}° and "
        f"{error_text(row.translation_m.median)} m</span><span>{sigma}</span></div>"
    )
