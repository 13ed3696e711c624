"""A real arm against its model: ball-in-socket readings, held out by place of the tool.

    python benchmarks/arm_calibration.py DATA --arm gen3_lite

DATA has the layout of Kinova Gen3 lite readings published with platonics-delft's
kinematics_calibration: TOOL/hole_0.csv and TOOL/hole_1.csv, 50 mm apart.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from lcdata.arm import Arm
from lcdata.groundtruth.arm_calibration import calibrate_arm, read_sockets


def show(label, found, seconds):
    print(
        f"{label}: scatter nominal {found.nominal_rms_mm:.2f} mm RMS, fitted "
        f"{found.fitted_rms_mm:.2f}; held out nominal {found.heldout_nominal_rms_mm:.2f}, fitted "
        f"{found.heldout_rms_mm:.2f} (max {found.heldout_max_mm:.1f}; "
        f"{found.heldout_steady_rms_mm:.2f} about steady sockets); sockets "
        f"{found.socket_distance_mm:.2f} mm apart; {found.readings} readings, {seconds:.1f} s"
    )
    for name, value in found.offsets_deg.items():
        print(f"  {name} {value:+.2f} +- {found.offsets_std_deg[name]:.2f} deg")
    print(f"  not determined: {', '.join(found.undetermined) or 'nothing'}")
    print(f"  moved: {', '.join(found.moved) or 'nothing'}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--arm", default="gen3_lite")
    options = parser.parse_args()
    arm = Arm.load(options.arm)
    sockets = read_sockets(options.data, arm.joint_names)
    for label, settings, target in (
        ("joint offsets", {}, 3.7),
        ("joint offsets, distance of sockets not used", {"socket_distance_m": None}, 3.7),
        ("kinematic parameters", {"kinematics": True}, 2.5),
    ):
        started = time.process_time()
        found = calibrate_arm(arm, sockets, **settings)
        show(label, found, time.process_time() - started)
        reached = found.heldout_rms_mm <= target
        print(f"  target {target} mm held out: {'reached' if reached else 'missed'}")


if __name__ == "__main__":
    main()
