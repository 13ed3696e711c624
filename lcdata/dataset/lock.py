"""One writer at a time.

The lock is on the data set's folder itself, in the kernel: it leaves no file behind, and ends with
the process that holds it, however that ends.
"""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lcdata.errors import DatasetError

_WITHOUT_LOCKS = {errno.EBADF, errno.EINVAL, errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP}
"""Of file systems that lock no folders, as some of a network: there nobody is kept out."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes from writing a data set.

    Args:
        folder: Its folder, which must be there.

    Raises:
        DatasetError: Another process is writing it, or it cannot be read.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise DatasetError(f"{folder}: cannot be opened ({error.strerror})") from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DatasetError(
                f"another lcdata command is writing {folder}", "wait for it to end"
            ) from error
        except OSError as error:
            if error.errno not in _WITHOUT_LOCKS:
                raise
        yield
    finally:
        os.close(descriptor)
