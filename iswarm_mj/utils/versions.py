"""Versions of what computes a run."""

from importlib.metadata import version

from iswarm_mj import __version__


def versions() -> dict[str, str]:
    """Versions of what decides the outcome of a run, beside the settings."""
    return {"iswarm_mj": __version__, **{name: version(name) for name in ("mujoco", "jax", "numpy")}}
