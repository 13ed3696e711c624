"""The data set on disk: schema, writer, reader, build, validation."""

from __future__ import annotations

from lcdata.dataset.reader import Dataset
from lcdata.dataset.schema import DatasetInfo, PairRecord, PoseRecord
from lcdata.dataset.validate import validate

__all__ = ["Dataset", "DatasetInfo", "PairRecord", "PoseRecord", "validate"]
