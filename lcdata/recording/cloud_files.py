"""Clouds from files: PCD, PLY, KITTI's .bin and NumPy's .npy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import MessageError

XYZI = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])

PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}

PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "<"}


class CloudFile(NamedTuple):
    """Points of a file.

    Args:
        records: (height * width,) structured, every field under its name in the file.
        height: Rings of an organised cloud, else 1.
        width: Columns, or number of points.
    """

    records: NDArray[np.void]
    height: int
    width: int


def read_cloud(path: Path) -> CloudFile:
    """Read a cloud.

    Raises:
        MessageError: Unreadable, damaged, or an array that is no cloud.
    """
    try:
        return READERS[path.suffix.lower()](path)
    except MessageError:
        raise
    except (OSError, ValueError, LookupError, TypeError, RuntimeError, EOFError) as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise MessageError(f"{path} cannot be read ({reason})", "write it again") from error


def _pcd(path: Path) -> CloudFile:
    from pypcd4 import PointCloud

    cloud = PointCloud.from_path(path)
    return CloudFile(cloud.pc_data, int(cloud.metadata.height), int(cloud.metadata.width))


def _bin(path: Path) -> CloudFile:
    data = path.read_bytes()
    if len(data) % XYZI.itemsize:
        raise MessageError(
            f"{path} has {len(data)} bytes, no multiple of {XYZI.itemsize}",
            "KITTI's clouds are x y z intensity in float32; write others as PCD or PLY",
        )
    return _row(np.frombuffer(data, XYZI))


def _npy(path: Path) -> CloudFile:
    array = np.load(path, allow_pickle=False)
    if array.dtype.names:
        records = array.reshape(-1)
        height, width = array.shape if array.ndim == 2 else (1, array.size)
        return CloudFile(records, height, width)
    if array.ndim not in (2, 3) or array.shape[-1] not in (3, 4):
        raise MessageError(
            f"{path} is an array of shape {array.shape}",
            "give (N, 3) or (N, 4), or (rings, columns, 3 or 4): x y z and intensity",
        )
    height, width = array.shape[:2] if array.ndim == 3 else (1, len(array))
    flat = array.reshape(-1, array.shape[-1]).astype("<f4")
    dtype = np.dtype(XYZI.descr[: flat.shape[1]])
    return CloudFile(np.ascontiguousarray(flat).view(dtype).reshape(-1), height, width)


def _ply(path: Path) -> CloudFile:
    """The vertices of a PLY; they must come first, as they do nearly always."""
    data = path.read_bytes()
    head, mark, body = data.partition(b"end_header")
    if not data.startswith(b"ply") or not mark:
        raise MessageError(f"{path} has no PLY header", "write it again")
    body = body[body.index(b"\n") + 1 :]
    order, count, element, fields = "", 0, "", []
    for words in (line.split() for line in head.decode("ascii", "replace").splitlines()):
        if words[:1] == ["format"]:
            order = PLY_ORDERS[words[1]]
            text = words[1] == "ascii"
        elif words[:1] == ["element"]:
            if not element and words[1] != "vertex":
                raise MessageError(f"{path} begins with {words[1]}, not with vertices", "export")
            element = words[1]
            count = int(words[2]) if element == "vertex" else count
        elif words[:1] == ["property"] and element == "vertex":
            fields.append((words[2], order + PLY_TYPES[words[1]]))
    dtype = np.dtype(fields)
    if text:
        lines = body.decode().splitlines()[:count]
        rows = [tuple(map(float, line.split()[: len(fields)])) for line in lines]
        return _row(np.array(rows, dtype))
    records = np.frombuffer(body, dtype, count)
    return _row(records.astype(dtype.newbyteorder("=")))


def _row(records: NDArray[Any]) -> CloudFile:
    return CloudFile(records, 1, len(records))


READERS: dict[str, Callable[[Path], CloudFile]] = {
    ".pcd": _pcd,
    ".ply": _ply,
    ".bin": _bin,
    ".npy": _npy,
}
"""Reader of each kind of file."""
