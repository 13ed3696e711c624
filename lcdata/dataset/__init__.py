"""The data set on disk: schema, writer, reader, build, validation."""

from __future__ import annotations

from lcdata.dataset.build import BuildSummary, build
from lcdata.dataset.groundtruth_change import Regeneration
from lcdata.dataset.groundtruth_versions import poses_of, versions
from lcdata.dataset.reader import Dataset
from lcdata.dataset.regenerate import regenerate
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
