"""Where an arm model's URDF lies: in the package, in example-robot-data, or anywhere."""

from __future__ import annotations

from pathlib import Path

from lcdata.errors import ArmError, MissingLibraryError

EXAMPLES = "example-robot-data:"
"""Prefix of the models of the optional package example-robot-data."""


def model_directory() -> Path:
    """Folder of the arm models that come with the package, installed or in a checkout."""
    package = Path(__file__).parents[1]
    installed = package / "arm_models"
    return installed if installed.is_dir() else package.parent / "arm_models"


def find_urdf(model: str | Path, relative_to: Path | None = None) -> Path:
    """Path of an arm model's URDF.

    Args:
        model: A name in `arm_models/` (`"gen3_lite"`), one of the package example-robot-data
            (`"example-robot-data:ur5"`) or the path of a URDF file.
        relative_to: Folder that a relative path starts from.

    Raises:
        ArmError: No such name and no such file.
        MissingLibraryError: example-robot-data is not installed.
    """
    if str(model).startswith(EXAMPLES):
        return _find_example(str(model).removeprefix(EXAMPLES))
    named = model_directory() / str(model) / f"{model}.urdf"
    if named.is_file():
        return named
    path = Path(model) if relative_to is None else relative_to / model
    if path.suffix.lower() == ".urdf" and path.is_file():
        return path.resolve()
    names = sorted(p.name for p in model_directory().iterdir() if (p / f"{p.name}.urdf").is_file())
    raise ArmError(
        f"no arm model {str(model)!r}",
        f"give the path of a .urdf file, {EXAMPLES}ur5 and its like, or one of {', '.join(names)}",
    )


def mesh_folder(urdf: Path) -> Path | None:
    """Folder that a URDF's `package://example-robot-data` starts from; None for other URDFs.

    A data set keeps the URDF of its arm, not the meshes: they are where the package is installed.
    """
    if b"package://example-robot-data/" not in urdf.read_bytes():
        return None
    try:
        anywhere = _find_example("ur5")
    except (ArmError, MissingLibraryError):
        return None
    return next((p.parent for p in anywhere.parents if p.name == "example-robot-data"), None)


def _find_example(name: str) -> Path:
    """URDF of the package example-robot-data, which has files and no module."""
    from importlib import metadata

    try:
        files = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError as error:
        raise MissingLibraryError(
            f"{EXAMPLES}{name}: the package example-robot-data is not installed",
            "pip install 'lcdata[arms]' (440 MB)",
        ) from error
    urdfs = {f.stem: f for f in sorted(files, key=str) if f.suffix == ".urdf"}
    found = urdfs.get(name) or urdfs.get(f"{name}_robot")
    if found is None:
        raise ArmError(
            f"example-robot-data has no {name}.urdf", f"it has {', '.join(sorted(urdfs))}"
        )
    return Path(str(found.locate())).resolve()
