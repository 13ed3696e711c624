"""The figures of a run: which there are, how each is drawn, what is written under it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from lcdata.evaluation.results import TrialResult
from lcdata.report import words
from lcdata.report.dependence import (
    Values,
    dependence_plot,
    in_view,
    initial_errors,
    matched_lines,
    varies,
)
from lcdata.report.distributions import ecdf_plot
from lcdata.report.html import captioned
from lcdata.report.plots import box_plots
from lcdata.report.pose_plot import MOST_POSES, pose_names, pose_plot
from lcdata.report.theme import DARK, LIGHT, Theme

Draw = Callable[[Sequence[TrialResult], Theme], bytes]

KINDS = ("errors", "ecdf", "poses", "start", "lines", "view")
"""First part of the files' names."""


@dataclass(frozen=True)
class Figure:
    """A plot in both themes.

    Args:
        kind: One of `KINDS`.
        light: PNG file.
        html: Both themes with caption.
    """

    kind: str
    light: bytes
    html: str


def distributions(trials: Sequence[TrialResult]) -> list[Figure]:
    """Figures on how errors are distributed: boxes, shares, poses.

    Args:
        trials: Of one run.
    """
    figures = [
        _figure(
            "errors",
            box_plots,
            trials,
            "Box plots of rotation and translation errors by scenario and method",
            "Each dot is a trial; boxes are quartiles of all trials, failed ones counted beyond "
            "the upper edge, whiskers 1.5 times their distance. The band is the ground truth's "
            "own uncertainty: methods whose medians differ by less are not ranked, ≈.",
        ),
        _figure(
            "ecdf",
            ecdf_plot,
            trials,
            "Share of trials below an error, by method",
            "Share of all trials whose error is below a value, failed ones included: a curve that "
            "ends below 1 is of a method that gave no estimate in the rest. The band is the ground "
            "truth's own uncertainty.",
        ),
    ]
    if 1 < len(pose_names(trials)) <= MOST_POSES:
        caption = (
            "Dots are medians at a pose, lines reach from 25 % to 75 %; failed trials count as "
            "infinitely wrong, up to the upper edge. The band is the ground truth's own "
            "uncertainty at that pose."
        )
        alt = "Median errors pose by pose, by method"
        figures.append(_figure("poses", pose_plot, trials, alt, caption))
    return figures


def dependences(
    trials: Sequence[TrialResult], shares: Mapping[str, float], *, first: str = ""
) -> list[Figure]:
    """Figures on what errors depend on, of quantities that vary.

    Args:
        trials: Of one run, or of several.
        shares: Share of the cloud in view, by pair.
        first: Starts each caption.
    """
    figures = []
    if varies(trials, initial_errors):
        figures.append(start_figure(trials, first))
    if varies(trials, matched_lines):
        failed = sum(t.failed for t in trials)
        without = words.count(failed, "trial") + " without an estimate cannot be shown here. "
        caption = (
            f"{first}Lines that the estimate rests on, in methods that match lines. "
            f"{without if failed else ''}Lines go through medians."
        )
        over = "the number of matched lines"
        figures.append(_dependence("lines", matched_lines, trials, over, caption))
    viewed = in_view(shares)
    if varies(trials, viewed):
        pairs = {pair for t in trials for pair in t.pair_ids}
        known = sum(pair in shares for pair in pairs)
        sample = "" if known == len(pairs) else f"Known of {known} of {len(pairs)} pairs. "
        caption = (
            f"{first}Share of the cloud's returns inside the image, at the ground truth. {sample}"
            "Lines go through medians; a failed trial is at the upper edge."
        )
        over = "the share of the cloud in view (%)"
        figures.append(_dependence("view", viewed, trials, over, caption))
    return figures


def start_figure(trials: Sequence[TrialResult], first: str = "") -> Figure:
    """Errors over initial errors.

    Args:
        trials: Of one run, or of several.
        first: Starts the caption.
    """
    caption = (
        f"{first}Errors over the initial error; lines go through medians. A failed trial is at "
        "the upper edge."
    )
    return _dependence("start", initial_errors, trials, "its initial size ({unit})", caption)


def _dependence(
    kind: str, values: Values, trials: Sequence[TrialResult], over: str, caption: str
) -> Figure:
    alt = f"Errors over {over}, by method".replace(" ({unit})", "")
    draw = partial(dependence_plot, values=values, over=over)
    return _figure(kind, draw, trials, alt, caption)


def _figure(kind: str, draw: Draw, trials: Sequence[TrialResult], alt: str, caption: str) -> Figure:
    light = draw(trials, LIGHT)
    return Figure(kind, light, captioned(light, draw(trials, DARK), alt, caption))
