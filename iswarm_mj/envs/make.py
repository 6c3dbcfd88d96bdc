"""How environments are made."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.base import CompiledEngine, Engine
from iswarm_mj.engines.checked import make_compiled_engine
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.envs import tables
from iswarm_mj.envs.core import Core, Speaker
from iswarm_mj.envs.env import Env
from iswarm_mj.envs.tables import Row
from iswarm_mj.geometry.robot import RobotFile
from iswarm_mj.sensors.fields import Flag
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation.build import initial_state, world_params
from iswarm_mj.simulation.memory_limits import devices_of
from iswarm_mj.simulation.scenario import Scenario, refuse_beside_scenario
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.setup import Setup, set_up
from iswarm_mj.simulation.stated import STEPS
from iswarm_mj.simulation.worlds import World, random_keys
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.library import TASKS, find
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.base import Quantity
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.signatures import usable_task
from iswarm_mj.utils.constraints import check, check_kind, is_whole
from iswarm_mj.utils.errors import UserError

MOST_BITS = 29
"""Flags that fit into a message beside two bits of LED number and the parity."""


def make_env(
    scenario: Scenario | Any = None,
    n_robots: int | None = None,
    *,
    task: Any = None,
    config: SwarmConfig | None = None,
    engine: EngineSettings | None = None,
    payload: Any = None,
    steps: int | None = None,
    stop_at: int | None = None,
    n_worlds: int | None = None,
    n_starts: int = 64,
    seed: int | None = None,
    robot_file: RobotFile = None,
) -> Env:
    """Return an environment in which each robot of a swarm has actions, observations and a reward.

    `make_env(scenario)` takes all of a scenario but its strategy, in whose place robots are told what to do; the parts
    of a scenario can be given one by one in its place.

    Args:
        scenario: what is simulated; or a task, as `task`.
        n_robots: N, 20 by default.
        task: `"cleaning"`, the default, FILE.py:CLASS, the name of an installed task, or a `tasks.base.Task`.
        config: of the swarm; defaults if None.
        engine: settings, by default `PlanarSettings()`. With `MjxSettings()`, `reset` and `step` are of one world, for
            `jax.vmap`; otherwise of `n_worlds` at once.
        payload: message fields by name, a `Payload` (`sensors.messages`), or a number of bits, one flag each. Without
            it, actions are motion only.
        steps: maximum control steps of an episode, 800 by default.
        stop_at: progress that ends an episode; the task's goal by default.
        n_worlds: B, 1 by default; with MJX only the size of Warp's buffers.
        n_starts: number of initial layouts, drawn from `seed`; the keys of `reset` pick one.
        seed: of the layouts, 0 by default.
        robot_file: MJCF file of the robots, or of each kind (`RobotFile`); None for `models/robot.xml`.

    Raises:
        UserError: unknown task, settings that do not fit, or more worlds than fit into memory; or parts beside a
            scenario.
    """
    if not isinstance(scenario, Scenario):
        if scenario is not None and task is not None:
            raise UserError("the task is given twice, first and as `task`; leave out one of them")
        task = task if scenario is None else scenario
        return prepare_env(
            "cleaning" if task is None else task,
            20 if n_robots is None else n_robots,
            config=config,
            engine=engine,
            payload=payload,
            steps=STEPS if steps is None else steps,
            stop_at=stop_at,
            n_worlds=n_worlds,
            n_starts=n_starts,
            seed=0 if seed is None else seed,
            robot_file=robot_file,
        ).make()

    refuse_beside_scenario(
        task=task,
        n_robots=n_robots,
        config=config,
        engine=engine,
        steps=steps,
        stop_at=stop_at,
        n_worlds=n_worlds,
        seed=seed,
        robot_file=robot_file,
    )
    if not isinstance(scenario.worlds, int):
        raise UserError(
            "an environment begins in `n_starts` layouts of a seed; give a scenario with a number of worlds"
        )
    return prepare_env(
        scenario.task,
        scenario.n_robots,
        config=scenario.config,
        engine=scenario.engine,
        payload=payload,
        steps=scenario.steps,
        stop_at=scenario.goal,
        n_worlds=scenario.n_worlds,
        n_starts=n_starts,
        seed=scenario.seed,
        robot_file=scenario.robot_file,
    ).make()


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


def prepare_env(
    task: Any,
    n_robots: int,
    *,
    config: SwarmConfig | None = None,
    engine: EngineSettings | None = None,
    payload: Any = None,
    steps: int = 800,
    stop_at: int | None = None,
    n_worlds: int | None = None,
    n_starts: int = 64,
    seed: int = 0,
    robot_file: RobotFile = None,
) -> PreparedEnv:
    """Check the settings of an environment, see `make_env`, and return what makes it."""
    config = SwarmConfig() if config is None else config
    engine = PlanarSettings() if engine is None else engine
    check_kind("config", config, SwarmConfig)
    if config.strategy.update_order != "synchronous":
        raise UserError("strategy.update_order is sequential, but robots of an environment act at once; leave it out")
    check("n_starts", n_starts, "a whole number from 1 to 100000", is_whole(n_starts) and 1 <= n_starts <= 100_000)

    settings = RunSettings(n_robots, steps, seed, n_worlds=1 if n_worlds is None else n_worlds, stop_at=stop_at)
    layouts = [World(PRESETS["type1"], int(n_robots), int(seed), index) for index in range(n_starts)]
    setup = set_up(config, settings, engine, task_of(task), layouts, robot_file)

    messages = as_payload(payload)
    messages.check_room(len(setup.robot.sides))
    senses = tuple(
        (name, (quantity, int(np.prod(setup.sensed[name].shape[1:], dtype=int))))
        for name, quantity in setup.task.senses.items()
    )

    made, n_batch = _engine_of(setup)
    return PreparedEnv(setup, made, layouts, steps, messages, senses, n_batch)


def _engine_of(setup: Setup) -> tuple[Engine | CompiledEngine, int | None]:
    """Return the engine, and the number of worlds that it takes at once; None if `jax.vmap` maps one."""
    settings, n_worlds = setup.engine, setup.settings.n_worlds
    if settings.on_host:
        n_threads = getattr(settings, "threads", 0) or len(os.sched_getaffinity(0))
        return setup.host_engine()(n_worlds, n_threads), n_worlds
    platform = devices_of(settings)[0].platform
    engine = make_compiled_engine(settings, setup.model, setup.robot, n_worlds, platform)
    return engine, n_worlds if engine.mapping(platform) == "batch" else None


def task_of(given: Any) -> Any:
    """Return a task by its name, or as it was given.

    Raises:
        UserError: it is none.
    """
    if isinstance(given, str):
        given = CLEANING if given == "cleaning" else find(TASKS, given)
        if isinstance(given, type):
            with user_code(given.__name__):
                given = given()
    return usable_task(given)


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
