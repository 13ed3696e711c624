"""What decides a trial beside pairs and parameters: files, URLs, guesses; and what goes wrong."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import http.server
import os
import resource
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from toy_methods import Blobs, Masked

from lcdata.dataset import Dataset, schema
from lcdata.dataset.atomic import write_parquet
from lcdata.dataset.validate import checksum
from lcdata.errors import DatasetError, ExperimentError
from lcdata.evaluation import run_trials
from lcdata.evaluation.inputs import content, parameter_files
from lcdata.evaluation.pool import run_here
from lcdata.evaluation.results import TrialResult
from lcdata.experiment import Store, load_experiment, run_experiment, status
from lcdata.experiment import run as run_module

Write = Callable[..., Path]


def with_checksums(dataset: Dataset) -> Dataset:
    """The data set with its files' checksums in its index, as a build writes them."""
    pairs = [
        dataclasses.replace(
            p,
            image_sha256=checksum(dataset.path / p.image) or "",
            cloud_sha256=checksum(dataset.path / p.cloud) or "",
        )
        for p in dataset.pairs
    ]
    write_parquet(dataset.path / schema.PAIRS, schema.pairs_table(pairs))
    return Dataset.open(dataset.path)


def computed(path: Path) -> int:
    """How many pairs a run of an experiment file has worked on."""
    Blobs.prepared.clear()
    run_experiment(load_experiment(path), jobs=0)
    return len(Blobs.prepared)


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    folder = tmp_path / "masks"
    (folder / "hall").mkdir(parents=True)
    (folder / "hall" / "0.png").write_bytes(b"one")
    return folder


def test_files_that_parameters_name_are_part_of_a_trial(write: Write, masks: Path) -> None:
    path = write(methods=[{"masked": {"masks": str(masks)}}])
    assert computed(path) == 8 and computed(path) == 0
    (masks / "hall" / "0.png").write_bytes(b"two")
    assert computed(path) == 8
    (masks / "hall" / "1.png").write_bytes(b"two")
    assert computed(path) == 8 and computed(path) == 0
    moved = masks.rename(masks.with_name("elsewhere"))  # the same content
    assert computed(write(methods=[{"masked": {"masks": str(moved)}}])) == 0
    here = load_experiment(write(methods=[{"masked": {"masks": "elsewhere"}}])).methods["masked"]
    assert here == Masked(masks=str(moved))  # beside the experiment file, wherever one runs it
    (moved / "hall" / "1.png").rename(moved / "hall" / "2.png")
    assert computed(path.with_name("experiment.yaml")) == 8


def test_calibrate_compares_them_too(dataset: Dataset, masks: Path) -> None:
    def made() -> tuple[int, str]:
        Blobs.prepared.clear()
        found = run_trials(dataset, [Masked(masks=str(masks))], jobs=0)
        assert len({t.message for t in found.trials}) == 1
        return len(Blobs.prepared), found.trials[0].message

    assert made() == (8, "['0.png', 'hall']") and made()[0] == 0
    (masks / "hall" / "1.png").touch()
    assert made() == (8, "['0.png', '1.png', 'hall']") and made()[0] == 0


