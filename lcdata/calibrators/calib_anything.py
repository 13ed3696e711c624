"""Calib-Anything: LiDAR points that fall into one segment of the image should be alike."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.errors import CalibrationError
from lcdata.pair import Pair

if TYPE_CHECKING:
    from lcdata.features.cloud_attributes import CloudAttributes
    from lcdata.features.segment_layers import SegmentLayers
    from lcdata.features.segment_objective import SegmentFeatures, SegmentObjective

Array = NDArray[np.float64]

FEWEST_POINTS = 300
"""Points in view of a pair below which masks say nothing."""

FEWEST_MASKS = 5

NEAREST_M = 0.3
"""Closer returns, and the zeros of missing ones, are left out."""


@dataclass(frozen=True)
class CalibAnything(Calibrator):
    """Maximise the consistency of point attributes within image segments (Luo et al. 2023).

    Segments come from `masks`, or from a model (`encoder` and `decoder`), or from the colours of
    the image. The box around the initial guess has to contain its error.

    Args:
        masks: Folder of mask images, see `lcdata.features.mask_files`; empty for none.
        encoder: ONNX file of a SAM-family image encoder; empty for none.
        decoder: ONNX file of its prompt decoder.
        grid: Prompts along the longer side of the image.
        score: `"published"`, or `"explained"`: the share of the inconsistency that the masks do
            not explain, which is not drawn to where the camera sees less variety.
        search_rotation_deg: Half-width of the box about each axis, degrees.
        search_translation_m: Half-width of the box along each axis, metres.
        search_samples: Poses in the first round of the search.
        cluster_m: Points so near each other belong to one cluster, metres.
        max_rotation_sigma_deg: A result is not trusted if the predicted standard deviation of
            its rotation is larger, degrees.
        max_translation_sigma_m: The same of the translation, metres.
        seed: Seed of the search's random numbers.
    """

    name: ClassVar[str] = "calib_anything"

    masks: str = ""
    encoder: str = ""
    decoder: str = ""
    grid: int = 32
    score: str = "explained"
    search_rotation_deg: float = 4.0
    search_translation_m: float = 0.2
    search_samples: int = 2500
    cluster_m: float = 0.25
    max_rotation_sigma_deg: float = 0.25
    max_translation_sigma_m: float = 0.05
    seed: int = 0

    def __post_init__(self) -> None:
        if self.score not in ("explained", "published"):
            raise CalibrationError(
                f"method {self.name!r}: score is {self.score!r}", "use explained or published"
            )
        if bool(self.encoder) != bool(self.decoder):
            raise CalibrationError(
                f"method {self.name!r}: encoder {str(self.encoder)!r} with decoder "
                f"{str(self.decoder)!r}",
                "give both ONNX files of one model, or neither",
            )
        if self.masks and self.encoder:
            raise CalibrationError(
                f"method {self.name!r}: masks {str(self.masks)!r} and encoder "
                f"{str(self.encoder)!r}",
                "give masks or a model that makes them",
            )
        limits = {
            "grid": 200,
            "search_rotation_deg": 45.0,
            "search_translation_m": math.inf,
            "search_samples": 10_000_000,
            "cluster_m": math.inf,
            "max_rotation_sigma_deg": math.inf,
            "max_translation_sigma_m": math.inf,
        }
        self._check_numbers(limits, ("grid", "search_samples", "seed"))

    @property
    def box(self) -> Array:
        """(6,) half-widths, metres then radians."""
        return np.repeat([self.search_translation_m, np.deg2rad(self.search_rotation_deg)], 3)

    def prepare(self, pair: Pair) -> SegmentFeatures:
        """Segments of the image, and attributes of the points, of one pair."""
        from lcdata.features.segment_objective import SegmentFeatures

        layers = self._layers(pair)
        if layers.masks < FEWEST_MASKS:
            raise CalibrationError(
                f"{_name(pair)}: {layers.masks} segments in the image",
                "give masks of more objects, or a picture with more in it",
            )
        cloud, note = self._attributes(pair)
        return SegmentFeatures(layers, cloud, note)

    def _layers(self, pair: Pair) -> SegmentLayers:
        from lcdata.features.image_segments import SCALES
        from lcdata.features.mask_files import read_mask, segment_files
        from lcdata.features.segment_layers import layers_of_image, layers_of_masks

        if self.masks:
            shape = pair.camera.height, pair.camera.width
            files = segment_files(self.masks, pair)
            return layers_of_masks((read_mask(path, shape) for path in files), pair.camera)
        if self.encoder:
            from lcdata.features.sam_masks import sam_masks

            found = sam_masks(pair.image, pair.camera, self.encoder, self.decoder, self.grid)
            return layers_of_masks(found, pair.camera)
        if pair.image.min() == pair.image.max():
            raise CalibrationError(
                f"{_name(pair)}: all pixels are {int(pair.image.min())}",
                "calib_anything needs a picture",
            )
        return layers_of_image(pair.image, pair.camera, SCALES)

    def _attributes(self, pair: Pair) -> tuple[CloudAttributes, str]:
        from lcdata.features.cloud_attributes import cloud_attributes

        with np.errstate(invalid="ignore", over="ignore"):
            points = np.asarray(pair.points, np.float32)
            good = np.isfinite(points).all(axis=1)
            good &= np.abs(points).sum(axis=1) > NEAREST_M
            good &= np.abs(points).max(axis=1, initial=0.0) < 1e4
        light, note = None, "no intensity: normals and classes only"
        if pair.intensity is not None:
            with np.errstate(over="ignore"):
                light = np.asarray(pair.intensity, np.float32)
            known = good & np.isfinite(light)
            # Intensities that are missing here and there cost their points, not the attribute.
            enough = known.any() and known.sum() >= 0.5 * good.sum()
            if enough and np.ptp(light[known], axis=None) > 0:
                light, good, note = light[known], known, ""
            else:
                light, note = None, "intensity tells nothing: normals and classes only"
        return cloud_attributes(points[good], light, self.cluster_m), note

    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Array | None,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        """Estimate the extrinsic that all the pairs share; see `Calibrator.calibrate`."""
        from lcdata.calibrators.segment_verdict import judge
        from lcdata.features.segment_objective import Prior, objective

        started = time.perf_counter()
        T_initial, features = self._ready(pairs, initial, prepared)
        notes = list(dict.fromkeys(f.note for f in features if f.note))
        reach = 1.5 * np.deg2rad(self.search_rotation_deg)
        prior = Prior(T_initial, self.box)
        first = objective(features, T_initial, reach, self.score, prior)
        if first.inside < FEWEST_POINTS * len(features):
            return _blind(features, T_initial, first.inside, started)
        T, last = self._register(features, T_initial, first)
        limits = self.max_translation_sigma_m, self.max_rotation_sigma_deg
        rng = np.random.default_rng([self.seed, 1])
        covariance, undetermined, doubts = judge(last, T, T_initial, self.box, limits, rng)
        # Both costs of the points that are in view in the end, or they could not be compared.
        cost_initial, cost = (
            float(c) for c in replace(last, prior=None).hard(np.stack([T_initial, T]))
        )
        if not cost < cost_initial and not np.array_equal(T, T_initial):
            doubts.append("diverged: no better than the initial guess")
        return Calibration(
            T,
            converged=not (undetermined or doubts),
            degenerate=bool(undetermined),
            covariance=covariance,
            seconds=time.perf_counter() - started,
            cost_initial=cost_initial,
            cost_final=cost,
            message="; ".join(undetermined + doubts + notes),
        )

    def _register(
        self, features: Sequence[SegmentFeatures], T_initial: Array, first: SegmentObjective
    ) -> tuple[Array, SegmentObjective]:
        """Search the box, then nearer by what is hidden from there, then fit parabolas."""
        from lcdata.features.segment_objective import objective
        from lcdata.features.segment_search import again, search, settled

        rng = np.random.default_rng(self.seed)
        T = search(first, T_initial, self.box, self.search_samples, rng)
        near = 0.3 * self.box
        last = objective(features, T, 2.0 * float(near[3]), self.score, first.prior)
        T = again(last, T, near, 300, rng)
        return settled(last, T, rng), last


def _name(pair: Pair) -> str:
    return f"pair {pair.pair_id}" if pair.pair_id else "pair"


def _blind(
    features: Sequence[SegmentFeatures], T_initial: Array, inside: int, started: float
) -> Calibration:
    from lcdata.features.nid_views import whereabouts

    places = "; ".join(
        dict.fromkeys(whereabouts(f.layers, f.cloud.points, T_initial) for f in features)
    )
    seen = "no point" if inside == 0 else f"only {inside} points"
    return Calibration(
        T_initial,
        converged=False,
        degenerate=True,
        covariance=np.full((6, 6), np.nan),
        seconds=time.perf_counter() - started,
        message=f"{seen} in view from the initial guess: {places}",
    )
