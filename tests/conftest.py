"""Fixtures that the whole suite shares."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# How long an example takes says how busy the machine is, not whether the code is right.
settings.register_profile("lcdata", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("lcdata")

# A job in the background starts with Ctrl-C ignored, and so would every process that it starts.
signal.signal(signal.SIGINT, signal.default_int_handler)

SHARED = Path(__file__).parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of real data beside the checkout; the test is skipped where it is absent."""
    if not (SHARED / "data").is_dir():
        pytest.skip("no real data: the folder shared/ is not beside this checkout")
    return SHARED


@pytest.fixture(scope="session")
def sample_recordings() -> Path:
    """The simulated recordings that come with the repository."""
    return Path(__file__).parents[1] / "recordings"
