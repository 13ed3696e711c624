"""Two runs, two methods, two versions of the ground truth on one timeline."""

from __future__ import annotations

import os
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import yaml
from box_room import BAD, GOOD, RIG, RUN, add_results, make
from rrd import Rrd

from lcdata.dataset import Dataset, regenerate
from lcdata.errors import ReportError
from lcdata.evaluation.results import results_path, write_run
from lcdata.geometry import se3
from lcdata.review import Selection, Wanted, save_review
from lcdata.review.arrange import arrange
from lcdata.review.verdict import verdicts

LATER = "later"


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    """Two runs: in the later one `beta` is right on pair 2, and `alpha` is not there."""
    dataset = make(tmp_path_factory.mktemp("compare") / "rooms", arm=False)
    results = add_results(dataset)
    better = []
    for r in (r for r in results if r.method == BAD):
        pose = dataset.pose(r.pose_id)
        T = se3.exp([0.001, 0, 0, 0, 0, 0]) @ pose.T_camera_lidar
        moved = replace(r, T_camera_lidar_estimated=T) if not r.failed else r
        better.append(replace(moved, run=LATER).against(pose))
    write_run(results_path(dataset, LATER), better)
    age = results_path(dataset, RUN).stat().st_mtime
    os.utime(
        results_path(dataset, LATER), (age - 1.0, age - 1.0)
    )  # the file system's clock ticks slowly
    return dataset


def errors(trials, pair_id):
    return {m: t.rotation_error_deg for m, t in trials.of_pair(pair_id).items()}


def test_a_run_beside_another(rooms, tmp_path):
    wanted = Wanted(compare=LATER)
    rrd = Rrd(save_review(rooms, tmp_path / "r.rrd", wanted=wanted).path)
    first, second = (arrange(rooms, Wanted(run=run)).trials for run in (RUN, LATER))
    a, b = (rrd.rows(f"/errors/rotation_deg/{BAD}.{side}", "Scalars:scalars") for side in "AB")
    difference = rrd.rows(f"/difference/rotation_deg/{BAD}", "Scalars:scalars")
    found = [errors(first, record.pair_id).get(BAD, np.nan) for record in rooms.pairs]
    shared = np.flatnonzero(np.isfinite(found)).tolist()
    assert sorted(difference) == sorted(a) == sorted(b) == shared
    for number in shared:
        pair_id = rooms.pairs[number].pair_id
        assert a[number] == [errors(first, pair_id)[BAD]]
        assert b[number] == [errors(second, pair_id)[BAD]]
        assert difference[number][0] == pytest.approx(b[number][0] - a[number][0])
    assert difference[2][0] < -5  # wrong before, right now
    overlays = [rrd.rows(f"/overlays/{BAD}.{side}/cloud", "Points2D:positions") for side in "AB"]
    assert overlays[0][2] != overlays[1][2]
    assert not any(f"/{GOOD}" in entity for entity in rrd.entities)
    text = rrd.static("/summary", "TextDocument:text")[0]
    assert f"is run {RUN}" in text
    assert f"is run {LATER} (not in both: {GOOD})" in text


def test_a_results_file_elsewhere(rooms, tmp_path):
    path = tmp_path / "elsewhere.parquet"
    path.write_bytes(results_path(rooms, LATER).read_bytes())
    shown = arrange(rooms, Wanted(compare=str(path)))
    assert shown.comparison is not None
    assert shown.comparison.b.startswith("run elsewhere")
    assert shown.trials.methods == (f"{BAD}.A", f"{BAD}.B")


def test_the_worst_are_where_they_differ_most(rooms):
    shown = arrange(rooms, Wanted(Selection(worst=1), compare=LATER))
    (record,) = shown.dataset.pairs
    assert record.pair_id == rooms.pairs[2].pair_id
    assert "where the two differ most" in shown.note


def test_a_banner_says_both_and_its_frame_is_that_of_the_worse(rooms):
    shown = arrange(rooms, Wanted(compare=LATER))
    key = shown.views[0].key
    lines, frame = verdicts(shown, key, rooms.pairs[2])
    assert [text[:9] for text, _ in lines] == ["A wrong, ", "B right: "]
    assert len({colour for _, colour in lines}) == 2
    alone = arrange(rooms, Wanted(run=RUN))
    assert frame == verdicts(alone, BAD, rooms.pairs[2])[1]
    lines, _ = verdicts(shown, key, rooms.pairs[3])  # no trial in either
    assert [text for text, _ in lines] == ["A no results", "B no results"]


