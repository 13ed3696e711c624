"""Papers' experiments, run again: a paper's figure beside ours."""

from __future__ import annotations

from lcdata.reproduce.experiment import Experiment, Outcome, Table
from lcdata.reproduce.registry import EXPERIMENTS, find

__all__ = ["EXPERIMENTS", "Experiment", "Outcome", "Table", "find"]
