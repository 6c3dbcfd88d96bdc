"""How environments are made."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.base import CompiledEngine, Engine
from iswarm_mj.engines.checked import make_compiled_engine
from iswarm_mj.envs import tables
from iswarm_mj.envs.core import Core, Speaker
from iswarm_mj.envs.env import Env
from iswarm_mj.envs.tables import Row
from iswarm_mj.sensors.fields import Flag
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation.build import initial_state, world_params
from iswarm_mj.simulation.memory_limits import devices_of
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.setup import Setup, set_up
from iswarm_mj.simulation.worlds import World, random_keys
from iswarm_mj.tasks.base import Quantity
from iswarm_mj.utils.constraints import check, check_kind, is_whole
from iswarm_mj.utils.errors import UserError, closest, shown

MOST_BITS = 29
"""Flags that fit into a message beside two bits of LED number and the parity."""


def make_env(scenario: Scenario | None = None, *, payload: Any = None, n_starts: int = 64, **fields: Any) -> Env:
    """Return an environment in which each robot of a swarm has actions, observations and a reward.

    It takes all of a scenario but its strategy, in whose place robots are told what to do. With
    `MjxSettings()`, `reset` and `step` are of one world, for `jax.vmap`; with other engines they are
    of all worlds of the scenario at once.

    Args:
        scenario: what is simulated; `steps` are those of an episode at most, and `goal` ends one.
        payload: message fields by name, a `Payload` (`sensors.messages`), or a number of bits, one flag each. Without
            it, actions are motion only.
        n_starts: number of initial layouts, drawn from the seed; the keys of `reset` pick one.
        fields: fields of the scenario, in its place: `make_env(robots=20)` is `make_env(Scenario(robots=20))`.

    Raises:
        UserError: parts that do not fit each other, more worlds than fit into memory, or fields beside a scenario.
    """
    return prepare_env(scenario_of(scenario, fields), payload=payload, n_starts=n_starts).make()


def scenario_of(scenario: Any, fields: Mapping[str, Any]) -> Scenario:
    """Return the scenario of a call that takes its fields by name in its place.

    Raises:
        UserError: both are given, or there is no such field.
    """
    if scenario is not None:
        check_kind("scenario", scenario, Scenario)
        if fields:
            raise UserError(f"`{next(iter(fields))}` is given beside a scenario, which has it; set it in the scenario")
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
    """An environment that is checked, but for its arrays, which start JAX's threads.

    A process with these threads cannot be forked, and Gymnasium forks one that has made an environment.
    """

    setup: Setup
    engine: Engine | CompiledEngine
    layouts: Sequence[World]
    """From which episodes begin."""
    steps: int
    """Maximum control steps of an episode."""
    payload: Payload
    senses: tuple[tuple[str, tuple[Quantity, int]], ...]
    """See `Core`."""
    n_worlds: int | None
    """See `Env`."""

    @property
    def n_robots(self) -> int:
        """N."""
        return self.setup.capacity

    @property
    def observations(self) -> list[Row]:
        """See `tables.observation_rows`."""
        return tables.observation_rows(self.setup.config, self.setup.robot, self.payload, dict(self.senses))

    @property
    def actions(self) -> list[Row]:
        """See `tables.action_rows`."""
        return tables.action_rows(self.setup.config, self.payload)

    def make(self) -> Env:
        """Return the environment."""
        speaker: Any = Speaker(self.payload)
        # An episode has a key of its own.
        params = world_params(self.setup, random_keys(self.layouts[:1]), speaker)
        poses, worlds = initial_state(self.setup)
        with jax.default_device(self.setup.device):
            core = Core(
                static_config=self.setup.static,
                config=self.setup.config,
                robot=self.setup.robot,
                robot_file=self.setup.robot_file,
                params=jax.tree.map(lambda a: jnp.asarray(a)[0], params),
                poses=jnp.asarray(poses, jnp.float32),
                worlds=jax.tree.map(jnp.asarray, worlds),
                steps=self.steps,
                payload=self.payload,
                senses=self.senses,
            )
        return Env(core, self.engine, self.n_worlds, on_host=self.setup.engine.on_host)


def prepare_env(scenario: Scenario, *, payload: Any = None, n_starts: int = 64) -> PreparedEnv:
    """Check the settings of an environment, see `make_env`, and return what makes it."""
    if not isinstance(scenario.worlds, int):
        raise UserError(
            "an environment begins in `n_starts` layouts of a seed; give a scenario with a number of worlds"
        )
    if scenario.config.strategy.update_order != "synchronous":
        raise UserError("strategy.update_order is sequential, but robots of an environment act at once; leave it out")
    check("n_starts", n_starts, "a whole number from 1 to 100000", is_whole(n_starts) and 1 <= n_starts <= 100_000)

    layouts = replace(scenario, worlds=int(n_starts)).list_worlds()
    setup = set_up(scenario, scenario.settings(), layouts)

    messages = as_payload(payload)
    messages.check_room(len(setup.robot.sides))
    senses = tuple(
        (name, (quantity, int(np.prod(setup.sensed[name].shape[1:], dtype=int))))
        for name, quantity in setup.task.senses.items()
    )

    made, n_batch = _engine_of(setup)
    return PreparedEnv(setup, made, layouts, scenario.steps, messages, senses, n_batch)


def _engine_of(setup: Setup) -> tuple[Engine | CompiledEngine, int | None]:
    """Return the engine, and the number of worlds that it takes at once; None if `jax.vmap` maps one."""
    settings, n_worlds = setup.engine, setup.settings.n_worlds
    if settings.on_host:
        n_threads = getattr(settings, "threads", 0) or len(os.sched_getaffinity(0))
        return setup.host_engine()(n_worlds, n_threads), n_worlds
    platform = devices_of(settings)[0].platform
    engine = make_compiled_engine(settings, setup.model, setup.robot, n_worlds, platform)
    return engine, n_worlds if engine.mapping(platform) == "batch" else None


def as_payload(given: Any) -> Payload:
    """Return what messages carry: nothing for None, flags for a number of bits.

    Raises:
        UserError: it is no payload, or there are too many bits.
    """
    if given is None or isinstance(given, Payload):
        return given or Payload()
    if isinstance(given, int) and not isinstance(given, bool):
        check("payload", given, f"fields, or a number of bits from 0 to {MOST_BITS}", given in range(MOST_BITS + 1))
        return Payload({f"bit_{number}": Flag() for number in range(given)})
    return Payload(given)
