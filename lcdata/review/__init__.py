"""Data set and results as a Rerun recording."""
