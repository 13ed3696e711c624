"""Experiments: one file that names data sets, methods and initial guesses; trials computed once."""

from lcdata.experiment.plan import Plan
from lcdata.experiment.report import write_reports
from lcdata.experiment.run import Status, run_experiment, status
from lcdata.experiment.spec import Experiment, load_experiment
from lcdata.experiment.store import Store

__all__ = [
    "Experiment",
    "Plan",
    "Status",
    "Store",
    "load_experiment",
    "run_experiment",
    "status",
    "write_reports",
]
