from __future__ import annotations

import base64
import csv
import re
import statistics
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
import toy_dataset
from page_reader import Reader
from toy_methods import Biased, Blobs, Habit

from lcdata.dataset import Dataset
from lcdata.errors import ReportError
from lcdata.evaluation import run_trials
from lcdata.report import write_report
from lcdata.report.plots import box_plots
from lcdata.report.tables import percent
from lcdata.report.theme import DARK, LIGHT


def images(reader: Reader) -> Iterator[np.ndarray]:
    for source in reader.sources:
        assert source.startswith("data:image/")
        data = base64.b64decode(source.partition(",")[2])
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        yield image


@pytest.fixture(scope="module")
def page(calibrated: Dataset) -> Reader:
    calls: list[tuple[str, int, int]] = []
    path = write_report(calibrated, progress=lambda *call: calls.append(call))
    assert calls == [("report", n, 4) for n in range(1, 5)]
    return Reader(path.read_text())


def test_all_files_are_there(page: Reader, calibrated: Dataset) -> None:
    names = {path.name for path in (calibrated.path / "report").iterdir()}
    assert names == {
        "index.html",
        "results.csv",
        "summary.csv",
        "table.md",
        "table.tex",
        "comparisons.csv",
        "by_pose.csv",
        "errors-5deg-0.5m-seed0.png",
        "ecdf-5deg-0.5m-seed0.png",
        "poses-5deg-0.5m-seed0.png",
    }


def test_page_needs_nothing_but_itself(page: Reader) -> None:
    # three plots in two themes; best and median of 3 methods (habit's median failed) in three
    # pictures, each, worst ones in two
    worst = len(re.findall(r"Worst", page.text)) - 1  # one in the note above them
    assert worst >= 3 * 3
    assert len(list(images(page))) == 3 * 2 + 3 * 2 * 3 - 1 + 2 * worst
    assert "http" not in page.text and not any("//" in link for link in page.links)


def test_page_says_what_one_must_know(page: Reader, calibrated: Dataset) -> None:
    for text in (
        "Simulated data",
        "Simulated recordings, no real sensors: 8 LiDAR-camera pairs at 4 poses in 2 scenarios",
        "Of 16 trials, blobs succeeds in 100 %, biased in 100 % and habit in 50 %.",
        "Its own uncertainty (root mean square, 1 sigma): 0.14° and 5 mm.",
        "Seed 0",
        "8.66° and 0.866 m in all",
        f"ground truth {calibrated.info.groundtruth_version}",
        "blobs and biased are not ranked",
        "blobs has the smaller median by",
        "Trials without an estimate",
        "habit on hall/pose_000/001, trial 0: ZeroDivisionError: a line of no length",
        "off on purpose",
    ):
        assert text in page.text, text
    assert page.text.count("ZeroDivisionError") == 8 + 1  # the list and the median trial


