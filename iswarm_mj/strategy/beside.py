"""Modules beside users' files, which their code can import, and no other code."""

import sys
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
        """Return where a module is that a user's code imports, or `strategy.sources` for it."""
        frame = sys._getframe(1)
        while frame.f_back and frame.f_globals.get("__name__", "").startswith("importlib"):
            frame = frame.f_back
        asks = is_users(frame.f_code.co_filename) or frame.f_globals.get("__name__") == "iswarm_mj.strategy.sources"
        return PathFinder.find_spec(name, list(cls.folders)) if asks and path is None else None


def add_folder(folder: Path) -> None:
    """Let users' code import what is in a folder."""
    if Beside not in sys.meta_path:
        sys.meta_path.append(Beside)
    if str(folder) not in Beside.folders:
        Beside.folders += (str(folder),)
