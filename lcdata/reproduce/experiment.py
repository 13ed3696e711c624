"""What an experiment of a paper is, and what running it gives."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lcdata.errors import CalibrationError

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Table:
    """A table of a paper with ours beside it.

    Args:
        title: What it shows.
        header: Names of its columns.
        rows: Cells as text, as many as the header has.
        note: Where the figures cannot be compared, or the paper's cannot be right.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass(frozen=True)
class Outcome:
    """What running an experiment gave.

    Args:
        name: Of the experiment.
        source: Paper and table or figure.
        protocol: What was done, in one paragraph, with seed and counts.
        tables: The figures.
        values: The same as numbers, for scripts.
        pictures: PNG files by name.
    """

    name: str
    source: str
    protocol: str
    tables: tuple[Table, ...]
    values: dict[str, Any] = field(default_factory=dict)
    pictures: dict[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Settings:
    """Options that experiments share; each says which it uses.

    Args:
        runs: Monte Carlo runs, or scenes, of a case; None for the experiment's own default.
        seed: Of all random numbers.
        jobs: Processes; None for one a core.
        folder: Where single results are kept, so that a run that was stopped goes on; None keeps
            none.
        options: The experiment's own options.
    """

    runs: int | None = None
    seed: int = 0
    jobs: int | None = None
    folder: Path | None = None
    options: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """An experiment of a paper.

    Args:
        name: As it is typed.
        source: Paper and table or figure.
        summary: One line for the list.
        options: Its own options: name, and default with meaning.
        run: Runs it.
    """

    name: str
    source: str
    summary: str
    run: Callable[[Settings, Progress | None], Outcome]
    options: dict[str, str] = field(default_factory=dict)


def checked_options(experiment: Experiment, given: Sequence[str]) -> dict[str, str]:
    """Options of an experiment from NAME=VALUE.

    Raises:
        CalibrationError: It has no such option, or there is no value.
    """
    options = {}
    for text in given:
        name, sign, value = text.partition("=")
        if not sign or not value:
            raise CalibrationError(f"{text!r} sets nothing", "write NAME=VALUE")
        if name not in experiment.options:
            close = difflib.get_close_matches(name, experiment.options, n=1)
            known = ", ".join(experiment.options) or "none"
            hint = f"did you mean {close[0]!r}?" if close else f"it has {known}"
            raise CalibrationError(f"{experiment.name} has no option {name!r}", hint)
        options[name] = value
    return options
