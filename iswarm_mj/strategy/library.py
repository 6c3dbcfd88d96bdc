"""Strategies by name: of a class in a file, or of an entry point of an installed package."""

import difflib
import importlib.util
import sys
from dataclasses import is_dataclass
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from iswarm_mj.strategy.explain import explained
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.files import check_file

GROUP = "iswarm_mj.strategies"
"""Group of entry points by which packages offer strategies: classes, or objects whose fields are the defaults."""
LARGEST_FILE = 2**24
"""Size up to which a strategy's file is read [bytes]."""
_FORM = "FILE.py:CLASS, as walk.py:Walk"


def find_strategy(name: str) -> Any:
    """Return a class of strategies, or an object whose values are defaults.

    Args:
        name: `FILE.py:CLASS`, or the name of an entry point.

    Raises:
        UserError: there is no such file, class or name, or the file cannot be imported.
    """
    path, colon, cls = name.rpartition(":")
    if colon:
        return _of_file(Path(path), cls)
    if name.endswith(".py") or "/" in name:
        return _of_file(Path(name), "")
    installed = {point.name: point for point in entry_points(group=GROUP)}
    if name not in installed:
        similar = difflib.get_close_matches(name, installed, n=1)
        remedy = f"perhaps you meant {similar[0]}" if similar else None
        raise ConfigError("strategy", name, f"{_FORM}, or installed ({', '.join(sorted(installed)) or 'none'})", remedy)
    with explained(f"strategy {name}"):
        return installed[name].load()


def _of_file(path: Path, name: str) -> Any:
    module = _imported(path)
    classes = [
        key
        for key, value in vars(module).items()
        if isinstance(value, type) and value.__module__ == module.__name__ and hasattr(value, "act")
    ]
    found = getattr(module, name, None) if name else None
    if found is None:
        fact = f"{path} has no {name}" if name else f"strategy {path} names no class"
        there = f"its strategies are {', '.join(classes)}" if classes else "it has no class with a method act"
        raise UserError(f"{fact}; {there}; write {path}:{classes[0] if classes else 'CLASS'}")
    if not isinstance(found, type) and not is_dataclass(found):
        raise UserError(f"{path}:{name} is a {type(found).__name__}; name a class, see iswarm_mj.strategy.protocol")
    return found


def _imported(path: Path) -> ModuleType:
    """Execute a file, which may import others beside it."""
    if not path.is_file():
        raise UserError(f"strategy file {path} does not exist; give {_FORM}")
    try:
        check_file(path, LARGEST_FILE)
    except OSError as error:
        raise UserError(f"strategy file {path} cannot be read ({error.strerror}); give {_FORM}") from None
    path = path.resolve()
    name = f"iswarm_strategy_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise UserError(f"strategy file {path} is not Python; give {_FORM}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look for their types there
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    with explained(f"strategy file {path.name}"):
        spec.loader.exec_module(module)
    return module
