from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from chromium import Browser, find_chromium

from lcdata.dataset import Dataset, build
from lcdata.pick import PickServer, Session


@pytest.fixture(scope="session")
def gym(sample_recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The simulated gym, one pair a pose."""
    out = tmp_path_factory.mktemp("pick") / "set"
    return build(sample_recordings / "gym", out, pairs_per_pose=1).dataset


@pytest.fixture
def served(gym: Dataset) -> Iterator[PickServer]:
    """The page of the first pair, without former picks."""
    for old in (gym.path / "picks").rglob("*.json"):
        old.unlink()
    with PickServer(Session(gym, gym.pairs[0].pair_id)) as server:
        thread = threading.Thread(target=server.serve, daemon=True)
        thread.start()
        yield server
        server.stop()
        thread.join(10)
        assert not thread.is_alive()


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if find_chromium() is None:
        pytest.skip("no Chromium on this machine (apt install chromium)")
    with Browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened
