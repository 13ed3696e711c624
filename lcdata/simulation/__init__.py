"""Simulated recordings: scenes, sensors, recorder."""
