"""What PLK-Calib's figures share: running their trials, and how numbers are written."""

from __future__ import annotations

from collections.abc import Sequence

from lcdata.evaluation.metrics import Summary
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.statistics import UNKNOWN
from lcdata.report.poses import by_pose
from lcdata.report.tables import converged_text, quartile_text, rate_text, trials_text
from lcdata.report.words import count, listing
from lcdata.reproduce.experiment import Progress, Settings, Table
from lcdata.reproduce.kept import run_parts
from lcdata.reproduce.plk_pairs import PairName
from lcdata.reproduce.plk_trials import Kept, Row, Task, Work, run_task


def run_work(
    name: str,
    settings: Settings,
    pairs: Sequence[PairName],
    work: Sequence[Work],
    progress: Progress | None,
) -> list[Row]:
    """All work on all pairs; rows that are kept from before are not computed again.

    Args:
        name: Of the experiment.
        settings: Folder and processes.
        pairs: The pairs.
        work: What to do with each.
        progress: Called with the name, rows done and rows in all.
    """
    kept = Kept(settings.folder / f"{name}.jsonl" if settings.folder else None)
    tasks = [Task(pair, tuple(work)) for pair in pairs]
    return run_parts(name, tasks, kept, run_task, settings.jobs, progress)


def where(settings: Settings, pairs: Sequence[PairName]) -> str:
    """The data of a protocol, in words."""
    scenes = list(dict.fromkeys(pair.scenario for pair in pairs))
    poses = len({pair.pose_id for pair in pairs})
    counts = f"{count(len(pairs), 'pair')} of {count(poses, 'arm pose')} in {listing(scenes)}"
    if "data" in settings.options:
        return (
            f"Data set {settings.options['data']}: {counts}. Errors are against its ground truth, "
            "which is uncertain itself."
        )
    return (
        f"Simulated: {counts} (a Kinova arm on a tower holds a ZED 2i of 1280x720 px, an Ouster "
        "OS1-128 of 128x2048 beams stands beside it, as in the paper; every pair of a pose has "
        "noise and moving people of its own), errors against the exact extrinsic; scene seed "
        f"{settings.seed}."
    )


BOX_HEADER = ("Trials", "Success", "Rotation (deg)", "Translation (m)", "Converged")


def box_cells(row: Summary) -> tuple[str, ...]:
    """Numbers of a box, in the order of `BOX_HEADER`."""
    return (
        trials_text(row),
        rate_text(row.success_rate, row.success_interval),
        quartile_text(row.rotation_deg, row.rotation_deg_interval),
        quartile_text(row.translation_m, row.translation_m_interval),
        converged_text(row),
    )


BOX_NOTE = (
    "Success: below 0.5 deg and 0.1 m. Errors: median [95 % confidence interval] (25 %, 75 %); a "
    "trial without an estimate (failed) counts as infinitely wrong. Converged: the method's own "
    "verdict."
)


def pose_table(trials: Sequence[TrialResult]) -> Table:
    """Errors pose by pose."""
    rows = []
    for row in by_pose(trials):
        count = f"{row.successes} / {row.trials}" + (
            f" ({row.failed} failed)" if row.failed else ""
        )
        errors = (quartile_text(q, UNKNOWN) for q in (row.rotation_deg, row.translation_m))
        rows.append((row.pose_id, row.method, count, *errors))
    header = ("Pose", "Method", "Success", "Rotation (deg)", "Translation (m)")
    return Table("Pose by pose: median (25 %, 75 %)", header, tuple(rows))
