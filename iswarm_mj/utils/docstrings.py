"""What the source says of the fields of a class: the strings that follow them."""

import ast
import functools
import inspect
import textwrap
from collections.abc import Mapping, Sequence
from itertools import pairwise


@functools.cache
def field_docs(cls: type) -> Mapping[str, str]:
    """Return the docstrings of a class's fields, those of its bases included, each on one line.

    A class whose source is not at hand, since it was made by a program, has those of its bases.
    """
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        found |= _own_docs(base)
    return found


def _own_docs(cls: type) -> dict[str, str]:
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(cls)))
    except (OSError, TypeError, SyntaxError):
        return {}
    node = tree.body[0]
    return docs_of(node.body) if isinstance(node, ast.ClassDef) and node.name == cls.__name__ else {}


def docs_of(body: Sequence[ast.stmt]) -> dict[str, str]:
    """Strings that follow assignments, by the names assigned to, each on one line."""
    found = {}
    for before, after in pairwise(body):
        target = before.targets[0] if isinstance(before, ast.Assign) else getattr(before, "target", None)
        text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else None
        if isinstance(target, ast.Name) and isinstance(text, str):
            found[target.id] = " ".join(text.split())
    return found
