"""Reading a recording back with Rerun's own reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
from rerun.chunk import RrdReader


class Rrd:
    """All chunks of a recording."""

    def __init__(self, path: Path) -> None:
        self.chunks = RrdReader(path).stream().to_chunks()

    @property
    def entities(self) -> set[str]:
        return {chunk.entity_path for chunk in self.chunks}

    @property
    def timelines(self) -> set[str]:
        return {name for chunk in self.chunks for name in chunk.timeline_names}

    def rows(self, entity: str, component: str, timeline: str = "pair") -> dict[Any, Any]:
        """Values of a component (`Archetype:field`) by time; static values at time None."""
        found: dict[Any, Any] = {}
        for chunk in self.chunks:
            if chunk.entity_path != entity:
                continue
            batch: pa.RecordBatch = chunk.to_record_batch()
            if component not in batch.schema.names:
                continue
            values = batch.column(component).to_pylist()
            times = [None] * len(values)
            if not chunk.is_static:
                column = batch.column(timeline)
                times = column.cast(pa.int64()).to_pylist()
            found |= {t: v for t, v in zip(times, values, strict=True) if v is not None}
        return found

    def static(self, entity: str, component: str) -> Any:
        return self.rows(entity, component)[None]
