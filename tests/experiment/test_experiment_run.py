from __future__ import annotations

import dataclasses
import json
import re
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import toy_dataset
import yaml
from toy_methods import Biased, Blobs

from lcdata.dataset import Dataset, schema
from lcdata.dataset.atomic import write_parquet
from lcdata.dataset.validate import checksum
from lcdata.errors import ExperimentError, ReportError
from lcdata.evaluation import run_trials
from lcdata.evaluation.pool import run_here
from lcdata.evaluation.results import TrialResult
from lcdata.experiment import Store, load_experiment, run_experiment, status, write_reports
from lcdata.experiment import run as run_module

Write = Callable[..., Path]

SWEEP = {
    "methods": ["blobs", {"biased": {"bias_m": [0.0, 0.2]}}],
    "starts": [{"rotation_deg": [1, 5], "translation_m": 0.1}],
    "trials": 2,
    "seeds": [0, 1],
}


def files(store: Path) -> list[Path]:
    return sorted((store / "trials").glob("*.parquet"))


def test_each_trial_is_what_calibrate_gives(write: Write, dataset: Dataset) -> None:
    found = run_experiment(load_experiment(write(**SWEEP)), jobs=0)["set"]
    assert len(found.trials) == 8 * 3 * 2 * 2 * 2
    expected = run_trials(
        dataset,
        {"blobs": Blobs(), "biased(bias_m=0.2)": Biased(bias_m=0.2)},
        init_rotation_deg=1,
        init_translation_m=0.1,
        trials=2,
        seed=1,
        jobs=0,
    )
    by_name = {(t.run, *t.key): t for t in found.trials}
    for want in expected.trials:
        got = by_name[want.run, *want.key]
        np.testing.assert_allclose(got.T_camera_lidar_initial, want.T_camera_lidar_initial)
        np.testing.assert_allclose(
            got.T_camera_lidar_estimated, want.T_camera_lidar_estimated, atol=1e-9
        )
        for name in ("seed", "trial", "init_rotation_deg", "group", "groundtruth_version"):
            assert getattr(got, name) == getattr(want, name)
        assert got.translation_error_m == pytest.approx(want.translation_error_m)
    exact = by_name["5deg-0.1m-seed0", "biased(bias_m=0)", ("hall/pose_000/000",), 0]
    assert exact.translation_error_m < 0.02


def test_features_are_made_once_a_pair_for_all_protocols(write: Write, dataset: Dataset) -> None:
    Blobs.prepared.clear()
    run_experiment(load_experiment(write(**SWEEP)), jobs=0)
    assert sorted(Blobs.prepared) == [pair.pair_id for pair in dataset.pairs]


def test_nothing_is_computed_twice(write: Write, dataset: Dataset) -> None:
    path = write(**SWEEP)
    first = run_experiment(load_experiment(path), jobs=0)["set"]
    Blobs.prepared.clear()
    before = files(path.parent / "lcdata-trials")
    again = run_experiment(load_experiment(path), jobs=0)["set"]
    assert not Blobs.prepared and files(path.parent / "lcdata-trials") == before
    assert [t.key for t in first.trials] == [t.key for t in again.trials]
    # another file, other names, partly the same content
    store = Store.open(path.parent / "lcdata-trials")
    before = len(store.keys())
    other = path.with_name("other.yaml")
    content = {
        "datasets": ["set"],
        "methods": [{"method": "blobs", "label": "mine"}],
        "starts": [{"rotation_deg": 5, "translation_m": 0.1}],
        "trials": 3,
    }
    other.write_text(yaml.safe_dump(content))
    found = run_experiment(load_experiment(other), jobs=0)["set"]
    assert len(found.trials) == 24 and {t.method for t in found.trials} == {"mine"}
    # a third trial a pair is new, unless its random signs are those of another one
    assert 4 <= len(Blobs.prepared) <= 8 and len(store.keys()) == before + len(Blobs.prepared)
    copy = path.parent / "copy"  # the same files elsewhere are the same content
    (path.parent / "set").rename(copy)
    other.write_text(yaml.safe_dump(content | {"datasets": ["copy"]}))
    Blobs.prepared.clear()
    assert len(run_experiment(load_experiment(other), jobs=0)["copy"].trials) == 24
    assert not Blobs.prepared


