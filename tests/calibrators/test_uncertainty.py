import numpy as np

from lcdata.calibrators.uncertainty import too_uncertain


def test_norms_of_the_deviations_are_held_to_their_limits():
    covariance = np.diag([0.03**2, 0.04**2, 0.0, 0.0, np.deg2rad(0.3) ** 2, np.deg2rad(0.4) ** 2])
    assert too_uncertain(covariance, 0.0501, 0.501) == []
    assert too_uncertain(covariance, 0.0499, 0.501) == [
        "predicted standard deviation of 0.5 deg, 0.05 m"
    ]
    assert too_uncertain(covariance, 0.0501, 0.499)


def test_what_is_not_known_is_too_uncertain():
    assert too_uncertain(np.full((6, 6), np.nan), 1.0, 1.0) == ["no predicted standard deviation"]