@pytest.mark.parametrize("methods", [(GOOD,), ()])
def test_two_methods_of_a_run(rooms, tmp_path, methods):
    wanted = Wanted(Selection(methods=methods), compare=BAD)
    done = save_review(rooms, tmp_path / "r.rrd", wanted=wanted)
    rrd = Rrd(done.path)
    shown = arrange(rooms, wanted)
    assert shown.views[0].sources == (GOOD, BAD)
    title = shown.views[0].key.removesuffix(".both")
    escaped = title.replace(" ", "\\ ")
    series = rrd.rows(f"/difference/translation_m/{escaped}", "Scalars:scalars")
    found = errors(shown.trials, rooms.pairs[2].pair_id)
    assert set(found) == {GOOD, BAD}
    assert series[2][0] > 0.1
    assert sorted(series) == [0, 2, 4, 5, 6, 7][: len(series)]


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        (Wanted(compare="latex"), "did you mean later"),
        (Wanted(compare=RUN), "compared with itself"),
        (Wanted(Selection(methods=(GOOD,)), compare=LATER), "no method 'alpha' to show"),
        (Wanted(run=LATER, compare=BAD), "compared with one other method"),
        (Wanted(compare=LATER, truths=("first", "present")), "at once"),
        (Wanted(truths=("first", "present")), "one version of its ground truth"),
    ],
)
def test_what_cannot_be_compared_is_told(rooms, wanted, message):
    with pytest.raises(ReportError, match=message):
        arrange(rooms, wanted)


@pytest.fixture(scope="module")
def versions(tmp_path_factory):
    """An arm's data set whose LiDAR turned out to sit 3 cm higher."""
    folder = tmp_path_factory.mktemp("truths")
    dataset = make(folder / "rooms", pairs=1)
    add_results(dataset)
    rig = deepcopy(RIG)
    rig["T_base_lidar"]["translation_m"] = [-0.2, 0.1, 0.63]
    (folder / "rig.yaml").write_text(yaml.safe_dump(rig))
    before = Dataset.open(dataset.path)
    regenerate(before, folder / "rig.yaml")
    return before, Dataset.open(dataset.path)


def test_two_ground_truths(versions, tmp_path):
    before, now = versions
    names = before.info.groundtruth_version, now.info.groundtruth_version
    wanted = Wanted(truths=("first", names[1][:6]))
    rrd = Rrd(save_review(now, tmp_path / "r.rrd", wanted=wanted).path)
    moved = rrd.rows("/difference/translation_m/moved", "Scalars:scalars")
    sigmas = rrd.rows("/difference/sigma_distance/moved", "Scalars:scalars")
    change = rrd.rows(f"/difference/translation_m/{GOOD}", "Scalars:scalars")
    against_b = rrd.rows(f"/errors/translation_m/{GOOD}", "Scalars:scalars")
    trials = arrange(now, Wanted()).trials
    for number, record in enumerate(now.pairs):
        a, b = (d.pose(record.pose_id) for d in (before, now))
        apart = se3.translation_error(b.T_camera_lidar, a.T_camera_lidar)
        assert moved[number][0] == pytest.approx(apart)
        assert apart > 0.02
        expected = se3.sigma_distance(b.T_camera_lidar, a.T_camera_lidar, a.covariance)
        assert sigmas[number][0] == pytest.approx(expected)
        estimate = trials.of_pair(record.pair_id)[GOOD].T_camera_lidar_estimated
        on_a, on_b = (se3.translation_error(estimate, p.T_camera_lidar) for p in (a, b))
        assert against_b[number][0] == pytest.approx(on_b)
        assert change[number][0] == pytest.approx(on_b - on_a)
    clouds = [
        rrd.rows(f"/overlays/{source}/cloud", "Points2D:positions")[0]
        for source in ("ground_truth_a", "ground_truth")
    ]
    assert clouds[0] != clouds[1]
    whole = Rrd(save_review(before, tmp_path / "a.rrd").path)
    assert clouds[0] == whole.rows("/overlays/ground_truth/cloud", "Points2D:positions")[0]
    text = rrd.static("/summary", "TextDocument:text")[0]
    assert f"ground truth {names[0]}" in text
    assert f"ground truth {names[1]} (the present one)" in text


@pytest.mark.parametrize(
    ("truths", "message"),
    [
        (("first", "first"), "are one version"),
        (("zzz", "present"), "is no version"),
        (("", "present"), "is the start of several versions"),
    ],
)
def test_versions_that_are_not_there(versions, truths, message):
    with pytest.raises(ReportError, match=message):
        arrange(versions[1], Wanted(truths=truths))


def test_ground_truth_can_be_compared_backwards_and_filtered(versions):
    shown = arrange(versions[1], Wanted(Selection(worst=1), truths=("present", "first")))
    assert len(shown.dataset) == 1
    pose_id = shown.dataset.pairs[0].pose_id
    np.testing.assert_array_equal(
        shown.dataset.pose(pose_id).T_camera_lidar, versions[0].pose(pose_id).T_camera_lidar
    )
