"""The training of a policy: a search for the weights that all robots share."""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

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
from iswarm_mj.search.journal import Journal, journal
from iswarm_mj.search.plots import draw_learning
from iswarm_mj.search.rows import Rows
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

CHECKPOINT = "checkpoint.sqlite"
CURVE = "learning.csv"
WEIGHTS = "weights.npz"
FIGURE = "learning"
COUNTED = ("picked", "delivered", "collisions", "faults")
"""Means over the worlds of a candidate, beside its fitness; `faults` is the share of worlds with a
fault."""
PROGRESS_INTERVAL = 25
"""Control steps between two counts of the progress."""
MAX_WEIGHT = 1e6
"""Size below which weights must be at the start."""
VALIDATION_INTERVAL = 10
"""Generations between two validations."""
VALIDATION_SET = 2**31
"""Number of the set of worlds for validation, which is that of no generation."""


class TrainingArena(NamedTuple):
    """One arena of a training."""

    config: SwarmConfig
    """Configuration with the arena."""
    robots: list[int]
    """Numbers of robots, of which the worlds of a candidate have one each, in turn."""


@dataclass(frozen=True)
class Training(TrainingPlan):
    """Plan of a training, and the configuration of its worlds."""

    config: SwarmConfig = field(default_factory=SwarmConfig)

    def __post_init__(self):
        validate(self)
        allowed = f"between 1 and {self.worlds} numbers, since a candidate has {self.worlds} worlds"
        n_numbers = len(self.robots)
        check("robots", f"{n_numbers} numbers", allowed, 1 <= n_numbers <= self.worlds)
        for config, robots in self.arenas:
            for n_robots in robots:
                check_robots(config.arena, n_robots)

    @property
    def arenas(self) -> list[TrainingArena]:
        """The arenas in which each candidate has worlds, with as many robots per area."""
        default = self.config.arena
        arenas = []
        for arena in [replace(default, size=size) for size in self.sizes] or [default]:
            area_ratio = (arena.size / default.size) ** 2
            robots = [round(area_ratio * n_robots) for n_robots in self.robots]
            arenas.append(TrainingArena(replace(self.config, arena=arena), robots))
        return arenas


