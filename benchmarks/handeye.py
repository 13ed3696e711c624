"""The hand-eye solver: exact data, wrong poses, time, and refined rigs against their truth.

    python benchmarks/handeye.py

Simulated estimates: 0.3 deg and 3 cm of noise on each axis, arm poses of +-30 deg about three
axes. Then whole rigs: mounts that are off the hand measurement by its standard deviations (5 mm
and 0.5 deg on each axis), a Gen3 lite with and without joint offsets, and estimates with the
noise of the line methods on one simulated pair (6 mm and 0.04 deg on each axis): how far is the
ground truth of the poses off before and after, and does the covariance say so? Times are of the
processor, on one core.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from lcdata.arm import Arm
from lcdata.geometry import se3
from lcdata.groundtruth.handeye_input import closed_form
from lcdata.handeye import Joints, Prior, solve

X = se3.exp([0.02, -0.04, 0.06, 1.2, -1.1, 0.9])
Z = se3.exp([0.1, -0.2, 0.5, 0.1, 0.05, 1.5])
CENTRE = se3.exp([0.3, 0.2, 0.4, 0.1, 2.0, 0.5])
NOISE = np.repeat([0.03, np.deg2rad(0.3)], 3)
LINES = np.repeat([0.006, np.deg2rad(0.04)], 3)
MOUNT = np.repeat([0.005, np.deg2rad(0.5)], 3)


def arm_poses(rng, n):
    shifts, turns = rng.uniform(-0.3, 0.3, (n, 3)), np.deg2rad(rng.uniform(-30, 30, (n, 3)))
    return np.array([se3.exp([*t, *r]) @ CENTRE for t, r in zip(shifts, turns, strict=True)])


def noisy(rng, T, std):
    return np.array([se3.exp(rng.normal(0, 1, 6) * std) for _ in T]) @ T


def errors(T, truth):
    """(N, 2) degrees and metres."""
    return np.array(
        [
            (np.rad2deg(se3.rotation_error(a, b)), se3.translation_error(a, b))
            for a, b in zip(T, truth, strict=True)
        ]
    )


def verdict(reached):
    return "reached" if reached else "missed"


def exact(runs):
    worst = 0.0
    for seed in range(runs):
        A = arm_poses(np.random.default_rng(seed), 20)
        found = solve(A, X @ A @ Z)
        worst = max(
            worst,
            np.abs(found.T_camera_effector - X).max(),
            np.abs(found.T_base_lidar - Z).max(),
        )
    print(f"exact data: largest difference {worst:.1e} (target 1e-9: {verdict(worst < 1e-9)})")


def wrong_poses(runs):
    links = {"closed form": [], "solve": [], "solve without the wrong ones": []}
    ratios, seconds = [], []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        A = arm_poses(rng, 20)
        truth = X @ A @ Z
        T = noisy(rng, truth, NOISE)
        T[:3] = noisy(rng, truth[:3], 10 * NOISE)
        started = time.process_time()
        found = solve(A, T)
        seconds.append(time.process_time() - started)
        without = solve(A[3:], T[3:])
        for name, link in (
            ("closed form", closed_form(A, T)[0]),
            ("solve", found.T_camera_effector),
            ("solve without the wrong ones", without.T_camera_effector),
        ):
            links[name].append(errors([link], [X])[0])
        ratios.append(links["solve"][-1] / links["solve without the wrong ones"][-1])
    print("3 of 20 poses at tenfold noise, T_camera_effector (median):")
    for name, found in links.items():
        degrees, metres = np.median(found, axis=0)
        print(f"  {name:30s} {degrees:.3f} deg {1e2 * metres:.2f} cm")
    worst, above = np.max(ratios), np.sum(np.array(ratios) >= 1.5)
    print(f"  ratio: median {np.median(ratios):.3f}, 1.5 or more in {above} of {runs} runs")
    print(f"  ratio, the worst of {runs} runs: {worst:.3f} (target 1.5: {verdict(worst < 1.5)})")
    ms = 1e3 * np.median(seconds)
    print(f"20 poses: {ms:.1f} ms (target 20: {verdict(ms < 20)})")


def rigs(runs, poses, offsets_deg):
    """True mounts off the rig by its standard deviations, and joints with offsets."""
    arm = Arm.load("gen3_lite")
    covariance = np.diag(MOUNT**2)
    before, after, squares = [], [], []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        low = np.array([-1.2, -1.0, 0.2, -1.0, -1.5, -1.0])
        q = rng.uniform(low, low + np.array([2.4, 1.2, 1.6, 2.0, 1.4, 2.0]), (poses, 6))
        A = se3.inverse(arm.chain().forward(q))
        offsets = np.deg2rad(rng.normal(0, offsets_deg, 6))
        truth = X @ se3.inverse(arm.chain().forward(q + offsets)) @ Z
        measured = [se3.exp(rng.normal(0, 1, 6) * MOUNT) @ link for link in (X, Z)]
        T = noisy(rng, truth, LINES)
        joints = Joints(arm, q, offsets_deg) if offsets_deg else None
        weights = np.tile(np.diag(LINES**2), (poses, 1, 1))
        prior = Prior(*measured, covariance, covariance)
        found = solve(A, T, weights=weights, prior=prior, joints=joints)
        fixed = se3.inverse(arm.chain().forward(q + found.joint_offsets)) if joints else A
        before.append(np.median(errors(measured[0] @ A @ measured[1], truth), axis=0))
        after.append(np.median(errors(found.extrinsic(fixed), truth), axis=0))
        xi = np.concatenate(
            [
                se3.log(X @ se3.inverse(found.T_camera_effector)),
                se3.log(Z @ se3.inverse(found.T_base_lidar)),
            ]
        )
        squares.append(xi @ np.linalg.solve(found.covariance, xi) / 12)
    (d0, m0), (d1, m1) = np.median(before, axis=0), np.median(after, axis=0)
    print(
        f"{runs} rigs, {poses} poses, joint offsets of {offsets_deg} deg: ground truth "
        f"{d0:.3f} deg {1e3 * m0:.1f} mm by hand, {d1:.3f} deg {1e3 * m1:.1f} mm refined "
        f"(target a third: {verdict(max(d1 / d0, m1 / m0) < 1 / 3)}); "
        f"normalised squared error of the links {np.mean(squares):.2f} "
        f"(target 0.8 to 1.25: {verdict(0.8 < np.mean(squares) < 1.25)})"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100)
    options = parser.parse_args()
    exact(min(options.runs, 20))
    wrong_poses(options.runs)
    for poses in (15, 60):
        for offsets_deg in (0.0, 0.5):
            rigs(options.runs, poses, offsets_deg)


if __name__ == "__main__":
    main()
