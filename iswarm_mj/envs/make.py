"""How environments are made."""

import os
from collections.abc import Sequence
from pathlib import Path
from types import NoneType
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.envs import actions, observations
from iswarm_mj.envs.core import Beginnings, Core, Speaker
from iswarm_mj.envs.env import CompiledEnv, Env, HostEnv
from iswarm_mj.sensors.conditions import Conditions, conditions_of
from iswarm_mj.sensors.fields import Flag
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation.common import common
from iswarm_mj.simulation.initial import Start
from iswarm_mj.simulation.room import check_room
from iswarm_mj.simulation.settings import EngineSettings, MjxSettings, MujocoSettings, PlanarSettings, RunSettings
from iswarm_mj.simulation.start import compiled_engine, devices_of, host_engine
from iswarm_mj.simulation.state import SwarmState, WorldParams
from iswarm_mj.simulation.tasks import ENDLESS, goal_of, job_of
from iswarm_mj.simulation.worlds import World, starts_of
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.layout import cell_of, check_robots
from iswarm_mj.tasks.library import find_task
from iswarm_mj.tasks.signatures import check_object
from iswarm_mj.utils.constraints import check, check_kind, is_whole
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.jax_setup import configure_jax

MOST_BITS = 29
"""That messages of flags carry: two are the number of the LED, one the parity."""


def make_env(
    task: Any = "cleaning",
    n_robots: int = 20,
    *,
    config: SwarmConfig | None = None,
    engine: EngineSettings | None = None,
    payload: Any = None,
    steps: int = 800,
    stop_at: int | None = None,
    n_worlds: int | None = None,
    n_starts: int = 64,
    seed: int = 0,
    robot_file: Path | str | None = None,
) -> Env:
    """Make an environment in which each robot of a swarm is told what to do.

    Args:
        task: `"cleaning"`, FILE.py:CLASS or the name of an installed one, or an object, see `tasks.protocol`.
        n_robots: N.
        config: of the swarm, its defaults if not given.
        engine: settings, by default `PlanarSettings()`. With `MjxSettings()`, `reset` and `step` are of one world, for
            `jax.vmap`; otherwise of `n_worlds` at once.
        payload: what robots may say: fields by their names or a `Payload` (`sensors.messages`), or a number of bits,
            which makes as many flags. Without it, actions are motion alone.
        steps: of an episode at most.
        stop_at: progress of the task that ends an episode; by default all that there is to do.
        n_worlds: B, by default 1; not with MJX, but for the size of Warp's buffers.
        n_starts: different layouts, of which each episode has one; `seed` draws them, and the keys of `reset` choose.
        seed: of the layouts.
        robot_file: MJCF file of the robots; None for `models/robot.xml`.

    Raises:
        UserError: no such task, settings that do not fit, or more worlds than fit into the memory.
    """
    configure_jax()
    config, engine = SwarmConfig() if config is None else config, PlanarSettings() if engine is None else engine
    check_kind("config", config, SwarmConfig)
    check_kind("robot_file", robot_file, (Path, str, NoneType))
    check_kind("engine", engine, (MujocoSettings, PlanarSettings, MjxSettings))
    robot_file = None if robot_file is None else Path(robot_file)
    task, speaker, robot = _task(task), Speaker(_payload(payload)), read_robot(robot_file)
    if config.strategy.update_order != "synchronous":
        raise UserError("strategy.update_order is sequential, but robots of an environment act at once; leave it out")
    settings = RunSettings(n_robots, steps, seed=seed, n_worlds=1 if n_worlds is None else n_worlds, stop_at=stop_at)
    check("n_starts", n_starts, "a whole number from 1 to 100000", is_whole(n_starts) and 1 <= n_starts <= 100_000)
    n_robots, seed = int(n_robots), int(seed)
    goal, cell = goal_of(task, config, settings), cell_of(robot)
    check_robots(config.arena, n_robots, cell)
    check_room(engine, settings.n_worlds, n_robots)
    speaker.payload.check_room(len(robot.sides))
    worlds = [World(PRESETS["type1"], n_robots, seed, index) for index in range(n_starts)]
    starts = starts_of(config, worlds, cell, task)
    job = job_of(task, config, robot, starts, n_robots)
    params = WorldParams(
        strategy=cast(Any, speaker),
        conditions=Conditions(*map(jnp.asarray, conditions_of(config))),
        key=jax.random.key(0),
        is_present=jnp.ones(n_robots, bool),
        goal=jnp.int32(ENDLESS if goal is None else goal),
        task=jax.tree.map(lambda a: a[0], job.task),
    )
    senses = {
        name: (quantity, int(np.prod(job.sensed[name].shape[1:], dtype=int)))
        for name, quantity in getattr(task, "senses", {}).items()  # a task without has no such attribute
    }
    shared = common(config).config
    core = Core(
        config=shared,
        robot=robot,
        params=params,
        beginnings=_beginnings(starts, config),
        steps=steps,
        payload=speaker.payload,
        observations=observations.rows(config, robot, speaker.payload, senses),
        actions=actions.rows(config, speaker.payload),
    )
    if engine.on_host:
        made = host_engine(config, engine, n_robots, n_robots, robot_file)(settings.n_worlds, _threads(engine))
        return HostEnv(core, made, settings.n_worlds)
    platform = devices_of(engine)[0].platform
    compiled = compiled_engine(config, engine, n_robots, settings.n_worlds, robot_file, platform)
    return CompiledEnv(core, compiled, settings.n_worlds if compiled.mapping(platform) == "batch" else None)


def _beginnings(starts: Sequence[Start], config: SwarmConfig) -> Beginnings:
    def stacked(*values: Any) -> jax.Array:
        return jnp.asarray(np.stack(values))

    balls, own = (jax.tree.map(stacked, *(getattr(start, name) for start in starts)) for name in ("balls", "own"))
    poses = jnp.asarray(np.stack([start.poses for start in starts]), jnp.float32)
    energy = None if config.energy.model == "none" else jnp.full(poses.shape[:2], config.energy.full)
    starved = None if energy is None else jnp.zeros(poses.shape[:2], jnp.int32)
    alive = stacked(*(start.is_alive for start in starts))
    return Beginnings(poses, SwarmState(None, balls, alive, own, energy, starved))


def _task(given: Any) -> Any:
    """A task by its name, or as it was given."""
    if isinstance(given, str):
        given = CLEANING if given == "cleaning" else find_task(given)
        if isinstance(given, type):
            with user_code(given.__name__):
                given = given()
    check_object(given)
    return given


def _payload(given: Any) -> Payload:
    if given is None or isinstance(given, Payload):
        return given or Payload()
    if isinstance(given, int) and not isinstance(given, bool):
        check("payload", given, f"fields, or a number of bits from 0 to {MOST_BITS}", given in range(MOST_BITS + 1))
        return Payload({f"bit_{number}": Flag() for number in range(given)})
    return Payload(given)


def _threads(engine: EngineSettings) -> int:
    return getattr(engine, "threads", 0) or len(os.sched_getaffinity(0))
