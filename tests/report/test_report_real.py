"""A real road scan, through the real methods, to the page."""

from __future__ import annotations

from pathlib import Path

import pytest

from lcdata.dataset import build
from lcdata.evaluation import run_trials
from lcdata.report import write_report


@pytest.mark.slow
def test_a_real_pair_is_reported_as_it_is(shared: Path, tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("ground_truth: static\n")
    bag = shared / "recordings" / "opencalib_crossing.bag"
    dataset = build(bag, tmp_path / "set", rig).dataset
    results = run_trials(dataset, ["projection", "plk"], jobs=1)
    assert not results.failures
    assert len(results.trials) == 2
    assert results.trials[0].features_seconds == results.trials[1].features_seconds  # shared
    for trial in results.trials:
        assert trial.success or not trial.converged, "a wrong estimate without a warning"
    page = write_report(dataset).read_text()
    assert "Recorded data" in page and "no uncertainty known" in page
