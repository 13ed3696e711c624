from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

sys.path.insert(0, str(Path(__file__).parents[1] / "evaluation"))  # toy data set and methods

import toy_dataset

from lcdata.dataset import Dataset

Write = Callable[..., Path]


def register_toys(folder: Path) -> Path:
    """A folder that, on the path, makes the toy methods those of an installed package."""
    info = folder / "toys-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
    names = ("Blobs", "Biased", "Habit", "Slow", "Masked")
    lines = [f"{name.lower()} = toy_methods:{name}" for name in names]
    (info / "entry_points.txt").write_text("\n".join(["[lcdata.calibrators]", *lines, ""]))
    return folder


@pytest.fixture
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Toy methods, registered as a third party registers its own."""
    folder = register_toys(tmp_path / "installed")
    monkeypatch.syspath_prepend(str(folder))
    return folder


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    """Two scenarios, two poses each, two pairs each."""
    return toy_dataset.make(tmp_path / "set")


@pytest.fixture
def write(tmp_path: Path, toys: Path, dataset: Dataset) -> Write:
    """Write an experiment file beside the data set."""

    def file(text: str | None = None, **content: object) -> Path:
        path = tmp_path / "experiment.yaml"
        whole = {"datasets": ["set"], "methods": ["blobs"]} | content
        path.write_text(text if text is not None else yaml.safe_dump(whole))
        return path

    return file
