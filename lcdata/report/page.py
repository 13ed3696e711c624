"""index.html: one page that needs no network and no other file."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from lcdata.evaluation.comparison import Comparison
from lcdata.evaluation.metrics import ALL_SCENARIOS, Quartiles, Summary, is_explained
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.text import MISSING, not_ranked, number, rate_interval_text
from lcdata.report import compared, words
from lcdata.report.gallery import PICTURES, Exhibit
from lcdata.report.plots import DARK, LIGHT
from lcdata.report.poses import pose_table
from lcdata.report.style import STYLE
from lcdata.report.tables import (
    by_scenario,
    converged_text,
    error_text,
    interval_text,
    percent,
)

COLUMNS = (
    "Method",
    "Trials",
    "Success",
    "Explained",
    "Rotation",
    "Translation",
    "Sigma distance",
    "Converged",
    "Degenerate",
    "Seconds",
)


@dataclass(frozen=True)
class Section:
    """What the page shows of one run.

    Args:
        trials: Its trials.
        summaries: Their summaries.
        comparisons: Their methods two by two.
        plots: Pictures, HTML, each with its caption.
        exhibits: Trials with pictures, by method.
        version: Of the ground truth.
    """

    trials: Sequence[TrialResult]
    summaries: Sequence[Summary]
    comparisons: Sequence[Comparison]
    plots: Sequence[str]
    exhibits: dict[str, list[Exhibit]]
    version: str

    @property
    def overall(self) -> list[Summary]:
        """One summary a method, over everything."""
        whole = [s for s in self.summaries if s.scenario == ALL_SCENARIOS]
        return whole or list(self.summaries)

    @property
    def methods(self) -> list[str]:
        """Methods in the order of their colours."""
        return list(dict.fromkeys(t.method for t in self.trials))


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
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
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
<footer>Written by lcdata from the stored results. results.csv beside this page has every trial,
table.md and table.tex the tables, comparisons.csv the methods two by two, by_pose.csv each pose,
groundtruth.csv (where it is known) what each pose's ground truth owes its uncertainty to.</footer>
</main>
</body>
</html>
"""


def _section(section: Section) -> str:
    plots = "".join(f'<figure class="plot">{plot}</figure>' for plot in section.plots)
    return f"""
<section>
<h2>{escape(words.run_title(section.trials))}</h2>
<p class="note">{escape(words.protocol(section.trials, section.version))}</p>
<div class="cards">{"".join(_card(section, row) for row in section.overall)}</div>
{_table(section)}
{plots}
{compared.html(section.comparisons, lambda method: _dot(section, method))}
{pose_table(section.trials, lambda method: _dot(section, method))}
{_gallery(section)}
{_failures(section)}
</section>
"""


def _scenarios(section: Section) -> list[Summary]:
    return [s for s in section.summaries if s.scenario != ALL_SCENARIOS]


def _dot(section: Section, method: str) -> str:
    index = section.methods.index(method)
    return f'<i class="dot" style="--c:{LIGHT.method(index)};--d:{DARK.method(index)}"></i>'


def _card(section: Section, row: Summary) -> str:
    sigma = "no ground-truth uncertainty known"
    if math.isfinite(row.sigma_distance):
        sigma = (
            f"{row.sigma_distance:.1f} sigma of the ground truth; "
            f"{percent(row.explained_rate)} may be exact"
        )
    failed = f', <em class="bad">{row.failed} failed</em>' if row.failed else ""
    return (
        f'<div class="card"><span class="name">{_dot(section, row.method)}{escape(row.method)}'
        f"</span><b>{percent(row.success_rate)}</b>"
        f"<span>of {words.count(row.trials, 'trial')} within 0.5° and 0.1 m{failed}</span>"
        f"<span>median {error_text(row.rotation_deg.median)}° and "
        f"{error_text(row.translation_m.median)} m</span><span>{sigma}</span></div>"
    )


def _table(section: Section) -> str:
    groups = []
    for rows in by_scenario(section.summaries):
        title = "All scenarios" if rows[0].scenario == ALL_SCENARIOS else rows[0].scenario
        truth = words.uncertainty(rows)
        groups.append(
            f'<tr class="scenario"><td colspan="{len(COLUMNS)}">{escape(title)}'
            f"<span>ground truth: {escape(truth)}</span></td></tr>"
        )
        groups += [_table_row(section, row, rows) for row in rows]
    head = "".join(f"<th>{column}</th>" for column in COLUMNS)
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(groups)}</tbody></table></div>"
        '<p class="note">Success: 95 % interval in small. Errors: median, its 95 % interval in '
        "brackets, and 25 % to 75 % in small. Bold: better than every other method of the "
        "scenario, by the paired comparison. ≈ not ranked.</p>"
    )


