"""Methods by name, ours and those that other packages register."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Sequence
from importlib.metadata import entry_points
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.errors import CalibrationError
from lcdata.geometry.se3 import check_transform
from lcdata.pair import Pair

GROUP = "lcdata.calibrators"
"""Entry-point group in which third parties register a `Calibrator` class."""


def available() -> list[str]:
    """Names of all methods that can be used, sorted."""
    return sorted({entry.name for entry in entry_points(group=GROUP)})


def create(name: str, **parameters: Any) -> Calibrator:
    """A method by its name.

    Args:
        name: One of `available()`.
        **parameters: The method's own parameters; defaults are its paper's.

    Raises:
        CalibrationError: No such method or parameter.
    """
    matching = [entry for entry in entry_points(group=GROUP) if entry.name == name]
    if not matching:
        names = available()
        close = difflib.get_close_matches(name, names, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"use one of {', '.join(names)}"
        raise CalibrationError(f"unknown method {name!r}", hint)
    cls = matching[0].load()
    if not (isinstance(cls, type) and issubclass(cls, Calibrator)):
        raise CalibrationError(
            f"method {name!r} ({matching[0].value}) is not a Calibrator",
            "subclass lcdata.calibrators.Calibrator",
        )
    known: list[str] = (
        [f.name for f in dataclasses.fields(cls)] if dataclasses.is_dataclass(cls) else []
    )
    for key in parameters:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"it has {', '.join(known)}"
            raise CalibrationError(f"method {name!r} has no parameter {key!r}", hint)
    return cls(**parameters)


def calibrate(
    pairs: Sequence[Pair] | Pair,
    initial: ArrayLike | str | None,
    method: str = "plk",
    **parameters: Any,
) -> Calibration:
    """Estimate the extrinsic that pairs share.

    Args:
        pairs: One pair, or several with the same extrinsic, which are solved jointly.
        initial: 4x4 initial guess of `T_camera_lidar` (LiDAR points to camera points); None for
            methods that need none; "auto" to guess it from the pairs (`initial_guess.guess`).
        method: One of `lcdata.calibrators.available()`.
        **parameters: The method's own parameters.

    Returns:
        The estimate, with its covariance and the flags `converged` and `degenerate`.

    Raises:
        CalibrationError: Unknown method, no pairs, or input that the method cannot use.
        GeometryError: An initial guess that is no rigid transform.
    """
    pairs = [pairs] if isinstance(pairs, Pair) else list(pairs)
    if not pairs:
        raise CalibrationError("no pairs to calibrate", "give one Pair or more")
    for pair in pairs:
        if not isinstance(pair, Pair):
            raise CalibrationError(
                f"cannot calibrate {type(pair).__name__} {str(pair)[:40]!r}", "give lcdata.Pair"
            )
    calibrator = create(method, **parameters)
    if isinstance(initial, str):
        return _from_nothing(calibrator, pairs, initial)
    if initial is None:
        if calibrator.needs_initial:
            raise CalibrationError(
                f"method {method!r} needs an initial guess",
                "give a 4x4 T_camera_lidar, or 'auto'",
            )
        return calibrator.calibrate(pairs, None)
    return calibrator.calibrate(
        pairs, np.asarray(check_transform(initial, "initial T_camera_lidar"))
    )


def _from_nothing(calibrator: Calibrator, pairs: Sequence[Pair], initial: str) -> Calibration:
    """An estimate from an automatic guess; doubts about the guess are doubts about the estimate."""
    from lcdata.calibrators.initial_guess import guess

    if initial != "auto":
        raise CalibrationError(f"no initial guess {initial!r}", "give a 4x4 matrix or 'auto'")
    found = guess(pairs)
    result = calibrator.calibrate(pairs, found.T_camera_lidar)
    seconds = result.seconds + found.seconds
    if found.converged:
        return dataclasses.replace(result, seconds=seconds)
    doubt = f"initial guess not to be trusted: {found.message}"
    message = "; ".join(part for part in (result.message, doubt) if part)
    return dataclasses.replace(result, converged=False, message=message, seconds=seconds)