def points(
    outcomes: Rollout, task: Any, config: SwarmConfig, robots: Sequence[int], steps: int
) -> Float[np.ndarray, "B"]:
    """Return the points of each world.

    They are the task's fitness, and 40 for each unit of its progress on average over time, so that
    early deliveries count before all balls are delivered. For a task without a fitness they are the
    rewards of all robots.

    Args:
        outcomes: of B worlds.
        task: what the robots did; one without a fitness is `rewarded`.
        config: of the worlds.
        robots: numbers of robots of the worlds.
        steps: control steps of a world.
    """
    if not is_scored(task):
        return outcomes.metrics[REWARD].astype(float)

    fitness = []
    for world, n_robots in enumerate(robots):
        measures = Measures(
            outcomes.delivered[world],
            outcomes.picked[world],
            outcomes.collisions[world],
            outcomes.mean_carriage_steps[world],
            int(outcomes.finished_at[world]) if outcomes.is_finished[world] else None,
        )
        with user_code(f"{type(task).__name__}.fitness"):
            fitness.append(float(task.fitness(measures, config, n_robots, steps)))
    return 40.0 * outcomes.delivered_after.mean(axis=1) + fitness


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
    It begins with the weights that the strategy has. After each tenth generation its mean is
    validated: tried in worlds of their own, which nothing else uses.

    Files:

    - weights.npz: the mean that did best in a validation, or before the first one the latest mean.
    - learning.csv: a row per generation. It and the weights are written after each generation.
    - learning.png and .svg, at the end.
    - checkpoint.sqlite.

    An interruption changes no byte of the files, if the engine rounds reproducibly, as on CPUs.

    Args:
        training: what to do.
        strategy: see `policy`.
        out: directory of the results.
        engine: in which the worlds run; a training must be resumed with its own.
        task: what the robots are to do.
        robot_file: MJCF file of the robots, or of each kind (`RobotFile`); None for
            `models/robot.xml`.
        again: discard the training in `out`, which otherwise goes on.

    Raises:
        UserError: the strategy has no weights, the task cannot be scored, or the directory holds
            another training.
    """
    for arena in training.arenas:
        for n_robots in arena.robots:
            check_total(robot_file, n_robots)
    untrained = policy(strategy, training.config, max(training.robots), robot_file)
    scored_task = _scored(task)
    flat_weights, unflatten = ravel_pytree(untrained.weights)
    start = np.asarray(flat_weights)
    settings = _settings(training, strategy, task, engine, robot_file, start)
    trials = _Trials(training, untrained, unflatten, scored_task, engine, robot_file)

    with journal(out / CHECKPOINT, settings, again) as finished:
        try:
            weights = _search_weights(training, start, trials, finished, out)
        finally:
            if not finished.entries:
                remove(out / CHECKPOINT)
    return unflatten(jnp.asarray(weights, jnp.float32))


def _scored(task: Any) -> Any:
    """Return a task by which worlds can be judged: itself, or with its rewards as a metric.

    Raises:
        UserError: the task has a fitness but no balls, or another method is wrong.
    """
    check_methods(task)
    if is_scored(task):
        return task
    if overrides(task, Task, "fitness"):
        name = type(task).__name__
        raise UserError(f"{name} has a fitness, which counts balls, but no method balls; add it")
    return rewarded(task)


def _settings(
    training: Training,
    strategy: Any,
    task: Any,
    engine: EngineSettings,
    robot_file: RobotFile,
    start: np.ndarray,
) -> dict[str, Any]:
    """Return the settings that determine a training, as its checkpoint states them."""
    plan = asdict(training)
    del plan["generations"]  # a training may go on for longer
    robots = []
    for path, n_robots in files_of(robot_file):
        robots.append((path and path.read_text(encoding="utf-8"), n_robots))
    return {
        **plan,
        "strategy": to_json(strategy),
        "task": to_json(task),
        **engine.identity,
        "robot": robots,
        "first_weights": zlib.crc32(start.tobytes()),
    }


@dataclass(frozen=True)
class _Trials:
    """Worlds in which candidates are tried."""

    training: Training
    untrained: Any
    """The strategy with its weights at the start."""
    unflatten: Callable[[jax.Array], Any]
    """Function that makes the strategy's weights of a vector (W,)."""
    task: Any
    """A task by which worlds can be judged."""
    engine: EngineSettings
    robot_file: RobotFile

    def mean_outcomes(
        self, candidates: Float[np.ndarray, "P W"], n_worlds: int, set_number: int
    ) -> Float[np.ndarray, "P 5"]:
        """Return fitness and `COUNTED` of candidates, means over their worlds.

        Args:
            candidates: weights.
            n_worlds: number of worlds that each candidate has in each arena, the same for all.
            set_number: which set of worlds; each number has others.
        """
        root = jax.random.key(self.training.seed)
        keys = jax.random.split(jax.random.fold_in(root, set_number), n_worlds)
        strategies = self._strategies(candidates, n_worlds)
        means = []
        for arena in self.training.arenas:
            outcomes = self._outcomes(arena, strategies, keys, len(candidates))
            means.append(outcomes.reshape(len(candidates), n_worlds, -1).mean(axis=1))
        return np.mean(means, axis=0)

    def _strategies(self, candidates: Float[np.ndarray, "P W"], n_worlds: int) -> Any:
        """Return a strategy whose arrays have an axis of worlds, `n_worlds` for each candidate."""
        weights = jax.vmap(self.unflatten)(jnp.asarray(candidates, jnp.float32))
        total = len(candidates) * n_worlds

        def repeat(leaf: Any) -> jax.Array:
            return jnp.repeat(leaf, n_worlds, axis=0)

        def broadcast(leaf: Any) -> jax.Array:
            return jnp.broadcast_to(leaf, (total, *jnp.shape(leaf)))

        strategies = jax.tree.map(broadcast, self.untrained)
        # Users' classes may check weights in `__init__`, which are those of one world there.
        object.__setattr__(strategies, "weights", jax.tree.map(repeat, weights))
        return strategies

    def _outcomes(
        self, arena: TrainingArena, strategies: Any, keys: jax.Array, n_candidates: int
    ) -> Float[np.ndarray, "B 5"]:
        """Return fitness and `COUNTED` of each world of all candidates.

        Args:
            arena: where they are.
            strategies: with an axis of worlds.
            keys: random keys of the worlds of one candidate.
            n_candidates: number of candidates, whose worlds follow each other.
        """
        robots = []
        for world in range(len(keys)):
            robots.append(arena.robots[world % len(arena.robots)])
        robots *= n_candidates
        worlds = []
        for n_robots, key in zip(robots, jnp.tile(keys, n_candidates), strict=True):
            worlds.append(World(TYPE1, n_robots, index=len(worlds), key=key))
        scenario = Scenario(
            arena.config,
            strategy=strategies,
            strategy_per_world=True,
            worlds=worlds,
            steps=self.training.steps,
            engine=self.engine,
            task=self.task,
            robot_file=self.robot_file,
        )
        outcomes = rollout(scenario, every=PROGRESS_INTERVAL)

        fitness = points(outcomes, self.task, arena.config, robots, self.training.steps)
        is_finite = np.isfinite(fitness)
        if not is_finite.all():
            raise UserError(
                f"fitness or rewards of {type(self.task).__name__} are {fitness[~is_finite][0]} "
                "in a world; make them finite"
            )
        is_faulty = np.zeros(len(robots))
        for fault in outcomes.faults:
            is_faulty[fault.world] = 1.0
        delivered = outcomes.delivered_after[:, -1]
        columns = [fitness, outcomes.picked, delivered, outcomes.collisions, is_faulty]
        return np.stack(columns, axis=1)


