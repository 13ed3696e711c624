from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "evaluation"))  # toy data set

import toy_dataset


@pytest.fixture
def sample_dataset(tmp_path: Path) -> Path:
    """A data set of two scenarios, two poses each, two pairs each."""
    return Path(toy_dataset.make(tmp_path / "set").path)
