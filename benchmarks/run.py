"""Run the benchmarks, keep what they print, and write docs/benchmarks.md from it.

    python benchmarks/run.py                    # all of them, one after the other: hours
    python benchmarks/run.py nid wide           # these
    python benchmarks/run.py --list             # names, commands, when each was run
    python benchmarks/run.py --page             # the page alone, from what is kept

plan.yaml names the commands and the figures that the page's first table takes from their output.
What a command prints is kept in printed/NAME.json with the machine, the versions and the load, so
that the page cannot say what no command printed.
"""

from __future__ import annotations

import argparse
import datetime
import importlib.metadata
import json
import os
import platform
import re
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import yaml

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "benchmarks.md"
PRINTED = HERE / "printed"
LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless", "open3d-cpu", "pin", "rerun-sdk")

INTRODUCTION = """\
# Benchmarks

This page is written by `python benchmarks/run.py`, which runs every script below and keeps what it
prints; `python benchmarks/run.py NAME` runs one again. Nothing here was typed by hand but the
paragraphs. Simulated means `lcdata simulate`; errors are against the exact truth that it writes.
Seconds are processor time where the script says so. The load is the number of processes that were
waiting or running before the start: seconds that were taken under a load are upper bounds.
"""


@dataclass(frozen=True)
class Figure:
    """One number of a script's output: the median of what the pattern's group finds."""

    what: str
    find: str
    unit: str = ""
    at_most: float | None = None
    at_least: float | None = None
    pick: str = "median"  # of several matches; also: min, max

    def value(self, output: str) -> float:
        """Raises SystemExit where the script does not print it."""
        found = [float(match) for match in re.findall(self.find, output, re.MULTILINE)]
        if not found:
            raise SystemExit(f"{self.what}: nothing printed matches {self.find!r}")
        picks = {"median": statistics.median, "min": min, "max": max}
        return float(picks[self.pick](found))

    def target(self) -> str:
        """What the figure should reach, in words."""
        if self.at_most is not None:
            return f"{self.at_most:g} or less" if self.at_most else "none"
        return f"{self.at_least:g} or more" if self.at_least is not None else ""

    def verdict(self, value: float) -> str:
        """Whether it does: nothing where there is no target."""
        if self.at_most is not None:
            return "reached" if value <= self.at_most else "missed"
        if self.at_least is not None:
            return "reached" if value >= self.at_least else "missed"
        return ""


@dataclass(frozen=True)
class Benchmark:
    """One command of plan.yaml."""

    name: str
    title: str
    command: str
    text: str = ""
    figures: tuple[Figure, ...] = ()

    @property
    def kept(self) -> Path:
        """Where its last run is."""
        return PRINTED / f"{self.name}.json"


@dataclass(frozen=True)
class Run:
    """What a command printed, and on what."""

    command: str
    output: str
    seconds: float
    day: str
    commit: str
    load: float
    machine: str
    versions: dict[str, str] = field(default_factory=dict)

    def conditions(self) -> str:
        """One line on when and where."""
        return (
            f"{self.day}, {self.commit}, {self.machine}, load {self.load:.1f}, "
            f"{self.seconds:.0f} s in all"
        )


def plan() -> list[Benchmark]:
    entries = yaml.safe_load((HERE / "plan.yaml").read_text())
    return [
        Benchmark(**{**entry, "figures": tuple(Figure(**one) for one in entry.get("figures", ()))})
        for entry in entries
    ]