class _Generation(NamedTuple):
    """A generation that was carried out, or read from the checkpoint."""

    is_new: bool
    """It was not in the checkpoint."""
    outcomes: Float[np.ndarray, "P 5"]
    """Fitness and `COUNTED` of its candidates."""
    spread: float
    """Standard deviation of the candidates, mean over the weights."""
    validated: float | None
    """Fitness of the mean of the search in a validation; None without one."""


def _search_weights(
    training: Training, start: np.ndarray, trials: _Trials, finished: Journal, out: Path
) -> Float[np.ndarray, "W"]:
    """Carry out a training, write its files but for the checkpoint, and return the best weights.

    Args:
        training: what to do.
        start: weights at the start (W,).
        trials: of candidates.
        finished: journal of the generations.
        out: directory of the results.
    """
    n_finished = len(finished.entries)
    n_generations = training.generations
    allowed = f"at least {n_finished}, which the training has"
    check("generations", n_generations, allowed, n_generations >= n_finished)
    remove_parts(out, CURVE, WEIGHTS, f"{FIGURE}.png", f"{FIGURE}.svg")
    search = SepCMA(
        start.astype(float),
        training.spread,
        seed=training.seed,
        population_size=training.population,
    )

    rows: list[dict[str, Any]] = []
    best_score = -np.inf
    best_weights = search.mean.copy()
    compiling = "preparing, and waiting for the first generation"
    with Progress(n_generations, "generation", done=n_finished, waiting=compiling) as bar:
        for number in range(n_generations):
            generation = _advance(search, number, trials, finished)
            rows.append(_row(number, generation))

            # Until the first validation the latest mean is the best.
            score = -np.inf if generation.validated is None else generation.validated
            if score >= best_score:
                best_score = score
                best_weights = search.mean.copy()

            if generation.is_new or number == n_generations - 1:
                write_csv(out / CURVE, rows)
                save_weights(out / WEIGHTS, best_weights)
            if generation.is_new:
                bar.say(f"best {rows[-1]['best']:.0f}, mean {rows[-1]['mean']:.0f}")
                bar.update()
        draw_learning(rows, out / FIGURE)
    _print_summary(rows, out)
    return best_weights


