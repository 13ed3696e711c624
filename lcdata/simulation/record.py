"""Simulated recordings on disk: bags, the hand-measured rig, and the truth beside them."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import SimulationError
from lcdata.geometry.camera import Camera
from lcdata.rig import Rig, load_rig
from lcdata.simulation import camera as cameras
from lcdata.simulation.bag import FORMATS, IMAGE_FORMATS, LIVOX_MESSAGES, Bag, bag_path
from lcdata.simulation.lidar import Ouster
from lcdata.simulation.lidars import Lidar, make_lidar
from lcdata.simulation.mounts import default_rig, joint_offsets
from lcdata.simulation.scenes import SCENARIOS, scenario_rng
from lcdata.simulation.schedule import JOINT_PERIOD_S, Clock, Schedule, clocks, plan
from lcdata.simulation.truth import check_same_tower, write_rig, write_truth
from lcdata.simulation.world import World

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

_NAMES_ORDER = (3, 0, None, 1, 5, 2, 4)
"""Drivers name joints in no special order, with the gripper's finger (None) among them."""
FINGER = "right_finger_bottom_joint"

_WHITE_NOISE = 0.2
"""Of the encoders' deviation, what changes from sample to sample; all of it stays for a pose."""
_COUNT_RAD = 2 * np.pi / 2**18
EPOCH_NS = 1_790_000_000 * 10**9
_CLOCKS = 6
SMALL = 15
"""Level of compression: samples are kept in the repository."""
_ON_THE_WAY = 10_000
"""Number of the first image without a scan, far from those of pairs."""


