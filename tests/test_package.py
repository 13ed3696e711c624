from __future__ import annotations

import ast
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "lcdata"

# Rooms from the ground up; a file imports from its own room and from floors below it only.
FLOORS = {
    "errors": 1.0,
    "yaml_file": 1.0,
    "geometry": 1.1,
    "arm": 1.2,
    "pair": 1.2,
    "open3d_loader": 1.2,
    "rig_links": 1.25,
    "rig_integration": 1.27,
    "rig_joint_log": 1.27,
    "rig_camera": 1.27,
    "rig": 1.3,
    "recording": 2,
    "groundtruth": 2,
    "features": 2,
    "dataset": 3,
    "simulation": 3,
    "calibrators": 3,
    "handeye": 3,
    "evaluation": 4,
    "report": 5,
    "experiment": 5.5,
    "pick": 5,
    "review": 5,
    "reproduce": 5.5,
    "cli": 6,
    "__init__": 7,
    "__main__": 7,
}


def room(module: str) -> str:
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def imported_modules(path: Path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "lcdata":
            if node.module == "lcdata":
                for alias in node.names:
                    known = alias.name in FLOORS
                    yield f"lcdata.{alias.name}" if known else "lcdata.__init__"
            else:
                yield node.module
        elif isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.startswith("lcdata."))


@pytest.mark.parametrize(
    "path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE))
)
def test_a_file_imports_from_its_room_and_from_floors_below_only(path):
    if path.parent == PACKAGE and path.name == "__init__.py":
        return
    own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    for module in imported_modules(path):
        other = room(module)
        if other == "__init__":  # the version
            continue
        assert other == own or FLOORS[other] < FLOORS[own], (
            f"{own} (floor {FLOORS[own]}) imports {module} (floor {FLOORS[other]})"
        )


def test_importing_the_package_and_the_command_line_loads_nothing_heavy():
    code = (
        "import sys, lcdata, lcdata.cli, lcdata.cli.app;"
        "heavy = {'numpy', 'scipy', 'cv2', 'numba', 'pinocchio', 'open3d', 'rerun', 'pyarrow',"
        "'matplotlib', 'rosbags', 'pydantic'} & set(sys.modules);"
        "sys.exit(','.join(sorted(heavy)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"loaded at start-up: {done.stderr}"


def test_the_python_face_is_there_without_further_imports():
    code = (
        "import lcdata;"
        "lcdata.handeye.solve; lcdata.calibrate; lcdata.Dataset.open; lcdata.Pair; lcdata.Camera"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_the_wheel_holds_the_arm_models_and_the_type_marker(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", tmp_path, ROOT], check=True
    )
    with zipfile.ZipFile(next(tmp_path.glob("lcdata-*.whl"))) as wheel:
        names = set(wheel.namelist())
    assert {
        "lcdata/arm_models/gen3_lite/gen3_lite.urdf",
        "lcdata/arm_models/gen3_lite/LICENSE",
        "lcdata/py.typed",
        "lcdata/pick/page.html",
    } <= names
    assert not any(name.startswith(("tests/", "recordings/", "benchmarks/")) for name in names)
