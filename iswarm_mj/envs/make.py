"""Environments are made in two steps: scenarios are checked first, arrays made later."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.base import CompiledEngine, Engine
from iswarm_mj.engines.validation import make_compiled_engine
from iswarm_mj.envs import tables
from iswarm_mj.envs.core import Core, Speaker
from iswarm_mj.envs.env import Env
from iswarm_mj.envs.tables import Row
from iswarm_mj.sensors.fields import Flag
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation.build import exercise_engine, initial_state, world_params
from iswarm_mj.simulation.memory_limits import devices_of
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.setup import Setup, set_up
from iswarm_mj.simulation.worlds import World, random_keys
from iswarm_mj.tasks.base import Quantity
from iswarm_mj.utils.constraints import check, check_kind, is_whole
from iswarm_mj.utils.errors import UserError, closest, shown
from iswarm_mj.utils.operating_system import n_usable_cores

MAX_FLAGS = 29
"""Number of flags that fit into a message beside two bits of LED number and the parity."""

MAX_STARTS = 100_000
"""Largest number of layouts in which episodes begin."""


def make_env(
    scenario: Scenario | None = None, *, payload: Any = None, n_starts: int = 64, **fields: Any
) -> Env:
    """Return an environment in which each robot of a swarm has actions, observations and a reward.

    It takes all of a scenario but its strategy, in whose place robots are told what to do. With
    `MjxSettings()`, `reset` and `step` are of one world, for `jax.vmap`; with other engines they
    are of all worlds of the scenario at once.

    Args:
        scenario: what is simulated; `steps` are those of an episode at most, and `goal` ends one.
        payload: message fields by name, a `Payload` (`sensors.messages`), or a number of bits, one
            flag each. Without it, actions are motion only.
        n_starts: number of initial layouts, drawn from the seed; the keys of `reset` pick one.
        fields: fields of the scenario, in its place: `make_env(robots=20)` is
            `make_env(Scenario(robots=20))`.

    Raises:
        UserError: parts that do not fit each other, more worlds than fit into memory, or fields
            beside a scenario.
    """
    scenario = scenario_of(scenario, fields)
    return prepare_env(scenario, payload=payload, n_starts=n_starts).make()


def scenario_of(scenario: Any, fields: Mapping[str, Any]) -> Scenario:
    """Return the scenario of a call that takes its fields by name in its place.

    Raises:
        UserError: both are given, or there is no such field.
    """
    if scenario is not None:
        check_kind("scenario", scenario, Scenario)
        if fields:
            name = next(iter(fields))
            raise UserError(
                f"`{name}` is given beside a scenario, which has it; set it in the scenario"
            )
        return scenario

    known = Scenario.__dataclass_fields__
    for name in fields:
        if name not in known:
            similar = closest(name, known)
            hint = f"perhaps you meant {similar}" if similar else f"it has {', '.join(known)}"
            raise UserError(f"a scenario has no field {shown(name)}; {hint}")
    return Scenario(**fields)


@dataclass(frozen=True)
class PreparedEnv:
    """An environment that is checked, but has no arrays yet, which start JAX's threads.

    A process with these threads cannot be forked, and Gymnasium forks one that has made an
    environment.
    """

    setup: Setup
    """Checked scenario."""
    engine: Engine | CompiledEngine
    """Engine of the worlds."""
    layouts: Sequence[World]
    """Layouts in which episodes begin."""
    steps: int
    """Largest number of control steps of an episode."""
    payload: Payload
    """Fields of the messages."""
    senses: tuple[tuple[str, tuple[Quantity, int]], ...]
    """Quantities that robots sense beside balls and dump, see `Core`."""
    n_worlds: int | None
    """Number of worlds B that `reset` and `step` take; None where they take one, for `jax.vmap`."""

    @property
    def n_robots(self) -> int:
        """Number of robots N."""
        return self.setup.capacity

    @property
    def observations(self) -> list[Row]:
        """Rows of an observation, see `tables.observation_rows`."""
        setup = self.setup
        senses = dict(self.senses)
        return tables.observation_rows(setup.config, setup.robot, self.payload, senses)

    @property
    def actions(self) -> list[Row]:
        """Rows of an action, see `tables.action_rows`."""
        return tables.action_rows(self.setup.config, self.payload)

    def make(self) -> Env:
        """Return the environment, with its engine checked."""
        setup = self.setup
        if not setup.engine.is_shipped:
            exercise_engine(setup)

        # The key of the parameters has no effect, since each episode has one of its own.
        key = random_keys(self.layouts[:1])
        speaker: Any = Speaker(self.payload)
        params = world_params(setup, key, speaker)
        poses, worlds = initial_state(setup)
        with jax.default_device(setup.device):
            core = Core(
                static_config=setup.static,
                config=setup.config,
                robot=setup.robot,
                robot_file=setup.robot_file,
                params=jax.tree.map(lambda a: jnp.asarray(a)[0], params),
                poses=jnp.asarray(poses, jnp.float32),
                worlds=jax.tree.map(jnp.asarray, worlds),
                steps=self.steps,
                payload=self.payload,
                senses=self.senses,
            )
        return Env(core, self.engine, self.n_worlds, on_host=setup.engine.on_host)


def prepare_env(scenario: Scenario, *, payload: Any = None, n_starts: int = 64) -> PreparedEnv:
    """Return an environment whose settings are checked, and that has no arrays yet.

    Two numbers of worlds meet here. The engine takes `scenario.worlds` of them at once, where it
    does not leave that to `jax.vmap` (`PreparedEnv.n_worlds`). Their episodes begin in `n_starts`
    layouts, from which each reset picks one for each world.

    Args:
        scenario: see `make_env`.
        payload: see `make_env`.
        n_starts: see `make_env`.

    Raises:
        UserError: see `make_env`.
    """
    if not isinstance(scenario.worlds, int):
        raise UserError(
            "an environment begins in `n_starts` layouts of a seed; "
            "give a scenario with a number of worlds"
        )
    if scenario.config.strategy.update_order != "synchronous":
        raise UserError(
            "strategy.update_order is sequential, but robots of an environment act at once; "
            "leave it out"
        )
    if scenario.failing is not None:
        raise UserError(
            f"failing is {scenario.failing}, but an environment lets no robots fail; leave it out"
        )
    is_in_range = is_whole(n_starts) and 1 <= n_starts <= MAX_STARTS
    check("n_starts", n_starts, f"a whole number from 1 to {MAX_STARTS}", is_in_range)

    # Episodes begin as the worlds of a run with `n_starts` worlds do. All else is of the scenario
    # as it was given: memory and engine are for its own number of worlds.
    layouts = replace(scenario, worlds=int(n_starts)).list_worlds()
    setup = set_up(scenario, scenario.settings(), layouts)

    message_fields = as_payload(payload)
    message_fields.check_room(n_leds=len(setup.robot.sides))  # with the number of the LED
    engine, n_worlds = _engine_of(setup)
    return PreparedEnv(
        setup=setup,
        engine=engine,
        layouts=layouts,
        steps=scenario.steps,
        payload=message_fields,
        senses=_senses_of(setup),
        n_worlds=n_worlds,
    )


def _senses_of(setup: Setup) -> tuple[tuple[str, tuple[Quantity, int]], ...]:
    """Return the quantities that the task lets robots sense, and how many numbers each has."""
    senses = []
    for name, quantity in setup.task.senses.items():
        size = int(np.prod(setup.sensed[name].shape[1:], dtype=int))
        senses.append((name, (quantity, size)))
    return tuple(senses)


def _engine_of(setup: Setup) -> tuple[Engine | CompiledEngine, int | None]:
    """Return the engine, and the number of worlds that it takes at once; None for `jax.vmap`."""
    settings = setup.engine
    n_worlds = setup.settings.n_worlds
    if settings.on_host:
        n_threads = getattr(settings, "threads", 0) or n_usable_cores()
        make_engine = setup.host_engine()
        return make_engine(n_worlds, n_threads), n_worlds
    platform = devices_of(settings)[0].platform
    engine = make_compiled_engine(settings, setup.model, setup.robot, n_worlds, platform)
    is_batched = engine.mapping(platform) == "batch"
    return engine, n_worlds if is_batched else None


def as_payload(payload: Any) -> Payload:
    """Return the fields of messages: none for None, flags for a number of bits.

    Raises:
        UserError: it is no payload, or there are too many bits.
    """
    if payload is None:
        return Payload()
    if isinstance(payload, Payload):
        return payload
    if isinstance(payload, int) and not isinstance(payload, bool):
        constraint = f"fields, or a number of bits from 0 to {MAX_FLAGS}"
        check("payload", payload, constraint, 0 <= payload <= MAX_FLAGS)
        return Payload({f"bit_{number}": Flag() for number in range(payload)})
    return Payload(payload)