def simulate(
    out: Path,
    *,
    scenario: str | Sequence[str] = "gym",
    poses: int = 5,
    pairs: int = 2,
    seed: int = 0,
    format: str = "mcap",
    lidar: str = "os1_128",
    columns: int | None = None,
    azimuth_window_deg: float | None = None,
    livox_message: str = "custom",
    camera: str | Camera = "zed2i",
    image_format: str = "jpeg",
    quality: int = 85,
    width: int = 1280,
    height: int = 720,
    rig: Path | Rig | None = None,
    joint_offset_std_deg: float = 0.0,
    clock_offset_s: float = 0.0,
    motion_hz: float = 0.0,
    force: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Write simulated recordings, `rig.yaml` and `truth.json` into a folder.

    The folder may hold recordings of other scenarios from the same rig and seed: the tower's
    true mounts depend on these only, so all share one rig and one truth.

    Args:
        out: The folder; made if missing.
        scenario: One or several of parking_lot, gym, yard, road; each becomes one recording.
        poses: Arm poses (dwells).
        pairs: Pairs of a scan and an image in each dwell. A few more are taken as the arm moves.
        seed: Same seed, same recording.
        format: ros1, mcap or sqlite3.
        lidar: os1_128, os1_64, avia or pandar_64.
        columns: Columns a turn of a spinning LiDAR: 512, 1024 or 2048; None for 2048 of the
            os1_128, 1024 of the os1_64.
        azimuth_window_deg: Sector ahead that it reports; all around for None.
        livox_message: What an avia's driver publishes: custom or pointcloud2.
        camera: zed2i, fisheye, atan, omni, equirectangular, or any camera.
        image_format: jpeg, png (compressed images), or raw bgr8, mono8, bayer_rggb8.
        quality: Of JPEG, 1 ... 100.
        width: Image width in pixels.
        height: Image height in pixels.
        rig: Hand-measured rig to simulate, or its file; a built-in one for None.
        joint_offset_std_deg: Deviation of the joints' constant zero-point errors; the built-in
            rig states it (`arm.joint_offset_std_deg`), the errors themselves it does not know.
        clock_offset_s: Added to the arm's stamps, beside the few milliseconds that every clock is
            off; truth.json has the arm's clock minus the camera's of each recording.
        motion_hz: Rate at which images are recorded while the arm moves, 15 at most; 0 for none
            but those of the shots.
        force: Replace recordings that exist.
        progress: Called with the scenario, shots done and shots in all.

    Returns:
        Paths of the recordings.

    Raises:
        SimulationError: Unknown choices, something in the way, or another tower in the folder.
    """
    names = [scenario] if isinstance(scenario, str) else list(scenario)
    check("scenario", names, SCENARIOS)
    check("recording format", [format], FORMATS)
    check("image format", [image_format], IMAGE_FORMATS)
    check("Livox message", [livox_message], LIVOX_MESSAGES)
    sensor = make_lidar(lidar, columns, azimuth_window_deg)
    lens = cameras.make_camera(camera, width, height) if isinstance(camera, str) else camera
    for label, number in (("poses", poses), ("pairs", pairs)):
        if number < 1:
            raise SimulationError(f"{number} {label}", "simulate 1 or more")
    if rig is None:
        kind = camera if isinstance(camera, str) else camera.model
        measured = default_rig(joint_offset_std_deg, lidar, kind)
    else:
        measured = rig if isinstance(rig, Rig) else load_rig(rig)
    paths = [bag_path(out, name, format) for name in names]
    for name in names:
        for other in FORMATS:
            if (path := bag_path(out, name, other)).exists() and not force:
                raise SimulationError(f"{path} exists", "give another folder, or --force")
    worlds = [World(name, seed, measured) for name in names]
    offsets = joint_offsets(worlds[0].arm, seed, joint_offset_std_deg)
    check_same_tower(out, measured, worlds[0].mounts, offsets, force)
    try:
        out.mkdir(parents=True, exist_ok=True)
        for world, path in zip(worlds, paths, strict=True):
            schedule = _schedule(world, poses, pairs, motion_hz)
            messages = _messages(
                world,
                schedule,
                clock_offset_s,
                (sensor, livox_message),
                lens,
                offsets,
                (image_format, quality),
                progress,
            )
            write_recording(path, format, messages)
            _, _, (_, camera_clock, arm_clock) = _start(world, clock_offset_s)
            difference = arm_clock.offset_s - camera_clock.offset_s
            write_truth(out, world, schedule.positions, offsets, difference)
            write_rig(out, measured)
    except OSError as error:
        raise SimulationError(
            f"{error.filename or out}: cannot be written ({error.strerror})",
            "give another folder, or free some space",
        ) from error
    return paths


def check(what: str, values: Sequence[object], allowed: Sequence[object]) -> None:
    """Refuse values that are not allowed.

    Raises:
        SimulationError: It names the first of them.
    """
    for value in values:
        if value not in allowed:
            raise SimulationError(
                f"unknown {what} {value!r}", f"choose from {', '.join(map(str, allowed))}"
            )


def write_recording(
    path: Path,
    format: str,
    messages: Iterable[tuple[int, Callable[[Bag], None]]],
    level: int = SMALL,
) -> None:
    """Write a recording that is there in full or not at all, in place of any of its name."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.stem}-") as temporary:
        draft = Path(temporary) / path.name
        with Bag(draft, format, level) as bag:
            for _, write in messages:
                write(bag)
        for other in FORMATS:
            _remove(bag_path(path.parent, path.stem, other))
        draft.replace(path)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _schedule(world: World, poses: int, pairs: int, motion_hz: float) -> Schedule:
    positions = np.array([world.pose(k) for k in range(poses)])
    return plan(positions, pairs, scenario_rng(world.seed, world.scenario, _CLOCKS, 0), motion_hz)


def _start(
    world: World, clock_offset_s: float
) -> tuple[np.random.Generator, int, tuple[Clock, Clock, Clock]]:
    """Chance from then on, when the recording starts, clocks of LiDAR, camera and arm."""
    rng = scenario_rng(world.seed, world.scenario, _CLOCKS, 1)
    start_ns = EPOCH_NS + int(rng.integers(10**6)) * 10**9 + int(rng.integers(10**9))
    lidar, camera, arm = clocks(rng)
    return rng, start_ns, (lidar, camera, replace(arm, offset_s=arm.offset_s + clock_offset_s))


