"""Shapes in the plane: robots, walls, obstacles."""
