"""Pictured trials as part of the page, each with the command that opens it in Rerun."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

from lcdata.dataset import Dataset
from lcdata.evaluation.metrics import is_explained
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.text import number
from lcdata.report import words
from lcdata.report.gallery import ESTIMATE, INITIAL, PICTURES, TRUTH, Exhibit
from lcdata.report.html import command, data, size

Dot = Callable[[str], str]
"""Coloured mark of a method, HTML."""


@dataclass(frozen=True)
class Opener:
    """Knows the command that opens a trial in Rerun.

    Args:
        dataset: Path of the data set, as it was given.
        last: By pair and method the last written run that has trials of them; empty where the
            trials are not among the data set's own results.
        first: By run, pair and method the number of the trial that is shown, the first one.
    """

    dataset: str
    last: dict[tuple[str, str], str]
    first: dict[tuple[str, str, str], int]

    @classmethod
    def of(cls, dataset: Dataset, trials: Sequence[TrialResult]) -> Opener:
        """From trials that are among the data set's own results."""
        written = sorted(dataset.result_files(), key=lambda path: path.stat().st_mtime_ns)
        rank = {path.stem: -place for place, path in enumerate(written)}
        last: dict[tuple[str, str], str] = {}
        first: dict[tuple[str, str, str], int] = {}
        for t in sorted(trials, key=lambda t: (rank.get(t.run, 1), t.trial)):
            for pair_id in t.pair_ids:
                last.setdefault((pair_id, t.method), t.run)
                first.setdefault((t.run, pair_id, t.method), t.trial)
        return cls(str(dataset.path), last, first)

    def __call__(self, trial: TrialResult) -> list[str]:
        """Words of the command."""
        pair_id = trial.pair_ids[0]
        words = ["lcdata", "review", self.dataset, "--pair", pair_id]
        if self.last:
            words += ["--method", trial.method]
            if self.last[pair_id, trial.method] != trial.run:
                words += ["--run", trial.run]
        return words

    def differs(self, trial: TrialResult) -> str:
        """What the command shows if that is not the trial itself; empty if it is."""
        if not self.last:
            return "shows the pair at its ground truth: the trials of an experiment are not in it"
        shown = self.first[trial.run, trial.pair_ids[0], trial.method]
        return "" if shown == trial.trial else f"shows trial {shown} on this pair"

    def worst(self, method: str, run: str, count: int) -> list[str]:
        """Words of the command that opens a method's worst pairs in one recording."""
        if not self.last:
            return []
        chosen = ["--worst", str(count), "--method", method, "--run", run]
        return ["lcdata", "review", self.dataset, *chosen]


def showcase(exhibits: dict[str, list[Exhibit]], dot: Dot, opener: Opener) -> str:
    """Section of the page on one run.

    Args:
        exhibits: By method.
        dot: Mark of a method.
        opener: The commands.
    """
    parts = [
        '<h3>LiDAR edges on the image</h3><p class="note">Borders and creases of the cloud (all '
        "its points, where it has hardly any), drawn where the initial guess, the estimate and "
        'the ground truth put them, coloured by depth: near<span class="scale"></span>far. '
        "Worst: of each pair its worst trial with an estimate, by the larger of the two errors in "
        "units of its limit of success. Click a picture to enlarge it. Commands open the pair, or "
        "a method's worst ones together, in Rerun, from the folder where this page was written.</p>"
    ]
    for method, shown in exhibits.items():
        heading = f"<h4>{dot(method)}{escape(method)}</h4>"
        worst = sum(exhibit.rank.startswith("worst") for exhibit in shown)
        together = opener.worst(method, shown[0].trial.run, worst) if worst > 1 else []
        parts.append(f'<div class="method">{heading}{command(together) if together else ""}</div>')
        parts += [_exhibit(exhibit, opener) for exhibit in shown]
    return "".join(parts)


