"""MuJoCo in C, many worlds on a thread pool."""
