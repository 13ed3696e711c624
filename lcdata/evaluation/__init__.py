"""Protocols, trials and metrics."""
