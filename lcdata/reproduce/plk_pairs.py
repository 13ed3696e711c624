"""Pairs of PLK-Calib's figures: simulated ones, or those of a data set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import lcdata
from lcdata.errors import CalibrationError
from lcdata.pair import Pair


@dataclass(frozen=True)
class PairName:
    """A pair that a worker can load.

    Args:
        scenario: Name of the scene, or of the recording.
        pose_id: Name of the arm pose.
        pair_id: Name of the pair.
        content: What must be as it was for results to hold: checksums, version of the ground
            truth, or of the simulation.
        dataset: Folder of the data set; None for a simulated pair.
        pose: Number of the simulated pose.
        index: Number of the simulated pair in it.
        seed: Of the simulated scene.
    """

    scenario: str
    pose_id: str
    pair_id: str
    content: str
    dataset: Path | None = None
    pose: int = 0
    index: int = 0
    seed: int = 0

    def load(self) -> Pair:
        """The pair with its ground truth.

        Raises:
            LcdataError: It cannot be read.
        """
        if self.dataset is not None:
            return _opened(self.dataset).load(self.pair_id)
        from lcdata.simulation import render_pair

        return render_pair(
            self.scenario, pose_index=self.pose, pair_index=self.index, seed=self.seed
        )


@lru_cache(maxsize=1)
def _opened(path: Path) -> lcdata.Dataset:
    return lcdata.Dataset.open(path)


def simulated(scenes: Sequence[str], poses: int, pairs: int, seed: int) -> list[PairName]:
    """Names of simulated pairs."""
    content = f"simulated {lcdata.__version__} seed {seed}"
    names = []
    for scene in scenes:
        for pose in range(poses):
            pose_id = f"{scene}/pose_{pose:03d}"
            for k in range(pairs):
                pair_id = f"{pose_id}/{k:03d}"
                names.append(PairName(scene, pose_id, pair_id, content, None, pose, k, seed))
    return names


def of_dataset(
    path: Path, scenes: Sequence[str] | None, poses: int | None, pairs: int | None
) -> list[PairName]:
    """Names of pairs of a data set, the first of each pose and the first poses of each recording.

    Args:
        path: Its folder.
        scenes: Recordings; None for all.
        poses: At most so many poses a recording; None for all.
        pairs: At most so many pairs a pose; None for all.

    Raises:
        CalibrationError: It has no such recording, or no pairs.
        DatasetError: It is none.
    """
    dataset = lcdata.Dataset.open(path)
    if scenes is not None:
        for scene in scenes:
            if scene not in dataset.scenarios:
                known = ", ".join(dataset.scenarios)
                raise CalibrationError(f"{path} has no scenario {scene!r}", f"it has {known}")
    chosen: dict[str, dict[str, list[PairName]]] = {}
    for record in dataset.pairs:
        if scenes is not None and record.scenario not in scenes:
            continue
        of_scene = chosen.setdefault(record.scenario, {})
        if record.pose_id not in of_scene and poses is not None and len(of_scene) >= poses:
            continue
        of_pose = of_scene.setdefault(record.pose_id, [])
        if pairs is None or len(of_pose) < pairs:
            version = dataset.pose(record.pose_id).pose_version
            content = f"{record.image_sha256[:16]} {record.cloud_sha256[:16]} truth {version}"
            folder = Path(dataset.path).resolve()
            name = PairName(record.scenario, record.pose_id, record.pair_id, content, folder)
            of_pose.append(name)
    names = [
        name for of_scene in chosen.values() for of_pose in of_scene.values() for name in of_pose
    ]
    if not names:
        raise CalibrationError(f"{path} has no pairs", "give a data set with pairs")
    return names
