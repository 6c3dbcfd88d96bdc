"""The training of a policy: an evolution strategy over the weights that all robots share, in
batches of worlds."""

import zlib
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from cmaes import SepCMA
from jax.flatten_util import ravel_pytree
from jaxtyping import Float

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.robot_file import check_total, files_of, read_robots
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.geometry.robot import RobotFile
from iswarm_mj.search.journal import journal
from iswarm_mj.search.plots import draw_learning
from iswarm_mj.search.settings import TrainingPlan
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.stacking import to_json
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.base import overrides
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.strategy.network import MAX_WEIGHTS, save_weights
from iswarm_mj.strategy.validation import as_strategy
from iswarm_mj.tasks.base import Task, is_scored
from iswarm_mj.tasks.layout import check_robots
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.tasks.rewarded import REWARD, rewarded
from iswarm_mj.tasks.validation import check_methods
from iswarm_mj.utils.constraints import check, validate
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import remove, remove_parts
from iswarm_mj.utils.progress import Progress
from iswarm_mj.utils.tables import write_csv
from iswarm_mj.utils.user_code import user_code
from iswarm_mj.workflows.rollout import Rollout, rollout

CHECKPOINT, CURVE, WEIGHTS, FIGURE = "checkpoint.sqlite", "learning.csv", "weights.npz", "learning"
COUNTED = ("picked", "delivered", "collisions", "faults")
"""What the checkpoint holds of each candidate beside its fitness: means over its worlds; worlds
with a fault."""
EVERY = 25
"""Control steps between two counts of the progress."""
LARGEST = 1e6
"""Weights at the start are smaller."""
VALIDATED_EVERY, VALIDATION = 10, 2**31
"""Generations between two validations, and the number of their worlds, which is that of no
generation."""


@dataclass(frozen=True)
class Training(TrainingPlan):
    """Everything that determines the outcome of a training, apart from the strategy and the engine."""

    config: SwarmConfig = field(default_factory=SwarmConfig)

    def __post_init__(self):
        validate(self)
        most = f"between 1 and {self.worlds} numbers, since a candidate has {self.worlds} worlds"
        check("robots", f"{len(self.robots)} numbers", most, 1 <= len(self.robots) <= self.worlds)
        for config, robots in self.scenes:
            for number in robots:
                check_robots(config.arena, number)

    @property
    def scenes(self) -> list[tuple[SwarmConfig, list[int]]]:
        """Configurations with the arenas of the worlds, and the numbers of robots that these have
        in turn."""
        own = self.config.arena
        areas = [replace(own, size=size) for size in self.sizes] or [own]
        each = [
            [round((area.size / own.size) ** 2 * number) for number in self.robots]
            for area in areas
        ]
        return [
            (replace(self.config, arena=area), robots)
            for area, robots in zip(areas, each, strict=True)
        ]


def points(
    found: Rollout, task: Any, config: SwarmConfig, robots: Sequence[int], steps: int
) -> Float[np.ndarray, "B"]:
    """Points of each world: the task's fitness, and 40 for each unit of its progress on average
    over time, so that early deliveries count before all balls are delivered; of a task without a
    fitness the rewards of all robots."""
    if not is_scored(task):
        return found.metrics[REWARD].astype(float)
    early = 40.0 * found.delivered_after.mean(axis=1)
    counted = (
        found.delivered,
        found.picked,
        found.collisions,
        found.mean_carriage_steps,
        found.finished_at,
    )
    measures = [Measures(*one[:-1], one[-1] or None) for one in zip(*counted, strict=True)]
    with user_code(f"{type(task).__name__}.fitness"):
        return early + [
            float(task.fitness(one, config, n, steps))
            for one, n in zip(measures, robots, strict=True)
        ]


