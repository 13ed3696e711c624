"""Lanes and poles of a road onto their masks: CRLF (Ma et al. 2021)."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.errors import CalibrationError
from lcdata.pair import Pair

if TYPE_CHECKING:
    from lcdata.features.road_cloud import RoadCloud
    from lcdata.features.road_view import Road, RoadView, Stack

Array = NDArray[np.float64]

REFINEMENTS = ("search", "random", "none")
WHETHER = ("auto", "always", "never")

CANDIDATES, KEPT = 60, 5
"""Poses of the coarse calibration a pair that are ranked, and those that are refined."""


@dataclass(frozen=True, eq=False)
class RoadFeatures:
    """What is known of a pair before any guess.

    Args:
        cloud: Its lane marks and poles; None where there are none to be found.
        view: Those and its masks; None where the masks need a guess, or where they cannot be used.
        problem: Why not; None where all is well.
    """

    cloud: RoadCloud | None
    view: RoadView | None
    problem: CalibrationError | None = None


@dataclass(frozen=True)
class Crlf(Calibrator):
    """Coarse calibration by P3L from nothing, then refinement by lane and pole masks.

    The masks come from files, from a segmentation network, or, with an initial guess, from a
    classical search of the image.

    Args:
        masks: A mask file, or a folder with `<pair_id>.png`: white where lanes and poles are.
        model: An ONNX file of a semantic segmentation.
        classes: Of the model: `{"lane": [numbers], "pole": [numbers]}`.
        contours: Move the masks' borders onto the image's edges first: `"auto"` (where they lie
            beside them), `"always"` or `"never"`.
        coarse: `"auto"` (only without an initial guess), `"always"` (also with one: the better
            wins) or `"never"`.
        reach_m: Largest distance of the camera from the LiDAR, for the coarse calibration.
        refine: `"search"` (ours), `"random"` (the paper's Algorithm 1) or `"none"`.
        search_rotation_deg: Half-width of the search about each axis.
        search_translation_m: Half-width along each axis.
        random_rotation_deg: Algorithm 1's theta0: 0.1 rad.
        random_translation_m: Its t0.
        random_step: Its initial step size.
        random_least: Its lower bound of the step size.
        random_decay: Its decay factor.
        random_count: Its search count.
        lane_sigmas: Lane points are brighter than the ground's mean by so many deviations.
        lane_distance_m: D0 of eq. (3).
        lowest_m: H0 of eq. (6), above the LiDAR.
        tallest_m: H1 of eq. (5), above the LiDAR.
        seed: Of all chance.
    """

    name: ClassVar[str] = "crlf"
    version: ClassVar[int] = 2
    needs_initial: ClassVar[bool] = False

    masks: str = ""
    model: str = ""
    classes: Mapping[str, Sequence[int]] | None = None
    contours: str = "auto"
    coarse: str = "auto"
    reach_m: float = 2.0
    refine: str = "search"
    search_rotation_deg: float = 2.5
    search_translation_m: float = 0.4
    random_rotation_deg: float = 5.73
    random_translation_m: float = 1.0
    random_step: float = 1.0
    random_least: float = 0.001
    random_decay: float = 0.1
    random_count: int = 10_000
    lane_sigmas: float = 1.0
    lane_distance_m: float = 0.3
    lowest_m: float = -1.0
    tallest_m: float = 3.0
    seed: int = 0

    def __post_init__(self) -> None:
        choices = {"refine": REFINEMENTS, "coarse": WHETHER, "contours": WHETHER}
        for name, known in choices.items():
            if getattr(self, name) not in known:
                raise CalibrationError(
                    f"method {self.name!r}: {name} is {getattr(self, name)!r}",
                    f"use {', '.join(known)}",
                )
        if self.masks and self.model:
            raise CalibrationError(
                f"method {self.name!r}: masks {self.masks} and model {self.model}", "give one"
            )
        limits = {
            "reach_m": 20.0,
            "search_rotation_deg": 45.0,
            "search_translation_m": 10.0,
            "random_rotation_deg": 180.0,
            "random_translation_m": math.inf,
            "random_step": 100.0,
            "random_least": self.random_step,
            "random_decay": 0.99,
            "random_count": 10_000_000,
            "lane_sigmas": 10.0,
            "lane_distance_m": 2.0,
            "tallest_m": 50.0,
        }
        self._check_numbers(limits, ("random_count", "seed"))

    def prepare(self, pair: Pair) -> RoadFeatures:
        """Lanes and poles of the cloud and, where they need no guess, of the image."""
        from lcdata.features.road_cloud import CloudOptions, road_cloud
        from lcdata.features.road_masks import given_masks
        from lcdata.features.road_view import road_view

        options = CloudOptions(
            lane_sigmas=self.lane_sigmas,
            lane_distance_m=self.lane_distance_m,
            lowest_m=self.lowest_m,
            tallest_m=self.tallest_m,
            seed=self.seed,
        )
        try:
            cloud = road_cloud(pair, options)
            if not (self.masks or self.model):
                return RoadFeatures(cloud, None)
            image = given_masks(pair, self.masks, self.model, self.classes, self.contours)
        except CalibrationError as problem:
            return RoadFeatures(None, None, problem)
        return RoadFeatures(cloud, road_view(cloud, image))

    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Array | None,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        """Estimate the extrinsic that all the pairs share; see `Calibrator.calibrate`."""
        from lcdata.features.crlf_refine import agreement
        from lcdata.features.crlf_verdict import judge
        from lcdata.features.road_view import stack, together

        started = time.perf_counter()
        views, notes = self._views(pairs, initial, prepared)
        start = None if initial is None else np.array(initial, float)
        road = together(views)
        starts = self._starts(road, start, pairs)
        T, data = self._refined(road, starts, start is not None)
        first = starts[0] if start is None else start
        # Both costs of the same points, or they could not be compared.
        both = stack(road, np.stack([T, first]))
        cost, cost_first = (-float(agreement(both, pose[None])[0]) for pose in (T, first))
        verdict = judge(road, data, T)
        doubts = verdict.doubts
        if cost > cost_first:
            doubts.append("diverged: no better than where it started")
        return Calibration(
            T,
            converged=not (verdict.undetermined or doubts),
            degenerate=bool(verdict.undetermined),
            covariance=verdict.covariance,
            seconds=time.perf_counter() - started,
            cost_initial=cost_first,
            cost_final=cost,
            message="; ".join(verdict.undetermined + doubts + notes),
        )

    def _views(
        self, pairs: Sequence[Pair], initial: Array | None, prepared: Sequence[Any] | None
    ) -> tuple[list[RoadView], list[str]]:
        """Features of the pairs that can be used, and what is to be said of the others."""
        if not pairs:
            raise CalibrationError(
                f"method {self.name!r} got no pairs", "give one of a road, or more"
            )
        if initial is None and not (self.masks or self.model):
            raise CalibrationError(
                f"method {self.name!r} has neither masks nor a model nor an initial guess",
                "give masks=FILE, model=FILE.onnx, or a 4x4 T_camera_lidar to search the image by",
            )
        from lcdata.features.marks import classical_masks
        from lcdata.features.road_view import road_view

        views: list[RoadView] = []
        problems: list[CalibrationError] = []
        done = prepared or [None] * len(pairs)
        for pair, known in zip(pairs, done, strict=True):
            features: RoadFeatures = self.prepare(pair) if known is None else known
            if features.view is not None:
                views.append(features.view)
            elif features.cloud is not None:
                image = classical_masks(pair, features.cloud, np.array(initial, float))
                views.append(road_view(features.cloud, image))
            elif features.problem is not None:
                problems.append(features.problem)
        if not views:
            raise problems[0]
        return views, [f"left out: {problem.message}" for problem in problems]

    def _starts(self, road: Road, initial: Array | None, pairs: Sequence[Pair]) -> Array:
        """(S, 4, 4) poses to refine, the most promising first."""
        from lcdata.features.crlf_coarse import coarse, lacking, ranked

        if initial is not None and self.coarse != "always":
            lack = [lacking(view, parallel=False) for view in road.views]
            if all(lack):
                raise CalibrationError(f"{_names(pairs)}: {lack[0]}", REMEDY)
            return initial[None]
        if initial is None and self.coarse == "never":
            raise CalibrationError(
                f"method {self.name!r}: no initial guess, and coarse is 'never'",
                "give a 4x4 T_camera_lidar, or coarse='auto'",
            )
        lack = [lacking(view) for view in road.views]
        if initial is None and all(lack):
            raise CalibrationError(f"{_names(pairs)}: {lack[0]}", REMEDY)
        found = [coarse(view, self.reach_m, CANDIDATES)[0] for view in road.views]
        poses = np.concatenate([*found, np.zeros((0, 4, 4)) if initial is None else initial[None]])
        if not len(poses):
            raise CalibrationError(
                f"{_names(pairs)}: no pose with the camera within {self.reach_m:g} m of the LiDAR "
                "lays two lanes and a pole on those of the mask",
                "check masks and intrinsics, give a larger reach_m, or an initial guess",
            )
        return ranked(road, poses, KEPT)

    def _refined(self, road: Road, starts: Array, guessed: bool) -> tuple[Array, Stack]:
        """The refined pose, and what was compared at last."""
        from lcdata.features.crlf_refine import random_refinement, refined
        from lcdata.features.road_view import LAST_POINTS, stack

        if self.refine == "search":
            widths = np.repeat([np.deg2rad(self.search_rotation_deg), self.search_translation_m], 3)
            return refined(road, starts, widths if guessed else 0.6 * widths, self.seed)
        T = starts[0]
        if self.refine == "random":
            settings = (
                self.random_step,
                self.random_least,
                float(self.random_count),
                self.random_decay,
            )
            T, _ = random_refinement(
                road,
                T,
                self.random_translation_m,
                math.radians(self.random_rotation_deg),
                settings,
                self.seed,
            )
        return T, stack(road, T[None], LAST_POINTS)


REMEDY = "give scans of a straight road with two parallel lanes and a pole, or use another method"


def _names(pairs: Sequence[Pair]) -> str:
    names = ", ".join(pair.pair_id for pair in pairs if pair.pair_id)
    return f"pair {names}" if names else "pair" if len(pairs) == 1 else f"{len(pairs)} pairs"
