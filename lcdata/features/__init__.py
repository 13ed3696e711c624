"""Lines in images and clouds, and their matching."""
