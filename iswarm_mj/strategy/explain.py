"""Errors in a strategy's own code, in one sentence that says where and what to do."""

import linecache
import sysconfig
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import jax

import iswarm_mj
from iswarm_mj.utils.errors import SimulationFault, UserError

_INNER = (
    str(Path(iswarm_mj.__file__).parent),
    *{sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")},
)
"""Folders of code that is not the user's."""

_TRACED = (
    (
        jax.errors.TracerBoolConversionError,
        "decides by values that are known only while the robots act, which Python's if, while, and, or, not cannot",
        "use jnp.where(condition, a, b), the operators & | ~, or jax.lax.cond",
    ),
    (
        jax.errors.TracerArrayConversionError,
        "hands NumPy values that are known only while the robots act",
        "use jax.numpy in its place",
    ),
    (
        jax.errors.NonConcreteBooleanIndexError,
        "selects by a mask that is known only while the robots act",
        "use jnp.where(mask, a, b), which keeps the shape",
    ),
    (
        (jax.errors.ConcretizationTypeError, jax.errors.TracerIntegerConversionError),
        "needs now a number that is known only while the robots act",
        "use jax.numpy or jax.lax (as jax.lax.fori_loop), or make a parameter of the class static by "
        'field(metadata={"static": True})',
    ),
)
"""Errors of JAX where Python asks for values of arrays that it traces: what the line does, and the remedy."""


@contextmanager
def explained(what: str) -> Iterator[None]:
    """Turn exceptions of the user's code into a `UserError` that names its line; those of this package pass.

    Args:
        what: that is called, as `Walk.act`.

    Raises:
        UserError: the code raised something else.
    """
    try:
        yield
    except (UserError, SimulationFault):
        raise
    except SystemExit as error:  # where not the user's code raised it, the parser has explained a flag
        if not _frames(error):
            raise
        raise UserError(_sentence(what, error)) from error
    except Exception as error:
        raise UserError(_sentence(what, error)) from error


def is_inner(path: str) -> bool:
    """Whether a file is part of this package, of Python or of an installed package."""
    return path.startswith(("<", *_INNER))


def _sentence(what: str, error: BaseException) -> str:
    place = _place(error)
    for kinds, does, remedy in _TRACED:
        if isinstance(error, kinds):
            return f"{what} {does} ({place}); {remedy}"
    told = (str(error).strip().splitlines() or [""])[0]
    return f"{what} raised {type(error).__name__}{': ' if told else ''}{told} ({place}); correct it there"


def _place(error: BaseException) -> str:
    """File, number and text of the last line of the user's own code that an exception passed through."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}, line {error.lineno}: `{(error.text or '').strip()}`"
    frames = _frames(error)
    if not frames:
        return "its parameters or its call"
    name, line = frames[-1].filename, frames[-1].lineno or 0
    return f"{name}, line {line}: `{linecache.getline(name, line).strip()}`"


def _frames(error: BaseException) -> list[traceback.FrameSummary]:
    """Of the user's own code, that an exception passed through."""
    return [frame for frame in traceback.extract_tb(error.__traceback__) if not is_inner(frame.filename)]
