"""Sweeps: lists of parameter values, laid out as methods with labels."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from lcdata.calibrators.base import Calibrator
from lcdata.calibrators.registry import create
from lcdata.calibrators.settings import created
from lcdata.errors import CalibrationError


def swept(method: str, parameters: Mapping[str, Any], label: str = "") -> dict[str, Calibrator]:
    """A method with every combination of the parameters' listed values.

    A list is a sweep. Where the parameter itself is a list (its default is one), a list of lists
    is.

    Args:
        method: Name of the method.
        parameters: Values, or lists of values, by name.
        label: What tables call it; by default its name. Swept values follow in parentheses.

    Returns:
        Methods by label: `nid(rounds=2)`, `nid(rounds=4)`.

    Raises:
        CalibrationError: An unknown method or parameter, or a value that is none.
    """
    default = create(method)
    choices: dict[str, list[Any]] = {}
    for key, value in parameters.items():
        name = str(key).replace("-", "_")
        many = isinstance(value, list)
        if isinstance(getattr(default, name, None), list | tuple):
            many = many and bool(value) and all(isinstance(item, list) for item in value)
        if many and not value:
            raise CalibrationError(f"{method}.{name} is swept over nothing", "list some values")
        choices[name] = value if many else [value]
    variants: dict[str, Calibrator] = {}
    for values in itertools.product(*choices.values()):
        chosen = dict(zip(choices, values, strict=True))
        shown = [f"{name}={_text(chosen[name])}" for name in choices if len(choices[name]) > 1]
        title = (label or method) + (f"({', '.join(shown)})" if shown else "")
        if title in variants:
            raise CalibrationError(f"{title} is swept over twice", "list each value once")
        variants[title] = created(method, {k: _frozen(v) for k, v in chosen.items()})
    return variants


def _frozen(value: Any) -> Any:
    """Lists as tuples: parameters do not change."""
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)