def test_other_inputs_are_other_trials(write: Write, dataset: Dataset, monkeypatch) -> None:
    def computed(**content: object) -> int:
        Blobs.prepared.clear()
        run_experiment(load_experiment(write(**content)), jobs=0)
        return len(Blobs.prepared)

    assert computed() == 8 and computed() == 0
    assert computed(methods=[{"blobs": {"smallest": 21}}]) == 8
    assert computed(seeds=3) == 8
    assert computed(group="pose") == 8
    monkeypatch.setattr(Blobs, "version", 2)
    assert computed() == 8
    monkeypatch.setattr(Blobs, "version", 1)
    assert computed() == 0
    toy_dataset.move_truth(dataset, np.array([0.01, 0, 0, 0, 0, 0]))
    assert computed() == 8


def test_equal_guesses_are_one_trial(write: Write) -> None:
    """From the ground truth itself neither the seed nor the trial's number matters."""
    content = {"starts": [{"rotation_deg": 0, "translation_m": 0}], "trials": 3, "seeds": [0, 1]}
    path = write(**content)
    found = run_experiment(load_experiment(path), jobs=0)["set"]
    assert len(found.trials) == 8 * 6
    assert len(Store.open(path.parent / "lcdata-trials").keys()) == 8
    assert {t.seed for t in found.trials} == {0, 1} and {t.trial for t in found.trials} == {0, 1, 2}


def test_what_was_computed_before_an_interruption_is_kept(write: Write) -> None:
    path, made = write(**SWEEP), []

    def interrupted(function, tasks):
        for item in run_here(function, tasks):
            yield item
            made.append(item)
            if len(made) == 50:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_experiment(load_experiment(path), executor=interrupted)
    rows = status(load_experiment(path))
    done = sum(row.done for row in rows)
    assert 20 < done < 192 and sum(row.trials for row in rows) == 192
    Blobs.prepared.clear()
    assert len(run_experiment(load_experiment(path), jobs=0)["set"].trials) == 192
    assert len(Blobs.prepared) < 8


def test_failures_are_results_until_they_are_retried(write: Write) -> None:
    path = write(methods=["blobs", {"habit": {"habit": "raise"}}])
    found = run_experiment(load_experiment(path), jobs=0)["set"]
    assert sum(t.failed for t in found.trials) == 4
    row = status(load_experiment(path))[1]
    assert (row.dataset, row.method, row.trials, row.done, row.failed) == ("set", "habit", 8, 8, 4)
    Blobs.prepared.clear()
    run_experiment(load_experiment(path), jobs=0)
    assert not Blobs.prepared
    run_experiment(load_experiment(path), jobs=0, retry_failed=True)
    assert len(Blobs.prepared) == 4


def test_a_method_that_kills_its_process_costs_its_own_trials_alone(write: Write) -> None:
    path = write(
        methods=["blobs", {"habit": {"habit": "exit"}}],
        datasets=[{"path": "set", "scenarios": ["hall"]}],
    )
    found = run_experiment(load_experiment(path), jobs=1)["set"]
    failed = [t for t in found.trials if t.failed]
    assert len(found.trials) == 8 and len(failed) == 2
    assert all("exit code 3" in t.message and t.method == "habit" for t in failed)


def test_two_at_a_time_share_the_work(write: Write, monkeypatch) -> None:
    """Each saves after every trial, and leaves out what the other one has saved."""
    monkeypatch.setattr(run_module, "SAVE_EVERY_S", 0.0)
    path = write(trials=2)
    status(load_experiment(path))  # makes the store
    turn = threading.Barrier(2, timeout=60)
    counts = {"a": 0, "b": 0}
    found = {}

    def work(name: str) -> None:
        def counting(function, tasks):
            for item in run_here(function, tasks):
                yield item
                counts[name] += isinstance(item, TrialResult)

        experiment = load_experiment(path)
        turn.wait()
        found[name] = run_experiment(experiment, executor=counting)["set"]

    threads = [threading.Thread(target=work, args=(name,)) for name in "ab"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found["a"].trials) == len(found["b"].trials) == 16
    assert counts["a"] + counts["b"] < 32  # not everything twice
    assert status(load_experiment(path))[0].done == 16


