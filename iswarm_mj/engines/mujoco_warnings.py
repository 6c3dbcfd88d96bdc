"""MuJoCo's warnings, which it would write to a file in the working directory."""

import mujoco


def keep_no_log() -> None:
    """Have MuJoCo not write its warnings to MUJOCO_LOG.TXT in the working directory, unless somebody else handles them.

    What they warn of is a fault here, which is reported.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_ignore)


def _ignore(_: str) -> None:
    """Do nothing about a warning."""
