"""Published pairs to a data set: list them, write each, write the index.

An import goes on where it stopped, keeps images byte by byte and every field of the clouds, and
writes as a build does.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset.build import RESERVED, BuildSummary, already_built, nothing_taken
from lcdata.dataset.importers.pair_files import Planned, write_pair
from lcdata.dataset.importers.published import (
    Choice,
    Importer,
    Item,
    Listing,
    Published,
    list_pairs,
)
from lcdata.dataset.importers.records import covariance_of_item, pose_records, scenario_entries
from lcdata.dataset.journal import Journal
from lcdata.dataset.package import Progress
from lcdata.dataset.pair_jobs import finished, grouped, write_each
from lcdata.dataset.reader import Dataset
from lcdata.dataset.schema import DatasetInfo, PairRecord
from lcdata.dataset.writer import write_index
from lcdata.errors import DatasetError, SourceError
from lcdata.rig import Pairing, Rig

Array = NDArray[np.float64]

SAMPLE_BYTES = 4096
"""How much of a file's beginning and end its fingerprint covers: there are many files."""


def import_dataset(
    importer: Importer,
    out: Path,
    *,
    choice: Choice | None = None,
    covariance: Array | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> BuildSummary:
    """Write published pairs as a data set with static ground truth.

    Pairs of one extrinsic share a pose. An import that was interrupted goes on where it stopped;
    one that is complete is left as it is.

    Args:
        importer: The published format, and where its files are.
        out: Folder of the data set.
        choice: Which pairs; all by default.
        covariance: 6x6 of the published extrinsics, translation (m) then rotation (rad), in the
            camera frame, where the format does not say it; None for unknown.
        force: Replace a data set of other pairs.
        progress: See `lcdata.dataset.build.Progress`.

    Raises:
        SourceError: There is nothing to import.
        DatasetError: `out` holds something else, or cannot be written; or no pair could be read.
    """
    listing = list_pairs(importer, choice or Choice())
    _check_names(importer, listing)
    if covariance is not None:
        listing = _with_covariance(listing, covariance)
    plan = _plan(listing)
    what: dict[str, Any] = {
        "sources": [_describe(importer, scenario) for scenario in listing.scenarios],
        "rig": _rig(importer, listing, plan).to_dict(),
        "arm": None,
        "pairs_per_pose": None,
    }
    if not force and (complete := already_built(out, what)):
        return complete
    with Journal.open(out, what, force=force) as journal:
        stamps = {p.pair_id: (p.item.stamp_lidar_ns, p.item.stamp_image_ns) for p in plan}
        records = finished(stamps, journal)

        def jobs() -> Iterator[tuple[str, Callable[[], PairRecord]]]:
            for planned in plan:
                if planned.pair_id not in records:
                    yield planned.pair_id, partial(write_pair, journal.folder, planned)

        def done(count: int) -> None:
            if progress:
                progress(f"importing {importer.format}", count, len(plan))

        unusable = write_each(jobs(), journal, records, done)
        lines = grouped(importer.source, listing.failures | unusable)
        # names of files need not be UTF-8, what dataset.json says must be
        failures = [line.encode(errors="backslashreplace").decode() for line in lines]
        if not records:
            journal.abandon()
            raise nothing_taken(importer.source, [], failures)
        pairs = list(records.values())
        info = DatasetInfo(
            rig=what["rig"],
            arm=None,
            sources=tuple(what["sources"]),
            scenarios=scenario_entries(out, listing.scenarios, plan, records),
            simulated=False,
            failures=tuple(failures),
        )
        write_index(out, info, pairs, pose_records(plan, records))
        journal.close_build()
    return BuildSummary.of(Dataset.open(out))


def _check_names(importer: Importer, listing: Listing) -> None:
    """Refuse scenarios whose names a data set needs for itself."""
    for name in (scenario.name for scenario in listing.scenarios):
        if name in RESERVED or name.startswith(".") or "/" in name or not name:
            raise SourceError(
                f"{importer.source} would be scenario {name!r}, a name that a data set uses itself",
                "rename the folder",
            )
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise SourceError(
                f"{name!a}: its name is not UTF-8", "rename the folder: it names the scenario"
            ) from error


def _with_covariance(listing: Listing, covariance: Array) -> Listing:
    """Every pair without a covariance of its own gets this one."""

    def known(item: Any) -> Any:
        if isinstance(item, Item) and item.covariance is None:
            return replace(item, covariance=covariance)
        return item

    scenarios = [replace(s, items=tuple(map(known, s.items))) for s in listing.scenarios]
    return Listing(scenarios, listing.failures)


def _plan(listing: Listing) -> list[Planned]:
    """Names of pairs and poses: pairs of one extrinsic share a pose."""
    plan = []
    for scenario in listing.scenarios:
        poses: dict[bytes, str] = {}
        taken: set[str] = set()
        for item in scenario.pairs:
            known = np.zeros(0) if item.covariance is None else item.covariance
            extrinsic = np.round(item.T_camera_lidar, 12).tobytes() + known.tobytes()
            pose_id = poses.setdefault(extrinsic, f"{scenario.name}/pose_{len(poses):03}")
            pair_id = f"{pose_id}/{_file_name(item.name)}"
            if pair_id in taken:
                raise DatasetError(
                    f"{scenario.name}: two pairs would be {pair_id}", "rename their files"
                )
            taken.add(pair_id)
            plan.append(Planned(pair_id, pose_id, scenario, item))
    return plan


def _file_name(name: str) -> str:
    """A name that can end a path on every system."""
    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    return safe.lstrip(".") or "pair"


def _rig(importer: Importer, listing: Listing, plan: Sequence[Planned]) -> Rig:
    """The rig that a recording of these pairs would have.

    One extrinsic and one camera stand in it, so that `lcdata groundtruth` has something to start
    from; several have no place there.
    """
    content: dict[str, Any] = {
        "ground_truth": "static",
        "note": f"imported from {importer.format}",
        "pairing": Pairing(tolerance_ms=max(s.tolerance_ms for s in listing.scenarios)),
    }
    cameras = {scenario.camera for scenario in listing.scenarios}
    if len(cameras) == 1:
        camera = cameras.pop()
        content["camera"] = {
            name: getattr(camera, name)
            for name in ("model", "width", "height", "intrinsics", "distortion")
        }
    extrinsics = {
        (p.item.T_camera_lidar.tobytes(), covariance_of_item(p.item).tobytes()) for p in plan
    }
    if len(extrinsics) == 1:
        item = plan[0].item
        link: dict[str, Any] = {"matrix": item.T_camera_lidar.tolist()}
        C = covariance_of_item(item)
        if np.array_equal(C, np.diag(np.diag(C))):
            std = np.sqrt(np.diag(C))
            link["translation_std_m"] = std[:3].tolist()
            link["rotation_std_deg"] = np.rad2deg(std[3:]).tolist()
        if np.isnan(C).all() or len(link) > 1:
            content["T_camera_lidar"] = link
    return Rig.from_dict(content, str(importer.source))


def _describe(importer: Importer, scenario: Published) -> dict[str, Any]:
    """Name, size and fingerprint of a scenario's files and of what was made of them."""
    digest = hashlib.sha256()
    camera = scenario.camera
    digest.update(repr((camera, scenario.image, scenario.lidar, scenario.tolerance_ms)).encode())
    for item in scenario.pairs:
        line = f"{item.name} {item.stamp_lidar_ns} {item.stamp_image_ns}\n"
        digest.update(line.encode(errors="surrogateescape"))
        for matrix in (item.T_camera_lidar, covariance_of_item(item), item.T_moved):
            digest.update(b"" if matrix is None else np.ascontiguousarray(matrix).tobytes())
    files = [*scenario.calibration, *(file for item in scenario.pairs for file in item.files)]
    total = 0
    for file in files:
        size, ends = _ends(file)
        total += size
        digest.update(f"{file.name} {size}\n".encode(errors="surrogateescape") + ends)
    return {
        "scenario": scenario.name,
        "name": importer.source.resolve().name,
        "format": importer.format,
        "bytes": total,
        "masks": sum(len(item.mask_files) for item in scenario.pairs),
        "fingerprint": digest.hexdigest(),
    }


def _ends(file: Path) -> tuple[int, bytes]:
    """Size of a file, and its first and last bytes; nothing of one that cannot be read."""
    try:
        with file.open("rb") as opened:
            first = opened.read(SAMPLE_BYTES)
            size = opened.seek(0, 2)
            opened.seek(max(size - SAMPLE_BYTES, 0))
            return size, first + opened.read(SAMPLE_BYTES)
    except OSError:  # its pair will say so
        return 0, b""