def test_tables_against_the_parquet_file(page: Reader, calibrated: Dataset) -> None:
    rows = pq.read_table(next((calibrated.path / "results").glob("*.parquet"))).to_pylist()
    markdown, _, _ = (calibrated.path / "report/table.md").read_text().partition("### Paired")
    lines = [line.strip("| ").split(" | ") for line in markdown.splitlines() if line[:1] == "|"]
    header, table = lines[0], lines[2:]
    assert len(table) == 3 * 3
    for cells in table:
        row = dict(zip(header, cells, strict=True))
        mine = [
            r
            for r in rows
            if r["method"] == row["Method"] and row["Scenario"] in (r["scenario"], "all")
        ]
        errors = [r["translation_error_m"] if not r["failed"] else np.inf for r in mine]
        median = statistics.median(errors)
        shown = re.sub(r"^~ ", "", row["Translation (m)"]).split()[0]
        assert shown == (f"{median:.3f}" if np.isfinite(median) else "∞")
        assert row["Trials"].split()[0] == str(len(mine))
        assert ("failed" in row["Trials"]) == (row["Method"] == "habit")
        good = [r for r in mine if r["rotation_error_deg"] < 0.5 and r["translation_error_m"] < 0.1]
        rate, interval = row["Success"].split(" [")
        assert rate == f"{100 * len(good) / len(mine):.0f} %"
        low, high = map(int, interval.strip("]").split(", "))
        assert low <= 100 * len(good) / len(mine) <= high and high - low > 20
        explained = [r for r in mine if r["sigma_distance"] < 3.55]
        assert row["Explained"] == percent(len(explained) / len(mine))
    with (calibrated.path / "report/results.csv").open() as file:
        trials = list(csv.DictReader(file))
    assert len(trials) == len(rows) == 48
    for trial, stored in zip(trials, rows, strict=True):
        assert trial["pair_ids"] == stored["pair_ids"][0]
        assert float(trial["rotation_error_deg"]) == pytest.approx(
            stored["rotation_error_deg"], nan_ok=True
        )
    latex, _, paired = (calibrated.path / "report/table.tex").read_text().partition(", paired")
    assert paired.count("\\toprule") == 1 and "< 0" not in paired
    body = [line for line in latex.splitlines() if line.endswith("\\\\")]
    assert {line.count("&") for line in body} == {len(header) - 1} and len(body) == 10
    assert not re.search(r"(?<!\\)[%_](?!.*usepackage)", "".join(body))


