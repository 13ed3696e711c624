"""Tables, plots and one HTML page from stored results."""

from lcdata.report.overlay import draw_overlay
from lcdata.report.write import write_report

__all__ = ["draw_overlay", "write_report"]
