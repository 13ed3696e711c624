"""Clouds as PCD files: binary, every recorded field, organised clouds stay organised.

The header is pypcd4's; the records follow it as they lie in memory, so that nothing is copied.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import DatasetError


def header(dtype: np.dtype[Any], height: int, width: int) -> bytes:
    """Header of a binary PCD file.

    Args:
        dtype: Packed structured type of one point; a field with a shape becomes COUNT > 1.
        height: Rings of an organised cloud, else 1.
        width: Columns, or number of points.
    """
    from pypcd4 import Encoding, MetaData

    parts = [np.dtype(dtype[name]) for name in dtype.names or ()]
    metadata = MetaData(
        fields=tuple(re.sub(r"[^\w.\-]", "_", name) or "_" for name in dtype.names or ()),
        size=tuple(part.base.itemsize for part in parts),
        type=tuple({"f": "F", "i": "I", "u": "U", "b": "U"}[part.base.kind] for part in parts),
        count=tuple(int(np.prod(part.shape, dtype=int)) for part in parts),
        points=height * width,
        width=width,
        height=height,
        data=Encoding.BINARY,
    )
    return str(metadata.compose_header()).encode()


def encode(records: NDArray[np.void], height: int, width: int) -> tuple[bytes, memoryview]:
    """A PCD file as two chunks, header and data.

    Args:
        records: (height * width,) packed, native-endian structured array.
        height: Rings of an organised cloud, else 1.
        width: Columns, or number of points.
    """
    data = np.ascontiguousarray(records).view(np.uint8)
    return header(records.dtype, height, width), data.reshape(-1).data


def read(path: Path) -> tuple[NDArray[np.void], int, int]:
    """Records (N,), height and width of a PCD file.

    Raises:
        DatasetError: Not there, not a PCD file, or cut short.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise DatasetError(f"{path}: not there", "`lcdata validate` lists what is wrong") from error
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from error
    return decode(data, path)


def decode(data: bytes, path: Path | str) -> tuple[NDArray[np.void], int, int]:
    """Records (N,), height and width of a PCD file's content.

    Args:
        data: The whole file.
        path: What errors call it.

    Raises:
        DatasetError: Not a PCD file, or cut short.
    """
    from pypcd4 import PointCloud

    try:
        cloud = PointCloud.from_fileobj(io.BytesIO(data))
    except (ValueError, RuntimeError, KeyError, OSError) as error:  # pydantic's is a ValueError
        reason = str(error).strip().splitlines()[0]
        raise DatasetError(f"{path}: not a PCD file, or cut short ({reason})") from error
    height, width = int(cloud.metadata.height), int(cloud.metadata.width)
    if len(cloud.pc_data) != height * width:
        raise DatasetError(f"{path}: {len(cloud.pc_data)} points, header says {width}x{height}")
    return cloud.pc_data, height, width


def has_points(records: NDArray[np.void]) -> bool:
    """Whether any point is finite and away from the origin, where drivers put a missing return."""

    def any_in(part: NDArray[np.void]) -> bool:
        x, y, z = part["x"], part["y"], part["z"]
        finite = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
        return bool((finite & ((x != 0) | (y != 0) | (z != 0))).any())

    return any_in(records[::101]) or any_in(records)  # nearly always a few points will do
