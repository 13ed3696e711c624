import pytest

from lcdata.calibrators.nid import Nid
from lcdata.calibrators.plk import Plk
from lcdata.calibrators.projection import Projection
from lcdata.calibrators.settings import configured
from lcdata.errors import CalibrationError


def test_parameters_go_to_their_method_with_the_type_of_its_default() -> None:
    settings = ["nid.rounds=3", "plk.paint=false", "nid.search-rotation-deg=4", "nid.solver=bfgs"]
    nid, plk, projection = configured(["nid", "plk", "projection"], settings)
    assert nid == Nid(rounds=3, search_rotation_deg=4.0, solver="bfgs")
    assert isinstance(nid, Nid) and isinstance(nid.search_rotation_deg, float)
    assert plk == Plk(paint=False)
    assert projection == Projection()


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("nid.rounds", "sets nothing: write METHOD.NAME=VALUE"),
        ("rounds=3", "sets nothing"),
        ("nid.rounds=", "sets nothing"),
        ("nid.round=3", "has no parameter 'round': did you mean 'rounds'"),
        ("plk.paint=false", "is for plk, which does not run: name it in --methods too"),
        ("nidd.rounds=3", "unknown method 'nidd': did you mean 'nid'"),
        ("nid.rounds=[3", "no readable value"),
        ("nid.rounds=many", "rounds is 'many'"),
        ("projection.paint=2", "projection.paint is 2: give true or false"),
    ],
)
def test_what_sets_nothing_is_told_with_a_remedy(setting: str, words: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        configured(["nid", "projection"], [setting])
    assert words in str(caught.value)


def test_text_parameters_may_look_like_numbers() -> None:
    with pytest.raises(CalibrationError, match="solver is '3'"):
        configured(["nid"], ["nid.solver=3"])
