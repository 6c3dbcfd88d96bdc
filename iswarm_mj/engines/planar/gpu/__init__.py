"""The planar engine's kernels for GPUs, in Warp."""