def test_methods_are_compared_pair_by_pair(page: Reader, calibrated: Dataset) -> None:
    """8 pairs: blobs is better than biased, by more than the truth's uncertainty; by p < 0.05."""
    folder = calibrated.path / "report"
    with (folder / "comparisons.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 3 * 2  # 2 scenarios and all; 3 pairs of methods; 2 errors
    whole = {(r["first"], r["second"], r["quantity"]): r for r in rows if r["scenario"] == "all"}
    row = whole["blobs", "biased", "translation_m"]
    assert row["better"] == "blobs" and float(row["p_corrected"]) < 0.05
    assert (row["trials"], row["units"], row["first_smaller"]) == ("16", "8", "16")
    assert float(row["difference_high"]) < -0.03 < float(row["sigma"])
    assert float(row["p"]) == pytest.approx(2 / 2**8)  # all 8 signs alike
    assert whole["blobs", "biased", "rotation_deg"]["better"] == ""
    row = whole["blobs", "habit", "translation_m"]
    assert row["better"] == "" and row["second_failed"] == "8" and row["second_smaller"] == "0"
    small = next(r for r in rows if r["scenario"] == "hall" and r["quantity"] == "translation_m")
    assert small["difference_low"] == "nan" and small["better"] == ""
    assert "4 pairs or groups are too few to rank it above biased" in page.text
    _, _, markdown = (folder / "table.md").read_text().partition("### Paired comparison")
    assert markdown.count("blobs – biased") == 6 and "| 16 / 0 / 0 |" in markdown
    assert page.text.count("Paired comparison") == 1 + 1 + 1  # heading, note, by scenario


def test_every_pose_has_a_line(page: Reader, calibrated: Dataset) -> None:
    with (calibrated.path / "report/by_pose.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(r["pose_id"], r["method"]) for r in rows] == [
        (pose.pose_id, method)
        for pose in calibrated.poses
        for method in ("blobs", "biased", "habit")
    ]
    habits = [r for r in rows if r["method"] == "habit"]
    assert all((r["trials"], r["failed"], r["successes"]) == ("4", "2", "2") for r in habits)
    assert all(r["rotation_deg_median"] == "inf" for r in habits)
    assert "Pose by pose" in page.text and "∞° ∞ m 2/4" in page.text


def test_static_reference_says_that_no_uncertainty_is_known(tmp_path: Path) -> None:
    dataset = toy_dataset.make(tmp_path / "set", ("road",), 1, 2, covariance=None)
    run_trials(dataset, [Blobs(), Biased()], jobs=0)
    page = Reader(write_report(dataset).read_text())
    assert "ground truth: no uncertainty known" in page.text
    assert "so that no method can be ranked by it" in page.text
    assert "are not ranked: the ground truth has no known uncertainty" in page.text
    assert "no uncertainty known" in (dataset.path / "report/table.md").read_text()


def test_ground_truth_worse_than_the_limits_is_a_warning(tmp_path: Path) -> None:
    covariance = np.diag([1e-4] * 3 + [np.radians(0.5) ** 2] * 3)
    dataset = toy_dataset.make(tmp_path / "set", ("hall",), 1, 1, covariance)
    run_trials(dataset, [Blobs()], jobs=0)
    page = Reader(write_report(dataset).read_text())
    assert "less certain than the limits of success" in page.text


def test_names_are_escaped_and_runs_kept_apart(tmp_path: Path) -> None:
    dataset = toy_dataset.make(tmp_path / "a<b>&", ("s_1",), 1, 1)
    run_trials(dataset, {"<script>": Blobs(), "a|b": Biased()}, jobs=0)
    run_trials(dataset, {"<script>": Blobs()}, init_rotation_deg=1, init_translation_m=0.1, jobs=0)
    path = write_report(dataset)
    page = Reader(path.read_text())
    assert path.read_text().count("<script>") == 1 and "<script>" in page.text  # its own
    assert page.text.index("From 5° and 0.5 m") < page.text.index("From 1° and 0.1 m")
    assert len(list(path.parent.glob("errors-*.png"))) == 2
    assert (path.parent / "start.png").is_file() and "How far off a guess may be" in page.text
    markdown = (path.parent / "table.md").read_text()
    assert "a\\|b" in markdown and markdown.count("## From") == 2
    (dataset.path / "results/1deg-0.1m-seed0.parquet").unlink()
    write_report(dataset)
    assert len(list(path.parent.glob("errors-*.png"))) == 1
    assert not (path.parent / "start.png").exists()


def test_stale_results_are_never_mixed(tmp_path: Path) -> None:
    dataset = toy_dataset.make(tmp_path / "set", ("hall",), 1, 2)
    with pytest.raises(ReportError, match="no results"):
        write_report(dataset)
    run_trials(dataset, [Blobs(), Biased()], jobs=0)
    moved = toy_dataset.move_truth(dataset, np.array([0.0, 0.3, 0, 0, 0, 0]))
    with pytest.raises(ReportError, match="older ground truth"):
        write_report(moved)
    run_trials(moved, [Blobs()], jobs=0)
    page = Reader(write_report(moved).read_text())
    assert "2 stored trials against an older ground truth are stale and left out" in page.text
    assert "biased" not in page.text
    page = Reader(write_report(moved, recompute=True).read_text())
    assert "measured again" in page.text and "biased" in page.text
    assert "Of 2 trials, blobs succeeds in 0 % and biased in 0 %." in page.text


def test_pictures_of_lost_files_are_left_out(tmp_path: Path) -> None:
    dataset = toy_dataset.make(tmp_path / "set", ("hall",), 1, 1)
    run_trials(dataset, [Blobs()], jobs=0)
    (dataset.path / dataset.pairs[0].cloud).unlink()
    assert "no picture" in Reader(write_report(dataset).read_text()).text


def test_plots_are_the_same_every_time_and_differ_by_theme(calibrated: Dataset) -> None:
    trials = run_trials(calibrated, [Blobs(), Biased(), Habit()], trials=2, jobs=0).trials
    light = box_plots(trials, LIGHT)
    assert light == box_plots(trials, LIGHT) != box_plots(trials, DARK)
    image = cv2.imdecode(np.frombuffer(light, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape[1] > 1200
    only_failed = [t for t in trials if t.failed]
    assert box_plots(only_failed, LIGHT).startswith(b"\x89PNG")


def test_per_cent_says_all_only_of_all() -> None:
    assert [percent(x) for x in (1, 0.999, 0.5, 0.001, 0, float("nan"))] == [
        "100 %",
        "99.9 %",
        "50 %",
        "0.1 %",
        "0 %",
        "–",
    ]
