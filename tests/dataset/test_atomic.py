"""Files are complete or not there, whatever happens while they are written."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lcdata.dataset import atomic
from lcdata.errors import DatasetError


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_writes_into_folders_that_it_makes(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "table.csv"
    with atomic.write_atomically(path) as temporary:
        assert temporary.parent == path.parent
        assert temporary.suffix == ".csv"
        temporary.write_text("x\n")
        assert not path.exists()
    assert path.read_text() == "x\n"
    assert names(path.parent) == ["table.csv"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_an_exception_leaves_the_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "file.bin"
    path.write_bytes(b"old")
    with pytest.raises(error), atomic.write_atomically(path) as temporary:
        temporary.write_bytes(b"half")
        raise error
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["file.bin"]


def test_helpers_round_trip(tmp_path: Path) -> None:
    atomic.write_bytes(tmp_path / "b", b"one", memoryview(b"two"))
    atomic.write_json(tmp_path / "j", {"é": [1, 2.5, None]})
    atomic.write_parquet(tmp_path / "p", pa.table({"a": [1, 2]}))
    assert (tmp_path / "b").read_bytes() == b"onetwo"
    assert json.loads((tmp_path / "j").read_text(encoding="utf-8")) == {"é": [1, 2.5, None]}
    assert pq.read_table(tmp_path / "p").to_pydict() == {"a": [1, 2]}
    assert names(tmp_path) == ["b", "j", "p"]


def test_a_folder_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    with pytest.raises(DatasetError, match="in the way"):
        atomic.write_bytes(tmp_path / "x", b"1")
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match="in the way"):
        atomic.write_bytes(tmp_path / "file" / "below", b"1")


def test_errors_of_other_files_stay_what_they_are(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), atomic.write_atomically(tmp_path / "x"):
        (tmp_path / "not there").read_text()


FULL = """
import resource, signal, sys
from pathlib import Path
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
from lcdata.dataset import atomic
from lcdata.errors import DatasetError
try:
    {statement}
except DatasetError as error:
    print(error)
    sys.exit(1)
"""


@pytest.mark.parametrize(
    "statement",
    [
        "atomic.write_bytes(Path(sys.argv[1]), bytes(1_000_000))",
        "import os, pyarrow as pa; "
        "atomic.write_parquet(Path(sys.argv[1]), pa.table({'a': [os.urandom(1_000_000)]}))",
    ],
)
def test_a_full_disk_is_one_line_and_no_half_file(tmp_path: Path, statement: str) -> None:
    code = FULL.replace("{statement}", statement)
    done = subprocess.run(  # noqa: PLW1510 (checked below)
        [sys.executable, "-c", code, str(tmp_path / "file")], capture_output=True, text=True
    )
    assert done.returncode == 1, done.stderr
    assert len(done.stdout.splitlines()) == 1
    assert "no space left" in done.stdout
    assert "free some space" in done.stdout
    assert names(tmp_path) == []


def test_a_killed_writer_leaves_no_final_name(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from lcdata.dataset import atomic\n"
        "with atomic.write_atomically(Path(sys.argv[1])) as temporary:\n"
        "    temporary.write_bytes(bytes(1000)); print('there', flush=True); time.sleep(60)\n"
    )
    path = tmp_path / "file.bin"
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "there\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert not path.exists()
    assert len(names(tmp_path)) == 1  # what a later build sweeps
    atomic.remove_leftovers(tmp_path)
    assert names(tmp_path) == []
