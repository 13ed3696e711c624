"""The rig's section on joint positions that come from a file instead of a topic."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from lcdata.rig_links import Section


class JointLogSection(Section):
    """How a joint log is to be read, where its own header does not say it."""

    file: str | None = None
    unit: Literal["auto", "rad", "deg"] = "auto"
    columns: tuple[str, ...] = ()
    stamp_column: str | None = None
    stamp_unit: Literal["auto", "s", "ms", "us", "ns"] = "auto"
    epoch_s: Annotated[float, Field(allow_inf_nan=False)] = 0.0


def _bare_file(value: Any) -> Any:
    return {"file": value} if isinstance(value, str) else value


JointLog = Annotated[JointLogSection | None, BeforeValidator(_bare_file)]
"""A section, or just the name of the file."""
