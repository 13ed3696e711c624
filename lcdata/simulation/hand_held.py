"""Recordings of a LiDAR and a camera on one frame that a hand moves; no arm."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import SimulationError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.rig import Rig
from lcdata.simulation import camera as cameras
from lcdata.simulation.bag import FORMATS, LIVOX_MESSAGES, Bag, bag_path
from lcdata.simulation.lidar import Ouster
from lcdata.simulation.lidars import Lidar, make_lidar
from lcdata.simulation.mounts import default_rig
from lcdata.simulation.record import EPOCH_NS, Progress, check, write_recording
from lcdata.simulation.scenes import SCENARIOS, scenario_rng
from lcdata.simulation.schedule import clocks
from lcdata.simulation.truth import RIG, TRUTH, replace_file
from lcdata.simulation.world import World

Array = NDArray[np.float64]

_CLOCKS, _MOUNT, _LENS = 8, 9, 10
_LINK = {
    "translation_m": [0.02, -0.09, 0.04],
    "rotation_rpy_deg": [91.0, -89.0, 1.0],
    "translation_std_m": 0.004,
    "rotation_std_deg": 0.3,
}
"""T_camera_lidar as somebody measured it: the camera looks where the LiDAR's x axis points."""


def simulate_hand_held(
    out: Path,
    *,
    scenario: str | Sequence[str] = "gym",
    seconds: float = 5.0,
    seed: int = 0,
    format: str = "mcap",
    lidar: str = "os1_64",
    columns: int | None = None,
    livox_message: str = "custom",
    camera: str | Camera = "zed2i",
    image_hz: float = 1.0,
    width: int = 1280,
    height: int = 720,
    force: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Write recordings of a LiDAR that moves while it scans, `rig.yaml` and `truth.json`.

    The frame with both sensors starts from rest, at the first scan, and is moved up and down.
    Every scan of the LiDAR is recorded; the first image is taken during the first scan.

    Args:
        out: The folder; made if missing.
        scenario: One or several of parking_lot, gym, yard, road; each becomes one recording.
        seconds: How long the motion takes.
        seed: Same seed, same recording.
        format: ros1, mcap or sqlite3.
        lidar: os1_128, os1_64, avia or pandar_64.
        columns: Columns a turn of a spinning LiDAR; None for the usual.
        livox_message: What an avia's driver publishes: custom or pointcloud2.
        camera: zed2i, fisheye, atan, omni, equirectangular, or any camera.
        image_hz: Images a second.
        width: Image width in pixels.
        height: Image height in pixels.
        force: Replace what is there.
        progress: Called with the scenario, scans done and scans in all.

    Returns:
        Paths of the recordings.

    Raises:
        SimulationError: Unknown choices, or something in the way.
    """
    names = [scenario] if isinstance(scenario, str) else list(scenario)
    check("scenario", names, SCENARIOS)
    check("recording format", [format], FORMATS)
    check("Livox message", [livox_message], LIVOX_MESSAGES)
    sensor = make_lidar(lidar, columns)
    lens = cameras.make_camera(camera, width, height) if isinstance(camera, str) else camera
    if not seconds * 1e9 >= sensor.scan_ns:
        raise SimulationError(f"{seconds:g} s of motion", "simulate 0.1 s or more")
    paths = [bag_path(out, name, format) for name in names]
    taken = [out / TRUTH, *(bag_path(out, name, kind) for name in names for kind in FORMATS)]
    for path in taken:
        if path.exists() and not force:
            raise SimulationError(f"{path} exists", "give another folder, or --force")
    rig = Rig.from_dict(
        {
            "ground_truth": "static",
            "note": f"Simulated {lidar} and {lens.model} camera on a frame that a hand moves.",
            "simulated": True,
            "T_camera_lidar": _LINK,
            "integration": "dynamic",
        },
        "the simulator's rig",
    )
    assert rig.T_camera_lidar is not None
    rng = scenario_rng(seed, "", _MOUNT)
    xi = rng.normal(size=6) * np.sqrt(np.diag(rig.T_camera_lidar.covariance))
    T_camera_lidar = se3.exp(xi) @ rig.T_camera_lidar.T
    truth = {"simulated": True, "seed": seed, "T_camera_lidar": T_camera_lidar.tolist()}
    motions: dict[str, object] = {}
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, path in zip(names, paths, strict=True):
            world = World(name, seed, default_rig())
            start_ns, events = _events(
                world, sensor, lens, T_camera_lidar, seconds, image_hz, livox_message, progress
            )
            write_recording(path, format, events, level=3)
            times = np.arange(0.0, seconds + 1e-9, 0.05)
            T = world.hand_motion(0, 0)(times)
            motions[name] = {
                "start_ns": start_ns,
                "seconds": times.tolist(),
                "T_start_lidar": T.tolist(),
            }
        replace_file(out / RIG, rig.to_yaml())
        replace_file(out / TRUTH, json.dumps({**truth, "motions": motions}) + "\n")
    except OSError as error:
        raise SimulationError(
            f"{error.filename or out}: cannot be written ({error.strerror})",
            "give another folder, or free some space",
        ) from error
    return paths


def _events(
    world: World,
    lidar: Lidar,
    lens: Camera,
    T_camera_lidar: Array,
    seconds: float,
    image_hz: float,
    livox_message: str,
    progress: Progress | None,
) -> tuple[int, Iterator[tuple[int, Callable[[Bag], None]]]]:
    """Stamp of the first scan, and what reaches the recorder, in the order in which it does."""
    rng = scenario_rng(world.seed, world.scenario, _CLOCKS)
    start_ns = EPOCH_NS + int(rng.integers(10**6)) * 10**9 + int(rng.integers(10**9))
    lidar_clock, camera_clock, _ = clocks(rng)
    scans = np.array(
        np.arange(round(seconds * 1e9 / lidar.scan_ns)) * lidar.scan_ns * 1e-9, np.float64
    )
    images = np.array(0.02 + np.arange(max(1, int(seconds * image_hz))) / image_hz, np.float64)
    scan_ns, scan_bag = lidar_clock.stamps(start_ns, scans, rng)
    image_ns, image_bag = camera_clock.stamps(start_ns, images, rng)
    motion = world.hand_motion(0, 0)
    around = world.surroundings(0, 0)
    columns = lidar.columns if isinstance(lidar, Ouster) else None

    def cloud(k: int) -> Callable[[Bag], None]:
        def write(bag: Bag) -> None:
            records = world.scan(around, lidar, 0, 0, k, motion)
            bag.cloud(int(scan_ns[k]), int(scan_bag[k]), records, columns, livox_message)
            if progress:
                progress(f"simulate {world.scenario}", k + 1, len(scans))

        return write

    def picture(k: int) -> Callable[[Bag], None]:
        def write(bag: Bag) -> None:
            stamps = int(image_ns[k]), int(image_bag[k])
            T_world_lidar = world.T_world_lidar @ motion(images[k])
            chance = scenario_rng(world.seed, world.scenario, _LENS, k)
            pixels = cameras.render(
                around,
                world.scene.light,
                lens,
                T_world_lidar @ se3.inverse(T_camera_lidar),
                chance,
            )
            bag.image(*stamps, pixels, "jpeg", 85)
            bag.camera_info(*stamps, lens)

        return write

    events = [(int(scan_bag[k]), cloud(k)) for k in range(len(scans))]
    events += [(int(image_bag[k]), picture(k)) for k in range(len(images))]
    return int(scan_ns[0]), iter(sorted(events, key=lambda event: event[0]))
