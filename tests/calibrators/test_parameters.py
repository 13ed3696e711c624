from __future__ import annotations

import math

import pytest

from lcdata.calibrators import create
from lcdata.errors import CalibrationError


@pytest.mark.parametrize("method", ["projection", "plk"])
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("search_samples", 0),
        ("search_samples", 2.5),
        ("search_samples", "many"),
        ("search_rotation_deg", math.nan),
        ("search_rotation_deg", 200),
        ("search_translation_m", -1),
        ("max_rotation_sigma_deg", True),
        ("seed", -1),
    ],
)
def test_a_parameter_that_cannot_be_is_named_with_its_value(method, name, value):
    with pytest.raises(CalibrationError, match=f"{name} is {value!r}"):
        create(method, **{name: value})