def test_a_file_that_changed_is_named_with_its_checksum(write: Write, dataset: Dataset) -> None:
    pairs = [
        dataclasses.replace(
            p,
            image_sha256=checksum(dataset.path / p.image) or "",
            cloud_sha256=checksum(dataset.path / p.cloud) or "",
        )
        for p in dataset.pairs
    ]
    write_parquet(dataset.path / schema.PAIRS, schema.pairs_table(pairs))
    path = write()
    run_experiment(load_experiment(path), jobs=0)
    image = dataset.path / pairs[3].image
    before = image.read_bytes()
    image.write_bytes(before + b"\0")
    with pytest.raises(ExperimentError) as caught:
        run_experiment(load_experiment(path), jobs=0)
    assert str(image) in str(caught.value) and pairs[3].image_sha256[:12] in str(caught.value)
    image.write_bytes(before)
    Blobs.prepared.clear()
    assert len(run_experiment(load_experiment(path), jobs=0)["set"].trials) == 8
    assert not Blobs.prepared
    image.unlink()
    with pytest.raises(ExperimentError, match="cannot be read"):
        run_experiment(load_experiment(path), jobs=0)


def test_files_are_read_once_for_their_checksums(write: Write, dataset: Dataset) -> None:
    path = write()
    run_experiment(load_experiment(path), jobs=0)
    kept = path.parent / "lcdata-trials" / "checksums.json"
    stamp = kept.stat().st_mtime_ns
    assert len(json.loads(kept.read_text())) == 16
    status(load_experiment(path))
    assert kept.stat().st_mtime_ns == stamp
    kept.write_text("[]")  # damaged: made again
    assert status(load_experiment(path))[0].done == 8


def test_stores_that_cannot_be_used(write: Write, tmp_path: Path) -> None:
    path = write(store="other")
    store = tmp_path / "other"
    store.mkdir()
    (store / "something").touch()
    with pytest.raises(ExperimentError, match="no store of trials"):
        run_experiment(load_experiment(path), jobs=0)
    (store / "store.json").write_text('{"lcdata.trials": 2}')
    with pytest.raises(ExperimentError, match=r"version 2.*newer lcdata"):
        status(load_experiment(path))
    (store / "store.json").write_text("{}")
    with pytest.raises(ExperimentError, match="cannot be read"):
        status(load_experiment(path))


def test_a_damaged_file_of_trials_is_named(write: Write) -> None:
    path = write()
    run_experiment(load_experiment(path), jobs=0)
    (file,) = files(path.parent / "lcdata-trials")
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(ReportError, match=file.name):
        status(load_experiment(path))
    file.unlink()
    assert status(load_experiment(path))[0].done == 0


def test_files_of_one_process_become_one(write: Write, monkeypatch) -> None:
    monkeypatch.setattr(run_module, "SAVE_EVERY_S", 0.0)
    path = write()
    run_experiment(load_experiment(path), jobs=0)
    assert len(files(path.parent / "lcdata-trials")) == 1
    assert status(load_experiment(path))[0].done == 8


def test_scenarios_and_guesses_that_are_not_there(write: Write) -> None:
    path = write(datasets=[{"path": "set", "scenarios": ["barn"]}])
    with pytest.raises(ExperimentError, match="no scenario 'barn': it has hall, lawn"):
        status(load_experiment(path))
    path = write(datasets=[{"path": "set", "scenarios": ["lawn"]}])
    assert status(load_experiment(path))[0].trials == 4


def test_report_over_the_experiments_trials(write: Write, dataset: Dataset, tmp_path) -> None:
    path = write(**SWEEP)
    with pytest.raises(ExperimentError, match="no trial has been computed yet"):
        write_reports(load_experiment(path), tmp_path / "out")
    run_experiment(load_experiment(path), jobs=0)
    more = write(**SWEEP | {"seeds": [0], "trials": 3}, datasets=["set"])
    pages = write_reports(load_experiment(more), tmp_path / "out")
    assert pages == [tmp_path / "out" / "set" / "index.html"]
    text = pages[0].read_text()
    missing = re.search(r"(\d+) of 144 trials have not been run yet", text)
    assert missing and 30 < int(missing[1]) <= 48  # by chance a third guess is one of the first
    assert "biased(bias_m=0.2)" in text and "How far off a guess may be" in text
    table = (tmp_path / "out" / "set" / "table.md").read_text()
    assert "## From 5° and 0.1 m an axis" in table and "Paired comparison" in table
    assert not (dataset.path / "report").exists() and not (dataset.path / "results").exists()
