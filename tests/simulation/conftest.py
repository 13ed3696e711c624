from __future__ import annotations

import pytest

from lcdata.errors import MissingLibraryError
from lcdata.open3d_loader import open3d


@pytest.fixture(scope="session", autouse=True)
def _ray_casting() -> None:
    """Scenes are cast by Open3D, which wants system libraries."""
    try:
        open3d()
    except MissingLibraryError as error:
        pytest.skip(str(error))
