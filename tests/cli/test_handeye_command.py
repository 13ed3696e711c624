"""`lcdata handeye` as a user types it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from lcdata.rig import load_rig

sys.path.insert(0, str(Path(__file__).parents[1] / "evaluation"))

import handeye_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """A data set with simulated estimates, the third pose half a metre off."""
    made = handeye_dataset.make(tmp_path_factory.mktemp("handeye") / "dataset")
    handeye_dataset.store(made, wrong=(3,))
    return made.path


def test_json_has_links_residuals_and_warnings(lcdata, dataset, tmp_path):
    rig = tmp_path / "refined.yaml"
    done = lcdata("handeye", dataset, "--write-rig", rig, "--json")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert content["outliers"] == ["gym/pose_003"]
    assert len(content["residuals"]) == content["poses"] == 12
    assert len(content["covariance"]) == 12
    assert content["observable"] is True
    refined = load_rig(rig)
    np.testing.assert_allclose(
        refined.T_base_lidar.T, content["T_base_lidar"]["matrix"], atol=1e-11
    )
    np.testing.assert_allclose(refined.covariance_of_links(), content["covariance"], rtol=1e-9)
    done = lcdata("groundtruth", dataset, "--rig", rig, "--dry-run", "--json")
    sigma = json.loads(done.stdout)["sigma_after_deg"]
    assert sigma == pytest.approx(content["refined_sigma"]["deg"], rel=1e-9)


def test_the_text_says_what_moved_and_by_how_much(lcdata, dataset):
    done = lcdata("handeye", dataset)
    assert done.returncode == 0, done.stderr
    for words in ("12 poses, from projection", "outlier", "moved", "singular-value ratio"):
        assert words in done.stdout


def test_nothing_is_replaced_or_half_written(lcdata, dataset, tmp_path):
    rig = tmp_path / "rig.yaml"
    rig.write_text("kept")
    done = lcdata("handeye", dataset, "--write-rig", rig)
    assert (done.returncode, rig.read_text()) == (1, "kept")
    assert "--force" in done.stderr
    assert lcdata("handeye", dataset, "--write-rig", rig, "--force").returncode == 0
    failed = lcdata("handeye", dataset, "--method", "plk", "--write-rig", tmp_path / "new.yaml")
    assert failed.returncode == 1
    assert failed.stderr.count("\n") == 1
    assert not (tmp_path / "new.yaml").exists()


def test_help_has_an_example(lcdata):
    done = lcdata("handeye", "--help")
    assert "Example:  lcdata handeye" in done.stdout
    assert "--json" in done.stdout


def test_dwells_do_not_tell_the_clock_offset_and_none_is_invented(lcdata, dataset):
    done = lcdata("handeye", dataset, "--clock-offset", "--json")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert content["clock_offset_s"] is content["clock_offset_std_s"] is None
    assert "clock offset: the arm stands still at all 12 poses" in content["unobservable"][-1]
    text = lcdata("handeye", dataset, "--clock-offset").stdout
    assert "not determined by the estimates: clock offset" in text
