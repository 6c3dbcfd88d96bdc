"""Errors in a user's own code, in one sentence that names the line and the remedy."""

import sysconfig
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import iswarm_mj
from iswarm_mj.utils.errors import SimulationFault, UserError

_INNER = (
    "<",
    str(Path(iswarm_mj.__file__).parent),
    *map(sysconfig.get_path, ("stdlib", "purelib", "platlib")),
)
"""How paths of code begin that is not the user's."""
_JAX_ERRORS = "https://docs.jax.dev/en/latest/errors.html"


def is_users(file: str) -> bool:
    """Return whether code in a file is a user's: neither of this package, nor of Python, nor
    installed."""
    return not file.startswith(_INNER)


@contextmanager
def user_code(what: str) -> Iterator[None]:
    """Turn exceptions of the user's code into a `UserError` that names its line; those of this
    package pass.

    Args:
        what: that is called, as `Walk.act`.

    Raises:
        UserError: the code raised something else.
    """
    try:
        yield
    except (UserError, SimulationFault):
        raise
    except (Exception, SystemExit) as error:
        frames = [
            one for one in traceback.extract_tb(error.__traceback__) if is_users(one.filename)
        ]
        if (
            isinstance(error, SystemExit) and not frames
        ):  # the command line's parser has explained a flag
            raise
        raise UserError(_sentence(what, error, frames)) from error


def _sentence(what: str, error: BaseException, frames: list[traceback.FrameSummary]) -> str:
    """What went wrong, and in which of the user's own lines, of which the error passed through
    `frames`."""
    place = "its parameters or its call"
    if isinstance(error, SyntaxError) and error.filename:
        place = f"{error.filename}, line {error.lineno}: `{(error.text or '').strip()}`"
    elif frames:
        place = f"{frames[-1].filename}, line {frames[-1].lineno}: `{frames[-1].line}`"
    text = ": ".join(filter(None, [type(error).__name__, str(error).strip().partition("\n")[0]]))
    explained = f", as {_JAX_ERRORS}#jax.errors.{type(error).__name__} explains"
    return f"{what} raised {text} ({place}); correct it there{explained * (type(error).__module__ == 'jax.errors')}"
