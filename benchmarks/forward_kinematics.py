"""Forward kinematics and covariance of many joint samples against a plain Pinocchio loop.

    python benchmarks/forward_kinematics.py --samples 1000000

Both give the effector's pose and J diag(variance) J^T in its own axes. The loop is what one
writes with Pinocchio and NumPy; `poses only` leaves the covariance out on both sides. Times are
of the processor, on one core, after the kernels are compiled.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pinocchio

from lcdata.arm import Arm

CHUNK = 50_000


def loop(arm, positions, variance, covariance):
    data, frame = arm.model.createData(), arm.model.getFrameId(arm.effector_frame)
    poses = np.empty((len(positions), 4, 4))
    covariances = np.empty((len(positions), 6, 6)) if covariance else None
    for i, q in enumerate(positions):
        if covariance:
            pinocchio.computeJointJacobians(arm.model, data, q)
            J = pinocchio.getFrameJacobian(arm.model, data, frame, pinocchio.LOCAL)
            covariances[i] = (J * variance) @ J.T
        else:
            pinocchio.forwardKinematics(arm.model, data, q)
        pinocchio.updateFramePlacement(arm.model, data, frame)
        poses[i] = data.oMf[frame].homogeneous
    return poses, covariances


def bare_loop(arm, positions):
    """The fastest loop there is: nothing is read back from Pinocchio."""
    model, data = arm.model, arm.model.createData()
    for q in positions:
        pinocchio.forwardKinematics(model, data, q)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--arm", default="gen3_lite")
    options = parser.parse_args()
    arm = Arm.load(options.arm)
    rng = np.random.default_rng(0)
    std = np.deg2rad(rng.uniform(0.01, 0.1, len(arm.joint_names)))
    arm.forward_many(np.zeros((1, len(std))))
    arm.covariance_many(np.zeros((1, len(std))), std)
    seconds = dict.fromkeys(("bare", "loop", "loop_poses", "many", "many_poses"), 0.0)
    worst = 0.0

    def timed(name, call):
        started = time.process_time()
        result = call()
        seconds[name] += time.process_time() - started
        return result

    for start in range(0, options.samples, CHUNK):
        size = min(CHUNK, options.samples - start)
        q = rng.uniform(-np.pi, np.pi, (size, len(std)))
        timed("bare", lambda q=q: bare_loop(arm, q))
        timed("loop_poses", lambda q=q: loop(arm, q, std**2, covariance=False))
        T, C = timed("loop", lambda q=q: loop(arm, q, std**2, covariance=True))
        poses = timed("many_poses", lambda q=q: arm.forward_many(q))
        T_many, C_many = timed("many", lambda q=q: arm.covariance_many(q, std))
        for a, b in ((T, T_many), (C, C_many), (T, poses)):
            worst = max(worst, float(np.abs(a - b).max()))
    rate = {name: options.samples / value / 1e6 for name, value in seconds.items()}
    print(f"{options.samples} samples of {arm.urdf.stem}, largest difference {worst:.1e}")
    for label, mine, theirs in (
        ("poses and covariances", "many", "loop"),
        ("poses only", "many_poses", "loop_poses"),
        ("poses only, loop that reads nothing back", "many_poses", "bare"),
    ):
        print(
            f"{label}: {rate[mine]:.2f} M/s, Pinocchio loop {rate[theirs]:.2f} M/s, "
            f"ratio {seconds[theirs] / seconds[mine]:.1f}"
        )
    reached = seconds["loop"] >= 2 * seconds["many"] and worst <= 1e-12
    print(f"target ratio 2, difference 1e-12: {'reached' if reached else 'missed'}")


if __name__ == "__main__":
    main()
