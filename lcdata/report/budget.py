"""Where the ground truth's own uncertainty comes from: a table, a line a pose, stacked bars."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby

import numpy as np

from lcdata.dataset import Dataset
from lcdata.dataset.schema import PoseRecord
from lcdata.groundtruth.budget import SOURCES, TITLES, Variances, shares, variances
from lcdata.report.budget_bars import budget_bars
from lcdata.report.html import Cell, Group
from lcdata.report.html import table as table_of
from lcdata.report.tables import tex
from lcdata.report.theme import Theme

UNKNOWN = (
    "The data set does not say where it comes from: a link without standard deviations, or a "
    "build by an older version (`lcdata groundtruth` adds it)."
)
NOTE = (
    "Standard deviations (root mean square over the poses, 1 sigma) of the extrinsic's "
    "translation and rotation by source, and its share of the variance. Sources are independent, "
    "so that squares add up. Only encoders and clock differ from pose to pose: errors of joint "
    "offsets and of the two links are the same in the whole data set, and do not average out. "
    "The clock's part counts only what the arm moves within a dwell: next to nothing."
)

HEADER = ("Scenario", "Source", "Translation (mm)", "Share", "Rotation (deg)", "Share")


@dataclass(frozen=True)
class Row:
    """A source in one scenario.

    Args:
        scenario: Name of the scenario.
        source: One of `SOURCES`, or "total".
        poses: Number of poses.
        sigma: Mean variances over the poses.
        share: Part of the total.
    """

    scenario: str
    source: str
    poses: int
    sigma: Variances
    share: Variances

    @property
    def title(self) -> str:
        """What a reader calls the source."""
        return TITLES.get(self.source, "all")

    @property
    def cells(self) -> tuple[str, ...]:
        """A line of the table, in the order of `HEADER`."""
        translation, rotation = (f"{part:.1%}" for part in self.share)
        return self.scenario, self.title, self.millimetres, translation, self.degrees, rotation

    @property
    def millimetres(self) -> str:
        """Standard deviation of the translation."""
        return f"{1e3 * math.sqrt(self.sigma.translation):.2f}"

    @property
    def degrees(self) -> str:
        """Standard deviation of the rotation."""
        return f"{math.degrees(math.sqrt(self.sigma.rotation)):.3f}"


def known(dataset: Dataset) -> list[PoseRecord]:
    """Poses with pairs, of which it is known where the uncertainty comes from."""
    used = {pair.pose_id for pair in dataset.pairs}
    return [
        p
        for p in dataset.poses
        if p.pose_id in used and p.budget and np.isfinite(sum(p.budget.values())).all()
    ]


def table(dataset: Dataset) -> list[Row]:
    """Source by source in each scenario, then all of them."""
    poses, result = known(dataset), []
    for scenario in dict.fromkeys(p.scenario for p in poses):
        here = [p for p in poses if p.scenario == scenario]
        total = _mean([variances(p.T_camera_lidar, p.covariance) for p in here])
        for source in SOURCES:
            parts = [
                variances(p.T_camera_lidar, p.budget[source]) for p in here if source in p.budget
            ]
            if parts:
                mean = _mean(parts)
                share = Variances(*(_ratio(a, b) for a, b in zip(mean, total, strict=True)))
                result.append(Row(scenario, source, len(here), mean, share))
        result.append(Row(scenario, "total", len(here), total, Variances(1.0, 1.0)))
    return result


def _mean(parts: Sequence[Variances]) -> Variances:
    return Variances(*(float(v) for v in np.mean(parts, axis=0)))


def _ratio(part: float, total: float) -> float:
    return part / total if total else 0.0


def poses_csv(dataset: Dataset) -> str:
    """groundtruth.csv: one line a pose, standard deviations and shares by source."""
    out = io.StringIO()
    poses = known(dataset)
    sources = [s for s in SOURCES if any(s in p.budget for p in poses)]
    names = ["pose_id", "groundtruth_version", "pose_version"]
    for source in ("total", *sources):
        names += [f"{source}_mm", f"{source}_deg"]
    for source in sources:
        names += [f"{source}_translation_share", f"{source}_rotation_share"]
    writer = csv.DictWriter(out, names, lineterminator="\n")
    writer.writeheader()
    for pose in poses:
        writer.writerow(
            {name: getattr(pose, name) for name in names[:3]} | dict(_pose_values(pose))
        )
    return out.getvalue()


def _pose_values(pose: PoseRecord) -> Iterator[tuple[str, float]]:
    for source, part in {"total": pose.covariance, **pose.budget}.items():
        variance = variances(pose.T_camera_lidar, part)
        yield f"{source}_mm", 1e3 * math.sqrt(variance.translation)
        yield f"{source}_deg", math.degrees(math.sqrt(variance.rotation))
    for source, share in shares(pose.T_camera_lidar, pose.budget).items():
        yield f"{source}_translation_share", share.translation
        yield f"{source}_rotation_share", share.rotation


def plot(dataset: Dataset, theme: Theme) -> bytes:
    """PNG of stacked bars, one a pose: shares of both variances."""
    poses = known(dataset)
    parts = [shares(p.T_camera_lidar, p.budget) for p in poses]
    sources = [s for s in SOURCES if any(sum(part.get(s, ())) > 0 for part in parts)]
    nothing = Variances(0.0, 0.0)
    values = np.array([[part.get(s, nothing) for s in sources] for part in parts])
    scenarios = [p.scenario for p in poses]
    return budget_bars(values, [TITLES[s] for s in sources], scenarios, theme)


def markdown(dataset: Dataset) -> str:
    """Section of table.md."""
    version = dataset.info.groundtruth_version
    title = f"## Where the ground truth's uncertainty comes from (version {version})\n\n"
    if not (rows := table(dataset)):
        return f"{title}{UNKNOWN}\n"
    lines = [HEADER, ("---",) * 2 + ("---:",) * 4, *(r.cells for r in rows)]
    body = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
    return f"{title}{body}\n\n{NOTE}\n"


def latex(dataset: Dataset) -> str:
    """Section of table.tex: a booktabs table."""
    head = f"% the ground truth's own uncertainty, version {dataset.info.groundtruth_version}\n"
    if not (rows := table(dataset)):
        return f"{head}% {UNKNOWN}\n"
    groups = [
        "\n".join(_tex_line(row.cells) for row in here)
        for _, here in groupby(rows, key=lambda row: row.scenario)
    ]
    body = "\n\\midrule\n".join(groups)
    return (
        f"{head}\\begin{{tabular}}{{llrrrr}}\n\\toprule\n{_tex_line(HEADER)}\n\\midrule\n{body}\n"
        "\\bottomrule\n\\end{tabular}\n"
    )


def _tex_line(cells: Sequence[str]) -> str:
    return f"{' & '.join(map(tex, cells))} \\\\"


def section(dataset: Dataset, pictures: str) -> str:
    """Section of the page.

    Args:
        dataset: The data set.
        pictures: The plot as HTML.
    """
    version = dataset.info.groundtruth_version
    title = "<section><h2>Where the ground truth's own uncertainty comes from</h2>"
    if not (rows := table(dataset)):
        return f'{title}<p class="note">{escape(UNKNOWN)}</p></section>'
    groups = [
        Group(f"{escape(scenario)}<span>{here[0].poses} poses</span>", [_cells(r) for r in here])
        for scenario in dict.fromkeys(r.scenario for r in rows)
        if (here := [r for r in rows if r.scenario == scenario])
    ]
    head = ("Source", "Translation", "Share", "Rotation", "Share")
    return (
        f'{title}<p class="note">Version {escape(version)}. {escape(NOTE)}</p>'
        f'<figure class="plot">{pictures}</figure>'
        f"<details><summary>Source by source</summary>{table_of(head, groups)}</details></section>"
    )


def _cells(row: Row) -> list[Cell]:
    """A line of the page's table."""
    return [
        Cell(escape(row.title)),
        Cell(f"{row.millimetres} mm", row.sigma.translation),
        Cell(f"{row.share.translation:.1%}", row.share.translation),
        Cell(f"{row.degrees}°", row.sigma.rotation),
        Cell(f"{row.share.rotation:.1%}", row.share.rotation),
    ]
