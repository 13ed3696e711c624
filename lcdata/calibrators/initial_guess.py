"""An initial guess without a guess: from edges over all rotations, or from matched points."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.geometry import se3
from lcdata.pair import Pair

Array = NDArray[np.float64]

ROUTES = ("auto", "edges", "matching")
MATCHER_NAMES = ("classical", "learned")

SUCCESS_ROTATION_DEG = 1.0
SUCCESS_TRANSLATION_M = 0.5
"""An initial guess within these succeeds (Koide et al., section IV)."""

MIN_SCORE = 2.5
"""Lowest score of a guess that may be trusted: 4 to 15 of simulated pairs, 2.4 to 3.3 of five
frames of a real road together, 1 to 2 of one such frame, which does not determine the answer."""

MIN_LEAD = 1.3
"""Lowest ratio of its evidence to that of the best other solution; the evidence is the score times
the agreement of intensities, so that two witnesses are heard."""

FLOOR = 1.0
"""Agreement of intensities in per cent that counts as none: added, so that of two poses without
any the edges decide."""


UPRIGHT = 1.3
"""Factor on the evidence of poses in which neither sensor is upside down against the other."""


@dataclass(frozen=True, eq=False)
class InitialGuess:
    """A guess of the extrinsic.

    Args:
        T_camera_lidar: 4x4, maps LiDAR points to camera points; the best that there is even where
            it cannot be trusted.
        converged: Whether it can be trusted to be within 1 deg and 0.5 m.
        message: Why not, or what should be known.
        route: "edges" or "matching".
        score: See `lcdata.features.edge_score`; NaN without edges.
        lead: Evidence over that of the best other solution, see `MIN_LEAD`.
        matches: Number of matched points, 0 of the route by edges.
        inliers: Those that agree with the guess.
        seconds: Wall time.
    """

    T_camera_lidar: Array
    converged: bool
    message: str
    route: str
    score: float = float("nan")
    lead: float = float("nan")
    matches: int = 0
    inliers: int = 0
    seconds: float = float("nan")


@dataclass(frozen=True)
class GuessOptions:
    """How to look for a guess.

    Args:
        route: "edges" searches all rotations for edges of the cloud on lines of the image;
            "matching" matches points of the image and of the cloud's intensity image; "auto"
            takes the first, and the second where the first cannot be trusted and it can.
        matcher: Name of the matcher, see `lcdata.features.image_matching`.
        rotate_camera: Turn the camera's image by so many degrees before matching: 0, 90, 180, 270.
        rotate_lidar: The same of the LiDAR's image.
        one_view: Match the cloud as the paper's one virtual camera sees it (a pinhole below 150
            degrees, else equirectangular), and not as six pinholes do.
        upright: Factor on the evidence of poses in which the LiDAR's z axis points up in the image
            (within 60 degrees): 1 for no such belief. It decides near ties only.
        reach_m: Largest translation along each axis that is searched, metres.
        seed: Of all chance.

    Raises:
        CalibrationError: An unknown route or angle.
    """

    route: str = "auto"
    matcher: str = "classical"
    rotate_camera: int = 0
    rotate_lidar: int = 0
    one_view: bool = False
    upright: float = UPRIGHT
    reach_m: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.route not in ROUTES:
            raise CalibrationError(
                f"unknown route {self.route!r} to an initial guess", f"use {', '.join(ROUTES)}"
            )
        if self.matcher not in MATCHER_NAMES:
            raise CalibrationError(
                f"unknown matcher {self.matcher!r}", f"use {' or '.join(MATCHER_NAMES)}"
            )
        for name in ("rotate_camera", "rotate_lidar"):
            if getattr(self, name) not in {0, 90, 180, 270}:
                raise CalibrationError(
                    f"{name} is {getattr(self, name)!r}", "give 0, 90, 180 or 270 degrees"
                )
        if not 0 < self.reach_m < 100:
            raise CalibrationError(f"reach_m is {self.reach_m!r}", "give metres above 0")


def guess(pairs: Sequence[Pair] | Pair, **options: object) -> InitialGuess:
    """Guess the extrinsic that pairs share from nothing but themselves.

    Args:
        pairs: One pair, or several with the same extrinsic, which are used jointly.
        **options: See `GuessOptions`.

    Returns:
        The guess. One that is not trustworthy says so.

    Raises:
        CalibrationError: No pairs, or pairs that no guess can be made from.
    """
    started = time.perf_counter()
    known = [f.name for f in dataclasses.fields(GuessOptions)]
    for name in options:
        if name not in known:
            raise CalibrationError(
                f"an initial guess has no option {name!r}", f"it has {', '.join(known)}"
            )
    chosen = GuessOptions(**options)  # type: ignore[arg-type]
    pairs = [pairs] if isinstance(pairs, Pair) else list(pairs)
    if not pairs:
        raise CalibrationError("no pairs to guess from", "give one Pair or more")
    found = _guess(pairs, chosen)
    return dataclasses.replace(found, seconds=time.perf_counter() - started)


def _guess(pairs: Sequence[Pair], options: GuessOptions) -> InitialGuess:
    """The guess of the route that was asked for."""
    if options.route == "matching":
        return _by_matching(pairs, options)
    if options.route == "edges":
        return _by_edges(pairs, options)
    try:
        found = _by_edges(pairs, options)
    except CalibrationError as no_edges:
        try:
            return _by_matching(pairs, options)
        except CalibrationError:
            raise no_edges from None
    if found.converged:
        return found
    try:
        matched = _by_matching(pairs, options)
    except CalibrationError:
        return found
    return matched if matched.converged else found


def _by_matching(pairs: Sequence[Pair], options: GuessOptions) -> InitialGuess:
    """Match points of the image and of the cloud's intensity images."""
    from lcdata.calibrators.matching_guess import pose_from_matching
    from lcdata.features.image_matching import make_matcher

    matcher = make_matcher(options.matcher)
    turns = options.rotate_camera, options.rotate_lidar
    found = pose_from_matching(pairs, matcher, *turns, options.one_view)
    return InitialGuess(
        found.T_camera_lidar,
        not found.doubts,
        "; ".join(found.doubts),
        "matching",
        matches=found.matches,
        inliers=found.inliers,
    )


