"""Clouds from files: PCD, PLY, NumPy's .npy, and the .bin of KITTI and of nuScenes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import MessageError

XYZI = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])

XYZI_RING = np.dtype([*XYZI.descr, ("ring", "<f4")])
"""A point of nuScenes: its ring is a whole number, written as a float."""

RINGS = 256
"""No LiDAR has more."""

PADDING = "#$%&~~"
"""How pypcd4 begins the names that it makes for the padding of a PCD's points."""

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
        records, height, width = READERS[path.suffix.lower()](path)
        if len(records) != height * width:
            raise MessageError(
                f"{path} has {len(records)} points, its header says {width}x{height}",
                "write it again",
            )
        return CloudFile(_native(records, path), height, width)
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
    """Four floats a point (KITTI), or five (nuScenes), which only the numbers can tell apart."""
    data = path.read_bytes()
    four, five = (len(data) % dtype.itemsize == 0 for dtype in (XYZI, XYZI_RING))
    if path.name.lower().endswith(".pcd.bin"):  # as nuScenes calls its files
        four = False
    if five and (not four or _is_ring(np.frombuffer(data, XYZI_RING)["ring"])):
        records = np.frombuffer(data, XYZI_RING)
        if not _is_ring(records["ring"]):
            return _row(_renamed(records, "ring", "column_5"))
        return _row(records.astype([*XYZI.descr, ("ring", "<u2")]))
    if not four:
        raise MessageError(
            f"{path} has {len(data)} bytes, no multiple of {XYZI.itemsize} or {XYZI_RING.itemsize}",
            "clouds are x y z intensity in float32 as KITTI's, or with a ring as nuScenes'; write "
            "others as PCD or PLY",
        )
    return _row(np.frombuffer(data, XYZI))


def _is_ring(values: NDArray[Any]) -> bool:
    """Whether numbers count rings."""
    return bool(len(values)) and bool(
        ((values >= 0) & (values < RINGS) & (values == np.floor(values))).all()
    )


def _renamed(records: NDArray[Any], old: str, new: str) -> NDArray[Any]:
    names = [new if name == old else name for name in records.dtype.names or ()]
    return records.view([(n, records.dtype[i]) for i, n in enumerate(names)])


def _npy(path: Path) -> CloudFile:
    array = np.load(path, allow_pickle=False)
    if array.dtype.names:
        records = array.reshape(-1)
        height, width = array.shape if array.ndim == 2 else (1, array.size)
        return CloudFile(records, height, width)
    columns = array.shape[-1] if array.ndim in (2, 3) else 0
    if not 3 <= columns <= 5:
        raise MessageError(
            f"{path} is an array of shape {array.shape}",
            "give (N, 3) to (N, 5), or (rings, columns, 3 to 5): x y z, intensity, ring",
        )
    height, width = array.shape[:2] if array.ndim == 3 else (1, len(array))
    flat = np.ascontiguousarray(array.reshape(-1, columns), "<f4")
    records = flat.view(np.dtype(XYZI_RING.descr[:columns])).reshape(-1)
    if columns == 5 and not _is_ring(records["ring"]):
        records = _renamed(records, "ring", "column_5")
    return CloudFile(records, height, width)


def _ply(path: Path) -> CloudFile:
    """The vertices of a PLY; they must come first, as they do nearly always."""
    data = path.read_bytes()
    head, mark, body = data.partition(b"end_header")
    if not data.startswith(b"ply") or not mark:
        raise MessageError(f"{path} has no PLY header", "write it again")
    body = body[body.index(b"\n") + 1 :]
    fields: list[tuple[str, str]] = []
    order, count, element = "", 0, ""
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
            # CloudCompare exports every field but the coordinates as scalar_...
            name = words[2].removeprefix("scalar_")
            taken = any(name == other for other, _ in fields)
            fields.append((words[2] if taken else name, order + PLY_TYPES[words[1]]))
    dtype = np.dtype(fields)
    if text:
        lines = body.decode().splitlines()[:count]
        rows = [tuple(map(float, line.split()[: len(fields)])) for line in lines]
        return _row(np.array(rows, dtype))
    records = np.frombuffer(body, dtype, count)
    return _row(records.astype(dtype.newbyteorder("=")))


def _native(records: NDArray[Any], path: Path) -> NDArray[np.void]:
    """Records without padding, in this machine's byte order, of types that a PCD can have.

    Raises:
        MessageError: Fields that are no numbers.
    """
    dtype = records.dtype
    kept = [name for name in dtype.names or () if not name.startswith(PADDING)]
    fields = []
    for name in kept:
        base, shape = dtype[name].base, dtype[name].shape
        if base.kind not in "fiub":
            raise MessageError(f"{path}: field {name} is of type {base}, no number", "leave it out")
        if base.kind == "f" and base.itemsize not in (4, 8):
            base = np.dtype("f4" if base.itemsize < 4 else "f8")
        fields.append((name, base.newbyteorder("="), shape))
    packed = np.dtype(fields)
    if packed == dtype:
        return records
    result = np.empty(len(records), packed)
    for name in kept:
        result[name] = records[name]
    return result


def _row(records: NDArray[Any]) -> CloudFile:
    return CloudFile(records, 1, len(records))


READERS: dict[str, Callable[[Path], CloudFile]] = {
    ".pcd": _pcd,
    ".ply": _ply,
    ".bin": _bin,
    ".npy": _npy,
}
"""Reader of each kind of file."""