def _messages(
    world: World,
    schedule: Schedule,
    clock_offset_s: float,
    lidar: tuple[Lidar, str],
    lens: Camera,
    offsets: Array,
    image: tuple[str, int],
    progress: Progress | None,
) -> Iterator[tuple[int, Callable[[Bag], None]]]:
    """What reaches the recorder, in the order in which it does; sensors run as it is read."""
    rng, start_ns, (lidar_clock, camera_clock, arm_clock) = _start(world, clock_offset_s)
    shots, frames = schedule.shots, schedule.frames
    scan_ns, scan_bag = lidar_clock.stamps(start_ns, np.array([s.scan_s for s in shots]), rng)
    image_ns, image_bag = camera_clock.stamps(start_ns, np.array([s.image_s for s in shots]), rng)
    times = np.arange(0.0, schedule.end_s, JOINT_PERIOD_S)
    times = times + rng.uniform(0, 3e-4, len(times))
    joint_ns, joint_bag = arm_clock.stamps(start_ns, times, rng)
    readings = _encoders(world, schedule, times, offsets, rng)
    frame_ns, frame_bag = camera_clock.stamps(start_ns, np.array([t for t, _ in frames]), rng)
    order = _NAMES_ORDER if len(world.arm.joint_names) == 6 else (None, *range(readings.shape[1]))
    joint_names = [FINGER if k is None else world.arm.joint_names[k] for k in order]
    finger = np.full((len(times), 1), 0.41)
    readings = np.hstack([finger if k is None else readings[:, [k]] for k in order])
    around = lru_cache(maxsize=1)(world.surroundings)
    sensor, livox_message = lidar
    columns = sensor.columns if isinstance(sensor, Ouster) else None
    done = [0]

    def cloud(k: int) -> Callable[[Bag], None]:
        def write(bag: Bag) -> None:
            shot = shots[k]
            records = world.scan(around(shot.pose, shot.pair), sensor, shot.pose, shot.pair)
            stamps = int(scan_ns[k]), int(scan_bag[k])
            bag.cloud(*stamps, records, columns, livox_message)
            done[0] += 1
            if progress:
                progress(f"simulate {world.scenario}", done[0], len(shots))

        return write

    def picture(k: int) -> Callable[[Bag], None]:
        def write(bag: Bag) -> None:
            shot, stamp, received = shots[k], int(image_ns[k]), int(image_bag[k])
            there = schedule.blend(schedule.positions, np.array([shot.image_s]))[0]
            scene, at = around(shot.pose, shot.pair), world.T_world_camera(there)
            bag.image(stamp, received, world.picture(scene, lens, at, shot.pose, shot.pair), *image)
            bag.camera_info(stamp, received, lens)

        return write

    def frame(k: int) -> Callable[[Bag], None]:
        def write(bag: Bag) -> None:
            (time, pose), stamp, received = frames[k], int(frame_ns[k]), int(frame_bag[k])
            there = schedule.blend(schedule.positions, np.array([time]))[0]
            scene, at = around(pose, _ON_THE_WAY), world.T_world_camera(there)
            picture = world.picture(scene, lens, at, pose, _ON_THE_WAY + k)
            bag.image(stamp, received, picture, *image)
            bag.camera_info(stamp, received, lens)

        return write

    def joints(k: int) -> Callable[[Bag], None]:
        return lambda bag: bag.joints(int(joint_ns[k]), int(joint_bag[k]), joint_names, readings[k])

    events = [(int(scan_bag[k]), cloud(k)) for k in range(len(shots))]
    events += [(int(image_bag[k]), picture(k)) for k in range(len(shots))]
    events += [(int(frame_bag[k]), frame(k)) for k in range(len(frames))]
    events += [(int(joint_bag[k]), joints(k)) for k in range(len(times))]
    ouster = type(sensor) is Ouster  # others have no frames of their own
    yield start_ns, lambda bag: bag.static_transforms(start_ns, start_ns, ouster)
    yield from sorted(events, key=lambda event: event[0])


def _encoders(
    world: World, schedule: Schedule, times: Array, offsets: Array, rng: np.random.Generator
) -> Array:
    """(T, n) readings in radians: truth less the zero-point offsets, plus what encoders add.

    Gear and backlash make an error that stays as long as the arm stands; the white noise on top
    is much smaller. Readings are whole counts.
    """
    std = np.deg2rad(world.rig.arm.encoder_std_deg)
    standing = rng.normal(scale=std, size=schedule.positions.shape)
    read = schedule.blend(schedule.positions + standing - offsets, times)
    read += rng.normal(scale=_WHITE_NOISE * std, size=read.shape)
    return np.asarray(np.rint(read / _COUNT_RAD) * _COUNT_RAD)
