"""lcdata groundtruth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lcdata.cli.common import DatasetPath, JsonFlag, guarded, print_json

if TYPE_CHECKING:
    from lcdata.dataset import Regeneration

EXAMPLE = "lcdata groundtruth dataset --arm-offsets my_arm.yaml --dry-run"

LISTED = 20


@guarded
def groundtruth(
    dataset: DatasetPath,
    rig: Annotated[
        Path | None,
        typer.Option(help="Rig with other links, arm or deviations; default: the stored one."),
    ] = None,
    arm_offsets: Annotated[
        Path | None, typer.Option(help="Joint offsets of the arm, see `lcdata arm calibrate`.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the change, write nothing.")
    ] = False,
    update_results: Annotated[
        bool,
        typer.Option("--update-results", help="Measure stored estimates against the new version."),
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Recompute the ground truth from stored joint positions; pairs stay as they are."""
    from lcdata.dataset import Dataset, regenerate
    from lcdata.evaluation import stale_trials
    from lcdata.evaluation import update_results as update

    result = regenerate(Dataset.open(dataset), rig, arm_offsets=arm_offsets, dry_run=dry_run)
    updated, stale = None, None
    if not dry_run:
        present = Dataset.open(dataset)
        updated = update(present) if update_results else None
        stale = stale_trials(present)
    if as_json:
        print_json(
            result.to_dict()
            | {
                "written": not dry_run,
                "stale_trials": stale,
                "updated_trials": updated.trials if updated else 0,
            }
        )
        return
    print("\n".join(_lines(result)))
    if dry_run:
        print("nothing was written (--dry-run)")
    if updated:
        print(f"{updated.trials} stored trials were measured against the present ground truth")
    if stale:
        print(f"{stale} stored trials are stale: --update-results measures them again")
    if not dry_run and result.before != result.after:
        print("`lcdata report` and `lcdata review` show the former version until they run again")


def _lines(result: Regeneration) -> list[str]:
    moved = result.moved
    lines = [f"ground truth {result.before} -> {result.after}, {len(result.changes)} poses"]
    if result.before == result.after:
        lines = [f"ground truth {result.after}: no pose changes"]
    lines += [f"  {text}" for text in result.inputs]
    if result.ignored:
        names = ", ".join(result.ignored)
        lines.append(f"not used: {names} of the rig differ, but chose the pairs, which stay")
    if result.before == result.after:
        return lines
    lines += [
        f"moved: median {moved['median_mm']:.2f} mm {moved['median_deg']:.3f} deg, largest "
        f"{moved['max_mm']:.2f} mm {moved['max_deg']:.3f} deg",
        f"own uncertainty: {_sigma(moved['sigma_before_mm'], moved['sigma_before_deg'])} -> "
        f"{_sigma(moved['sigma_after_mm'], moved['sigma_after_deg'])}",
    ]
    listed = list(result.changes)
    if len(listed) > LISTED:
        listed = sorted(listed, key=lambda c: c.translation_mm, reverse=True)[:LISTED]
        lines.append(f"the {LISTED} poses that moved most (--json has all):")
    width = max(len(c.pose_id) for c in listed)
    lines += [
        f"  {c.pose_id:<{width}}  {c.translation_mm:8.2f} mm  {c.rotation_deg:7.3f} deg"
        for c in listed
    ]
    return lines


def _sigma(millimetres: float, degrees: float) -> str:
    return "unknown" if math.isnan(millimetres) else f"{millimetres:.1f} mm {degrees:.2f} deg"
