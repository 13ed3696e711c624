"""The page in a real Chromium: does it sort, fit, copy, and leave the network alone?"""

from __future__ import annotations

import json
import math
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from page_reader import Reader, numbers

sys.path.insert(0, str(Path(__file__).parents[1] / "pick"))  # Chromium over its own pipe

from chromium import Browser, find_chromium

from lcdata.dataset import Dataset
from lcdata.report import write_report
from lcdata.report.html import Cell, Group, table
from lcdata.report.script import SCRIPT

pytestmark = pytest.mark.slow

ENTER = {"key": "Enter", "code": "Enter", "text": "\r", "windowsVirtualKeyCode": 13}
SHOWN = """
(() => {
  const table = document.querySelectorAll("table")[%d];
  return [...table.tBodies].map((body) => [...body.rows].map((row) => row.innerText));
})()
"""


class Watching(Browser):
    """Remembers what the page asks the network for."""

    def __init__(self, profile: Path) -> None:
        self.requests: list[str] = []
        super().__init__(profile, 1200, 900)
        self.call("Network.enable")

    def _next(self) -> Any:
        message = super()._next()
        if message.get("method") == "Network.requestWillBeSent":
            self.requests.append(message["params"]["request"]["url"])
        return message

    def show(self, path: Path, width: int) -> None:
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=900,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.call("Page.navigate", url=path.as_uri())
        self.until(f"location.href === {json.dumps(path.as_uri())}")
        self.until("document.readyState === 'complete'")

    def press(self, script: str) -> None:
        """Click the middle of an element with the mouse."""
        self.value(f"({script}).scrollIntoView({{block: 'center', behavior: 'instant'}})")
        box = f"(({script}).getBoundingClientRect())"
        x, y, w, h = (self.value(f"{box}.{name}") for name in ("x", "y", "width", "height"))
        self.click(x + w / 2, y + h / 2)


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watching]:
    if find_chromium() is None:
        pytest.skip("no Chromium on this machine (apt install chromium)")
    with Watching(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.fixture(scope="module")
def page(calibrated: Dataset) -> Path:
    return write_report(calibrated)


@pytest.mark.parametrize("width", [1200, 390])
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_fits_without_errors_and_without_a_network(
    chromium: Watching, page: Path, width: int, theme: str
) -> None:
    chromium.requests.clear()
    chromium.theme(theme)
    chromium.show(page, width)
    chromium.value("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    chromium.value("document.querySelectorAll('img').forEach((i) => { i.loading = 'eager'; })")
    chromium.until("[...document.images].every((image) => image.complete)")
    assert chromium.value("[...document.images].every((image) => image.naturalWidth > 100)")
    assert chromium.value("document.documentElement.scrollWidth") == width
    over = chromium.value(
        "[...document.querySelectorAll('main *')].filter((e) => !e.closest('.scroll, pre, picture')"
        f" && e.getBoundingClientRect().right > {width} + 0.5).map((e) => e.outerHTML.slice(0, 99))"
    )
    assert over == []
    background = chromium.value("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, numbers(background))) > 600) == (theme == "light")
    assert [url for url in chromium.requests if not url.startswith("data:")] == [page.as_uri()]
    assert chromium.problems == []


def test_the_policy_keeps_even_a_page_that_would_ask_from_asking(
    chromium: Watching, page: Path, tmp_path: Path
) -> None:
    bad = tmp_path / "bad.html"
    image = '<img id="bad" src="http://127.0.0.1:9/x.png">'
    bad.write_text(page.read_text().replace("</main>", f"{image}</main>"))
    chromium.show(bad, 1200)
    chromium.until("document.getElementById('bad').complete")
    assert any("Content Security Policy" in problem for problem in chromium.problems)
    chromium.problems.clear()


def test_a_click_on_a_head_sorts_each_scenario_by_its_numbers(
    chromium: Watching, page: Path
) -> None:
    chromium.show(page, 1200)
    head = "document.querySelector('table').tHead.rows[0].cells[5]"
    assert chromium.value(f"{head}.innerText").startswith("Translation")
    before = chromium.value(SHOWN % 0)
    assert chromium.value(f"{head}.getAttribute('aria-sort')") == "none"
    chromium.press(f"{head}.querySelector('button')")
    up = chromium.value(SHOWN % 0)
    assert chromium.value(f"{head}.getAttribute('aria-sort')") == "ascending"
    chromium.press(f"{head}.querySelector('button')")
    down = chromium.value(SHOWN % 0)
    assert chromium.value(f"{head}.getAttribute('aria-sort')") == "descending"
    for first, rising, falling in zip(before, up, down, strict=True):
        assert rising[0] == falling[0] == first[0]  # the scenario stays above its methods
        assert sorted(rising) == sorted(falling) == sorted(first)
        methods = [[row.split()[0] for row in rows[1:]] for rows in (rising, falling)]
        assert methods == [["blobs", "biased", "habit"], ["habit", "biased", "blobs"]]


def test_a_keyboard_sorts_too(chromium: Watching, page: Path) -> None:
    chromium.show(page, 1200)
    head = "document.querySelector('table').tHead.rows[0].cells[0]"
    chromium.value(f"{head}.querySelector('button').focus()")
    chromium.call("Input.dispatchKeyEvent", type="keyDown", **ENTER)
    chromium.call("Input.dispatchKeyEvent", type="keyUp", key="Enter", code="Enter")
    methods = [[row.split()[0] for row in rows[1:]] for rows in chromium.value(SHOWN % 0)]
    assert methods == [["biased", "blobs", "habit"]] * 3
    assert chromium.value(f"{head}.getAttribute('aria-sort')") == "ascending"
    buttons = chromium.value("document.querySelectorAll('th button').length")
    assert buttons == chromium.value("document.querySelectorAll('thead th').length") > 20


def test_keys_count_not_texts_and_missing_ones_stay_last(
    chromium: Watching, tmp_path: Path
) -> None:
    keys = [0.05, math.nan, 12.0, math.inf, 3.5, math.nan, -1.0, 3.5, 100.0]
    names = ["pose 10", "pose 2", "pose 1", "Pose 3", "pose 20", "a", "b", "c", "d"]
    rows = [
        [Cell(name), Cell(f"{k} deg / {i} mm", k)]
        for i, (name, k) in enumerate(zip(names, keys, strict=True))
    ]
    path = tmp_path / "table.html"
    body = table(("Name", "Error"), [Group("", rows)])
    path.write_text(f"<!doctype html><body>{body}<script>{SCRIPT}</script></body>")
    chromium.show(path, 1200)

    def order(column: int) -> list[int]:
        chromium.press(f"document.querySelector('table').tHead.rows[0].cells[{column}].firstChild")
        return [int(re.search(r"/ (\d+) mm", row).group(1)) for row in chromium.value(SHOWN % 0)[0]]

    known = [i for i, key in enumerate(keys) if not math.isnan(key)]
    assert order(1) == [*sorted(known, key=lambda i: keys[i]), 1, 5]
    fallen = order(1)
    assert [keys[i] for i in fallen[:-2]] == sorted((keys[i] for i in known), reverse=True)
    assert set(fallen[-2:]) == {1, 5}
    assert [names[i] for i in order(0)] == [
        *("a", "b", "c", "d"),
        *("pose 1", "pose 2", "Pose 3", "pose 10", "pose 20"),
    ]


def test_without_scripts_the_page_is_there_to_be_read(chromium: Watching, page: Path) -> None:
    chromium.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        chromium.show(page, 1200)
        shown = chromium.value("document.body.innerText")
    finally:
        chromium.call("Emulation.setScriptExecutionDisabled", value=False)
    for text in ("blobs succeeds in 100", "All scenarios", "lcdata review", "How to read this"):
        assert text in shown
    assert "↕" not in shown and "Copy" not in shown


def test_a_copied_command_opens_its_trial(chromium: Watching, page: Path, tmp_path: Path) -> None:
    chromium.show(page, 1200)
    block = "document.querySelector('.copied code').parentElement"
    text = chromium.value(f"{block}.querySelector('code').textContent")
    assert text in Reader(page.read_text()).commands
    chromium.value(
        "document.addEventListener('copy', () => { window.copied = `${getSelection()}`; });"
        "navigator.clipboard.writeText = async (text) => { window.copied = text; };"
    )
    chromium.press(f"{block}.querySelector('button')")
    chromium.until(f"{block}.querySelector('button').textContent === 'Copied'")
    assert chromium.value("window.copied") == text
    lcdata, *words = shlex.split(text)
    assert lcdata == "lcdata"
    out = tmp_path / "trial.rrd"
    script = "from lcdata.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", script, *words, "--save", str(out), "--json"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert out.stat().st_size > 1000
