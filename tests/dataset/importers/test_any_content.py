"""Whatever a published file holds, an import lists its pairs or names what is wrong."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lcdata.dataset.importers import Folder, Importer, KittiRaw, NuScenes, OpenCalib
from lcdata.dataset.importers.published import Choice, Listing, list_pairs
from lcdata.errors import SourceError

from . import layouts

FEW = settings(max_examples=25)
"""Every example writes and lists files."""

SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4)
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=4), max_leaves=16)
VALUES |= st.dictionaries(st.sampled_from(["data", "rows", "token"]), VALUES, max_size=2)


def listed_or_named(importer: Importer) -> None:
    try:
        listing = list_pairs(importer, Choice())
    except SourceError as error:
        assert error.message
    else:
        assert isinstance(listing, Listing) and listing.scenarios


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("road")
    layouts.folder_of_pairs(folder, 2)
    return folder


@FEW
@given(
    key=st.sampled_from(["K", "D", "T_camera_lidar", "camera_model", "width", "covariance"]),
    value=VALUES,
    model=st.sampled_from(["pinhole", "omni", "equirectangular"]),
)
def test_reference(road: Path, key: str, value: Any, model: str) -> None:
    content = json.loads((road / "reference.json").read_text())
    content |= {"camera_model": model, key: value}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "other.json"
        path.write_text(json.dumps(content))
        listed_or_named(Folder(road, path))


@FEW
@given(value=VALUES)
def test_a_reference_of_anything(road: Path, value: Any) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "other.json"
        path.write_text(json.dumps(value))
        listed_or_named(Folder(road, path))


def places(content: Any) -> list[Callable[[Any], None]]:
    """What sets each value in JSON content."""
    found: list[Callable[[Any], None]] = []
    pairs = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in list(pairs):
        found.append(lambda new, key=key: content.__setitem__(key, new))
        if isinstance(value, dict | list):
            found += places(value)
    return found


@FEW
@given(data=st.data())
def test_opencalib(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder:
        layouts.opencalib(Path(folder))
        path = data.draw(st.sampled_from(sorted(Path(folder).glob("*.json"))))
        content = json.loads(path.read_text())
        data.draw(st.sampled_from(places(content)))(data.draw(VALUES))
        path.write_text(json.dumps(content))
        listed_or_named(OpenCalib(Path(folder)))


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> layouts.NuScenesFiles:
    return layouts.NuScenesFiles(tmp_path_factory.mktemp("nuscenes"), samples=2)


@FEW
@given(data=st.data())
def test_nuscenes(tables: layouts.NuScenesFiles, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(tables.tables)))
    rows = json.loads(json.dumps(tables.tables[name]))
    data.draw(st.sampled_from(places(rows)))(data.draw(VALUES))
    path = tables.root / "v1.0-mini" / f"{name}.json"
    good = path.read_text()
    path.write_text(json.dumps(rows))
    try:
        listed_or_named(NuScenes(tables.root))
    finally:
        path.write_text(good)


@FEW
@given(data=st.data())
def test_kitti(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder:
        date = Path(folder) / "2011_09_26"
        layouts.kitti_calibration(date)
        drive = layouts.kitti_drive(date, frames=1)
        files = [*date.glob("*.txt"), *drive.rglob("*.txt")]
        path = data.draw(st.sampled_from(sorted(files)))
        words = path.read_text().split(" ")
        number = data.draw(st.integers(0, len(words) - 1))
        words[number] = data.draw(st.text(max_size=6) | st.floats().map(repr))
        path.write_text(" ".join(words))
        listed_or_named(KittiRaw(drive))
