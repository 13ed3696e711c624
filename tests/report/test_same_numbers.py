"""Page, Markdown, LaTeX and CSV are written by different code paths: they must agree."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest
from page_reader import Reader, Table, numbers

from lcdata.dataset import Dataset
from lcdata.report import write_report
from lcdata.report.html import Cell, Group, size, table

METHODS = ("blobs", "biased", "habit")
ALL = "All scenarios"


@pytest.fixture(scope="module")
def report(calibrated: Dataset) -> Path:
    return write_report(calibrated).parent


@pytest.fixture(scope="module")
def page(report: Path) -> Reader:
    return Reader((report / "index.html").read_text())


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def markdown_rows(text: str, columns: int) -> list[list[str]]:
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line[:2] == "| "]
    return [line for line in lines if len(line) == columns and "---" not in line[0]][1:]


def latex_rows(text: str, columns: int) -> list[list[str]]:
    for escaped, plain in (
        ("\\%", "%"),
        ("\\_", "_"),
        ("$\\infty$", "∞"),
        ("$-\\infty$", "-∞"),
        ("--", "–"),
    ):
        text = text.replace(escaped, plain)
    lines = [line.removesuffix(" \\\\").split(" & ") for line in text.splitlines() if "&" in line]
    return [line for line in lines if len(line) == columns][1:]


def scenario_of(group: str) -> str:
    name = group.partition("ground truth:")[0]
    return "all" if name == ALL else name


def test_main_table(page: Reader, report: Path) -> None:
    (shown,) = page.table("Method", "Trials")
    in_markdown = markdown_rows((report / "table.md").read_text().partition("### Paired")[0], 11)
    tex = (report / "table.tex").read_text().partition(", paired")[0]
    in_latex, in_csv = latex_rows(tex, 11), rows_of(report / "summary.csv")
    assert len(shown.rows) == len(in_markdown) == len(in_latex) == len(in_csv) == 9
    assert [row.group[: len(ALL)] == ALL for row in shown.rows] == [True] * 3 + [False] * 6
    for row in shown.rows:
        name = scenario_of(row.group), row.cells[0]
        (markdown,) = (cells for cells in in_markdown if tuple(cells[:2]) == name)
        (latex,) = (cells for cells in in_latex if tuple(cells[:2]) == name)
        (raw,) = (cells for cells in in_csv if (cells["scenario"], cells["method"]) == name)
        for html, md, tex_cell in zip(row.cells[1:], markdown[2:], latex[2:], strict=True):
            assert numbers(html) == numbers(md) == numbers(tex_cell)
        _check_rounding(row.cells, row.keys, raw)


def _check_rounding(cells: list[str], keys: list[str | None], raw: dict[str, str]) -> None:
    for column, name in ((4, "rotation_deg_median"), (5, "translation_m_median")):
        value = float(raw[name])
        wanted = f"{value:.3f}" if math.isfinite(value) else "∞"
        assert numbers(cells[column])[0] == wanted
        assert float(keys[column]) == pytest.approx(value)
    assert float(keys[2]) == pytest.approx(float(raw["success_rate"]))
    assert numbers(cells[2])[0] == f"{100 * float(raw['success_rate']):.0f}"
    assert numbers(cells[1])[0] == raw["trials"]
    assert ("failed" in cells[1]) == (raw["failed"] != "0")
    assert (
        numbers(cells[6]) == [f"{float(raw['sigma_distance']):.1f}"]
        or "inf" in raw["sigma_distance"]
    )


def test_comparisons(page: Reader, report: Path) -> None:
    shown = [row for table in page.table("Error", "Methods") for row in table.rows]
    in_markdown = markdown_rows((report / "table.md").read_text().partition("### Paired")[2], 9)
    in_latex = latex_rows((report / "table.tex").read_text().partition(", paired")[2], 9)
    in_csv = rows_of(report / "comparisons.csv")
    assert len(shown) == len(in_markdown) == len(in_latex) == len(in_csv) == 18
    for row in shown:
        name = scenario_of(row.group), *row.cells[:2]
        (markdown,) = (cells for cells in in_markdown if tuple(cells[:3]) == name)
        (latex,) = (cells for cells in in_latex if tuple(cells[:3]) == name)
        first, second = row.cells[1].split(" – ")
        (raw,) = (
            r
            for r in in_csv
            if (r["scenario"], r["quantity"].partition("_")[0], r["first"], r["second"])
            == (*name[:2], first, second)
        )
        for html, md, tex_cell in zip(row.cells[2:], markdown[3:], latex[3:], strict=True):
            assert numbers(html) == numbers(md) == numbers(tex_cell)
        assert row.cells[-1] == (raw["better"] or "not ranked")
        assert float(row.keys[6]) == pytest.approx(float(raw["p_corrected"]))


def test_poses(page: Reader, report: Path) -> None:
    (shown,) = page.table("Pose", "Ground truth ±")
    assert shown.head[2:] == ["In view", *METHODS]
    in_csv = {(row["pose_id"], row["method"]): row for row in rows_of(report / "by_pose.csv")}
    assert len(shown.rows) * 3 == len(in_csv) == 12
    for row in shown.rows:
        assert row.cells[1:3] == ["0.14° 0.005 m", "100 %"]
        for method, cell, key in zip(METHODS, row.cells[3:], row.keys[3:], strict=True):
            raw = in_csv[row.cells[0], method]
            medians = [float(raw["rotation_deg_median"]), float(raw["translation_m_median"])]
            wanted = [f"{m:.3f}" if math.isfinite(m) else "∞" for m in medians]
            wanted += [raw["successes"], raw["trials"]]
            wanted += [raw["failed"]] if raw["failed"] != "0" else []
            assert numbers(cell) == wanted
            assert float(key) == pytest.approx(max(medians[0] / 0.5, medians[1] / 0.1))


def test_every_shown_number_is_what_its_column_sorts_by(page: Reader) -> None:
    checked = 0
    for shown in page.tables:
        for row in shown.rows:
            for name, cell, key in zip(shown.head, row.cells, row.keys, strict=True):
                if key in {None, ""} or name in METHODS or not numbers(cell):
                    continue
                first = numbers(cell)[0].replace("∞", "inf")
                scale = 100.0 if "%" in cell else 1.0
                value = float(key.replace("Infinity", "inf")) * scale
                near = pytest.approx(value, abs=0.51 * scale / 100 if scale > 1 else 0.051)
                if not (cell.endswith(("mm", "°")) and len(numbers(cell)) == 1):  # variances
                    assert float(first) == near or cell.startswith("<"), (name, cell, key)
                    checked += 1
    assert checked > 100


def test_notations_on_the_page_are_those_of_the_files(page: Reader, report: Path) -> None:
    for file, part in (
        ("summary.csv", None),
        ("comparisons.csv", None),
        ("table.md", "| Scenario | Method |"),
        ("table.tex", "\\begin{tabular}"),
    ):
        text = (report / file).read_text()
        lines = text.strip().splitlines()
        if part:
            lines = [line for line in lines if line.startswith(("|", "\\begin", "\\mid"))]
            lines = lines[:5]
        for line in lines:
            assert " ".join(line.split()) in page.text, (file, line)


def test_files_beside_the_page_are_linked(page: Reader, report: Path) -> None:
    assert {link for link in page.links if not (report / link).is_file()} == set()
    assert "summary.csv" in page.links


def test_cells_escape_and_sort_keys() -> None:
    rows = [
        [Cell("a"), Cell("∞", math.inf)],
        [Cell("b"), Cell("–", math.nan)],
        [Cell("c"), Cell("0.5 deg / 9 mm", 0.5)],
    ]
    shown: Table = Reader(table(("Name", "Error"), [Group("", rows)])).tables[0]
    assert [row.keys for row in shown.rows] == [[None, "Infinity"], [None, ""], [None, "0.5"]]
    assert shown.rows[2].cells == ["c", "0.5 deg / 9 mm"]
    assert size(b"RIFF____WEBPVP8X") == ""
