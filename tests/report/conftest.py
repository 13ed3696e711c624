from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "evaluation"))  # toy data set and methods

import toy_dataset
from toy_methods import Biased, Blobs, Habit

from lcdata.dataset import Dataset
from lcdata.evaluation import run_trials


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A data set with trials of a good method, a biased one and one that fails at times."""
    dataset = toy_dataset.make(tmp_path_factory.mktemp("report") / "set")
    run_trials(dataset, [Blobs(), Biased(), Habit()], trials=2, jobs=0)
    return dataset
