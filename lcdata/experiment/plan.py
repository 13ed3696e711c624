"""What an experiment asks for: every trial by the content that it is computed from."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibrator
from lcdata.dataset import Dataset
from lcdata.errors import ExperimentError
from lcdata.evaluation.given import given_guesses
from lcdata.evaluation.inputs import file_contents
from lcdata.evaluation.protocol import GivenGuesses, Protocol
from lcdata.evaluation.results import SCHEMA_VERSION, Guess, Results, TrialResult
from lcdata.evaluation.task import FoundGuess, Task
from lcdata.evaluation.trials import grouped
from lcdata.experiment.checksums import Checksums
from lcdata.experiment.keys import guess_key, trial_key
from lcdata.experiment.spec import Experiment

if TYPE_CHECKING:
    from lcdata.dataset.schema import PairRecord, PoseRecord

Array = NDArray[np.float64]


class Start(NamedTuple):
    """Where a trial starts, and what tables say of it.

    Args:
        protocol: How it was made.
        trial: Number of the trial.
        T_camera_lidar: 4x4; None where it is found from the pairs.
        options: How it is found then.
    """

    protocol: Protocol
    trial: int
    T_camera_lidar: Array | None
    options: Mapping[str, object] = {}


@dataclass(frozen=True, eq=False)
class PlannedTrial:
    """One trial of the experiment.

    Args:
        key: By what it is computed from.
        dataset: Name of the data set.
        label: Label of the method.
        method: The method.
        pair_ids: Pairs.
        pose: Their ground truth.
        start: Where it starts.
    """

    key: str
    dataset: str
    label: str
    method: Calibrator
    pair_ids: tuple[str, ...]
    pose: PoseRecord
    start: Start

    def labelled(self, stored: TrialResult) -> TrialResult:
        """A stored trial, which another experiment may have computed, by this one's names."""
        protocol, pose = self.start.protocol, self.pose
        return dataclasses.replace(
            stored,
            run=protocol.run,
            method=self.label,
            pair_ids=self.pair_ids,
            scenario=pose.scenario,
            pose_id=pose.pose_id,
            trial=self.start.trial,
            seed=protocol.seed,
            group=protocol.group,
            init_rotation_deg=protocol.init_rotation_deg,
            init_translation_m=protocol.init_translation_m,
            T_camera_lidar_initial=stored.T_camera_lidar_initial
            if self.start.T_camera_lidar is None
            else self.start.T_camera_lidar,
            groundtruth_version=pose.pose_version,
            initial_groundtruth_version=pose.pose_version,
        )


@dataclass(frozen=True, eq=False)
class Unit:
    """Pairs that are solved together, with all their trials: what one task is.

    Args:
        task: All of the work on these pairs. Numbers of trials in it count its initial guesses.
        keys: Key of each piece of its work.
        guess_keys: Key of each initial guess that is found from the pairs, by its number.
    """

    task: Task
    keys: Mapping[tuple[str, int], str]
    guess_keys: Mapping[int, str]

    def left(self, done: Container[str]) -> Task | None:
        """The task with the work that has not been done; None if there is none."""
        seen: set[str] = set()  # two labels may mean the same method
        work = []
        for piece in self.task.work:
            key = self.keys[piece]
            if key not in done and key not in seen:
                seen.add(key)
                work.append(piece)
        return dataclasses.replace(self.task, work=tuple(work)) if work else None


@dataclass(frozen=True, eq=False)
class Plan:
    """All trials of an experiment.

    Args:
        datasets: Its data sets, opened, by name.
        trials: Its trials, in the order of tables.
        units: The work.
    """

    datasets: Mapping[str, Dataset]
    trials: Sequence[PlannedTrial]
    units: Sequence[Unit]

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        checksums: Checksums,
        known: Callable[[str], FoundGuess | None] = lambda _: None,
    ) -> Plan:
        """Plan an experiment.

        Args:
            experiment: The experiment.
            checksums: Each file is checked against its data set's index.
            known: Initial guesses that were found from pairs before, by key.

        Raises:
            ExperimentError: A file that has changed, an unknown scenario, or nothing to do.
            DatasetError: A data set that cannot be opened.
        """
        datasets = {name: Dataset.open(path) for name, path in experiment.datasets.items()}
        contents = {
            label: file_contents(method, checksums.of)
            for label, method in experiment.methods.items()
        }
        trials: list[PlannedTrial] = []
        units: list[Unit] = []
        try:
            for name, dataset in datasets.items():
                for starts, pairs in _starts(experiment, name, dataset):
                    unit, planned = _unit(
                        experiment, name, dataset, pairs, starts, checksums, contents, known
                    )
                    units.append(unit)
                    trials += planned
        finally:
            checksums.save()
        if not trials:
            raise ExperimentError(f"{experiment.path} asks for no trials", "no pair has a guess")
        labels = list(experiment.methods)
        trials.sort(key=lambda t: (t.pose.scenario, t.pose.pose_id, t.pair_ids))
        trials.sort(key=lambda t: (t.start.protocol.run, labels.index(t.label), t.start.trial))
        return cls(datasets, trials, units)

    @cached_property
    def wanted(self) -> set[str]:
        """Keys of all trials: what has to be computed, or read."""
        return {trial.key for trial in self.trials}

    def left(self, done: Container[str]) -> list[Task]:
        """Tasks with the work that has not been done."""
        return [task for unit in self.units if (task := unit.left(done)) is not None]

    def key(self, result: TrialResult) -> str:
        """Key of a trial as a task of this plan gives it."""
        return self._keys[result.run, result.method, result.pair_ids, result.trial]

    def guess_key(self, result: TrialResult) -> str | None:
        """Key of the initial guess of such a trial, if it was found from the pairs."""
        return self._guess_keys.get((result.run, result.pair_ids, result.trial))

    @cached_property
    def _guess_keys(self) -> dict[tuple[str, tuple[str, ...], int], str]:
        return {
            (unit.task.run, unit.task.pair_ids, number): key
            for unit in self.units
            for number, key in unit.guess_keys.items()
        }

    @cached_property
    def _keys(self) -> dict[tuple[str, str, tuple[str, ...], int], str]:
        return {
            (unit.task.run, label, unit.task.pair_ids, number): key
            for unit in self.units
            for (label, number), key in unit.keys.items()
        }

    def results(self, stored: Mapping[str, TrialResult]) -> dict[str, Results]:
        """Trials that are there, by the name of the data set."""
        found: dict[str, list[TrialResult]] = {name: [] for name in self.datasets}
        for trial in self.trials:
            if trial.key in stored:
                found[trial.dataset].append(trial.labelled(stored[trial.key]))
        return {name: Results(tuple(trials)) for name, trials in found.items()}


