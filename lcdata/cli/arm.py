"""lcdata arm: what one arm is like, as opposed to its model."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lcdata.cli.common import JsonFlag, guarded, print_json, progress_bar
from lcdata.errors import GroundTruthError

if TYPE_CHECKING:
    from lcdata.groundtruth.arm_calibration import ArmCalibration

EXAMPLE = "lcdata arm calibrate readings --arm gen3_lite --serial GL12 -o GL12.yaml"

app = typer.Typer(
    name="arm",
    help="Errors of one arm against its model.",
    no_args_is_help=True,
    add_completion=False,
)


@app.command(epilog=f"Example:  {EXAMPLE}")
@guarded
def calibrate(
    data: Annotated[
        Path,
        typer.Argument(
            help="Folder of TOOL/SOCKET.csv, or one CSV with tool,socket,joint_1,...",
            show_default=False,
        ),
    ],
    arm: Annotated[
        str, typer.Option(help="Arm model: a name, a URDF file, example-robot-data:ur5.")
    ] = "gen3_lite",
    base_frame: Annotated[str, typer.Option(help="Frame the arm stands on.")] = "base_link",
    effector_frame: Annotated[
        str, typer.Option(help="Frame that carries the ball.")
    ] = "end_effector_link",
    kinematics: Annotated[
        bool,
        typer.Option("--kinematics", help="Fit a small twist of each link too (figures only)."),
    ] = False,
    serial: Annotated[
        str | None, typer.Option(help="Serial number; default: the name of the file written.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Joint-offsets file for a rig to name.")
    ] = None,
    socket_distance: Annotated[
        str, typer.Option(help="Distance of hole_0 and hole_1 of a tool in m, or none.")
    ] = "0.05",
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Joint offsets of one arm from encoder readings with a ball in fixed sockets."""
    from lcdata.arm import Arm
    from lcdata.dataset.atomic import write_bytes
    from lcdata.groundtruth.arm_calibration import calibrate_arm, read_sockets

    distance = _distance(socket_distance)
    if out is not None and out.exists() and not force:
        raise GroundTruthError(f"{out} exists", "give another file, or --force")
    model = Arm.load(arm, base_frame=base_frame, effector_frame=effector_frame)
    sockets = read_sockets(data, model.joint_names)
    found = calibrate_arm(model, sockets, kinematics=kinematics, socket_distance_m=distance)
    if out is not None:
        # Offsets that were fitted beside link twists are not right without them, and a rig's
        # arm has its model's links.
        alone = calibrate_arm(model, sockets, socket_distance_m=distance) if kinematics else found
        write_bytes(out, alone.offsets_yaml(serial or out.stem).encode())
    if as_json:
        print_json(
            {"arm": arm, "serial": serial, "kinematics": kinematics, "file": out, **found.to_dict()}
        )
        return
    print("\n".join(_lines(found)))
    if out is not None:
        note = " (fitted without link twists, which it does not hold)" if kinematics else ""
        print(f"\n{out}: name it in a rig as arm: {{joint_offsets: {out.name}}}{note}")


CLOCK_EXAMPLE = "lcdata arm clock recordings/gym --rig recordings/rig.yaml"


@app.command(epilog=f"Example:  {CLOCK_EXAMPLE}")
@guarded
def clock(
    recording: Annotated[Path, typer.Argument(help="A bag or a ROS 2 folder.", show_default=False)],
    rig: Annotated[
        Path | None, typer.Option(help="Rig file; default: rig.yaml beside the recording.")
    ] = None,
    images: Annotated[
        int | None, typer.Option(min=3, help="At most so many images; default: enough.")
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Offset between the clocks of arm and camera, from images taken while the arm moves."""
    from dataclasses import asdict

    from lcdata.evaluation.clock_offset import clock_offset
    from lcdata.recording.source import find_recordings
    from lcdata.rig import RIG_FILE, find_rig, load_rig

    found = rig or find_rig(recording) or recording.parent / RIG_FILE
    paths = find_recordings(recording)
    with progress_bar(quiet=as_json) as progress:
        offsets = {
            path: clock_offset(path, load_rig(found), images=images, progress=progress)
            for path in paths
        }
    if as_json:
        print_json({"recordings": [{"path": p, **asdict(o)} for p, o in offsets.items()]})
        return
    for path, offset in offsets.items():
        verdict = "" if offset.significant else ", nothing that can be told from none"
        used = f"{offset.moving} images in motion and {offset.still} in dwells, against scans"
        if offset.source == "motion":
            used = f"{offset.moving} turns of the moving camera"
        print(f"{path}: arm clock - camera clock = {offset} from {used}{verdict}")


def _distance(text: str) -> float | None:
    if text.strip().lower() == "none":
        return None
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value < 10:
        raise GroundTruthError(
            f"socket distance {text!r}", "give metres (0.05), or none if it is not known"
        )
    return value


def _lines(found: ArmCalibration) -> list[str]:
    """The result for people."""
    lines = [
        f"{found.readings} readings      all       held out by place of the tool",
        f"  nominal      {_mm(found.nominal_rms_mm)}   {_mm(found.heldout_nominal_rms_mm)}",
        f"  fitted       {_mm(found.fitted_rms_mm)}   {_mm(found.heldout_rms_mm)}"
        f"   largest {_mm(found.heldout_max_mm).strip()}",
        "  (RMS distance of a reading's ball from the mean of its socket)",
    ]
    if isfinite(found.socket_distance_mm):
        lines.append(f"  sockets of a tool are {found.socket_distance_mm:.1f} mm apart, held out")
    lines += ["", "joint offsets, degrees to add to a reading"]
    std = found.offsets_std_deg
    lines += [f"  {name:<12} {x:+7.3f} +- {std[name]:.3f}" for name, x in found.offsets_deg.items()]
    lines += ["", *(f"not determined: {name}" for name in found.undetermined)]
    lines += [f"moved while it was measured: {socket}" for socket in found.moved]
    return lines if lines[-1] else lines[:-1]


def _mm(value: float) -> str:
    return f"{value:6.2f} mm" if isfinite(value) else "        -"
