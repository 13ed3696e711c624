"""Recordings to a data set: find them, package each, write the index.

Each recording is read twice: once for all stamps and joint positions, once for the clouds and
images that were chosen, so neither its length nor its order of messages costs memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from lcdata.dataset import schema
from lcdata.dataset.arms import describe_arm, store_urdf
from lcdata.dataset.journal import NAME, Journal
from lcdata.dataset.package import Part, Progress, package
from lcdata.dataset.reader import Dataset, read_info
from lcdata.dataset.schema import DatasetInfo
from lcdata.dataset.sources import check_names, describe_source, find_rig
from lcdata.dataset.writer import write_index
from lcdata.errors import DatasetError, LcdataError
from lcdata.recording.joint_log import find_joint_log, open_joint_log
from lcdata.recording.source import find_recordings, open_recording
from lcdata.rig import load_rig

RESERVED = (
    schema.RESULTS,
    schema.REPORT,
    schema.REVIEW,
    schema.GROUNDTRUTH,
    schema.PICKS,
    schema.MASKS,
    NAME,
)
"""Names in a data set's folder that are no scenario's."""


SHOWN_FAILURES = 4
"""How many reasons fit into the one line that a person reads."""


@dataclass(frozen=True)
class BuildSummary:
    """What a build made.

    Args:
        dataset: The data set, opened.
        pairs: Number of its pairs.
        poses: Number of its arm poses.
        failures: Recordings, poses and pairs that could not be used, a line each.
        warnings: What else a user should know, a line each.
    """

    dataset: Dataset
    pairs: int
    poses: int
    failures: list[str]
    warnings: list[str]

    @classmethod
    def of(cls, dataset: Dataset) -> Self:
        """Summary of a complete data set."""
        warnings = [w for scenario in dataset.info.scenarios.values() for w in scenario.warnings]
        failures = list(dataset.info.failures)
        return cls(dataset, len(dataset.pairs), len(dataset.poses), failures, warnings)


def build(
    recordings: Path,
    out: Path,
    rig: Path | None = None,
    *,
    pairs_per_pose: int | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> BuildSummary:
    """Package recordings into a data set with ground truth.

    A build that was interrupted goes on where it stopped; one that is complete is left as it is.

    Args:
        recordings: A recording or a folder of them.
        out: Folder of the data set.
        rig: Rig file; by default rig.yaml in the recordings' folder or beside the recording.
        pairs_per_pose: At most so many pairs of each pose, evenly spread; None for all.
        force: Replace a data set of other recordings or of another rig.
        progress: See `Progress`.

    Raises:
        DatasetError: `out` holds something else, or cannot be written.
        RigError: No rig, or a wrong one.
        LcdataError: No recording can be used; the first one's reason.
    """
    recordings, out = Path(recordings), Path(out)
    paths = find_recordings(recordings)
    check_names(paths, RESERVED)
    used = load_rig(Path(rig) if rig else find_rig(recordings, paths))
    arm = used.load_arm() if used.ground_truth == "arm" else None
    what: dict[str, Any] = {
        "sources": [describe_source(path, find_joint_log(path, used)) for path in paths],
        "rig": used.to_dict(),
        "arm": describe_arm(used.arm.model, arm) if arm else None,
        "pairs_per_pose": pairs_per_pose,
    }
    if not force and (complete := already_built(out, what)):
        return complete
    with Journal.open(out, what, force=force) as journal:
        parts: dict[str, Part] = {}
        failures: list[str] = []
        errors: list[LcdataError] = []
        for path in paths:
            try:
                with open_recording(path, used.stamps, open_joint_log(path, used)) as recording:
                    part = package(
                        recording,
                        used,
                        arm,
                        journal=journal,
                        pairs_per_pose=pairs_per_pose,
                        progress=progress,
                    )
                parts[recording.scenario] = part
                failures += part.failures
            except DatasetError:
                raise
            except LcdataError as error:
                errors.append(error)
                failures.append(str(error))
        pairs = [pair for part in parts.values() for pair in part.pairs]
        if not pairs:
            journal.abandon()
            raise nothing_taken(recordings, errors, failures)
        taken = {pair.pose_id for pair in pairs}
        poses = [p for part in parts.values() for p in part.poses if p.pose_id in taken]
        info = DatasetInfo(
            rig=what["rig"],
            arm=what["arm"],
            sources=tuple(what["sources"]),
            scenarios={name: part.scenario for name, part in parts.items() if part.pairs},
            simulated=used.simulated,
            pairs_per_pose=pairs_per_pose,
            failures=tuple(failures),
        )
        if arm:
            store_urdf(out, arm)
        write_index(out, info, pairs, poses)
        journal.close_build()
    return BuildSummary.of(Dataset.open(out))


def already_built(out: Path, what: dict[str, Any]) -> BuildSummary | None:
    """The data set in `out`, if it is complete and of the same recordings, rig and options."""
    if not (out / schema.INFO).is_file():
        return None
    info = read_info(out)
    plain = info.to_dict() | info.as_built
    if any(schema.plain(plain[key]) != schema.plain(what[key]) for key in what):
        return None
    dataset = Dataset.open(out)
    files = [name for pair in dataset.pairs for name in (pair.image, pair.cloud)]
    missing = [name for name in files if not (out / name).is_file()]
    if missing:
        raise DatasetError(
            f"{out}: {len(missing)} files are missing, among them {missing[0]}",
            "build it again with --force",
        )
    return BuildSummary.of(dataset)


def nothing_taken(
    recordings: Path, errors: Sequence[LcdataError], failures: Sequence[str]
) -> LcdataError:
    """Why there is no data set: the only recording's error, or all of them."""
    if len(errors) == len(failures) == 1:
        return errors[0]
    shown = list(failures[:SHOWN_FAILURES])
    if len(failures) > SHOWN_FAILURES:
        shown.append(f"and {len(failures) - SHOWN_FAILURES} more")
    return DatasetError(f"no pair could be taken from {recordings}", "; ".join(shown))
