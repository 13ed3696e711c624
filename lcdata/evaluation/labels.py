"""Methods by the names that results show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lcdata.calibrators.base import Calibrator
from lcdata.errors import CalibrationError


def by_label(
    methods: Sequence[str | Calibrator] | Mapping[str, Calibrator],
) -> dict[str, Calibrator]:
    """Methods by the name that tables show.

    Raises:
        CalibrationError: An unknown method, one given twice, or none.
    """
    if isinstance(methods, Mapping):
        return dict(methods)
    from lcdata.calibrators.registry import create

    calibrators: dict[str, Calibrator] = {}
    for method in methods:
        calibrator = create(method) if isinstance(method, str) else method
        if calibrator.name in calibrators:
            raise CalibrationError(
                f"method {calibrator.name!r} is given twice", "give a mapping of different labels"
            )
        calibrators[calibrator.name] = calibrator
    if not calibrators:
        raise CalibrationError("no methods to run", "name one or more")
    return calibrators