def _starts(
    experiment: Experiment, name: str, dataset: Dataset
) -> Iterator[tuple[list[Start], list[PairRecord]]]:
    """Pairs that are solved together, and where their trials start."""
    scenarios = experiment.scenarios[name] or dataset.scenarios
    if unknown := sorted(set(scenarios) - set(dataset.scenarios)):
        raise ExperimentError(
            f"{experiment.path}: data set {name} has no scenario {unknown[0]!r}",
            f"it has {', '.join(dataset.scenarios)}",
        )
    given = [
        (GivenGuesses(group=experiment.group, source=word), initial)
        for word, initial in (given_guesses(dataset, source) for source in experiment.given)
    ]
    for pairs in grouped(dataset, experiment.group):
        if pairs[0].scenario not in scenarios:
            continue
        pair_ids = tuple(pair.pair_id for pair in pairs)
        truth = dataset.pose(pairs[0].pose_id).T_camera_lidar
        starts = [
            Start(protocol, trial, protocol.initial_guess(truth, pair_ids, trial))
            for protocol in experiment.protocols.values()
            for trial in range(protocol.trials)
        ]
        starts += [
            Start(protocol, 0, np.array(initial[pair_ids[0]], float))
            for protocol, initial in given
            if pair_ids[0] in initial
        ]
        starts += [
            Start(GivenGuesses(group=experiment.group, source=word), 0, None, options)
            for word, options in experiment.automatic.items()
        ]
        if starts:
            yield starts, pairs


def _unit(
    experiment: Experiment,
    name: str,
    dataset: Dataset,
    pairs: Sequence[PairRecord],
    starts: Sequence[Start],
    checksums: Checksums,
    contents: Mapping[str, Mapping[str, str]],
    known: Callable[[str], FoundGuess | None],
) -> tuple[Unit, list[PlannedTrial]]:
    pair_ids = tuple(pair.pair_id for pair in pairs)
    pose = dataset.pose(pairs[0].pose_id)
    files = tuple(checksums.checked(dataset, pair) for pair in pairs)
    content = {
        "results": SCHEMA_VERSION,
        "pairs": files,
        "camera": repr(dataset.camera(pairs[0].scenario)),
        "groundtruth": pose.pose_version,
    }
    automatic = {n: start.options for n, start in enumerate(starts) if start.T_camera_lidar is None}
    guess_keys = {n: guess_key(content, options) for n, options in automatic.items()}
    found = {n: guess for n, key in guess_keys.items() if (guess := known(key)) is not None}
    keys: dict[tuple[str, int], str] = {}
    trials = []
    for label, method in experiment.methods.items():
        for number, start in enumerate(starts):
            key = keys[label, number] = trial_key(
                content, method, contents[label], start.T_camera_lidar, start.options
            )
            trials.append(PlannedTrial(key, name, label, method, pair_ids, pose, start))
    task = Task(
        dataset=dataset.address,
        run=name,
        protocol=starts[0].protocol,
        pose=pose,
        pair_ids=pair_ids,
        methods=dict(experiment.methods),
        work=tuple(keys),
        guesses={
            number: Guess(start.T_camera_lidar, pose.pose_version)
            for number, start in enumerate(starts)
            if start.T_camera_lidar is not None
        },
        automatic=automatic,
        found=found,
        checksums=files,
        contents=contents,
    )
    return Unit(task, keys, guess_keys), trials


def counted(trials: Iterable[PlannedTrial], done: Mapping[str, bool]) -> tuple[int, int, int]:
    """How many trials there are, are done, and of these failed."""
    states = [done.get(trial.key) for trial in trials]
    return len(states), sum(s is not None for s in states), sum(s is True for s in states)
