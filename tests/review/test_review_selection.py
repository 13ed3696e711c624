"""Filters: which pairs and methods are left, and in which order."""

from __future__ import annotations

import math
import os
from dataclasses import replace

import pytest
from box_room import BAD, GOOD, RUN, add_results, make
from rrd import Rrd

from lcdata.errors import ReportError
from lcdata.evaluation.results import results_path, write_run
from lcdata.review import Selection, Wanted, save_review
from lcdata.review.arrange import arrange
from lcdata.review.selection import suggestion, trial_badness


def ids(dataset, **filters) -> list[str]:
    wanted = Wanted(Selection(**filters))
    return [record.pair_id for record in arrange(dataset, wanted).dataset.pairs]


def test_nothing_chosen_shows_all(dataset):
    assert ids(dataset) == [record.pair_id for record in dataset.pairs]
    assert arrange(dataset, Wanted()).note == ""


@pytest.mark.parametrize(
    ("filters", "left"),
    [
        ({"scenarios": ("lab",)}, [4, 5, 6, 7]),
        ({"poses": ("pose_001",)}, [2, 3, 6, 7]),
        ({"poses": ("den/pose_001",)}, [2, 3]),
        ({"scenarios": ("lab",), "poses": ("pose_000",)}, [4, 5]),
        ({"pairs": ("lab/pose_000/001", "den/pose_000/000")}, [0, 5]),
        ({"pairs": ("pose_000/001",), "scenarios": ("den",)}, [1]),
    ],
)
def test_filters_combine(dataset, filters, left):
    assert ids(dataset, **filters) == [dataset.pairs[number].pair_id for number in left]


def test_the_worst_come_first_those_without_an_estimate_before_all(dataset):
    """`beta` has no estimate on 1, is wrong on 2 and has no trial on 3."""
    found = ids(dataset, worst=4)
    assert found[:2] == [dataset.pairs[1].pair_id, dataset.pairs[2].pair_id]
    assert len(found) == 4
    shown = arrange(dataset, Wanted(Selection(worst=2, methods=(GOOD,))))
    assert shown.trials.methods == (GOOD,)
    assert len(shown.trials.all) == 2
    of_alpha = {r.pair_id: shown.trials.of_pair(r.pair_id)[GOOD] for r in shown.dataset.pairs}
    everything = arrange(dataset, Wanted()).trials
    best = sorted(
        (trial_badness(everything.of_pair(r.pair_id)[GOOD]) for r in dataset.pairs), reverse=True
    )
    assert [trial_badness(trial) for trial in of_alpha.values()] == best[:2]


def test_worst_stays_within_the_other_filters(dataset):
    assert set(ids(dataset, worst=3, scenarios=("lab",))) <= set(ids(dataset, scenarios=("lab",)))
    assert len(ids(dataset, worst=100, scenarios=("lab",))) == 4  # fewer than asked for


def test_pairs_without_a_trial_are_not_among_the_worst(dataset):
    assert dataset.pairs[3].pair_id not in ids(dataset, worst=100, methods=(BAD,))
    assert len(ids(dataset, worst=100, methods=(BAD,))) == 7


def test_a_pair_without_a_trial_is_shown_and_says_so(dataset, tmp_path):
    wanted = Wanted(Selection(pairs=(dataset.pairs[3].pair_id,), methods=(BAD,)))
    rrd = Rrd(save_review(dataset, tmp_path / "r.rrd", wanted=wanted).path)
    assert len(rrd.rows("/lidar/cloud", "Points3D:positions")) == 1
    assert f"Run `{RUN}` has no trial on them" in rrd.static("/summary", "TextDocument:text")[0]


def test_the_review_holds_what_is_left_from_zero_on(dataset, tmp_path):
    wanted = Wanted(Selection(worst=3))
    done = save_review(dataset, tmp_path / "r.rrd", wanted=wanted)
    assert done.pairs == 3
    assert done.notes[0].startswith("Shown are 3 pairs of 8: `--worst 3`.")
    rrd = Rrd(done.path)
    assert sorted(rrd.rows("/lidar/cloud", "Points3D:positions")) == [0, 1, 2]
    lane = rrd.rows(f"/outcomes/{BAD}", "StateChange:state")
    assert [lane[k][0] for k in range(3)][:2] == ["no estimate", "wrong, not flagged"]
    stamps = rrd.rows(f"/outcomes/{BAD}", "StateChange:state", "stamp")
    assert max(stamps) > max(rrd.rows("/lidar/cloud", "Points3D:positions", "stamp"))


@pytest.mark.parametrize(
    ("filters", "message"),
    [
        ({"scenarios": ("lap",)}, "no scenario 'lap' to show: did you mean lab?"),
        ({"poses": ("den/pose_010",)}, "did you mean den/pose_00"),
        ({"pairs": ("den/pose_000/0",)}, "did you mean den/pose_000/00"),
        ({"methods": ("gamma",)}, "no method 'gamma' to show: there is alpha, beta"),
        ({"methods": ("betta",)}, "did you mean beta?"),
        (
            {"scenarios": ("lab",), "poses": ("den/pose_000",)},
            "no pair of .* is left by --scenario",
        ),
        ({"worst": 0}, "--worst 0 shows no pair"),
        ({"worst": 2, "methods": (BAD,), "pairs": ("den/pose_001/001",)}, "has none on these"),
    ],
)
def test_what_is_not_there_is_told_with_suggestions(dataset, filters, message):
    with pytest.raises(ReportError, match=message.replace("?", r"\?")):
        ids(dataset, **filters)


def test_without_results_there_is_no_worst(tmp_path):
    dataset = make(tmp_path / "set", arm=False, pairs=1)
    with pytest.raises(ReportError, match="needs results, and there are none"):
        ids(dataset, worst=2)


def test_a_run_is_suggested(dataset):
    with pytest.raises(ReportError, match=f"did you mean {RUN}"):
        arrange(dataset, Wanted(run=RUN + "0"))


def test_the_last_run_that_has_the_method_is_shown(tmp_path):
    dataset = make(tmp_path / "set", arm=False, pairs=1)
    results = add_results(dataset)
    os.utime(results_path(dataset, RUN), ns=(10**18, 10**18))
    write_run(results_path(dataset, "last"), [r for r in results if r.method == GOOD])
    assert arrange(dataset, Wanted()).trials.run == "last"
    assert arrange(dataset, Wanted(Selection(methods=(BAD,)))).trials.run == RUN


def test_suggestions_of_many_are_few():
    text = suggestion("zzz", [f"pose_{n:03}" for n in range(600)])
    assert text == "there is pose_000, pose_001, pose_002, pose_003 and 596 more"


def test_joint_trials_are_found_by_any_of_their_pairs(tmp_path):
    dataset = make(tmp_path / "set", arm=False)
    results = add_results(dataset)
    pair_ids = tuple(r.pair_id for r in dataset.pairs if r.pose_id == results[0].pose_id)
    joint = replace(results[0], pair_ids=pair_ids, group="pose")
    write_run(results_path(dataset, RUN), [joint])
    shown = arrange(dataset, Wanted(Selection(pairs=(pair_ids[1],))))
    assert list(shown.trials.of_pair(pair_ids[1])) == [GOOD]
    assert not math.isnan(trial_badness(shown.trials.all[0]))
