"""The experiment file: what it may say, and what is wrong with it."""

from __future__ import annotations

import dataclasses
import difflib
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from lcdata import yaml_file
from lcdata.calibrators.base import Calibrator
from lcdata.calibrators.initial_guess import GuessOptions
from lcdata.dataset import schema
from lcdata.dataset.remote import is_url
from lcdata.errors import CalibrationError, ExperimentError
from lcdata.evaluation.automatic import source_of
from lcdata.evaluation.inputs import located
from lcdata.evaluation.protocol import Protocol
from lcdata.experiment.sweep import swept

STORE = "lcdata-trials"
"""Default folder of computed trials, beside the experiment file: experiments there share it."""

TRUTH, AUTO = "truth", "auto"


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def _dataset(value: Any) -> Any:
    return {"path": value} if isinstance(value, str) else value


def _method(value: Any) -> Any:
    """A name alone, a name with its parameters, or the long form."""
    if isinstance(value, str):
        return {"method": value}
    if isinstance(value, dict) and "method" not in value and len(value) == 1:
        ((name, parameters),) = value.items()
        return {"method": name, "parameters": {} if parameters is None else parameters}
    return value


def _listed(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


class DatasetEntry(_Section):
    """A data set: its folder or URL, or `path`, `name` in tables and the `scenarios` to take."""

    path: str
    name: str = ""
    scenarios: list[str] = []


class MethodEntry(_Section):
    """A method: its name, `name: {parameter: value}`, or `method`, `label` and `parameters`."""

    method: str
    label: str = ""
    parameters: dict[str, Any] = {}


class Start(_Section):
    """Where trials start: the ground truth with an error, or a guess, found or given.

    Lists are swept: every rotation with every translation. `guess` has options of `init: auto`.
    """

    init: str = TRUTH
    guess: dict[str, Any] = {}
    rotation_deg: Annotated[list[float], BeforeValidator(_listed)] = [5.0]
    translation_m: Annotated[list[float], BeforeValidator(_listed)] = [0.5]


class ExperimentFile(_Section):
    """All keys of the file."""

    datasets: Annotated[
        list[Annotated[DatasetEntry, BeforeValidator(_dataset)]], Field(min_length=1)
    ]
    methods: Annotated[list[Annotated[MethodEntry, BeforeValidator(_method)]], Field(min_length=1)]
    starts: Annotated[list[Start], Field(min_length=1)] = [Start()]
    trials: Annotated[int, Field(ge=1)] = 1
    seeds: Annotated[list[int], BeforeValidator(_listed), Field(min_length=1)] = [0]
    group: Literal["pair", "pose"] = "pair"
    store: Path = Path(STORE)


@dataclass(frozen=True, eq=False)
class Experiment:
    """An experiment that can be run.

    Args:
        path: Its file.
        datasets: Folders or URLs of the data sets by name.
        scenarios: Scenarios to take, by the name of the data set; empty for all.
        methods: Methods by label, sweeps laid out.
        protocols: Of initial guesses with an error, by the name of the run.
        given: Sources of guesses of one's own: picks, or files of matches.
        automatic: Options of guesses from the pairs alone, by the word that names their run.
        group: "pair" or "pose".
        store: Folder of computed trials.
    """

    path: Path
    datasets: Mapping[str, Path | str]
    scenarios: Mapping[str, tuple[str, ...]]
    methods: Mapping[str, Calibrator]
    protocols: Mapping[str, Protocol]
    given: tuple[str, ...]
    automatic: Mapping[str, Mapping[str, object]]
    group: str
    store: Path


def load_experiment(path: Path | str) -> Experiment:
    """Read an experiment file; paths in it are relative to its folder.

    Raises:
        ExperimentError: Naming file, line, key, value and what is allowed: unknown keys, methods,
            parameters or data sets, keys or labels given twice.
    """
    path = Path(path)
    try:
        content, root = yaml_file.parse(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text file"
        raise ExperimentError(f"{path}: cannot be read ({reason})", "check the file") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", error)
        raise ExperimentError(f"{path}{line}: not YAML ({problem})") from error
    for key, first, second in yaml_file.duplicates(root):
        raise ExperimentError(
            f"{path}:{second}: {key} is given twice, first in line {first}", "keep one"
        )
    if not isinstance(content, dict):
        raise ExperimentError(
            f"{path}: holds no keys with values", "write at least `datasets:` and `methods:`"
        )
    try:
        file = ExperimentFile.model_validate(content)
    except ValidationError as error:
        text = yaml_file.describe(error, str(path), root, ExperimentFile)
        raise ExperimentError(text) from error
    return _Reader(path, root).experiment(file)


@dataclass(frozen=True)
class _Reader:
    """Turns names into what they name, and says where in the file a wrong one stands."""

    path: Path
    root: yaml.Node | None

    def experiment(self, file: ExperimentFile) -> Experiment:
        protocols: dict[str, Protocol] = {}
        given: list[str] = []
        automatic: dict[str, Mapping[str, object]] = {}
        for i, start in enumerate(file.starts):
            if start.guess and start.init != AUTO:
                raise self._wrong(
                    ("starts", i, "guess"), "these are options of `init: auto`", "leave them out"
                )
            if start.init == AUTO:
                automatic[self._automatic(start.guess, i)] = start.guess
                continue
            if start.init != TRUTH:
                given.append(self._guesses(start.init, i))
                continue
            for rotation, translation, seed in itertools.product(
                start.rotation_deg, start.translation_m, file.seeds
            ):
                try:
                    protocol = Protocol(rotation, translation, file.trials, seed, file.group)
                except CalibrationError as error:
                    raise self._wrong(("starts", i), error.message, error.remedy) from error
                protocols[protocol.run] = protocol
        datasets = self._datasets(file.datasets)
        return Experiment(
            path=self.path,
            datasets={name: folder for name, (folder, _) in datasets.items()},
            scenarios={name: tuple(entry.scenarios) for name, (_, entry) in datasets.items()},
            methods=self._methods(file.methods),
            protocols=protocols,
            given=tuple(dict.fromkeys(given)),
            automatic=automatic,
            group=file.group,
            store=self._beside(file.store),
        )

    def _beside(self, path: Path) -> Path:
        return (self.path.resolve().parent / path.expanduser()).resolve()

    def _wrong(self, place: tuple[str | int, ...], message: str, remedy: str) -> ExperimentError:
        line = yaml_file.line_of(self.root, place)
        where = f"{self.path}:{line}" if line else f"{self.path}"
        return ExperimentError(f"{where}: {message}", remedy)

    def _automatic(self, options: Mapping[str, object], i: int) -> str:
        """Word that names the run of automatic guesses with these options."""
        known = [f.name for f in dataclasses.fields(GuessOptions)]
        for name in options:
            if name not in known:
                close = difflib.get_close_matches(str(name), known, n=1)
                hint = f"did you mean {close[0]!r}?" if close else f"it has {', '.join(known)}"
                raise self._wrong(
                    ("starts", i, "guess"), f"an initial guess has no option {name!r}", hint
                )
        try:
            return source_of(options)
        except (CalibrationError, TypeError) as error:
            message = error.message if isinstance(error, CalibrationError) else str(error)
            raise self._wrong(("starts", i, "guess"), message, "see `lcdata calibrate`") from error

    def _guesses(self, source: str, i: int) -> str:
        """A source of initial guesses; files are beside the experiment's."""
        if source == "picks":
            return source
        if source.lower().endswith((".csv", ".json")):
            path = self._beside(Path(source))
            if not path.is_file():
                raise self._wrong(("starts", i, "init"), f"no file {source}", "check its name")
            return str(path)
        close = difflib.get_close_matches(source, [TRUTH, AUTO, "picks"], n=1)
        hint = (
            f"did you mean {close[0]!r}?"
            if close
            else "use truth, auto, picks, a CSV of matches or a toolbox's JSON"
        )
        raise self._wrong(("starts", i, "init"), f"no initial guess {source!r}", hint)

    def _datasets(self, entries: list[DatasetEntry]) -> dict[str, tuple[Path | str, DatasetEntry]]:
        found: dict[str, tuple[Path | str, DatasetEntry]] = {}
        for i, entry in enumerate(entries):
            folder: Path | str = entry.path.rstrip("/")
            if not is_url(folder):
                folder = self._beside(Path(entry.path))
                if not (folder / schema.INFO).is_file():
                    raise self._wrong(
                        ("datasets", i), f"no data set {entry.path}", _datasets_near(folder)
                    )
            name = entry.name or PurePosixPath(folder).name
            if name in found or name in {"", ".", ".."} or "/" in name:
                raise self._wrong(
                    ("datasets", i),
                    f"data set {name!r} {'is there twice' if name in found else 'has no name'}",
                    "give each a `name` of its own",
                )
            found[name] = folder, entry
        return found

    def _methods(self, entries: list[MethodEntry]) -> dict[str, Calibrator]:
        methods: dict[str, Calibrator] = {}
        for i, entry in enumerate(entries):
            try:
                variants = swept(entry.method, entry.parameters, entry.label)
            except CalibrationError as error:
                raise self._wrong(("methods", i), error.message, error.remedy) from error
            if twice := sorted(variants.keys() & methods.keys()):
                raise self._wrong(
                    ("methods", i), f"method {twice[0]!r} is given twice", "give each a `label`"
                )
            folder = self.path.resolve().parent
            methods |= {label: located(method, folder) for label, method in variants.items()}
        return methods


def _datasets_near(folder: Path) -> str:
    """What one may have meant: data sets beside a folder that is none."""
    try:
        there = sorted(p.parent.name for p in folder.parent.glob(f"*/{schema.INFO}"))
    except OSError:
        there = []
    close = difflib.get_close_matches(folder.name, there, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    if there:
        return f"in {folder.parent} are {', '.join(there[:8])}"
    return f"there is no {schema.INFO} in {folder}"