def train(
    training: Training,
    strategy: Any,
    out: Path,
    engine: EngineSettings,
    *,
    task: Any,
    robot_file: RobotFile = None,
    again: bool = False,
) -> Any:
    """Train the weights of a strategy, write the results into `out`, and return the weights.

    The search is CMA-ES with a diagonal covariance (Ros and Hansen 2008), of the `cmaes` package.
    It begins with the weights that the strategy has. After each tenth generation its mean is tried
    in worlds of their own, which nothing else uses. Files: weights.npz, the mean that did best
    there, or the last one before any was tried; learning.csv, a row per generation, both written
    after each; learning.png and .svg at the end; checkpoint.sqlite. An interruption changes no byte
    of the files, if the engine rounds reproducibly, as on CPUs.

    Args:
        training: what to do.
        strategy: see `policy`.
        out: directory of the results.
        engine: in which the worlds run; a training must be resumed with its own.
        task: what the robots are to do.
        robot_file: MJCF file of the robots, or of each kind (`RobotFile`); None for
            `models/robot.xml`.
        again: discard the training in `out`, which otherwise goes on.
    """
    for number in {number for _, numbers in training.scenes for number in numbers}:
        check_total(robot_file, number)
    made = policy(strategy, training.config, max(training.robots), robot_file)
    check_methods(task)
    has_fitness = is_scored(task)
    if overrides(task, Task, "fitness") and not has_fitness:
        raise UserError(
            f"{type(task).__name__} has a fitness, which counts balls, but no method balls; add it"
        )
    start, shaped = ravel_pytree(made.weights)
    settings = {
        **asdict(training),
        "strategy": to_json(strategy),
        "task": to_json(task),
        **engine.identity,
    }
    settings["robot"] = [
        (path and path.read_text(), number) for path, number in files_of(robot_file)
    ]
    settings["first_weights"] = zlib.crc32(np.asarray(start).tobytes())
    del settings["generations"]  # a training may go on for longer
    search = SepCMA(
        np.asarray(start, float),
        training.spread,
        seed=training.seed,
        population_size=training.population,
    )

    aim = task if has_fitness else rewarded(task)
    given = {"engine": engine, "task": aim, "robot_file": robot_file}

    def tried(candidates: np.ndarray, n_worlds: int, number: int) -> np.ndarray:
        return _tried(
            training,
            made,
            jax.vmap(shaped)(jnp.asarray(candidates, jnp.float32)),
            n_worlds,
            number,
            given,
        )

    rows: list[dict[str, Any]] = []
    best, kept = -np.inf, search.mean.copy()
    with ExitStack() as stack:
        finished = stack.enter_context(journal(out / CHECKPOINT, settings, again))
        stack.callback(lambda: finished.entries or remove(out / CHECKPOINT))  # nothing was done
        done = len(finished.entries)
        wanted = training.generations
        check("generations", wanted, f"at least {done}, which the training has", wanted >= done)
        remove_parts(out, CURVE, WEIGHTS, f"{FIGURE}.png", f"{FIGURE}.svg")
        compiling = "preparing, and waiting for the first generation"
        bar = stack.enter_context(Progress(wanted, "generation", done=done, waiting=compiling))
        for generation in range(wanted):
            candidates = np.array([search.ask() for _ in range(training.population)])
            is_new = (generation,) not in finished.entries
            entry = {} if is_new else finished.entries[generation,]
            if is_new:
                entry["candidates"] = tried(candidates, training.worlds, generation).tolist()
            with finished.explained():
                found = np.array(entry["candidates"], float).reshape(
                    training.population, 1 + len(COUNTED)
                )
                mean = None if is_new or entry["mean"] is None else float(entry["mean"])
            search.tell(list(zip(candidates, -found[:, 0], strict=True)))
            if is_new:
                if generation % VALIDATED_EVERY == VALIDATED_EVERY - 1:
                    mean = float(tried(search.mean[None], training.validation, VALIDATION)[0, 0])
                entry["mean"] = mean
                finished.add((generation,), entry)
            score = -np.inf if mean is None else mean
            if score >= best:
                best, kept = score, search.mean.copy()
            rows.append(_row(generation, found, mean, float(candidates.std(axis=0).mean())))
            if is_new or generation == wanted - 1:
                write_csv(out / CURVE, rows)
                save_weights(out / WEIGHTS, kept)
            if is_new:
                bar.say(f"best {rows[-1]['best']:.0f}, mean {rows[-1]['mean']:.0f}")
                bar.update()
        draw_learning(rows, out / FIGURE)
    print(
        f"     fitness  mean {rows[0]['mean']:.0f} in generation 1, {rows[-1]['mean']:.0f} in generation {len(rows)}"
    )
    if rows[-1]["faults"]:
        print(
            f"      faults  in {100 * rows[-1]['faults']:.0f} % of the worlds of the last generation"
        )
    print(f"     results  {out}; weights in {out / WEIGHTS}")
    return shaped(jnp.asarray(kept, jnp.float32))


