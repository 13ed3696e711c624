"""Options that PLK-Calib's figures share."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path

from lcdata.calibrators.base import Calibrator
from lcdata.calibrators.settings import configured
from lcdata.errors import CalibrationError
from lcdata.reproduce.experiment import Settings
from lcdata.reproduce.plk_pairs import PairName, of_dataset, simulated

METHODS = "projection,plk"
POSES = 5


def pair_options(scenes: str, pairs: int) -> dict[str, str]:
    """Options of both figures."""
    return {
        "methods": f"{METHODS}: names of any methods, parameters behind a name as in "
        "plk:decoupled=true:paint=false",
        "scenes": f"{scenes}: simulated scenes, or recordings of the data set (all)",
        "poses": f"{POSES}: arm poses a scene (of a data set: all)",
        "pairs": f"{pairs}: pairs a pose, as --runs (of a data set: all)",
        "data": "a data set to run it on in place of simulated pairs",
    }


def pair_names(settings: Settings, scenes: Sequence[str], pairs: int) -> list[PairName]:
    """The pairs that the options choose.

    Raises:
        CalibrationError: An unknown scene, or no pairs.
        DatasetError: The data set is none.
    """
    options = settings.options
    poses = whole(settings, "poses") if "poses" in options else None
    count = whole(settings, "pairs") if "pairs" in options else settings.runs
    chosen = listed(options["scenes"]) if "scenes" in options else None
    if "data" in options:
        return of_dataset(Path(options["data"]), chosen, poses, count)
    from lcdata.simulation import SCENARIOS

    for scene in chosen or ():
        known(scene, SCENARIOS, "scene")
    return simulated(chosen or scenes, poses or POSES, count or pairs, settings.seed)


def methods(settings: Settings) -> dict[str, Calibrator]:
    """Methods by what the option calls them.

    Raises:
        CalibrationError: An unknown method or parameter, or one given twice.
    """
    found: dict[str, Calibrator] = {}
    for text in listed(settings.options.get("methods", METHODS)):
        name, *parameters = text.split(":")
        if text in found:
            raise CalibrationError(f"method {text!r} is given twice", "name it once")
        found[text] = configured([name], [f"{name}.{p}" for p in parameters])[0]
    return found


def listed(text: str) -> list[str]:
    """Parts between commas.

    Raises:
        CalibrationError: There are none.
    """
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not parts:
        raise CalibrationError(f"{text!r} names nothing", "give names with commas between them")
    return parts


def known(name: str, names: Iterable[str], kind: str) -> str:
    """A name that exists.

    Raises:
        CalibrationError: It does not; the nearest is suggested.
    """
    names = list(names)
    if name not in names:
        close = difflib.get_close_matches(name, names, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"use one of {', '.join(names)}"
        raise CalibrationError(f"unknown {kind} {name!r}", hint)
    return name


def whole(settings: Settings, name: str, default: int = 1) -> int:
    """A whole number of 1 or more.

    Raises:
        CalibrationError: It is none.
    """
    value = number(settings, name, default)
    if value != int(value) or value < 1:
        raise CalibrationError(f"{name} is {value:g}", "give a whole number of 1 or more")
    return int(value)


def number(settings: Settings, name: str, default: float) -> float:
    """A number of 0 or more.

    Raises:
        CalibrationError: It is none.
    """
    text = settings.options.get(name, str(default))
    try:
        value = float(text)
    except ValueError as error:
        raise CalibrationError(f"{name} is {text!r}", "give a number") from error
    if not 0.0 <= value < float("inf"):
        raise CalibrationError(f"{name} is {text!r}", "give a number of 0 or more")
    return value
