"""Packages that only some uses need, by the extras of pyproject.toml that install them.

A module imports them as any other. Where one is missing, the doors of the package (`iswarm`, and
the public names) turn the error of the import into a sentence that names the extra.
"""

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager

from iswarm_mj.utils.errors import UserError

EXTRAS = {
    "cluster": ("ray",),
    "marl": ("gymnasium", "pettingzoo"),
    "paper": ("jinja2", "matplotlib"),
    "play": ("msgspec", "viser", "websockets"),
    "search": ("cmaes", "matplotlib"),
    "video": ("imageio_ffmpeg", "matplotlib"),
    "warp": ("warp",),
}
"""Modules that each extra installs; of a module in several, the first is named."""
_PACKAGES = {"imageio_ffmpeg": "imageio-ffmpeg", "warp": "warp-lang"}
"""Packages whose names differ from those of their modules."""


def require(extra: str) -> None:
    """Check that the modules of an extra are installed, before work that would be in vain.

    Raises:
        UserError: names a module that is not, and the extra.
    """
    for module in EXTRAS[extra]:
        if importlib.util.find_spec(module) is None:
            raise _missing(module, extra)


@contextmanager
def naming_extras() -> Iterator[None]:
    """Name the extra if a module that is imported in the block is missing.

    Raises:
        UserError: a module of an extra is missing.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        for extra, modules in EXTRAS.items():
            if module in modules:
                raise _missing(module, extra) from None
        raise


def _missing(module: str, extra: str) -> UserError:
    """Return the error that names the extra of a module that is missing."""
    package = _PACKAGES.get(module, module)
    return UserError(
        f'the package {package} is not installed; run pip install "iswarm-mj[{extra}]"'
    )
