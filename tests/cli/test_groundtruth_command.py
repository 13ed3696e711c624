from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
import yaml

sys.path.insert(0, str(Path(__file__).parents[1] / "review"))  # data set of an arm with results

from box_room import add_results, make

from lcdata.dataset import Dataset
from lcdata.dataset.arms import describe_arm
from lcdata.dataset.atomic import write_json
from lcdata.evaluation import read_results


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("groundtruth") / "set"
    made = make(folder, pairs=1)
    arm = describe_arm("gen3_lite", made.rig.load_arm())
    write_json(folder / "dataset.json", made.info.to_dict() | {"arm": arm})
    add_results(made)
    return Dataset.open(folder)


def test_a_new_rig_from_dry_run_to_report(lcdata, dataset, tmp_path):
    rig = dataset.rig.to_dict()
    rig["T_base_lidar"]["translation_m"][2] += 0.02
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump(rig))
    before = dataset.info.groundtruth_version

    done = lcdata("groundtruth", dataset.path, "--rig", path, "--dry-run")
    assert done.returncode == 0, done.stderr
    assert f"ground truth {before} -> " in done.stdout
    assert "den/pose_000" in done.stdout
    assert "nothing was written" in done.stdout
    assert Dataset.open(dataset.path).info.groundtruth_version == before

    done = lcdata("groundtruth", dataset.path, "--rig", path, "--json")
    answer = json.loads(done.stdout)
    assert answer["written"]
    assert answer["before"] == before
    assert len(answer["poses"]) == 4
    assert answer["stale_trials"] == len(read_results(dataset).trials)

    done = lcdata("report", dataset.path)
    assert done.returncode == 1
    assert "--update-results" in done.stderr
    done = lcdata("report", dataset.path, "--update-results")
    assert done.returncode == 0, done.stderr
    page = (dataset.path / "report" / "index.html").read_text()
    assert answer["after"] in page

    again = Dataset.open(dataset.path)
    current, stale = read_results(again).split_stale(again)
    assert not stale.trials
    assert max(t.translation_error_m for t in current.trials if not t.failed) > 0.02

    done = lcdata("groundtruth", dataset.path, "--update-results")
    assert "no pose changes" in done.stdout


def test_joint_offsets_of_another_arm_are_one_line(lcdata, dataset, tmp_path):
    path = tmp_path / "other.yaml"
    path.write_text("model: ur5\noffsets_deg: {joint_1: 0.1}\n")
    done = lcdata("groundtruth", dataset.path, "--arm-offsets", path)
    assert done.returncode == 1
    assert "joint offsets of a ur5, the arm is a gen3_lite" in done.stderr
    assert done.stderr.count("\n") == 1
