"""What the source says of the fields of a class: the strings that follow them."""

import ast
import functools
import inspect
import textwrap
from collections.abc import Mapping
from itertools import pairwise


@functools.cache
def field_docs(cls: type) -> Mapping[str, str]:
    """Return the docstrings of a class's fields, those of its bases included, each on one line.

    A class whose source is not at hand, since it was made by a program, has those of its bases.
    """
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        try:
            node = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        except (OSError, TypeError, SyntaxError):
            continue
        body = node.body if isinstance(node, ast.ClassDef) and node.name == base.__name__ else []
        for before, after in pairwise(body):
            target = before.targets[0] if isinstance(before, ast.Assign) else getattr(before, "target", None)
            text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else None
            if isinstance(target, ast.Name) and isinstance(text, str):
                found[target.id] = " ".join(text.split())
    return found
