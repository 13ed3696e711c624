"""The one place that imports Open3D, which wants system libraries that not every machine has."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

from lcdata.errors import MissingLibraryError


@cache
def open3d() -> Any:
    """The `open3d` module.

    libusb comes from a wheel and is loaded first; libEGL and libGL have no wheel.

    Raises:
        MissingLibraryError: Open3D or a system library that it needs is missing.
    """
    try:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        import open3d as module
    except (ImportError, OSError) as error:
        raise MissingLibraryError(
            f"Open3D cannot be loaded ({str(error).splitlines()[0]})",
            "on Debian or Ubuntu run: apt-get install libegl1 libgl1 libx11-6 libgomp1",
        ) from error
    return module
