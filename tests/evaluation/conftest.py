from __future__ import annotations

from pathlib import Path

import pytest
import toy_dataset

from lcdata.dataset import Dataset


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    """Two scenarios, two poses each, two pairs each."""
    return toy_dataset.make(tmp_path / "set")
