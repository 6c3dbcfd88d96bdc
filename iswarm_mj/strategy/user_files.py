"""Python files of users: how they are imported, and which files they import themselves."""

import ast
import importlib.util
import os
import re
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import NamedTuple

from iswarm_mj.utils.user_code import is_users


class _Imported(NamedTuple):
    """A file that was executed."""

    content: bytes
    """Content of the file then."""
    module: ModuleType
    """Its module."""


_IMPORTING = RLock()
"""Held while a file is executed, as that changes the modules and the path of all threads."""
_IMPORTED: dict[str, _Imported] = {}
"""Files that were executed without an error, by the names of their modules."""


def import_file(path: Path) -> ModuleType | None:
    """Execute a file, and return its module; None if it is no file of Python.

    The file can import what lies beside it, as a script can. It is executed again if it has changed
    since, so that edits count, and objects of its classes are equal as long as it has not; what it
    imports is executed once, as all modules are. Files of one name in different directories are
    different modules, and so are the files that they import from there. Of several threads, one
    executes files at a time.
    """
    with _IMPORTING:
        return _import_now(path)


def _import_now(path: Path) -> ModuleType | None:
    """Execute a file, and return its module, see `import_file`."""
    path = path.resolve()
    script = _running_script(path)
    if script is not None:
        return script

    number = zlib.crc32(os.fsencode(path))
    name = f"{re.sub(r'[^A-Za-z0-9]', '_', path.stem)}_{number:08x}"
    content = path.read_bytes()
    before = _IMPORTED.get(name)
    if before is not None and before == (content, sys.modules.get(name)):
        return before.module

    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        return None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look for their types there
    with _first_in_path(path.parent):
        names_before = {*sys.modules}
        spec.loader.exec_module(module)
        for new_name in sys.modules.keys() - names_before:
            _pickle_by_value(sys.modules[new_name])
    _pickle_by_value(module)
    _IMPORTED[name] = _Imported(content, module)
    return module


def _pickle_by_value(module: ModuleType) -> None:
    """Let asynchronous environments take a user's module to processes that cannot import it.

    They pickle by cloudpickle, which comes with Gymnasium; without Gymnasium there are none.
    """
    file = getattr(module, "__file__", None)
    if file is not None and is_users(file):
        with suppress(ImportError):
            import cloudpickle  # noqa: TID251, which bans reading pickles; nothing is read here

            cloudpickle.register_pickle_by_value(module)


def _running_script(path: Path) -> ModuleType | None:
    """Return the script that this process runs, if a file is that script; None otherwise.

    A script that names itself must not be imported: it would be executed a second time, and ask for
    the same import again.
    """
    script = sys.modules.get("__main__")
    file = getattr(script, "__file__", None)
    return script if file is not None and Path(file).resolve() == path else None


@contextmanager
def _first_in_path(directory: Path) -> Iterator[None]:
    """Let imports look into a directory first, until the end of the block.

    The directory does not stay in the path, since packages try to import others that may not be
    installed, as numba does with `coverage`, and would import a user's file of that name instead.

    Loaded modules that would hide a file of the directory are set aside. At the end they come back,
    in place of modules of the same names that the block loaded; whoever imported those keeps them.
    """
    set_aside = {
        name: module for name, module in [*sys.modules.items()] if _hides(name, module, directory)
    }
    for name in set_aside:
        del sys.modules[name]
    # Python may not notice a file that was created just after it listed the directory.
    importlib.invalidate_caches()
    sys.path.insert(0, str(directory))
    try:
        yield
    finally:
        with suppress(ValueError):  # the file may have changed the path
            sys.path.remove(str(directory))
        sys.modules.update(set_aside)


def _hides(name: str, module: ModuleType, directory: Path) -> bool:
    """Return whether a loaded module hides a file or package of the same name in a directory.

    Only modules of users count, and only those that lie elsewhere.
    """
    file = getattr(module, "__file__", None)
    if name == "__main__" or file is None or not is_users(file):
        return False
    top = name.partition(".")[0]
    is_there = (directory / f"{top}.py").exists() or (directory / top).is_dir()
    return is_there and not Path(file).resolve().is_relative_to(directory)


def sources(path: Path) -> list[Path]:
    """Return a file of Python, and the files of a user that it imports in any of its lines,
    directly or not.

    What is found depends on `sys.path`, as for the import itself. The file must be valid Python.
    """
    files = [path.resolve()]
    with _first_in_path(files[0].parent):
        for file in files:  # grows on the way
            package = _package(file)
            for name in _names_in(ast.parse(file.read_bytes())):
                for origin in map(Path, _origins(name, package)):
                    is_source = origin.suffix == ".py" and is_users(str(origin))
                    if is_source and origin.resolve() not in files:
                        files.append(origin.resolve())
    return files


def _origins(name: str, package: str) -> Iterator[str]:
    """Yield the files of a module and of the packages above it; none if it is no module."""
    with suppress(ImportError, ValueError, AttributeError):
        parts = importlib.util.resolve_name(name, package).split(".")
        for n in range(1, len(parts) + 1):
            spec = importlib.util.find_spec(".".join(parts[:n]))
            if spec is not None and spec.origin:
                yield spec.origin


def _names_in(tree: ast.AST) -> Iterator[str]:
    """Yield the names of all that could be a module, with dots before relative ones."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            yield module
            dot = "." if node.module else ""
            for alias in node.names:
                yield f"{module}{dot}{alias.name}"


def _package(file: Path) -> str:
    """Return the package that a file belongs to, by the folders with an `__init__.py` above it."""
    parts: list[str] = []
    folder = file.parent
    while (folder / "__init__.py").exists():
        parts = [folder.name, *parts]
        folder = folder.parent
    return ".".join(parts)
