from __future__ import annotations

import csv
import io
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "review"))  # data set of an arm with results

from box_room import GOOD, RUN, add_results, load_arm, make

from lcdata.dataset import Dataset, schema
from lcdata.dataset.atomic import write_parquet
from lcdata.evaluation.results import results_path, write_run
from lcdata.groundtruth.budget import TITLES
from lcdata.groundtruth.chain import arm_truth
from lcdata.report import budget, write_report


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    made = make(tmp_path_factory.mktemp("budget") / "set", pairs=1)
    arm = load_arm(made.rig)
    poses = [
        replace(p, budget=arm_truth(made.rig, arm, p.joint_positions).budget) for p in made.poses
    ]
    write_parquet(made.path / schema.POSES, schema.poses_table(poses))
    alike = [t for t in add_results(made) if t.method == GOOD]
    alike += [replace(t, method="gamma") for t in alike]
    write_run(results_path(made, RUN), alike)
    return Dataset.open(made.path)


def test_shares_add_up_and_sigmas_are_those_of_the_covariance(dataset):
    rows = budget.table(dataset)
    for scenario in dataset.scenarios:
        here = [r for r in rows if r.scenario == scenario]
        assert here[-1].source == "total"
        for k in range(2):
            assert sum(r.share[k] for r in here[:-1]) == pytest.approx(1)
            assert sum(r.sigma[k] for r in here[:-1]) == pytest.approx(here[-1].sigma[k])


def test_every_pose_has_a_line_in_the_csv(dataset):
    lines = list(csv.DictReader(io.StringIO(budget.poses_csv(dataset))))
    assert [line["pose_id"] for line in lines] == [p.pose_id for p in dataset.poses]
    for line in lines:
        parts = [float(line[f"{s}_mm"]) ** 2 for s in dataset.poses[0].budget]
        assert np.sqrt(sum(parts)) == pytest.approx(float(line["total_mm"]))
        assert line["groundtruth_version"] == dataset.info.groundtruth_version


def test_page_table_and_plots_show_budget_version_and_what_is_not_ranked(dataset):
    page = write_report(dataset)
    text, table = page.read_text(), (page.parent / "table.md").read_text()
    for title in (TITLES["joint_offsets"], TITLES["T_base_lidar"]):
        assert title in text
        assert f"| {title} |" in table
    assert f"version {dataset.info.groundtruth_version}" in text
    assert f"version {dataset.info.groundtruth_version}" in table
    latex = (page.parent / "table.tex").read_text().partition("own uncertainty, version ")[2]
    lines = [line for line in latex.splitlines() if line.endswith("\\\\")]
    assert len(lines) == 1 + len(budget.table(dataset))
    assert {line.count("&") for line in lines} == {5}
    assert any(f"& {TITLES['T_base_lidar']} &" in line and "\\%" in line for line in lines)
    assert not re.search(r"(?<!\\)[%_]", "".join(lines))
    assert (page.parent / "groundtruth-budget.png").stat().st_size > 5000
    assert (page.parent / "groundtruth.csv").is_file()
    assert text.count('alt="Stacked bars') == 1
    assert "| ~ " in table
    assert "≈</abbr>" in text


def test_without_a_budget_the_page_says_so(tmp_path):
    dataset = make(tmp_path / "set", arm=False, pairs=1)
    add_results(dataset)
    page = write_report(dataset)
    assert "does not say where it comes from" in page.read_text()
    assert "% The data set does not say" in (page.parent / "table.tex").read_text()
    assert not (page.parent / "groundtruth-budget.png").exists()
