"""What the page asks for: pictures of a pair, points under a click, the pose of its matches."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset import Dataset
from lcdata.dataset.picks import read_picks, write_picks
from lcdata.errors import CalibrationError, DatasetError
from lcdata.features.lidar_view import equalised, lidar_view
from lcdata.features.point_pose import PointPose, point_pose
from lcdata.geometry import se3

Array = NDArray[np.float64]

SHOWN_POINTS = 100_000
"""Points of the live projection; a person sees no more, and a page draws them at once."""

REACH_PX = 6
"""How far from a click on the LiDAR's picture the nearest point may be, pixels of the picture."""

MARGIN = 0.02
"""What is shown around the part of the LiDAR's picture that has points."""


class Session:
    """One pair on the page. It keeps no matches: the page does.

    Args:
        dataset: The data set.
        pair_id: Which pair.

    Attributes:
        saved: Where matches were saved; None before.
        pose: The pose that was saved.

    Raises:
        DatasetError: Unknown pair, or files that are damaged.
        CalibrationError: The cloud has no points.
    """

    def __init__(self, dataset: Dataset, pair_id: str) -> None:
        self.dataset, self.pair_id = dataset, pair_id
        self.saved: Path | None = None
        self.pose: PointPose | None = None
        pair = dataset.load(pair_id)
        self.camera, self._image = pair.camera, pair.image
        size = (pair.image.shape[1], pair.image.shape[0])
        if size != (self.camera.width, self.camera.height):
            raise DatasetError(
                f"{pair_id}: image of {size[0]}x{size[1]} for a camera of "
                f"{self.camera.width}x{self.camera.height}",
                "`lcdata validate` lists what is wrong",
            )
        self._points = np.asarray(pair.points, float)
        self._has_intensity = pair.intensity is not None and np.ptp(pair.intensity) > 0
        self._view = lidar_view(self._points, pair.intensity)
        if not (self._view.index >= 0).any():
            raise CalibrationError(f"{pair_id}: its cloud has no points", "take another pair")
        self._shown = self._choose_shown(pair.intensity)

    def _choose_shown(self, intensity: NDArray[Any] | None) -> tuple[Array, NDArray[np.uint8]]:
        """Points of the live projection, far ones first, and (N, 2) shades 0..255.

        Shades are the ranks of intensity and nearness.
        """
        rows = np.flatnonzero(np.isfinite(self._points).all(1) & (self._points != 0).any(1))
        rows = rows[:: max(1, -(-len(rows) // SHOWN_POINTS))]
        distance = np.linalg.norm(self._points[rows], axis=1)
        rows = rows[np.argsort(-distance)]
        distance = np.linalg.norm(self._points[rows], axis=1)
        everything = np.ones(len(rows), bool)
        near = equalised(-distance, everything)
        bright = near if intensity is None else equalised(np.asarray(intensity)[rows], everything)
        return self._points[rows], np.stack([bright, near], axis=1)

    def state(self) -> dict[str, Any]:
        """What the page starts from."""
        rows, columns = np.nonzero(self._view.index >= 0)
        height, width = self._view.index.shape
        margin = MARGIN * max(int(np.ptp(rows)), int(np.ptp(columns)), 50)
        shown = [
            max(float(columns.min()) - margin, 0),
            max(float(rows.min()) - margin, 0),
            min(float(columns.max()) + margin, width),
            min(float(rows.max()) + margin, height),
        ]
        return {
            "pair_id": self.pair_id,
            "image": [self.camera.width, self.camera.height],
            "view": [width, height],
            "shown": shown,
            "has_intensity": bool(self._has_intensity),
            **self._former(),
        }

    def _former(self) -> dict[str, Any]:
        """Matches that were saved before."""
        try:
            picks = read_picks(self.dataset, self.pair_id)
        except DatasetError as error:
            return {"matches": [], "message": f"former picks are left out: {error.message}"}
        if picks is None:
            return {"matches": [], "message": ""}
        turned = picks.matches[:, 2:] @ self._view.R_view_lidar.T
        where = self._view.camera.project(turned)[0]
        matches = np.concatenate([picks.matches, where], axis=1)
        return {"matches": matches.tolist(), "message": ""}

    def image(self) -> bytes:
        """The camera's image as JPEG."""
        return _encoded(".jpg", self._image[..., ::-1] if self._image.ndim == 3 else self._image)

    def intensity(self) -> bytes:
        """The LiDAR's intensities as PNG, histogram-equalised."""
        return self._lidar_picture(self._view.intensity)

    def range(self) -> bytes:
        """The LiDAR's ranges as PNG, near ones bright, histogram-equalised."""
        index = self._view.index
        distance = np.linalg.norm(self._points[np.maximum(index, 0)], axis=-1)
        return self._lidar_picture(equalised(-distance, index >= 0))

    def _lidar_picture(self, shades: NDArray[np.uint8]) -> bytes:
        """Transparent where nothing was measured."""
        seen = np.where(self._view.index >= 0, 255, 0).astype(np.uint8)
        return _encoded(".png", np.stack([shades, shades, shades, seen], axis=2))

    def point(self, u: float, v: float) -> dict[str, Any]:
        """The point that the LiDAR's picture shows at a pixel, and the nearest one within reach.

        Raises:
            CalibrationError: There is none.
        """
        index = self._view.index
        height, width = index.shape
        column, row = round(u), round(v)
        left, top = max(column - REACH_PX, 0), max(row - REACH_PX, 0)
        window = index[top : row + REACH_PX + 1, left : column + REACH_PX + 1]
        rows, columns = np.nonzero(window >= 0)
        if not len(rows) or not (0 <= column < width and 0 <= row < height):
            raise CalibrationError("no point there", "pick where the LiDAR measured")
        nearest = np.hypot(columns + left - u, rows + top - v).argmin()
        x, y, z = self._points[window[rows[nearest], columns[nearest]]]
        place = [float(columns[nearest] + left), float(rows[nearest] + top)]
        return {"point": [x, y, z], "at": place}

    def solve(self, matches: list[list[float]]) -> dict[str, Any]:
        """The pose of matches and the points as it projects them.

        Args:
            matches: u v x y z of each.

        Raises:
            CalibrationError: They give no pose.
        """
        pose = self._pose(matches)
        values = np.array(matches, float)
        T = pose.T_camera_lidar
        points, shades = self._shown
        pixels, inside = self.camera.project(se3.apply(T, points))
        drawn = np.empty((int(inside.sum()), 3), "<u2")
        drawn[:, :2] = np.clip(np.rint(pixels[inside]), 0, 65535)
        drawn[:, 2] = shades[inside, 0] + 256 * shades[inside, 1].astype(int)
        std = np.sqrt(np.maximum(np.diag(pose.covariance), 0))
        return {
            "T_camera_lidar": T.tolist(),
            "rms_px": min(pose.rms_px, 1e4),
            "residuals_px": pose.residuals_px.tolist(),
            "projected": np.nan_to_num(
                self.camera.project(se3.apply(T, values[:, 2:]))[0], nan=-1e4
            ).tolist(),
            "std_deg": float(np.rad2deg(np.linalg.norm(std[3:]))),
            "std_m": float(np.linalg.norm(std[:3])),
            "warnings": list(pose.warnings),
            "overlay": base64.b64encode(drawn.tobytes()).decode(),
        }

    def save(self, matches: list[list[float]]) -> dict[str, Any]:
        """Write matches and pose into the data set.

        Raises:
            CalibrationError: They give no pose.
            DatasetError: It cannot be written.
        """
        self.pose = self._pose(matches)
        self.saved = write_picks(self.dataset, self.pair_id, np.array(matches), self.pose)
        return {"path": str(self.saved)}

    def _pose(self, matches: list[list[float]]) -> PointPose:
        try:
            values = np.array(matches, float).reshape(-1, 5)
        except (ValueError, TypeError) as error:
            raise CalibrationError("matches are not u v x y z") from error
        return point_pose(values[:, 2:], values[:, :2], self.camera)


def _encoded(suffix: str, pixels: NDArray[Any]) -> bytes:
    import cv2

    options = [cv2.IMWRITE_JPEG_QUALITY, 92] if suffix == ".jpg" else []
    _, data = cv2.imencode(suffix, np.ascontiguousarray(pixels), options)
    return bytes(data)
