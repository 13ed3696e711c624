from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lcdata.errors import CalibrationError
from lcdata.evaluation import Protocol, perturb
from lcdata.geometry import se3

TRUTH = se3.exp([0.1, -0.4, 0.3, 1.2, -0.5, 0.7])


@given(st.floats(0, 60), st.floats(0, 10), st.integers(0, 2**32))
def test_every_axis_is_off_by_the_same_amount(degrees: float, metres: float, seed: int) -> None:
    guess = perturb(TRUTH, degrees, metres, np.random.default_rng(seed))
    turn = Rotation.from_matrix(guess[:3, :3] @ TRUTH[:3, :3].T).as_rotvec(degrees=True)
    np.testing.assert_allclose(np.abs(turn), degrees, atol=1e-5)
    np.testing.assert_allclose(np.abs(guess[:3, 3] - TRUTH[:3, 3]), metres, atol=1e-12)


def test_paper_protocol_is_866_in_all() -> None:
    guess = Protocol().initial_guess(TRUTH, ["a"], 0)
    assert np.degrees(se3.rotation_error(guess, TRUTH)) == pytest.approx(5 * 3**0.5)
    assert se3.translation_error(guess, TRUTH) == pytest.approx(0.5 * 3**0.5)


def test_all_64_signs_occur_and_differ_between_pairs_trials_and_seeds() -> None:
    def signs(seed: int, name: str, trial: int) -> tuple[float, ...]:
        guess = Protocol(seed=seed).initial_guess(np.eye(4), [name], trial)
        return tuple(np.sign(se3.log(guess) @ np.eye(6)))

    per_trial = [signs(0, "a", n) for n in range(600)]
    assert len(set(per_trial)) == 64
    assert [signs(0, "b", n) for n in range(20)] != per_trial[:20]
    assert [signs(1, "a", n) for n in range(20)] != per_trial[:20]
    assert [signs(0, "a", n) for n in range(20)] == per_trial[:20]


@pytest.mark.parametrize(
    "options",
    [
        {"init_rotation_deg": -1},
        {"init_rotation_deg": 104},
        {"init_rotation_deg": float("nan")},
        {"init_translation_m": float("inf")},
        {"trials": 0},
        {"seed": -1},
        {"group": "scene"},
    ],
)
def test_impossible_protocols_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(CalibrationError):
        Protocol(**options)


def test_run_name_tells_protocols_apart_but_not_their_length() -> None:
    assert Protocol().run == "5deg-0.5m-seed0"
    assert Protocol(trials=9).run == Protocol().run
    names = {Protocol().run, Protocol(1).run, Protocol(seed=1).run, Protocol(group="pose").run}
    assert len(names) == 4
