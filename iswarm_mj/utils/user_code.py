"""Code that users write: its errors in one sentence, and the methods that its classes must have.

The modules `validation` of `strategy`, `tasks` and `engines` say what is checked of each, and
`utils.declared_shapes` compares shapes and types.
"""

import sysconfig
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from iswarm_mj.utils.errors import SimulationFault, UserError

_PACKAGE = __name__.partition(".")[0]
_NOT_USERS = (
    "<",
    str(Path(__file__).parents[1]),
    *(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")),
)
"""Beginnings of the paths of code that is not the user's."""

_JAX_ERRORS = "https://docs.jax.dev/en/latest/errors.html"

_AMBIGUOUS = "The truth value of an array"
"""Beginning of the errors of NumPy and JAX on arrays in place of a flag."""

_SIMILAR = 0.8
"""Similarity (difflib) from which on a name is taken for another one that is misspelt."""


def is_users(file: str) -> bool:
    """Return whether code in a file is a user's: neither of this package, nor of Python, nor
    installed."""
    return not file.startswith(_NOT_USERS)


def is_shipped(cls: type) -> bool:
    """Return whether a class is one of this package, and not of a user."""
    return cls.__module__.partition(".")[0] == _PACKAGE


@contextmanager
def user_code(what: str) -> Iterator[None]:
    """Turn exceptions of the user's code into a `UserError` that names its line; those of this
    package pass.

    Args:
        what: name of what is called, as `Walk.act`.

    Raises:
        UserError: the code raised something else.
    """
    try:
        yield
    except (UserError, SimulationFault):
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        users_frames = [frame for frame in frames if is_users(frame.filename)]

        # The parser of the command line exits by itself once it has explained a flag.
        if isinstance(error, SystemExit) and not users_frames:
            raise
        raise UserError(_explain(what, error, users_frames)) from error


def _explain(
    what: str, error: BaseException, users_frames: Sequence[traceback.FrameSummary]
) -> str:
    """Return one sentence on an error: what was raised, in which line of the user, and the cure.

    Args:
        what: name of what was called.
        error: exception that was raised.
        users_frames: lines of the user that the exception passed through, the innermost last.
    """
    raised = type(error).__name__
    first_line = str(error).strip().partition("\n")[0]
    is_ambiguous = first_line.startswith(_AMBIGUOUS)
    if is_ambiguous:
        # Its advice, any() or all(), makes one decision for all robots.
        first_line = first_line.partition(". ")[0]
    if first_line:
        raised += f": {first_line}{_meant_attribute(error)}"

    if isinstance(error, SyntaxError) and error.filename:
        source = (error.text or "").strip()
        place = f"{error.filename}, line {error.lineno}: `{source}`"
    elif users_frames:
        innermost = users_frames[-1]
        place = f"{innermost.filename}, line {innermost.lineno}: `{innermost.line}`"
    else:
        place = "its parameters or its call"

    sentence = f"{what} raised {raised} ({place}); correct it there"
    if is_ambiguous or type(error).__name__ == "TracerBoolConversionError":
        sentence += (
            ": arrays hold a value for each robot, so write jnp.where(condition, a, b) in place of "
            "`if`, `and` and `or`"
        )
    if type(error).__module__ == "jax.errors":
        sentence += f", as {_JAX_ERRORS}#jax.errors.{type(error).__name__} explains"
    return sentence


def _meant_attribute(error: BaseException) -> str:
    """Return which attribute of an object may be meant by one that it lacks, as an insertion."""
    if not isinstance(error, AttributeError) or error.obj is None or error.name is None:
        return ""
    similar = get_close_matches(error.name, dir(error.obj), n=1, cutoff=_SIMILAR)
    return f" (perhaps you meant {similar[0]})" if similar else ""


def check_class(given: Any, base: type, role: str) -> None:
    """Check that a class of a user derives from a base class and has its methods.

    Args:
        given: class, or an object of it.
        base: class of this package that documents the methods.
        role: what objects of the class are, with an article, as "a task".

    Raises:
        UserError: it does not derive from the base class, lacks a method, or has an attribute whose
            name is nearly that of another.
    """
    cls = given if isinstance(given, type) else type(given)
    name = cls.__name__
    if not issubclass(cls, base):
        raise UserError(
            f"{name} is not {role}, since it does not derive from {base.__name__}; write class "
            f"{name}({base.__name__}), with from iswarm_mj import {base.__name__}"
        )

    public = [attribute for attribute in dir(base) if not attribute.startswith("_")]
    missing = [attribute for attribute in public if _lacks_method(cls, base, attribute)]
    if missing:
        raise _without_methods(cls, missing, f"{role} has it, see {base.__name__}")
    _check_spelling(cls, base, public)


def check_is_complete(cls: type) -> None:
    """Check that a class has all methods that its base classes ask for, before it is called.

    Raises:
        UserError: it lacks one, or has misspelt it.
    """
    missing = sorted(getattr(cls, "__abstractmethods__", ()))
    if missing:
        raise _without_methods(cls, missing, "add it")


def _without_methods(cls: type, missing: Sequence[str], remedy: str) -> UserError:
    """Return the error about a class that lacks methods.

    Args:
        cls: class of a user.
        missing: names of the methods.
        remedy: what to do unless the class has misspelt one of them.
    """
    listed = " and no method ".join(missing)
    return UserError(f"{cls.__name__} has no method {listed}; {_renaming(cls, missing) or remedy}")


def _renaming(cls: type, missing: Sequence[str]) -> str:
    """Return that an attribute of a class may be a misspelt method that it lacks; "" if none is."""
    present = [attribute for attribute in vars(cls) if attribute not in missing]
    for method in missing:
        similar = get_close_matches(method, present, n=1, cutoff=_SIMILAR)
        if similar:
            return f"rename {similar[0]}, which it has, to {method}"
    return ""


def _lacks_method(cls: type, base: type, attribute: str) -> bool:
    """Return whether a class lacks a method of its base class, or has something else there."""
    if attribute in getattr(cls, "__abstractmethods__", ()):
        return True
    return callable(getattr(base, attribute)) and not callable(getattr(cls, attribute))


def _check_spelling(cls: type, base: type, public: Sequence[str]) -> None:
    """Refuse attributes whose names are nearly those of attributes that the class inherits.

    Args:
        cls: class of a user.
        base: class of this package that documents the methods.
        public: names of the attributes of the base.

    Raises:
        UserError: there is such an attribute.
    """
    known = {*public, *getattr(base, "ATTRIBUTES", ())}
    field_names = {field.name for field in fields(cls)} if is_dataclass(cls) else set()

    for parent in cls.__mro__:
        is_users_class = issubclass(parent, base) and not is_shipped(parent)
        if not is_users_class:
            continue
        defined = set(vars(parent))
        inherited = sorted(known - defined)
        for name in sorted(defined - known - field_names):
            similar = get_close_matches(name, inherited, n=1, cutoff=_SIMILAR)
            if similar and not name.startswith("_"):
                raise UserError(
                    f"{cls.__name__}.{name} is never used: {base.__name__} has {similar[0]}, but "
                    f"no {name}; rename it, or call a helper of your own _{name}"
                )
