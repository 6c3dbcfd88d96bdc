"""All engines. An engine is a folder with its settings, and its line here."""

from dataclasses import fields
from typing import TYPE_CHECKING, Any, Literal

from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.settings import EngineSettings

ENGINES: dict[str, type[EngineSettings]] = {
    settings.name: settings for settings in (MujocoSettings, PlanarSettings, MjxSettings)
}
"""Settings of each engine by its name."""

IDENTITY = ("engine", "impl", "refinement", "accuracy", "solver_iterations")
"""Keys of the `identity` of an engine; each has some of them."""

if TYPE_CHECKING:
    EngineName = str
    ImplName = str
else:
    EngineName = Literal[tuple(ENGINES)]
    ImplName = Literal[
        "default", *dict.fromkeys(impl for engine in ENGINES.values() for impl in engine.implementations)
    ]


def engine_settings(name: str, **given: Any) -> EngineSettings:
    """Return the settings of an engine, from values of which it takes those that it has; None is its own default."""
    own = {f.name for f in fields(ENGINES[name])}
    return ENGINES[name](**{key: value for key, value in given.items() if key in own and value is not None})


def engines_with(setting: str) -> list[str]:
    """Return the names of the engines that have a setting; none for what is no setting of an engine."""
    return [name for name, engine in ENGINES.items() if setting in {f.name for f in fields(engine)}]
