"""The rig's section on scans that become one cloud."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from lcdata.rig_links import Section


class IntegrationSection(Section):
    """How many scans make the cloud of a pair, and how they are brought together."""

    mode: Literal["none", "static", "dynamic"] = "none"
    voxel_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 0.01
    max_scans: Annotated[int, Field(gt=0)] = 100
    max_points: Annotated[int, Field(ge=1000)] = 2_000_000


def _bare_mode(value: Any) -> Any:
    return {"mode": value} if isinstance(value, str) else value


Integration = Annotated[IntegrationSection | None, BeforeValidator(_bare_mode)]
"""A section, or just the mode."""
