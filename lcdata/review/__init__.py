"""Data set and results as a Rerun recording."""

from __future__ import annotations

from lcdata.review.arrange import Wanted
from lcdata.review.save import Review, save_review
from lcdata.review.selection import Selection
from lcdata.review.viewer import open_viewer, serve

__all__ = ["Review", "Selection", "Wanted", "open_viewer", "save_review", "serve"]
