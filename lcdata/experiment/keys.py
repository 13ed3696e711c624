"""What a trial is stored by: a checksum of all that decides what it gives."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

import lcdata
from lcdata.calibrators.base import Calibrator
from lcdata.calibrators.initial_guess import GuessOptions
from lcdata.evaluation.worker import parameters

Array = NDArray[np.float64]

DIGITS = 10
"""Of an initial guess, in its key: two machines may differ in the last ones."""


def trial_key(
    content: Mapping[str, object],
    method: Calibrator,
    files: Mapping[str, str],
    T_initial: Array | None,
    options: Mapping[str, object],
) -> str:
    """sha256 of all that decides what a trial gives; of files their content, not their place."""
    values = json.loads(parameters(method, files))
    described = {name: value for name, value in values.items() if name not in files}
    everything = {
        **content,
        "method": [method.name, method.version, json.dumps(described, sort_keys=True)],
        "initial": guess_key(content, options)
        if T_initial is None
        else [round(float(value), DIGITS) + 0.0 for value in np.ravel(T_initial)],
    }
    return hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()


def guess_key(content: Mapping[str, object], options: Mapping[str, object]) -> str:
    """sha256 of all that decides what is found from pairs; their ground truth does not."""
    everything = {
        "pairs": content["pairs"],
        "camera": content["camera"],
        "guess": dataclasses.asdict(GuessOptions(**options)),  # type: ignore[arg-type]
        "lcdata": lcdata.__version__,
    }
    return hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()
