"""Parameters of methods as a user types them: METHOD.NAME=VALUE."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from lcdata.calibrators.base import Calibrator
from lcdata.calibrators.registry import create
from lcdata.errors import CalibrationError


def configured(methods: Sequence[str], settings: Sequence[str] = ()) -> list[Calibrator]:
    """Methods by their names, with parameters of their own.

    Args:
        methods: Names of methods.
        settings: METHOD.NAME=VALUE each, VALUE as in YAML: `nid.rounds=3`, `plk.paint=false`,
            `crlf.masks=masks`.

    Raises:
        CalibrationError: An unknown method or parameter, one of a method that does not run, or a
            value that is none.
    """
    parameters: dict[str, dict[str, Any]] = {name: {} for name in methods}
    for text in settings:
        place, sign, value = text.partition("=")
        method, dot, name = place.strip().partition(".")
        if not (sign and dot and name and value.strip()):
            raise CalibrationError(f"{text!r} sets nothing", "write METHOD.NAME=VALUE")
        if method not in parameters:
            create(method)  # a name that no method has is told with its nearest
            raise CalibrationError(
                f"{text!r} is for {method}, which does not run", "name it in --methods too"
            )
        parameters[method][name.replace("-", "_")] = _value(text, value.strip())
    return [created(name, parameters[name]) for name in methods]


def created(method: str, values: Mapping[str, Any]) -> Calibrator:
    """A method whose parameters have the types of its defaults.

    Args:
        method: Its name.
        values: Parameters as they were read from YAML.

    Raises:
        CalibrationError: An unknown method or parameter, or a value of another kind.
    """
    values = dict(values)
    default = create(method)
    fields: tuple[dataclasses.Field[Any], ...] = (
        dataclasses.fields(default) if dataclasses.is_dataclass(default) else ()
    )
    for name in values.keys() & {f.name for f in fields}:
        before = getattr(default, name)
        if isinstance(before, str) and not isinstance(values[name], str):
            values[name] = str(values[name])
        elif isinstance(before, float) and type(values[name]) is int:
            values[name] = float(values[name])
        elif isinstance(before, bool) and not isinstance(values[name], bool):
            raise CalibrationError(f"{method}.{name} is {values[name]!r}", "give true or false")
    return create(method, **values) if values else default


def _value(text: str, value: str) -> Any:
    import yaml

    try:
        return yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise CalibrationError(f"{text!r} has no readable value", "write it as in YAML") from error
