"""Methods from initial guesses of one's own: picks, matches of a file."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import toy_dataset
from toy_methods import Biased, Blobs
from typer.testing import CliRunner

from lcdata.calibrators.base import Calibration
from lcdata.cli.app import app
from lcdata.dataset import Dataset
from lcdata.dataset.picks import picks_path, write_picks
from lcdata.errors import CalibrationError
from lcdata.evaluation import read_results, run_trials
from lcdata.evaluation.automatic import source_of
from lcdata.evaluation.given import given_guesses
from lcdata.features.point_pose import point_pose
from lcdata.geometry import se3
from lcdata.pair import Pair
from lcdata.report import write_report
from lcdata.review import save_review


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return toy_dataset.make(tmp_path_factory.mktemp("given") / "set")


def matches(dataset: Dataset, pair_id: str, noise: float = 0.0, count: int = 10) -> np.ndarray:
    pair = dataset.load(pair_id)
    rng = np.random.default_rng(0)
    bearings = pair.camera.unproject(
        rng.uniform([5, 5], [pair.camera.width - 6, pair.camera.height - 6], (count, 2))
    )
    seen = bearings * rng.uniform(2, 9, (count, 1))
    points = se3.apply(se3.inverse(pair.T_camera_lidar), seen)
    pixels = pair.camera.project(seen)[0] + rng.normal(0, noise, (count, 2))
    return np.concatenate([pixels, points], axis=1)


def pick(dataset: Dataset, pair_id: str, noise: float) -> np.ndarray:
    found = matches(dataset, pair_id, noise)
    camera = dataset.camera(dataset.pair(pair_id).scenario)
    pose = point_pose(found[:, 2:], found[:, :2], camera)
    write_picks(dataset, pair_id, found, pose)
    return pose.T_camera_lidar


def test_methods_start_from_picks_and_again_when_they_change(dataset: Dataset) -> None:
    with pytest.raises(CalibrationError, match="has no picks: `lcdata pick DATASET PAIR`"):
        given_guesses(dataset, "picks")
    chosen = dataset.pairs[0]
    picked = pick(dataset, chosen.pair_id, 0.3)
    source, initial = given_guesses(dataset, "picks")
    assert source == "picks"
    of_pose = {r.pair_id for r in dataset.pairs if r.pose_id == chosen.pose_id}
    assert set(initial) == of_pose

    results = run_trials(dataset, [Blobs()], initial=initial, source=source, jobs=0)
    assert {t.pair_ids[0] for t in results.trials} == of_pose
    for t in results.trials:
        np.testing.assert_allclose(t.T_camera_lidar_initial, picked, atol=1e-12)
        truth = dataset.pose(t.pose_id).T_camera_lidar
        expected = np.rad2deg(se3.rotation_error(picked, truth))
        assert t.initial_rotation_error_deg == pytest.approx(expected)
        assert t.run == "init-picks" and np.isnan(t.init_rotation_deg) and not t.rebased

    # What is stored stays; another method starts there too.
    stored = {t.key: t.seconds for t in read_results(dataset, "init-picks").trials}
    run_trials(dataset, [Blobs(), Biased()], initial=initial, source=source, jobs=0)
    both = read_results(dataset, "init-picks").trials
    assert len(both) == 2 * len(of_pose)
    assert {t.key: t.seconds for t in both if t.method == Blobs.name} == stored

    # Picked again: what started elsewhere is computed again.
    moved = pick(dataset, chosen.pair_id, 1.0)
    _, initial = given_guesses(dataset, "picks")
    again = run_trials(dataset, [Blobs()], initial=initial, source=source, jobs=0)
    for t in again.trials:
        np.testing.assert_allclose(t.T_camera_lidar_initial, moved, atol=1e-12)

    # Jointly, and on a report's page.
    joint = run_trials(dataset, [Blobs()], initial=initial, source=source, group="pose", jobs=0)
    assert [t.run for t in joint.trials] == ["init-picks-pose"]
    run_trials(dataset, [Blobs()], jobs=0)
    page = write_report(dataset).read_text()
    assert "From initial guesses that were given (init-picks)" in page
    assert "an initial guess that was given" in page and "nan" not in page.split("<body>")[1][:4000]
    picks_path(dataset, chosen.pair_id).unlink()


def test_methods_start_from_matches_of_a_file(dataset: Dataset, tmp_path: Path) -> None:
    pair_id = dataset.pairs[-1].pair_id
    rows = [",".join([pair_id, *map(repr, row)]) for row in matches(dataset, pair_id).tolist()]
    path = tmp_path / "my matches.csv"
    path.write_text("\n".join(["pair_id,u,v,x,y,z", *rows]))
    source, initial = given_guesses(dataset, str(path))
    assert source == "matches-my-matches"
    results = run_trials(
        dataset, [Blobs()], initial=initial, source=source, pair_ids=[pair_id], jobs=0
    )
    (trial,) = results.trials
    assert trial.initial_translation_error_m < 1e-4
    with pytest.raises(CalibrationError, match="no pair has an initial guess"):
        run_trials(dataset, [Blobs()], initial=initial, pair_ids=[dataset.pairs[0].pair_id])
    with pytest.raises(CalibrationError, match="no initial guess 'guess': use truth, picks"):
        given_guesses(dataset, "guess")


def test_a_toolbox_calib_json_starts_all_pairs(dataset: Dataset, tmp_path: Path) -> None:
    T = dataset.poses[0].T_camera_lidar
    written = se3.to_xyz_xyzw(se3.inverse(T)).tolist()
    (tmp_path / "calib.json").write_text(json.dumps({"results": {"T_lidar_camera": written}}))
    notes: list[str] = []
    source, initial = given_guesses(dataset, str(tmp_path / "calib.json"), notes.append)
    assert source == f"toolbox-{tmp_path.name}-calib"
    assert notes == ["calib.json: results.T_lidar_camera maps camera to LiDAR and was inverted"]
    assert set(initial) == {record.pair_id for record in dataset.pairs}
    for guess in initial.values():
        np.testing.assert_allclose(guess, T, atol=1e-9)


def test_automatic_guesses_of_other_options_are_another_run() -> None:
    assert source_of({}) == source_of({"matcher": "classical", "rotate_camera": 0}) == "auto"
    turned = source_of({"rotate_lidar": 90, "matcher": "classical"})
    assert turned == "auto-rotate-lidar-90"
    assert len({source_of({"route": r}) for r in ("auto", "edges", "matching")}) == 3
    with pytest.raises(CalibrationError, match="rotate_camera is 45: give 0, 90"):
        source_of({"rotate_camera": 45})
    with pytest.raises(CalibrationError, match="unknown matcher 'glue'"):
        source_of({"matcher": "glue"})


@dataclass(frozen=True)
class Guessless(Blobs):
    """`Blobs` that can do without a guess."""

    name: ClassVar[str] = "guessless"
    needs_initial: ClassVar[bool] = False

    def calibrate(
        self, pairs: Sequence[Pair], initial: Any, prepared: Sequence[Any] | None = None
    ) -> Calibration:
        features = prepared or [self.prepare(pair) for pair in pairs]
        pixels, points = (np.concatenate(each) for each in zip(*features, strict=True))
        pose = point_pose(points, pixels, pairs[0].camera)
        assert initial is None
        return Calibration(pose.T_camera_lidar, True, False, np.full((6, 6), np.nan), 0.1)


def test_methods_start_from_nothing_or_say_that_they_cannot(tmp_path: Path) -> None:
    dataset = toy_dataset.make(tmp_path / "set")
    Blobs.prepared.clear()
    results = run_trials(dataset, [Blobs()], from_nothing=True, trials=3, jobs=0)
    assert not Blobs.prepared
    results = run_trials(dataset, [Blobs(), Guessless()], from_nothing=True, jobs=0)
    assert {t.run for t in results.trials} == {"init-none"}
    assert all("needs an initial guess" in t.message for t in results.trials if t.method == "blobs")
    found = [t for t in read_results(dataset).trials if t.method == "guessless"]
    assert len(found) == len(dataset.pairs) == len(results.failures)
    for t in found:
        assert t.T_camera_lidar_initial is None and np.isnan(t.initial_rotation_error_deg)
        assert not t.failed and t.rotation_error_deg < 0.5 and t.translation_error_m < 0.05

    # Stored ones stay; those from a guess are another run.
    again = run_trials(dataset, [Guessless()], from_nothing=True, jobs=0)
    assert [t.seconds for t in again.trials] == [t.seconds for t in found]
    with pytest.raises(CalibrationError, match="another run"):
        given = {dataset.pairs[0].pair_id: np.eye(4)}
        run_trials(dataset, [Blobs()], initial=given, run="init-none", jobs=0)
    with pytest.raises(CalibrationError, match="initial guesses, and none"):
        run_trials(dataset, [Blobs()], initial={"a": np.eye(4)}, from_nothing=True)

    page = write_report(dataset).read_text()
    assert "From nothing (init-none)" in page and "Each starts without an initial guess" in page
    assert "nan" not in page.split("<body>")[1][:4000]
    with (dataset.path / "report" / "results.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["method"] == "guessless"]
    assert rows[0]["initial_x_m"] == "nan" and float(rows[0]["estimated_x_m"]) == pytest.approx(
        found[0].T_camera_lidar_estimated[0, 3], abs=1e-6
    )
    save_review(dataset, tmp_path / "review.rrd")


def test_the_command_runs_methods_from_nothing(dataset: Dataset) -> None:
    arguments = ["--init", "none", "--methods", "plk,crlf", "--jobs", "1", "--json"]
    done = CliRunner().invoke(app, ["calibrate", str(dataset.path), *arguments])
    assert done.exit_code == 3
    failures = json.loads(done.stdout)["failures"]
    assert len(failures) == 2 * len(dataset.pairs)
    assert "needs an initial guess" in next(f for f in failures if f.startswith("plk"))
    assert "needs an initial guess" not in next(f for f in failures if f.startswith("crlf"))