def _table_row(section: Section, row: Summary, rows: Sequence[Summary]) -> str:
    failed = f' <small class="bad">{row.failed} failed</small>' if row.failed else ""
    cells = [
        f"{_dot(section, row.method)}{escape(row.method)}",
        f"{row.trials}{failed}",
        f"{percent(row.success_rate)} "
        f"<small>{rate_interval_text(row.success_interval).removesuffix(' %')}</small>",
        percent(row.explained_rate),
        _error(section, row, rows, "rotation_deg", "°"),
        _error(section, row, rows, "translation_m", " m"),
        number(row.sigma_distance, 1),
        converged_text(row),
        str(row.degenerate),
        number(row.seconds, 2),
    ]
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _error(
    section: Section, row: Summary, rows: Sequence[Summary], quantity: str, unit: str
) -> str:
    q: Quartiles = getattr(row, quantity)
    if not math.isfinite(q.q1):
        return MISSING
    middle = f"{error_text(q.median)}{unit if math.isfinite(q.median) else ''}"
    tied = not_ranked(row, rows, quantity)
    if tied:
        why = f"not ranked against {words.listing(tied)}: the ground truth cannot tell them apart"
        middle = f'<abbr title="{escape(why)}">≈</abbr> {middle}'
    elif _best(section, row, quantity) == len(rows) - 1 > 0:
        middle = f'<span class="best">{middle}</span>'
    interval = interval_text(getattr(row, f"{quantity}_interval"))
    small = [part for part in (interval, f"{error_text(q.q1)}–{error_text(q.q3)}") if part]
    return "".join([middle, *(f"<br><small>{part}</small>" for part in small)])


def _best(section: Section, row: Summary, quantity: str) -> int:
    """How many other methods of the scenario one is better than."""
    return sum(
        c.better == row.method and (c.scenario, c.quantity) == (row.scenario, quantity)
        for c in section.comparisons
    )


def captioned(light: bytes, dark: bytes, alt: str, caption: str) -> str:
    """A plot and what it shows."""
    return f'{picture(light, dark, alt)}<figcaption class="note">{escape(caption)}</figcaption>'


def picture(light: bytes, dark: bytes, alt: str) -> str:
    """A plot that follows the page's theme, PNG files in the page itself."""
    return (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{_data(dark, "png")}">'
        f'<img src="{_data(light, "png")}" alt="{escape(alt)}"></picture>'
    )


def _gallery(section: Section) -> str:
    parts = [
        "<h3>Points on the image</h3>"
        '<p class="note">The LiDAR points at the initial guess, at the estimate and at the ground '
        'truth, coloured by depth: near<span class="scale"></span>far.</p>'
    ]
    for method, exhibits in section.exhibits.items():
        parts.append(f"<h3>{_dot(section, method)}{escape(method)}</h3>")
        parts += [_exhibit(exhibit) for exhibit in exhibits]
    return "".join(parts)


def _exhibit(exhibit: Exhibit) -> str:
    t = exhibit.trial
    where = f"{escape(t.pose_id)}, {words.count(len(t.pair_ids), 'pair')} jointly"
    if len(t.pair_ids) == 1:
        where = escape(t.pair_ids[0])
    says = "; ".join(
        text
        for text, is_so in (
            ("not converged", not t.converged and not t.failed),
            ("degenerate", t.degenerate),
            ("cost grew", t.diverged),
            (t.message, bool(t.message)),
        )
        if is_so
    )
    verdict = '<span class="bad">miss</span>'
    if t.success:
        verdict = '<span class="good">success</span>'
    elif is_explained(t):
        verdict = "no success, but the ground truth's own uncertainty explains it"
    sigma = f", {t.sigma_distance:.1f} sigma" if math.isfinite(t.sigma_distance) else ""
    errors = f"{number(t.rotation_error_deg, 3)}° and {number(t.translation_error_m, 3)} m{sigma}"
    captions = {
        "Initial guess": f"{number(t.initial_rotation_error_deg, 2)}° and "
        f"{number(t.initial_translation_error_m, 3)} m off",
        "Estimate": f"{errors} off",
        "Ground truth": "",
    }
    figures = "".join(
        _picture(name, captions[name], exhibit.pictures.get(name))
        for name in PICTURES
        if name != PICTURES[0] or t.T_camera_lidar_initial is not None
    )
    return (
        f'<p class="trial"><b>{exhibit.rank}</b> <code>{where}</code>, trial {t.trial}: '
        f"{'no estimate' if t.failed else errors}, {verdict}"
        f'<span class="muted">{escape(f" ({says})") if says else ""}</span></p>'
        f'<div class="row">{figures}</div>'
    )


def _picture(name: str, caption: str, jpeg: bytes | None) -> str:
    if jpeg is None:
        return f'<figure><div class="none">no picture</div><figcaption>{name}</figcaption></figure>'
    text = f"{name}, {caption}" if caption else name
    return (
        f'<figure><label title="enlarge"><input type="checkbox"><img loading="lazy" '
        f'src="{_data(jpeg, "jpeg")}" alt="LiDAR points on the image: {escape(name.lower())}">'
        f"</label><figcaption>{escape(text)}</figcaption></figure>"
    )


def _failures(section: Section) -> str:
    failed = [f"{t.name}: {t.message}" for t in section.trials if t.failed]
    if not failed:
        return ""
    return f"<h3>Trials without an estimate</h3>{_list(failed)}"


def _list(items: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>"


def _data(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
