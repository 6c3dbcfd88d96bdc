"""Modules beside users' files, which their code can import, and no other code; and of which files a module consists."""

import ast
import importlib.util
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any

from iswarm_mj.strategy.user_code import is_users


class Beside:
    """A finder of modules, asked after all others.

    Were the folders in `sys.path`, packages would take users' files for modules that are not installed: numba looks for
    `coverage`.
    """

    folders: tuple[str, ...] = ()

    @classmethod
    def find_spec(cls, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return where a module is that a user's code imports, or `sources` for it."""
        frame = sys._getframe(1)
        while frame.f_back and frame.f_globals.get("__name__", "").startswith("importlib"):
            frame = frame.f_back
        asks = is_users(frame.f_code.co_filename) or frame.f_globals.get("__name__") == __name__
        return PathFinder.find_spec(name, list(cls.folders)) if asks and path is None else None


def add_folder(folder: Path) -> None:
    """Let users' code import what is in a folder."""
    if Beside not in sys.meta_path:
        sys.meta_path.append(Beside)
    if str(folder) not in Beside.folders:
        Beside.folders += (str(folder),)


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
