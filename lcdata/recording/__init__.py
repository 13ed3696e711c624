"""Recordings in: bags and folders to typed messages, dwells and pairs."""
