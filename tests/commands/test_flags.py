"""Settings in messages become flags where there are such."""

from dataclasses import fields

import pytest

from iswarm_mj.commands.flags import in_flags
from iswarm_mj.commands.main import COMMANDS
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.utils.errors import ConfigError, FaultKind, SimulationFault, UserError


@pytest.mark.parametrize(
    "error, text",
    [
        (ConfigError("arena.size", 7, "between 10 and 150 rd"), "--arena.size must be between 10 and 150 rd (got 7)"),
        (ConfigError("arena.dump_size", 7, "small"), "--arena.dump-size must be small (got 7)"),
        (ConfigError("n_robots", 0, "at least 1"), "--robots must be at least 1 (got 0)"),
        (ConfigError("n_worlds", 0, "at least 1"), "--worlds must be at least 1 (got 0)"),
        (ConfigError("n_places", 0, "at least `n_robots`"), "n_places must be at least --robots (got 0)"),
        (ConfigError("p_vector_forget", 2, "between 0 and 1"), "--p-vector-forget must be between 0 and 1 (got 2)"),
        (ConfigError("operators.elite", 2, "below `steps`"), "--operators.elite must be below --steps (got 2)"),
        (ConfigError("worlds", 2, "1", "use `jax.pmap`"), "--worlds must be 1 (got 2); use `jax.pmap`"),
        (
            SimulationFault(kind=FaultKind.TOO_MANY_CONTACTS),
            "contact buffer full; use fewer robots, or with mjx increase --contact-capacity",
        ),
        (UserError("file x: size must be 3"), "file x: size must be 3"),
    ],
)
def test_names(error, text):
    assert in_flags(error, COMMANDS.values()) == text


@pytest.mark.parametrize("command", ["clean", "bench", "experiment", "evolve"])
def test_refinement_is_that_of_the_engine(command):
    (field,) = (field for field in fields(COMMANDS[command]) if field.name == "refinement")
    assert field.default == PlanarSettings().refinement
