"""SE(3), Pluecker lines and camera models."""
