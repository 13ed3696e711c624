"""Initial guesses by hand: a page that shows image and LiDAR side by side."""

from lcdata.pick.server import PickServer
from lcdata.pick.session import Session

__all__ = ["PickServer", "Session"]