def machine() -> str:
    """The processor's own name where the system tells it."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists() and (match := re.search(r"model name\s*:\s*(.+)", info.read_text())):
        name = match[1]
    return f"{os.cpu_count()} cores of {name}, {platform.system()}"


def versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for library in LIBRARIES:
        try:
            found[library] = importlib.metadata.version(library)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def commit() -> str:
    """The commit that is measured, and whether the package has changes that are not in it."""

    def git(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["git", *arguments], cwd=HERE.parent, capture_output=True, text=True, check=False
        )

    found = git("rev-parse", "--short", "HEAD")
    if found.returncode:
        return "no commit"
    changed = git("status", "--porcelain", "lcdata", "benchmarks/*.py").stdout.strip()
    return f"commit {found.stdout.strip()}{' and changes' if changed else ''}"


def run(benchmark: Benchmark) -> Run:
    """Run one command and echo it. Raises SystemExit where it fails: nothing is kept then."""
    load = os.getloadavg()[0]
    scratch = tempfile.mkdtemp(prefix="lcdata-benchmarks-")
    command = benchmark.command.format(
        work=scratch, dataset=f"{scratch}/dataset", shared=HERE.parents[1] / "shared" / "data"
    )
    program, *arguments = shlex.split(command)
    start = (
        [sys.executable, "-m", "lcdata"]
        if program == "lcdata"
        else [sys.executable, str(HERE / program)]
    )
    began = time.perf_counter()
    lines = []
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "NO_COLOR": "1", "COLUMNS": "140"}
    try:
        if "{dataset}" in benchmark.command:
            build = ["build", str(HERE.parent / "recordings"), "-o", f"{scratch}/dataset"]
            subprocess.run(
                [sys.executable, "-m", "lcdata", *build],
                check=True,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        with subprocess.Popen(
            [*start, *arguments], stdout=subprocess.PIPE, text=True, env=environment
        ) as process:
            for line in process.stdout or ():
                print("  " + line, end="", flush=True)
                lines.append(line.rstrip())
    finally:
        shutil.rmtree(scratch)
    if process.returncode:
        raise SystemExit(f"{benchmark.command} ended with {process.returncode}: nothing was kept")
    return Run(
        benchmark.command,
        "\n".join(lines).strip("\n"),
        time.perf_counter() - began,
        datetime.date.today().isoformat(),
        commit(),
        load,
        machine(),
        versions(),
    )


def kept(benchmark: Benchmark) -> Run | None:
    return Run(**json.loads(benchmark.kept.read_text())) if benchmark.kept.exists() else None


def page(benchmarks: list[Benchmark]) -> str:
    """The page's text, from what is kept."""
    runs = {benchmark.name: kept(benchmark) for benchmark in benchmarks}
    rows = ["| what | measured | to reach | | section |", "| --- | --- | --- | --- | --- |"]
    sections = []
    for benchmark in benchmarks:
        anchor = re.sub(r"[^a-z0-9 -]", "", benchmark.title.lower()).replace(" ", "-")
        found = runs[benchmark.name]
        command = benchmark.command
        shown = command if command.startswith("lcdata") else f"python benchmarks/{command}"
        body = f"## {benchmark.title}\n\n{benchmark.text.strip()}\n\n    {shown}\n"
        if found is None:
            sections.append(f"{body}\nNot run for this page.\n")
            continue
        if found.command != benchmark.command:
            body += f"\nThe figures below are of `{found.command}`.\n"
        sections.append(f"{body}\n{found.conditions()}:\n\n```text\n{found.output}\n```\n")
        for figure in benchmark.figures:
            value = figure.value(found.output)
            rows.append(
                f"| {figure.what} | {value:g} {figure.unit} | {figure.target()} | "
                f"{figure.verdict(value)} | [{benchmark.title}](#{anchor}) |"
            )
    tested = sorted({json.dumps(one.versions) for one in runs.values() if one is not None})
    with_versions = "\n".join(
        "- " + ", ".join(f"{name} {version}" for name, version in json.loads(one).items())
        for one in tested
    )
    table = "\n".join(rows)
    ending = f"## Versions\n\n{with_versions}\n"
    return "\n".join(
        [INTRODUCTION, f"## Figures and what they should reach\n\n{table}\n", *sections, ending]
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="of plan.yaml; all where none is given")
    parser.add_argument("--list", action="store_true", help="print the names and commands")
    parser.add_argument("--page", action="store_true", help="run nothing, write the page")
    options = parser.parse_args()
    benchmarks = plan()
    known = {benchmark.name: benchmark for benchmark in benchmarks}
    if unknown := [name for name in options.names if name not in known]:
        parser.error(f"no benchmark {', '.join(unknown)}: there are {', '.join(known)}")
    if options.list:
        for benchmark in benchmarks:
            found = kept(benchmark)
            print(f"{benchmark.name:20s} {benchmark.command:60s} {found.day if found else 'never'}")
        return
    if not options.page:
        for benchmark in [known[name] for name in options.names] or benchmarks:
            print(f"{benchmark.name}: {benchmark.command}", flush=True)
            found = run(benchmark)
            for figure in benchmark.figures:
                figure.value(found.output)
            PRINTED.mkdir(exist_ok=True)
            benchmark.kept.write_text(json.dumps(asdict(found), indent=1) + "\n")
            PAGE.write_text(page(benchmarks))
    PAGE.write_text(page(benchmarks))


if __name__ == "__main__":
    main()
