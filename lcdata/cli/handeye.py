"""lcdata handeye."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

from lcdata.cli.common import DatasetPath, JsonFlag, guarded, print_json, progress_bar

EXAMPLE = "lcdata handeye dataset --direct --write-rig refined.yaml"


@guarded
def handeye(
    dataset: DatasetPath,
    method: Annotated[
        str | None,
        typer.Option(help="Whose estimates to use; default: the one with most poses."),
    ] = None,
    run: Annotated[str | None, typer.Option(help="Run of stored results; default: all.")] = None,
    direct: Annotated[
        bool,
        typer.Option("--direct", help="Solve with the features of all poses in one problem."),
    ] = False,
    features: Annotated[
        str,
        typer.Option(help="What --direct uses: lines, or intensities as nid or nid_edge do."),
    ] = "lines",
    joint_offsets: Annotated[
        bool, typer.Option("--joint-offsets", help="Solve for the joints' zero points too.")
    ] = False,
    clock_offset: Annotated[
        bool,
        typer.Option(
            "--clock-offset", help="Ask for the offset of arm and camera clock: dwells tell none."
        ),
    ] = False,
    write_rig: Annotated[
        Path | None,
        typer.Option("--write-rig", help="Rig file with the refined links, for groundtruth --rig."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace that rig file.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Refine the two hand-measured links from calibration results over many arm poses.

    The data set stays as it is: `lcdata groundtruth DATASET --rig FILE` applies a refined rig.
    """
    from lcdata.dataset import Dataset
    from lcdata.evaluation.handeye import refine
    from lcdata.evaluation.refined_rig import check_target, write_refined_rig
    from lcdata.evaluation.refinement import describe

    opened = Dataset.open(dataset)
    if write_rig is not None:
        check_target(write_rig, force)
    with progress_bar(quiet=as_json) as progress:
        refinement = refine(
            opened,
            method=method,
            run=run,
            joint_offsets=joint_offsets,
            clock_offset=clock_offset,
            direct=direct,
            features=features,
            progress=progress,
        )
    content = describe(refinement)
    if write_rig is not None:
        write_refined_rig(refinement, write_rig)
        content["rig"] = write_rig
    if as_json:
        print_json(content)
        return
    print("\n".join(_lines(content)))
    if write_rig is not None:
        print(f"\n{write_rig}: apply it with `lcdata groundtruth {dataset} --rig {write_rig}`")


def _lines(content: dict[str, Any]) -> list[str]:
    """The refinement for people."""
    lines = [f"{content['poses']} poses, from {content['source']}"]
    for name in ("T_camera_effector", "T_base_lidar"):
        link = content[name]
        std = ", ".join(f"{1e3 * x:.1f}" for x in link["translation_std_m"])
        turn = ", ".join(f"{x:.3f}" for x in link["rotation_std_deg"])
        lines += [
            f"\n{name}  moved {link['moved_mm']:.1f} mm, {link['moved_deg']:.3f} deg",
            *("  " + "".join(f"{x:12.6f}" for x in row) for row in link["matrix"][:3]),
            f"  std {std} mm; {turn} deg",
        ]
    for name, x in content["joint_offsets_deg"].items():
        lines.append(f"{name:<12} {x:+7.3f} +- {content['joint_offsets_std_deg'][name]:.3f} deg")
    lines += ["", f"{'residuals':<24} {'':>18} {'pose left out':>20}"]
    for row in content["residuals"]:
        note = "  outlier" if row["pose_id"] in content["outliers"] else ""
        lines.append(
            f"  {row['pose_id']:<22} {_error(row['mm'], row['deg'])} "
            f"{_error(row['left_out_mm'], row['left_out_deg'])}{note}"
            if isfinite(row["mm"])
            else f"  {row['pose_id']:<22} no estimate"
        )
    now, refined = content["groundtruth_sigma"], content["refined_sigma"]
    lines += [
        "",
        f"ground truth, standard deviation: {_error(now['mm'], now['deg']).strip()} -> "
        f"{_error(refined['mm'], refined['deg']).strip()}",
        f"observability: singular-value ratio {content['singular_value_ratio']:.3f}",
        *(f"not determined by the estimates: {name}" for name in content["unobservable"]),
    ]
    return lines


def _error(mm: float, deg: float) -> str:
    return f"{mm:8.1f} mm {deg:6.3f} deg" if isfinite(mm) else "               unknown"
