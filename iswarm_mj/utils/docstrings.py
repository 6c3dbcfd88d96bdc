"""Docstrings of fields: the strings that follow them in the source of their class."""

import ast
import functools
import inspect
import textwrap
from collections.abc import Mapping
from itertools import pairwise


@functools.cache
def field_docs(cls: type) -> Mapping[str, str]:
    """Return the docstrings of a class's fields, those of its bases included, each on one line.

    A class without source, since a program made it, has those of its bases.
    """
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        try:
            node = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        except (OSError, TypeError, SyntaxError):
            continue
        if not isinstance(node, ast.ClassDef) or node.name != base.__name__:
            continue
        for statement, next_statement in pairwise(node.body):
            name = _assigned_name(statement)
            text = _string(next_statement)
            if name is not None and text is not None:
                docs[name] = " ".join(text.split())
    return docs


def _assigned_name(statement: ast.stmt) -> str | None:
    """Return the name that a statement assigns or annotates; None for another statement."""
    target = getattr(statement, "target", None)
    if isinstance(statement, ast.Assign):
        target = statement.targets[0]
    return target.id if isinstance(target, ast.Name) else None


def _string(statement: ast.stmt) -> str | None:
    """Return the string that is a statement of its own; None for another statement."""
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        value = statement.value.value
        return value if isinstance(value, str) else None
    return None
