"""Checks of the environment: variables and limits of memory with which libraries fail.

`docs/faults.md` says what each variable does to a run.
"""

import os
import subprocess
import sys
from functools import cache
from importlib import import_module

from iswarm_mj.utils.errors import UserError, shown
from iswarm_mj.utils.ram import check_address_space

_VARIABLES = {"jax": "JAX_", "numba": "NUMBA_", "mujoco": "MUJOCO_GL"}
"""Beginning, or whole name, of the variables that a library reads when it is imported."""
_PARSE_XLA_FLAGS = "from jaxlib import xla_client; xla_client.CompileOptions()"
_PATIENCE_S = 60.0
"""Time after which the check of XLA's flags is given up, and they are taken to be valid [s]."""


def check_environment() -> None:
    """Refuse environment variables and limits with which a library cannot be imported or used.

    Without any of them the check is cheap.

    Raises:
        UserError: names the variable or the limit.
    """
    # Libraries that are loaded have found room already.
    are_loaded = _VARIABLES.keys() <= sys.modules.keys()
    if not are_loaded:
        check_address_space()

    for library, beginning in _VARIABLES.items():
        _check_import(library, beginning)
    # If NUMBA_DISABLE_JIT is set, `_check_import` has imported Numba, which then knows its value.
    if "numba" in sys.modules and sys.modules["numba"].config.DISABLE_JIT:
        raise UserError("NUMBA_DISABLE_JIT must be 0, since engines are compiled (got 1); unset it")
    if os.environ.get("XLA_FLAGS"):
        _check_xla_flags(os.environ["XLA_FLAGS"])


def _check_import(library: str, beginning: str) -> None:
    """Import a library if one of its variables is set; the error of a failure names them.

    Args:
        library: name of the library.
        beginning: beginning of the names of its variables.

    Raises:
        UserError: the import fails.
    """
    names = [name for name in os.environ if name.startswith(beginning)]
    if not names or library in sys.modules:
        return
    try:
        import_module(library)
    except Exception as error:  # of any kind, such as AttributeError where OpenGL has no library
        variables = ", ".join(f"{name}={shown(os.environ[name])}" for name in sorted(names))
        remedy = "unset it, or correct it and install what it names"
        raise UserError(
            f"{library} cannot be imported with {variables} ({shown(error)}); {remedy}"
        ) from None


@cache
def _check_xla_flags(flags: str) -> None:
    """Parse XLA's flags in another process, since those that XLA does not know end the process."""
    command = [sys.executable, "-c", _PARSE_XLA_FLAGS]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=_PATIENCE_S
        )
    except (OSError, subprocess.TimeoutExpired):  # this says nothing about the flags
        return
    if done.returncode == 0:
        return
    # Warnings, whose lines begin with W, may precede the line of the error, which is such as
    # "F1126 15:25:16 25193 parse_flags_from_env.cc:234] Unknown flag in XLA_FLAGS:
    # --xla_nonsense=1".
    lines = [line for line in done.stderr.splitlines() if line.startswith("F")]
    reasons = [line.partition("] ")[2] for line in lines if "] " in line]
    reason = shown(reasons[0]) if reasons else f"the process ended with {done.returncode}"
    raise UserError(
        f"XLA_FLAGS must hold flags that XLA knows (got {shown(flags)}: {reason}); "
        "correct or unset it"
    )