def _by_edges(pairs: Sequence[Pair], options: GuessOptions) -> InitialGuess:
    """Search all rotations for edges on lines; intensities are a second witness."""
    from lcdata.features.edge_score import extract_edge_features
    from lcdata.features.intensity_score import intensity_agreement
    from lcdata.features.pose_search import SearchOptions, search

    features = [extract_edge_features(pair) for pair in pairs]

    def witness(poses: Array) -> Array:
        agreement = [intensity_agreement(pair, poses) for pair in pairs]
        down = -poses[:, 1, 2]  # the LiDAR's -z along the camera's y
        belief = np.where(down > 0.5, options.upright, 1.0)
        return np.asarray(belief * (FLOOR + np.mean(agreement, axis=0)))

    options_of_search = SearchOptions(reach_m=options.reach_m, seed=options.seed)
    found = search(features, options_of_search, witness=witness)
    evidence = np.maximum(found.scores, 0.0) * witness(found.poses)
    first, *others = np.argsort(-evidence, kind="stable")
    T, score = found.poses[first], float(found.scores[first])
    lead = evidence[first] / max(evidence[others[0]], 1e-9) if others else np.inf
    doubts = []
    if score < MIN_SCORE:
        doubts.append(
            f"edges hardly agree with lines (score {score:.1f}, trusted from {MIN_SCORE})"
        )
    if lead < MIN_LEAD:
        apart = np.rad2deg(se3.rotation_error(T, found.poses[others[0]]))
        doubts.append(
            f"a pose {apart:.0f} deg away fits nearly as well (evidence {lead:.2f} times its, "
            f"trusted from {MIN_LEAD})"
        )
    if doubts:
        doubts.append("give more pairs of other scenes, pick matches, or check it by eye")
    return InitialGuess(T, not doubts, "; ".join(doubts), "edges", score=score, lead=float(lead))