def policy(strategy: Any, config: SwarmConfig, n_robots: int, robot_file: RobotFile = None) -> Any:
    """Return what is trained: a dataclass with a field `weights`, at the start of training.

    It is the strategy itself or, where that has such a method, what `for_training(config, robot,
    n_robots)` or else `for_world` with the same arguments returns. Weights are arrays of floats,
    one or several in a pytree.

    Raises:
        UserError: there is no such field, or there are too many weights for a file.
    """
    made = strategy
    for name in ("for_training", "for_world"):
        if hasattr(strategy, name):
            with user_code(f"{type(strategy).__name__}.{name}"):
                made = getattr(strategy, name)(config, read_robots(robot_file), n_robots)
            break
    is_field = is_dataclass(made) and "weights" in {one.name for one in fields(made)}
    weights = jax.tree.leaves(made.weights) if is_field else []
    are_arrays = all(
        isinstance(one, jax.Array | np.ndarray) and one.dtype.kind == "f" for one in weights
    )
    if not weights or not are_arrays:
        raise UserError(
            f"{type(made).__name__} has no weights to train; give it a field `weights`, an array of floats or several"
        )
    n_weights = sum(one.size for one in weights)
    check(
        "weights",
        f"{n_weights} numbers",
        f"between 2 and {MAX_WEIGHTS} numbers",
        2 <= n_weights <= MAX_WEIGHTS,
    )
    are_usual = all(bool(np.all(np.abs(one) < LARGEST)) for one in weights)
    check("weights", "others", f"finite numbers below {LARGEST:g} in size", are_usual)
    return as_strategy(made)


def _tried(
    training: Training,
    made: Any,
    weights: Any,
    n_worlds: int,
    number: int,
    given: Mapping[str, Any],
) -> Float[np.ndarray, "P 5"]:
    """Fitness and `COUNTED` of P candidates, means over their worlds; worlds of another number are
    others."""
    keys = jax.random.split(jax.random.fold_in(jax.random.key(training.seed), number), n_worlds)
    n_candidates = len(jax.tree.leaves(weights)[0])
    repeated = jax.tree.map(lambda a: jnp.repeat(a, n_worlds, axis=0), weights)
    own = jax.tree.map(
        lambda a: jnp.broadcast_to(a, (n_candidates * n_worlds, *jnp.shape(a))), made
    )
    object.__setattr__(
        own, "weights", repeated
    )  # of users' classes, which may check them in `__init__`
    found = []
    for config, numbers in training.scenes:
        robots = [numbers[world % len(numbers)] for world in range(n_worlds)] * n_candidates
        worlds = [
            World(TYPE1, n_robots, index=index, key=key)
            for index, (n_robots, key) in enumerate(
                zip(robots, jnp.tile(keys, n_candidates), strict=True)
            )
        ]
        scenario = Scenario(
            config,
            strategy=own,
            strategy_per_world=True,
            worlds=worlds,
            steps=training.steps,
            **given,
        )
        got = rollout(scenario, every=EVERY)
        faulty = {fault.world for fault in got.faults}
        faults = [world in faulty for world in range(len(robots))]
        fitness = points(got, given["task"], config, robots, training.steps)
        if not np.isfinite(fitness).all():
            what = f"fitness or rewards of {type(given['task']).__name__}"
            raise UserError(
                f"{what} are {fitness[~np.isfinite(fitness)][0]} in a world; make them finite"
            )
        every = np.stack(
            [fitness, got.picked, got.delivered_after[:, -1], got.collisions, faults], axis=1
        )
        found.append(every.reshape(n_candidates, n_worlds, -1).mean(axis=1))
    return np.mean(found, axis=0)


def _row(
    generation: int, found: np.ndarray, validated: float | None, spread: float
) -> dict[str, Any]:
    fitness = found[:, 0]
    values = {"best": fitness.max(), "mean": fitness.mean(), "worst": fitness.min()}
    values |= dict(zip(COUNTED, found[:, 1:].mean(axis=0), strict=True))
    values = {name: float(value) for name, value in values.items()}
    return {"generation": generation + 1, **values, "validation": validated, "spread": spread}
