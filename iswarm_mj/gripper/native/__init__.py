"""Engine plugins of MuJoCo, compiled by numba."""
