from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from toy_methods import Biased

from lcdata.errors import ExperimentError
from lcdata.experiment import load_experiment
from lcdata.experiment.sweep import swept

Write = Callable[..., Path]

FULL = """\
datasets:
  - set
  - {path: set, name: half, scenarios: [hall]}
methods:
  - blobs
  - biased: {bias_m: [0, 0.1], smallest: 10}
  - {method: biased, label: far, parameters: {bias_m: 1}}
starts:
  - {rotation_deg: [1, 5], translation_m: 0.1}
trials: 2
seeds: [0, 7]
group: pose
store: elsewhere/trials
"""


def test_everything_that_a_file_may_say(write: Write) -> None:
    path = write(FULL)
    found = load_experiment(path)
    assert list(found.datasets) == ["set", "half"]
    assert found.scenarios == {"set": (), "half": ("hall",)}
    assert list(found.methods) == ["blobs", "biased(bias_m=0)", "biased(bias_m=0.1)", "far"]
    assert found.methods["biased(bias_m=0.1)"] == Biased(bias_m=0.1, smallest=10)
    assert found.methods["far"] == Biased(bias_m=1.0)
    assert list(found.protocols) == [
        "1deg-0.1m-seed0-pose",
        "1deg-0.1m-seed7-pose",
        "5deg-0.1m-seed0-pose",
        "5deg-0.1m-seed7-pose",
    ]
    assert all(p.trials == 2 for p in found.protocols.values())
    assert found.store == path.parent / "elsewhere" / "trials"


def test_two_lines_are_enough(write: Write) -> None:
    found = load_experiment(write("datasets: [set]\nmethods: [blobs]\n"))
    assert list(found.protocols) == ["5deg-0.5m-seed0"] and found.group == "pair"
    assert found.store.name == "lcdata-trials"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("- blobs", "- blops", ("yaml:5: unknown method 'blops'", "did you mean 'blobs'")),
        ("smallest: 10", "smalest: 10", ("yaml:6:", "no parameter 'smalest'", "'smallest'")),
        ("- set", "- sett", ("yaml:2: no data set sett", "did you mean 'set'")),
        ("trials: 2", "trails: 2", ("yaml:10: unknown key trails", "did you mean trials")),
        ("scenarios: [hall]", "scenario: [hall]", ("yaml:3:", "did you mean scenarios")),
        ("trials: 2", "trials: 0", ("yaml:10: trials is 0", "greater than or equal to 1")),
        ("trials: 2", "trials: 2\nseeds: 1", ("yaml:12: seeds is given twice, first in line 11",)),
        ("name: half, ", "", ("yaml:3: data set 'set' is there twice",)),
        ("label: far, ", "label: blobs, ", ("yaml:7: method 'blobs' is given twice",)),
        ("[0, 0.1]", "[]", ("yaml:6: biased.bias_m is swept over nothing",)),
        ("[0, 0.1]", "[1, 1]", ("yaml:6:", "swept over twice")),
        ("[1, 5]", "[1, 500]", ("yaml:9:", "rotation error of 500")),
        ("{rotation_deg", "{init: pick, rotation_deg", ("no initial guess 'pick'", "'picks'")),
        ("group: pose", "group: poses", ("yaml:12: group is 'poses'",)),
        ("datasets:", "datasets: [", ("not YAML",)),
    ],
)
def test_what_is_wrong_is_named_with_its_line(
    write: Write, old: str, new: str, words: tuple[str, ...]
) -> None:
    assert old in FULL
    with pytest.raises(ExperimentError) as caught:
        load_experiment(write(FULL.replace(old, new, 1)))
    for word in ("experiment.yaml", *words):
        assert word in str(caught.value)


def test_files_that_are_none(write: Write) -> None:
    path = write("")
    with pytest.raises(ExperimentError, match="no keys with values"):
        load_experiment(path)
    with pytest.raises(ExperimentError, match="cannot be read"):
        load_experiment(path.parent / "none.yaml")
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ExperimentError, match="no text file"):
        load_experiment(path)


def test_sweeps_are_all_combinations(toys: object) -> None:
    found = swept("biased", {"bias_m": [0.1, 0.2], "smallest": [5, 6, 7]})
    assert len(found) == 6
    assert found["biased(bias_m=0.2, smallest=7)"] == Biased(bias_m=0.2, smallest=7)
    assert swept("biased", {"bias-m": 1}) == {"biased": Biased(bias_m=1.0)}