def _exhibit(exhibit: Exhibit, opener: Opener) -> str:
    t = exhibit.trial
    names = [name for name in PICTURES if name in exhibit.pictures]
    if exhibit.rank in {"best", "median"}:
        names = list(PICTURES)
    elif ESTIMATE not in names:
        names = [ESTIMATE, TRUTH]
    if t.T_camera_lidar_initial is None:
        names = [name for name in names if name != INITIAL]
    captions = {
        INITIAL: f"{number(t.initial_rotation_error_deg, 2)}° and "
        f"{number(t.initial_translation_error_m, 3)} m off",
        ESTIMATE: "" if t.failed else f"{_errors(t)} off",
        TRUTH: "",
    }
    figures = "".join(_picture(name, captions[name], exhibit.pictures.get(name)) for name in names)
    about = _about(exhibit, opener)
    kind = "beside" if len(names) == 2 else "under"
    return f'<article class="exhibit {kind}">{about}<div class="row">{figures}</div></article>'


def _about(exhibit: Exhibit, opener: Opener) -> str:
    """What a person must know of a trial."""
    t = exhibit.trial
    where = f"{escape(t.pose_id)}, {words.count(len(t.pair_ids), 'pair')} jointly"
    if len(t.pair_ids) == 1:
        where = escape(t.pair_ids[0])
    lines = [_verdict(t)]
    if not t.failed:
        lines.append(f"{_errors(t)}{_sigma(t)}")
    if math.isfinite(t.groundtruth_rotation_sigma_deg):
        lines.append(
            f'<span class="muted">ground truth ± {t.groundtruth_rotation_sigma_deg:.2f}° and '
            f"{t.groundtruth_translation_sigma_m:.3f} m</span>"
        )
    start = (
        f"{number(t.initial_rotation_error_deg, 2)}° and "
        f"{number(t.initial_translation_error_m, 3)} m"
    )
    if t.T_camera_lidar_initial is None:
        start = "nothing"
    lines.append(f'<span class="muted">from {start}</span>')
    if says := _says(t):
        lines.append(f'<span class="muted">{escape(says)}</span>')
    differs = opener.differs(t)
    note = f'<p class="note">{escape(differs)}</p>' if differs else ""
    return (
        f'<div class="about"><p class="trial"><b>{exhibit.rank.capitalize()}</b> '
        f"<code>{where}</code>, trial&nbsp;{t.trial}</p>"
        f"<ul>{''.join(f'<li>{line}</li>' for line in lines)}</ul>"
        f"{command(opener(t))}{note}</div>"
    )


def _errors(t: TrialResult) -> str:
    return f"{number(t.rotation_error_deg, 3)}° and {number(t.translation_error_m, 3)} m"


def _sigma(t: TrialResult) -> str:
    return f", {t.sigma_distance:.1f} sigma" if math.isfinite(t.sigma_distance) else ""


def _verdict(t: TrialResult) -> str:
    if t.failed:
        return '<span class="bad">no estimate</span>'
    if t.success:
        return '<span class="good">success</span>'
    if is_explained(t):
        return "no success, but the ground truth's own uncertainty explains it"
    return '<span class="bad">miss</span>'


def _says(t: TrialResult) -> str:
    """What the method itself says of its estimate."""
    notes = (
        ("not converged", not t.converged and not t.failed),
        ("degenerate", t.degenerate),
        ("cost grew", t.diverged),
        (t.message, bool(t.message)),
    )
    return "; ".join(text for text, is_so in notes if is_so)


def _picture(name: str, caption: str, webp: bytes | None) -> str:
    if webp is None:
        return f'<figure><div class="none">no picture</div><figcaption>{name}</figcaption></figure>'
    text = f"{name}, {caption}" if caption else name
    return (
        f'<figure><label title="enlarge"><input type="checkbox"><img loading="lazy" '
        f'src="{data(webp)}"{size(webp)} alt="LiDAR on the image: {escape(name.lower())}">'
        f"</label><figcaption>{escape(text)}</figcaption></figure>"
    )