def test_which_parameters_name_files(masks: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert parameter_files(Masked(masks=str(masks))) == {"masks": masks}
    assert not parameter_files(Masked()) and not parameter_files(Masked(masks=str(masks / "no")))
    assert not parameter_files(Blobs()) and not parameter_files(Masked(masks="a\0b"))
    file = masks / "hall" / "0.png"
    assert content(file) == checksum(file) != content(masks)


@pytest.fixture
def server(tmp_path: Path, dataset: Dataset) -> Iterator[tuple[str, list[str]]]:
    """A web server with the data set; its URL, and what was asked of it."""
    asked: list[str] = []

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *arguments: object) -> None:
            asked.append(self.path)

    made = http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(Handler, directory=str(tmp_path))
    )
    thread = threading.Thread(target=made.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{made.server_address[1]}", asked
    made.shutdown()
    made.server_close()


def test_a_data_set_on_a_web_server(
    write: Write, dataset: Dataset, server: tuple[str, list[str]]
) -> None:
    pytest.importorskip("aiohttp", reason="the extra dask is not installed")
    with_checksums(dataset)
    url, asked = server
    path = write(datasets=[f"{url}/set"], starts=[{"rotation_deg": 1, "translation_m": 0.1}])
    assert status(load_experiment(path))[0].trials == 8
    assert not [name for name in asked if name.endswith((".png", ".pcd"))]
    (there,) = run_experiment(load_experiment(path), jobs=1).values()
    assert len(there.trials) == 8 and not there.failures
    assert {name for name in asked if name.endswith((".png", ".pcd"))} == {
        f"/set/{name}" for p in dataset.pairs for name in (p.image, p.cloud)
    }
    # the same content, wherever it is read from
    local = write(datasets=["set"], starts=[{"rotation_deg": 1, "translation_m": 0.1}])
    assert computed(local) == 0
    # a file that changed is found by who reads it
    (dataset.path / dataset.pairs[0].image).write_bytes(b"other")
    more = write(datasets=[f"{url}/set"], seeds=9)
    with pytest.raises(ExperimentError, match=rf"{url}/set/hall/pose_000/000.png has changed"):
        run_experiment(load_experiment(more), jobs=1)
    missing = write(datasets=[f"{url}/sat"])
    with pytest.raises(DatasetError, match=f"{url}/sat/dataset.json: not there"):
        status(load_experiment(missing))


def test_other_urls(write: Write, dataset: Dataset, tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec", reason="the extra dask is not installed")
    path = write(datasets=[(tmp_path / "set").as_uri()])
    assert computed(path) == 8
    assert computed(write()) == 0
    memory = fsspec.filesystem("memory")
    memory.put(str(dataset.path), "/kept/set", recursive=True)
    opened = Dataset.open("memory://kept/set")
    np.testing.assert_array_equal(
        opened.load("hall/pose_000/000").image, dataset.load("hall/pose_000/000").image
    )
    memory.rm("/kept/set/hall/pose_000/000.pcd")
    with pytest.raises(DatasetError, match=r"memory://kept/set/\S+/000\.pcd: not there"):
        opened.load("hall/pose_000/000")
    for url in ("nonsense://a/b", "memory://nothing"):
        with pytest.raises(DatasetError, match=url):
            Dataset.open(url)


def test_a_file_that_changes_while_trials_run(
    write: Write, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_checksums(dataset)
    path = write()

    def changing(function, tasks):
        for item in run_here(function, tasks):
            yield item
            if isinstance(item, TrialResult) and len(tasks) == 4:
                (dataset.path / dataset.pair(tasks[1].pair_ids[0]).cloud).write_bytes(b"other")

    with pytest.raises(ExperimentError, match=r"\.pcd has changed: its sha256 is .*…, the exper"):
        run_experiment(load_experiment(path), executor=changing)
    done = Store.open(path.parent / "lcdata-trials").keys()
    assert len(done) == 5 and not any(done.values())


def test_a_guess_that_cannot_be_found_is_a_failed_trial(write: Write) -> None:
    path = write(
        datasets=[{"path": "set", "scenarios": ["hall"]}],
        starts=[{"init": "auto", "guess": {"route": "edges"}}, {"rotation_deg": 1}],
    )
    found = run_experiment(load_experiment(path), jobs=0)["set"]
    failed = [t for t in found.trials if t.failed]
    assert {t.run for t in failed} == {"init-auto-route-edges"} and len(failed) == 4
    assert all("no initial guess: " in t.message for t in failed)
    assert all(np.isnan(t.initial_rotation_error_deg) for t in failed)
    assert len([t for t in found.trials if not t.failed]) == 4
    assert computed(path) == 0 and status(load_experiment(path))[0].failed == 4


def test_stored_guesses_are_started_from(write: Write, dataset: Dataset) -> None:
    """What was found before, here by hand, is where all methods start."""
    path = write(
        datasets=[{"path": "set", "scenarios": ["hall"]}],
        methods=["blobs", {"biased": {"bias_m": 0.1}}],
        starts=[{"init": "auto"}],
    )
    from lcdata.evaluation.task import DOUBT, FoundGuess
    from lcdata.experiment import Plan
    from lcdata.experiment.checksums import Checksums

    experiment = load_experiment(path)
    store = Store.open(experiment.store)
    near = {}
    for unit in Plan.of(experiment, Checksums.read(store.folder)).units:
        T = dataset.pose(unit.task.pose.pose_id).T_camera_lidar.copy()
        T[:3, 3] += 0.05
        near[unit.task.pair_ids] = T
        store.keep_guess(unit.guess_keys[0], FoundGuess(T, f"{DOUBT}one witness"))
    found = run_experiment(experiment, jobs=0)["set"]
    assert len(found.trials) == 8 and not found.failures
    for trial in found.trials:
        np.testing.assert_allclose(trial.T_camera_lidar_initial, near[trial.pair_ids], atol=1e-9)
        assert trial.message.endswith(f"{DOUBT}one witness") and trial.run == "init-auto"
        assert trial.initial_translation_error_m == pytest.approx(0.05 * 3**0.5)


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ({"init": "autom"}, "did you mean 'auto'"),
        ({"init": "auto", "guess": {"rote": "edges"}}, "no option 'rote': did you mean 'route'"),
        ({"init": "auto", "guess": {"route": "edge"}}, "unknown route 'edge'"),
        ({"init": "picks", "guess": {"route": "edges"}}, "options of `init: auto`"),
        ({"init": "none.csv"}, "no file none.csv"),
    ],
)
def test_starts_that_are_none(write: Write, start: dict[str, object], words: str) -> None:
    with pytest.raises(ExperimentError, match=words) as caught:
        load_experiment(write(starts=[start]))
    assert "experiment.yaml:" in str(caught.value)


def test_a_disk_that_fills_loses_nothing(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A real small disk: what was computed when it fills is stored all the same."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = os.geteuid() == 0 and shutil.which("mount")
    if (
        not mounted
        or subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(disk)],
            check=False,
            capture_output=True,
        ).returncode
    ):
        pytest.skip("no small disk can be mounted here")
    try:
        monkeypatch.setattr(run_module, "SAVE_EVERY_S", 0.0)
        path = write(store=str(disk / "store"), trials=4)
        yielded = []

        def filling(function, tasks):
            for item in run_here(function, tasks):
                if isinstance(item, TrialResult):
                    yielded.append(item)
                    if len(yielded) == 10:
                        _fill(disk / "filler")
                yield item

        with pytest.raises(DatasetError, match="no space left to write it: free some space"):
            run_experiment(load_experiment(path), executor=filling)
        (disk / "filler").unlink()
        assert len(Store.open(disk / "store").keys()) == len(yielded) >= 10
        found = run_experiment(load_experiment(path), jobs=0)["set"]
        assert len(found.trials) == 32 and not found.failures
    finally:
        subprocess.run(["umount", str(disk)], check=False)


def _fill(path: Path) -> None:
    """Write until the disk is full."""
    with path.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while file.write(bytes(4096)):
            pass


def test_a_limit_of_the_file_size_is_told_as_a_full_disk(write: Write) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    path = write(trials=3)

    def limiting(function, tasks):
        for item in run_here(function, tasks):
            yield item
            if isinstance(item, TrialResult):
                resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))

    try:
        with pytest.raises(DatasetError, match="no space left"):
            run_experiment(load_experiment(path), executor=limiting)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
