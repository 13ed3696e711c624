"""What a review shows: pairs, the extrinsics over their images, side by side or together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lcdata.review import colours, names
from lcdata.review.trials import Trials

if TYPE_CHECKING:
    from lcdata.dataset.reader import Dataset
    from lcdata.dataset.schema import PairRecord, PoseRecord

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """One picture of the image with a cloud on it, or with two.

    Args:
        key: Folder of its verdict: the source, or a name of both.
        title: What a reader calls it.
        sources: One, whose cloud is coloured by distance, or two, each in a colour of its own.
    """

    key: str
    title: str
    sources: tuple[str, ...]


@dataclass(frozen=True)
class Together:
    """Two sources of an extrinsic that are compared.

    Args:
        title: Name of the two: the method of two runs, say.
        a: The first.
        b: The second.
    """

    title: str
    a: str
    b: str

    @property
    def view(self) -> View:
        """Both on one image."""
        return View(names.together(self.title), f"{self.title}: A and B", (self.a, self.b))


@dataclass(frozen=True, eq=False)
class Comparison:
    """What is compared, A before B.

    Args:
        a: A in words.
        b: B in words.
        together: Sources two by two.
        former: Poses of ground truth A by pose_id, where B is the one that counts.
        errors_a: Trials with their errors against ground truth A.
    """

    a: str
    b: str
    together: tuple[Together, ...]
    former: Mapping[str, PoseRecord] = field(default_factory=dict)
    errors_a: Trials = field(default_factory=Trials)


@dataclass(frozen=True, eq=False)
class Shown:
    """What a review shows.

    Args:
        dataset: The data set, of whose pairs those that are shown.
        trials: The trials on them; a method of two runs has two names.
        comparison: What is compared; None for nothing.
        note: What was left out by filters, and how pairs are ordered; empty for nothing.
    """

    dataset: Dataset
    trials: Trials
    comparison: Comparison | None = None
    note: str = ""

    @property
    def of_truths(self) -> bool:
        """Whether two versions of the ground truth are compared."""
        return self.comparison is not None and bool(self.comparison.former)

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """Sources of an extrinsic whose cloud is put into the image."""
        methods = self.trials.methods
        if self.comparison is not None and not self.of_truths:
            return *methods, names.GROUND_TRUTH
        guesses = (names.INITIAL, *methods) if methods else ()
        truths = (names.FORMER, names.GROUND_TRUTH) if self.of_truths else (names.GROUND_TRUTH,)
        return *guesses, *truths

    @cached_property
    def views(self) -> tuple[View, ...]:
        """Pictures, in reading order."""
        alone = {source: View(source, self.title(source), (source,)) for source in self.sources}
        if self.comparison is None:
            return tuple(alone.values())
        both = tuple(t.view for t in self.comparison.together)
        if self.of_truths:
            truths = alone.pop(names.FORMER), alone.pop(names.GROUND_TRUTH)
            return *both, *truths, *alone.values()
        return *both, alone[names.GROUND_TRUTH]

    @cached_property
    def colours(self) -> dict[str, colours.RGB]:
        """Colour of each source, in series and frustums."""
        palette = colours.of_sources(self.trials.methods)
        if self.comparison is None:
            return palette
        if self.of_truths:
            return palette | {names.FORMER: colours.SIDES[0]}
        return palette | colours.of_sides([(t.a, t.b) for t in self.comparison.together])

    def title(self, source: str) -> str:
        """What a reader calls a source."""
        if self.of_truths and source in (names.FORMER, names.GROUND_TRUTH):
            return f"ground truth {'A' if source == names.FORMER else 'B'}"
        return names.title(source)

    def extrinsics(self, record: PairRecord) -> dict[str, Array | None]:
        """4x4 of each source on a pair; None where it has none."""
        shown = self.trials.of_pair(record.pair_id)
        found: dict[str, Array | None] = {}
        for source in self.sources:
            trial = shown.get(source)
            if source == names.GROUND_TRUTH:
                found[source] = self.dataset.pose(record.pose_id).T_camera_lidar
            elif source == names.FORMER and self.comparison is not None:
                pose = self.comparison.former.get(record.pose_id)
                found[source] = None if pose is None else pose.T_camera_lidar
            elif source == names.INITIAL:
                found[source] = next((t.T_camera_lidar_initial for t in shown.values()), None)
            else:
                found[source] = trial.T_camera_lidar_estimated if trial else None
        return found
