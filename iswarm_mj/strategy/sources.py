"""Which files a user's module consists of: its own, and those of the user's modules that it imports."""

import ast
import importlib.util
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from iswarm_mj.strategy.user_code import is_users


def sources(path: Path) -> list[Path]:
    """Return a file of Python, and the files of a user that it imports in any of its lines, directly or not.

    What is found depends on `sys.path`, as for the import itself; the file is one that could be imported.
    """
    found = [path.resolve()]
    for file in found:  # grows on the way
        package = _package(file)
        for name in _imported(ast.parse(file.read_bytes())):
            spec = None
            with suppress(ImportError, ValueError, AttributeError):  # a name that is none of a module
                spec = importlib.util.find_spec(name, package)
            if spec is not None and spec.origin and spec.origin.endswith(".py") and is_users(spec.origin):
                origin = Path(spec.origin).resolve()
                found += [origin] if origin not in found else []
    return found


def _imported(tree: ast.AST) -> Iterator[str]:
    """Names of all that could be a module, with dots before relative ones."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            yield module
            dot = "." if node.module else ""
            yield from (f"{module}{dot}{alias.name}" for alias in node.names)


def _package(file: Path) -> str:
    """The package that a file belongs to, by the folders with an `__init__.py` above it."""
    parts: list[str] = []
    folder = file.parent
    while (folder / "__init__.py").exists():
        parts, folder = [folder.name, *parts], folder.parent
    return ".".join(parts)
