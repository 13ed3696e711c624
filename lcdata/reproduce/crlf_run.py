"""What CRLF's two experiments share: their options and the run over frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import lcdata
from lcdata.calibrators.registry import create
from lcdata.errors import CalibrationError
from lcdata.reproduce.crlf_frames import SOURCES, Source, beside_the_checkout, count, source_of
from lcdata.reproduce.crlf_trials import Kept, Row, Task
from lcdata.reproduce.experiment import Progress, Settings
from lcdata.reproduce.kept import run_kept

GOOD_M, GOOD_DEG = 0.5, 3.0
"""Errors below which all of the paper's coarse calibrations are."""


def sources_option() -> dict[str, str]:
    """Options of both experiments."""
    names = ",".join(source.name for source in SOURCES)
    return {
        "sources": f"{names}: simulated roads, real frames",
        "data": "folder with kitti_road/ and opencalib_crossing/; shared/data beside the checkout",
    }


def run_sources(
    name: str,
    settings: Settings,
    frames: int,
    run: Callable[[Task], Iterator[Row]],
    progress: Progress | None,
) -> tuple[dict[Source, list[Row]], str]:
    """Run an experiment on the frames of all sources that are there.

    Args:
        name: Of the experiment.
        settings: Options.
        frames: Simulated frames a source.
        run: Works on one frame.
        progress: Called with the name, frames done and frames in all.

    Returns:
        Rows of each source that has frames, and a sentence on those that have none.

    Raises:
        CalibrationError: An unknown source, no frames at all, or a process that died.
    """
    text = settings.options.get("sources")
    chosen = SOURCES if text is None else [source_of(part.strip()) for part in text.split(",")]
    given = settings.options.get("data")
    data = beside_the_checkout() if given is None else Path(given)
    counts = {source: count(source, frames, data) for source in chosen}
    missing = [source.folder for source, there in counts.items() if not there]
    if len(missing) == len(counts):
        raise CalibrationError(
            f"{data}: neither frames nor simulated sources", "give --set data=FOLDER"
        )
    kept = kept_rows(name, settings.folder)
    tasks = [
        Task(name, source.name, number, settings.seed, data)
        for source, there in counts.items()
        for number in range(there)
    ]
    rows = run_kept(name, tasks, kept, run, settings.jobs, progress)
    found: dict[Source, list[Row]] = {source: [] for source, there in counts.items() if there}
    for row in rows:
        found[source_of(row.source)].append(row)
    skipped = f"Left out, as {data} does not have them: {', '.join(missing)}. " if missing else ""
    return found, skipped


def kept_rows(name: str, folder: Path | None) -> Kept:
    """Rows of an experiment that are done; those of another version are not taken for today's."""
    version = f"{lcdata.__version__}-crlf{create('crlf').version}"
    return Kept(folder / f"{name}-{version}.jsonl" if folder else None)
