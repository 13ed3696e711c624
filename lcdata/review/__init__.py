"""Data set and results as a Rerun recording."""

from __future__ import annotations

from lcdata.review.save import save_review
from lcdata.review.viewer import open_viewer, serve

__all__ = ["open_viewer", "save_review", "serve"]
