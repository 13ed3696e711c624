"""The data set on disk: schema, writer, reader, build, validation."""

from __future__ import annotations

from lcdata.dataset.build import BuildSummary, build
from lcdata.dataset.reader import Dataset
from lcdata.dataset.regenerate import Regeneration, poses_of, regenerate, versions
from lcdata.dataset.schema import DatasetInfo, PairRecord, PoseRecord
from lcdata.dataset.validate import validate

__all__ = [
    "BuildSummary",
    "Dataset",
    "DatasetInfo",
    "PairRecord",
    "PoseRecord",
    "Regeneration",
    "build",
    "poses_of",
    "regenerate",
    "validate",
    "versions",
]
