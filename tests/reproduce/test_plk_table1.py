"""PLK-Calib's Table I, run again."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from lcdata.cli.app import app
from lcdata.errors import LcdataError
from lcdata.features.line_solver import Problem, solve_decoupled, solve_projection
from lcdata.geometry import se3
from lcdata.reproduce import find
from lcdata.reproduce.experiment import Settings, checked_options
from lcdata.reproduce.line_cases import CASES, lines
from lcdata.reproduce.line_monte_carlo import Problems, decoupled, projection
from lcdata.reproduce.plk_table1 import PAPER, T_CAMERA_LIDAR, K

WELL_POSED = ("normal", "coplanar")


def problems(case: str, runs: int, count: int, noise: float, seed: int = 5) -> Problems:
    rng = np.random.default_rng(seed)
    camera = np.stack([lines(case, rng, count) for _ in range(runs)])
    pixels = camera @ K.T
    image = pixels[..., :2] / pixels[..., 2:] + rng.normal(0, noise, (runs, count, 2, 2))
    lidar = se3.apply(se3.inverse(T_CAMERA_LIDAR), camera.reshape(-1, 3)).reshape(camera.shape)
    start = se3.exp([0.05, -0.05, 0.05, 0.01, 0.01, -0.01]) @ T_CAMERA_LIDAR
    return Problems(lidar, image, K, np.tile(start, (runs, 1, 1)))


@pytest.mark.parametrize("case", WELL_POSED)
@pytest.mark.parametrize("solve", [projection, decoupled])
def test_exact_lines_give_the_exact_pose(case, solve):
    found = solve(problems(case, 20, 5, 0.0))
    assert np.abs(found - T_CAMERA_LIDAR).max() < 1e-8


@pytest.mark.parametrize(
    ("batched", "single"), [(projection, solve_projection), (decoupled, solve_decoupled)]
)
def test_batches_agree_with_the_line_methods(batched, single):
    """The calibrators weigh lines; with many good lines both come to nearly the same."""
    many = problems("normal", 5, 40, 0.2)
    for i, T in enumerate(batched(many)):
        normalised = (many.image[i] - K[:2, 2]) / K[0, 0]
        sigma = np.full(40, 0.2 / K[0, 0])
        problem = Problem(many.segments[i], normalised, sigma, np.full(40, 1e-6))
        other = single(problem, many.T_initial[i]).T_camera_lidar
        for pose in (T, other):
            assert np.rad2deg(se3.rotation_error(pose, T_CAMERA_LIDAR)) < 0.15
            assert se3.translation_error(pose, T_CAMERA_LIDAR) < 0.03


@pytest.mark.parametrize("case", CASES)
def test_lines_are_what_their_case_says(case):
    rng = np.random.default_rng(1)
    for _ in range(20):
        segments = lines(case, rng, 3)
        d = segments[:, 1] - segments[:, 0]
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        apart = np.abs(np.cross(d[0], d[1:])).max()
        assert (apart < 1e-9) == case.endswith("parallel")
        flat = np.linalg.svd(segments.reshape(-1, 3) - segments[0, 0])[1]
        assert (flat[2] < 1e-9) == case.startswith("coplanar")
        if case == "concurrent":
            A = np.concatenate([np.eye(3) - np.outer(u, u) for u in d])
            b = np.concatenate(
                [(np.eye(3) - np.outer(u, u)) @ s[0] for u, s in zip(d, segments, strict=True)]
            )
            assert np.linalg.lstsq(A, b, rcond=None)[1].max() < 1e-12


def test_what_cannot_be_determined_is_flagged():
    values = find("plk-table1").run(Settings(runs=100), None).values
    for case in CASES:
        flagged = values[f"{case}/Method I (projection)"]["flagged"]
        assert flagged < 0.3 if case in WELL_POSED else flagged == 1.0


def test_method_one_is_the_better_with_many_lines():
    values = find("plk-table1").run(Settings(runs=200, options={"lines": "12"}), None).values
    one, two = (values[f"normal/{m}"] for m in ("Method I (projection)", "Method II (PLK-Calib)"))
    for quantity in ("rotation_deg", "translation_m"):
        assert one[quantity]["median"] < two[quantity]["median"]


def test_the_command_writes_what_it_prints(tmp_path):
    done = CliRunner().invoke(
        app, ["reproduce", "plk-table1", "--runs", "20", "-o", str(tmp_path), "--set", "noise-px=2"]
    )
    assert done.exit_code == 0, done.output
    for cells in PAPER.values():
        assert all(cell in done.output for cell in cells)
    stored = json.loads((tmp_path / "plk-table1.json").read_text())
    assert "2 px of" in stored["protocol"] and len(stored["tables"][0]["rows"]) == 2 * len(CASES)
    assert (tmp_path / "plk-table1.md").read_text().startswith("# plk-table1")
    assert len((tmp_path / "plk-table1.csv").read_text().splitlines()) == 1 + 2 * len(CASES)
    listed = CliRunner().invoke(app, ["reproduce"])
    assert "plk-table1" in listed.output and "--set lines" in listed.output


def test_bad_options_are_named(tmp_path):
    with pytest.raises(LcdataError, match="did you mean 'plk-table1'"):
        find("plk-table")
    experiment = find("plk-table1")
    with pytest.raises(LcdataError, match="did you mean 'lines'"):
        checked_options(experiment, ["line=3"])
    with pytest.raises(LcdataError, match="NAME=VALUE"):
        checked_options(experiment, ["lines"])
    bad = [("lines", "2"), ("lines", "many"), ("lines", "3.5"), ("lines", "nan")]
    bad += [("noise-px", "-1"), ("noise-px", "nan"), ("init-rotation", "inf")]
    for name, value in bad:
        with pytest.raises(LcdataError):
            experiment.run(Settings(runs=1, options={name: value}), None)
