"""Experiments by name."""

from __future__ import annotations

import difflib
from importlib import import_module

from lcdata.errors import CalibrationError
from lcdata.reproduce.experiment import Experiment

EXPERIMENTS = {
    "crlf-fig7": "lcdata.reproduce.crlf_fig7",
    "crlf-table": "lcdata.reproduce.crlf_table",
    "nid-table": "lcdata.reproduce.nid_table",
    "plk-fig5": "lcdata.reproduce.plk_fig5",
    "plk-fig6": "lcdata.reproduce.plk_fig6",
    "plk-table1": "lcdata.reproduce.plk_table1",
}
"""Name to the module whose `EXPERIMENT` it is; imported when it is asked for."""


def find(name: str) -> Experiment:
    """An experiment by its name.

    Raises:
        CalibrationError: There is none.
    """
    if name not in EXPERIMENTS:
        close = difflib.get_close_matches(name, EXPERIMENTS, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"use one of {', '.join(EXPERIMENTS)}"
        raise CalibrationError(f"unknown experiment {name!r}", hint)
    experiment: Experiment = import_module(EXPERIMENTS[name]).EXPERIMENT
    return experiment
