from __future__ import annotations

from pathlib import Path

import pytest
from box_room import add_results, make
from rrd import Rrd

from lcdata.dataset import Dataset
from lcdata.review import save_review


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Eight pairs with an arm, two scenarios, results of two methods."""
    dataset = make(tmp_path_factory.mktemp("arm") / "rooms")
    add_results(dataset)
    return dataset


@pytest.fixture(scope="session")
def review(dataset: Dataset) -> Path:
    return save_review(dataset, dataset.path / "review.rrd").path


@pytest.fixture(scope="session")
def rrd(review: Path) -> Rrd:
    return Rrd(review)
