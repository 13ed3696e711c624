"""Protocols, trials and metrics."""

from lcdata.evaluation.protocol import Protocol, perturb
from lcdata.evaluation.results import Results, TrialResult, read_results
from lcdata.evaluation.text import summary_lines
from lcdata.evaluation.trials import run_trials
from lcdata.evaluation.update import stale_trials, update_results

__all__ = [
    "Protocol",
    "Results",
    "TrialResult",
    "perturb",
    "read_results",
    "run_trials",
    "stale_trials",
    "summary_lines",
    "update_results",
]
