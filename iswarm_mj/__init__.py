"""A physics-based simulator of the I-SWARM micro-robot swarm on MuJoCo."""

__version__ = "0.1.0"
