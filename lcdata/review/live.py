"""Live: trials as they are stored, in a viewer, a browser or a file, until it is ended."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from lcdata.errors import LcdataError, ReportError
from lcdata.review.arrange import Wanted, arrange
from lcdata.review.follower import Follower
from lcdata.review.save import Progress, send_all
from lcdata.review.shown import Shown
from lcdata.review.thinning import plan

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.dataset.reader import Dataset

POLL_S = 1.0
SOURCES = 5
"""Overlays a pair that points are planned for: who is live does not know the methods yet."""

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Options:
    """How to follow.

    Args:
        wanted: Which pairs, methods and run; None of the run for the one that is written last.
        points: Points of a cloud to keep; None for as many as the budget allows.
        thin: Every how many points to keep in place of a number.
        poll_s: Seconds between two looks at the results.
    """

    wanted: Wanted
    points: int | None = None
    thin: int | None = None
    poll_s: float = POLL_S


def follow(
    dataset: Dataset,
    options: Options,
    recorder: Callable[[], contextlib.AbstractContextManager[rr.RecordingStream]],
    *,
    ended: Callable[[], bool] = lambda: False,
    tell: Tell = lambda text: None,
    progress: Progress | None = None,
) -> int:
    """Show all pairs, then every trial as it is stored.

    Args:
        dataset: The data set.
        options: How to follow.
        recorder: Makes a recording; another one when another run is written.
        ended: Asked at every look whether to end. Ctrl-C ends it, too, once all pairs are there.
        tell: Told a line when something has come.
        progress: Called with the stage's name, pairs done and pairs in all, at the start.

    Returns:
        How many trials are shown.

    Raises:
        ReportError: No pairs, filters that leave none, or a comparison, which has no live form.
    """
    wanted = options.wanted
    if wanted.compare or wanted.truths or wanted.selection.worst:
        raise ReportError(
            "--live shows one run as it grows", "leave --compare, --ground-truth and --worst out"
        )
    count, go_on = 0, True
    while go_on:
        go_on = False  # where the viewer is closed meanwhile
        with recorder() as recording:
            count, go_on = _follow_run(recording, dataset, options, ended, tell, progress)
    return count


def _follow_run(
    recording: rr.RecordingStream,
    dataset: Dataset,
    options: Options,
    ended: Callable[[], bool],
    tell: Tell,
    progress: Progress | None,
) -> tuple[int, bool]:
    """Follow one run; its trials, and whether another run has taken its place."""
    state = _state(dataset)
    shown = _arranged(dataset, options, tell)
    thinning = plan(
        shown.dataset,
        max(SOURCES, len(shown.sources)),
        points=options.points,
        thin=options.thin,
    )
    failures = send_all(recording, shown, thinning, progress)
    for failure in failures:
        tell(failure)
    recording.flush()
    follower = Follower(recording, shown, thinning)
    tell(f"{_words(shown)}; Ctrl-C ends")
    with contextlib.suppress(KeyboardInterrupt):
        while not ended():
            time.sleep(options.poll_s)
            if (now := _state(dataset)) == state:
                continue
            state = now
            try:
                later = arrange(dataset, options.wanted, growing=True)
            except LcdataError as error:  # half a file, or one of another version: it may mend
                tell(str(error))
                continue
            if follower.shown.trials.run not in ("", later.trials.run):
                tell(f"run {later.trials.run} is written now")
                return len(later.trials.all), True
            if follower.update(later):
                recording.flush()
                tell(_words(later))
    return len(follower.shown.trials.all), False


def _arranged(dataset: Dataset, options: Options, tell: Tell) -> Shown:
    """What is there at the start; without results where they cannot be read."""
    try:
        return arrange(dataset, options.wanted, growing=True)
    except ReportError as error:
        nothing = replace(options.wanted, run="")
        shown = arrange(dataset, nothing, growing=True)
        tell(str(error))
        return shown


def _state(dataset: Dataset) -> list[tuple[str, int, int]]:
    found = []
    for path in dataset.result_files():
        with contextlib.suppress(OSError):  # replaced at this very moment
            status = path.stat()
            found.append((path.stem, status.st_mtime_ns, status.st_size))
    return found


def _words(shown: Shown) -> str:
    trials = shown.trials
    if not trials.all:
        return "no trials yet"
    return f"run {trials.run}: {len(trials.all)} trials of {', '.join(trials.methods)}"
