from __future__ import annotations

from pathlib import Path

import pytest

from . import small_dataset as small


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A small data set."""
    small.write(tmp_path / "set")
    return tmp_path / "set"