def _advance(search: SepCMA, number: int, trials: _Trials, finished: Journal) -> _Generation:
    """Let a search learn from its next generation, which is carried out if it is not known.

    Args:
        search: of weights.
        number: of the generation.
        trials: of candidates.
        finished: journal, to which the generation is added.
    """
    training = trials.training
    candidates = np.array([search.ask() for _ in range(training.population)])
    is_new = (number,) not in finished.entries
    if is_new:
        outcomes = trials.mean_outcomes(candidates, training.worlds, number)
        validated = None
    else:
        outcomes, validated = _read(finished, number, training.population)
    search.tell(list(zip(candidates, -outcomes[:, 0], strict=True)))

    if is_new:
        if number % VALIDATION_INTERVAL == VALIDATION_INTERVAL - 1:
            mean = search.mean[None]
            of_mean = trials.mean_outcomes(mean, training.validation, VALIDATION_SET)
            validated = float(of_mean[0, 0])
        finished.add((number,), {"candidates": outcomes.tolist(), "mean": validated})
    return _Generation(is_new, outcomes, float(candidates.std(axis=0).mean()), validated)


def _read(finished: Journal, number: int, n_candidates: int) -> tuple[np.ndarray, float | None]:
    """Return the outcomes of the candidates of a finished generation, and its validation.

    Raises:
        UserError: the journal is damaged.
    """
    with finished.explained():
        entry = finished.entries[number,]
        outcomes = np.array(entry["candidates"], float)
        validated = entry["mean"]
        return (
            outcomes.reshape(n_candidates, 1 + len(COUNTED)),
            None if validated is None else float(validated),
        )


def _row(number: int, generation: _Generation) -> dict[str, Any]:
    """Return the row of a generation in learning.csv."""
    fitness = generation.outcomes[:, 0]
    counted = generation.outcomes[:, 1:].mean(axis=0)
    return {
        "generation": number + 1,
        "best": float(fitness.max()),
        "mean": float(fitness.mean()),
        "worst": float(fitness.min()),
        **dict(zip(COUNTED, counted.tolist(), strict=True)),
        "validation": generation.validated,
        "spread": generation.spread,
    }


def _print_summary(rows: Rows, out: Path) -> None:
    """Print what a training has learnt."""
    first, last = rows[0]["mean"], rows[-1]["mean"]
    print(f"     fitness  mean {first:.0f} in generation 1, {last:.0f} in generation {len(rows)}")
    if rows[-1]["faults"]:
        share = 100 * rows[-1]["faults"]
        print(f"      faults  in {share:.0f} % of the worlds of the last generation")
    print(f"     results  {out}; weights in {out / WEIGHTS}")


def policy(strategy: Any, config: SwarmConfig, n_robots: int, robot_file: RobotFile = None) -> Any:
    """Return what is trained: a dataclass with a field `weights`, at the start of training.

    It is the strategy itself or, where that has such a method, what `for_training(config, robot,
    n_robots)` or else `for_world` with the same arguments returns. Weights are arrays of floats,
    one or several in a pytree.

    Raises:
        UserError: there is no such field, or there are too many weights for a file.
    """
    trainable = strategy
    for name in ("for_training", "for_world"):
        if hasattr(strategy, name):
            with user_code(f"{type(strategy).__name__}.{name}"):
                trainable = getattr(strategy, name)(config, read_robots(robot_file), n_robots)
            break

    arrays = _weight_arrays(trainable)
    if not arrays:
        raise UserError(
            f"{type(trainable).__name__} has no weights to train; "
            "give it a field `weights`, an array of floats or several"
        )
    n_weights = sum(array.size for array in arrays)
    is_number_allowed = 2 <= n_weights <= MAX_WEIGHTS
    allowed = f"between 2 and {MAX_WEIGHTS} numbers"
    check("weights", f"{n_weights} numbers", allowed, is_number_allowed)
    are_small = all(bool(np.all(np.abs(array) < MAX_WEIGHT)) for array in arrays)
    check("weights", "others", f"finite numbers below {MAX_WEIGHT:g} in size", are_small)
    return as_strategy(trainable)


def _weight_arrays(strategy: Any) -> list[Any]:
    """Return the arrays in the field `weights`; none without that field, or if it has others."""
    if not is_dataclass(strategy) or "weights" not in {each.name for each in fields(strategy)}:
        return []
    leaves = jax.tree.leaves(strategy.weights)
    for leaf in leaves:
        if not isinstance(leaf, jax.Array | np.ndarray) or leaf.dtype.kind != "f":
            return []
    return leaves
