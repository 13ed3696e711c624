"""How many points of each pair a review keeps, so that a large data set still fits."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import ReportError
from lcdata.review.text import count_text

if TYPE_CHECKING:
    from lcdata.dataset.reader import Dataset

BUDGET_BYTES = 385e6
"""What a review of any size is planned to take: a viewer holds all of it in memory."""

POINTS = 2_000, 30_000
"""Fewest and most points that are kept of a cloud unless a user says how many."""

OVERLAY = 500, 3_000
"""The same of an overlay: more would cover the image that they are to be compared with."""

OVERLAY_SHARE = 0.4
"""Of what the images leave of the budget, at most this goes into overlays."""

PNG_BYTES = 400_000
"""PNG images above this in the mean of their scenario are shown as JPEG; smaller as they are."""

POINT_BYTES, OVERLAY_POINT_BYTES, OVERLAY_BYTES = 16, 12, 7_000
JPEG_BYTES_A_PIXEL = 0.25


@dataclass(frozen=True)
class Thinning:
    """What is kept of each pair.

    Args:
        points: Most points of a cloud; None for every `step`-th.
        step: Every how many returns to keep in place of a number.
        overlay: Most points of an overlay.
        as_jpeg: Scenarios whose PNG images are shown as JPEG.
        note: What was thinned, for a reader; empty if nothing was.
    """

    points: int | None = POINTS[1]
    step: int = 1
    overlay: int = OVERLAY[1]
    as_jpeg: frozenset[str] = frozenset()
    note: str = ""

    def keep(self, count: int, pair_id: str) -> NDArray[np.int64]:
        """Which of `count` returns to keep, in their order.

        One at random of each of as many equal stretches of the scan as there are points to
        keep: even, yet without the stripes that every n-th column of a spinning LiDAR shows.
        The same pair always gives the same points.
        """
        if self.points is None:
            return np.arange(0, count, self.step)
        return spread(count, self.points, zlib.crc32(pair_id.encode()))


def spread(count: int, at_most: int, seed: int) -> NDArray[np.int64]:
    """Rows of one item of each of `at_most` equal stretches, at random; all if they are fewer."""
    if count <= at_most:
        return np.arange(count)
    bounds = np.linspace(0, count, at_most + 1).astype(np.int64)
    place = np.random.default_rng(seed).random(at_most)
    return bounds[:-1] + (place * np.diff(bounds)).astype(np.int64)


def plan(
    dataset: Dataset, sources: int, *, points: int | None = None, thin: int | None = None
) -> Thinning:
    """What to keep of each pair of a data set.

    Args:
        dataset: The data set, of which the pairs that are shown.
        sources: Number of overlays a pair.
        points: Points of a cloud to keep; None for as many as the budget allows.
        thin: Every how many returns to keep, in place of `points`.

    Raises:
        ReportError: Numbers below 1, or both of them.
    """
    if points is not None and thin is not None:
        raise ReportError("--points and --thin both say what to keep of a cloud", "give one")
    if thin is not None and thin < 1:
        raise ReportError(f"every {thin}th point cannot be kept", "give 1 or more")
    if points is not None and points < 1:
        raise ReportError(f"{points} points of a cloud cannot be kept", "give 1 or more")
    images, as_jpeg = _images(dataset)
    left = max(0.0, (BUDGET_BYTES - images) / len(dataset.pairs))
    allowed = OVERLAY_SHARE * left / max(1, sources) - OVERLAY_BYTES
    overlay = int(np.clip(allowed / OVERLAY_POINT_BYTES, *OVERLAY))
    left -= sources * (overlay * OVERLAY_POINT_BYTES + OVERLAY_BYTES)
    if thin is None and points is None:
        kept = int(np.clip(left / POINT_BYTES, *POINTS))
    else:
        kept = points or 0
    thinning = Thinning(kept, overlay=overlay, as_jpeg=as_jpeg)
    if thin is not None:
        thinning = Thinning(None, thin, overlay, as_jpeg)
    note = _note(thinning, dataset, images)
    return Thinning(thinning.points, thinning.step, overlay, as_jpeg, note)


def _images(dataset: Dataset) -> tuple[float, frozenset[str]]:
    """Bytes of all images as they are shown, and scenarios whose PNGs are shown as JPEG."""
    sizes: dict[str, list[int]] = {}
    pngs: dict[str, list[int]] = {}
    for record in dataset.pairs:
        size = _size(dataset.path / record.image)
        by_kind = pngs if Path(record.image).suffix.lower() == ".png" else sizes
        by_kind.setdefault(record.scenario, []).append(size)
    large = frozenset(name for name, found in pngs.items() if np.mean(found) > PNG_BYTES)
    total = float(sum(map(sum, sizes.values())))
    for scenario, found in pngs.items():
        camera = dataset.camera(scenario)
        as_jpeg = JPEG_BYTES_A_PIXEL * camera.width * camera.height * len(found)
        total += min(sum(found), as_jpeg) if scenario in large else sum(found)
    return total, large


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # missing: told when the pair is read
        return 0


def _note(thinning: Thinning, dataset: Dataset, images: float) -> str:
    largest = max(record.points for record in dataset.pairs)
    parts = []
    if thinning.points is None:
        if thinning.step > 1:
            parts.append(f"every {thinning.step}th return of a cloud is kept")
    elif largest > thinning.points:
        parts.append(f"clouds of up to {largest:,} points are thinned to {thinning.points:,} each")
    if thinning.overlay < OVERLAY[1]:
        parts.append(f"overlays to {thinning.overlay:,}")
    if thinning.as_jpeg:
        parts.append(f"PNG images of {_listed(sorted(thinning.as_jpeg))} are shown as JPEG")
    if images > 0.8 * BUDGET_BYTES:
        parts.append(
            f"the images of {count_text(len(dataset.pairs), 'pair')} alone take "
            f"{images / 1e6:.0f} MB, which filters such as --worst 20 avoid"
        )
    return "; ".join(parts)


def _listed(items: Sequence[str]) -> str:
    return ", ".join(items)
