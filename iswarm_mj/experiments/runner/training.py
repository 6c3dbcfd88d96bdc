"""The training of a policy: an evolution strategy over the weights that all robots share, in batches of worlds."""

from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from cmaes import SepCMA
from jaxtyping import Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.experiments.analysis.plots_of_searches import draw_learning
from iswarm_mj.experiments.runner.journal import Journal
from iswarm_mj.experiments.runner.training_plan import TrainingPlan
from iswarm_mj.simulation.strategies import to_json
from iswarm_mj.strategy.network import MOST_WEIGHTS, save_weights
from iswarm_mj.strategy.pytrees import as_strategy
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.measures import BROUGHT_HOME, PICKED
from iswarm_mj.utils.constraints import check, validate
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import check_resumable, remove_parts
from iswarm_mj.utils.lock import locked
from iswarm_mj.utils.progress import Progress
from iswarm_mj.utils.tables import write_csv
from iswarm_mj.workflows.rollout import Rollout, rollout

CHECKPOINT, CURVE, WEIGHTS, FIGURE = "checkpoint.sqlite", "learning.csv", "weights.npz", "learning"
COUNTED = ("picked", "delivered", "collisions", "faults")
"""What the checkpoint holds of each candidate beside its fitness: means over its worlds; worlds with a fault."""
EVERY = 25
"""Control steps between two counts of the progress."""


@dataclass(frozen=True)
class Training(TrainingPlan):
    """Everything that determines the outcome of a training, apart from the strategy and the engine."""

    config: SwarmConfig = field(default_factory=SwarmConfig)

    def __post_init__(self):
        validate(self)


def points(found: Rollout) -> Float[np.ndarray, "B"]:
    """Fitness of each world: 20 for each ball picked up, 20 for each delivered, 40 for those delivered on average over
    time, so that early ones count more. Of tasks without balls the progress stands for balls delivered."""
    after = found.delivered_after
    return PICKED * found.picked + BROUGHT_HOME * after[:, -1] + 40.0 * after.mean(axis=1)


def train(
    training: Training,
    strategy: Any,
    out: Path,
    engine: EngineSettings,
    *,
    task: Any,
    resume: bool = False,
    again: bool = False,
) -> Float[np.ndarray, "W"]:
    """Train the weights of a strategy, write the results into `out`, and return the weights.

    The search is CMA-ES with a diagonal covariance (Ros and Hansen 2008), of the `cmaes` package. It begins with the
    weights that the strategy has. Files: weights.npz, the mean of the search; learning.csv, a row per generation, both
    written after each; learning.png and .svg at the end; checkpoint.sqlite. An interruption changes no byte of the
    files, if the engine rounds reproducibly, as on CPUs.

    Args:
        training: what to do.
        strategy: see `policy`.
        out: directory of the results.
        engine: in which the worlds run; a training must be resumed with its own.
        task: what the robots are to do.
        resume: continue the training in `out`, if there is one.
        again: discard the training in `out`.

    Raises:
        UserError: the strategy cannot be trained; `out` is not writable or in use, contains a training that is not to
            be resumed, or a different one.
    """
    made = policy(strategy, training.config, training.robots)
    settings = {**asdict(training), "strategy": to_json(strategy), "task": to_json(task), **engine.identity}
    del settings["generations"]  # a training may go on for longer
    search = SepCMA(
        np.asarray(made.weights, float), training.spread, seed=training.seed, population_size=training.population
    )
    with ExitStack() as stack:
        stack.enter_context(locked(out))
        check_resumable(out, "training", CHECKPOINT, (CURVE, WEIGHTS), resume, again)
        journal = stack.enter_context(Journal(out / CHECKPOINT, settings))
        remove_parts(out, CURVE, WEIGHTS, f"{FIGURE}.png", f"{FIGURE}.svg")
        rows: list[dict[str, Any]] = []
        done, compiling = len(journal.entries), "compiling, and waiting for the first generation"
        bar = stack.enter_context(
            Progress(training.generations, "generation", done=min(done, training.generations), waiting=compiling)
        )
        for generation in range(training.generations):
            candidates = np.array([search.ask() for _ in range(training.population)])
            is_new = (generation,) not in journal.entries
            if is_new:
                journal.add((generation,), _tried(training, made, candidates, generation, engine, task))
            found = np.array(journal.entries[generation,])
            search.tell(list(zip(candidates, -found[:, 0], strict=True)))
            rows.append(_row(generation, found, float(candidates.std(axis=0).mean())))
            if is_new or generation == training.generations - 1:
                write_csv(out / CURVE, rows)
                save_weights(out / WEIGHTS, search.mean)
            if is_new:
                bar.say(f"best {rows[-1]['best']:.0f}, mean {rows[-1]['mean']:.0f}")
                bar.update()
        draw_learning(rows, out / FIGURE)
    print(f"     fitness  {rows[0]['mean']:.0f} in generation 1, {rows[-1]['mean']:.0f} in generation {len(rows)}")
    print(f"     results  {out}; weights in {out / WEIGHTS}")
    return np.asarray(search.mean, np.float32)


def policy(strategy: Any, config: SwarmConfig, n_robots: int) -> Any:
    """Return what is trained: a dataclass with a field `weights`, an array of one axis, at the start of training.

    It is the strategy itself or, where that has such a method, what `for_training(config, robot, n_robots)` or else
    `for_world` with the same arguments returns.

    Raises:
        UserError: there is no such field, or there are too many weights for a file.
    """
    made = strategy
    for name in ("for_training", "for_world"):
        if hasattr(strategy, name):
            with user_code(f"{type(strategy).__name__}.{name}"):
                made = getattr(strategy, name)(config, read_robot(), n_robots)
            break
    weights: Any = getattr(made, "weights", None)
    is_array = isinstance(weights, jax.Array | np.ndarray) and weights.ndim == 1 and weights.dtype.kind == "f"
    if not is_dataclass(made) or not is_array:
        raise UserError(
            f"{type(made).__name__} has no weights to train; give it a field `weights`, an array of floats of one axis"
        )
    check("weights", len(weights), f"between 1 and {MOST_WEIGHTS}", 1 <= len(weights) <= MOST_WEIGHTS)
    return as_strategy(made)


def _tried(
    training: Training, made: Any, candidates: np.ndarray, generation: int, engine: EngineSettings, task: Any
) -> list[list[float]]:
    """What the journal keeps of a generation: fitness and `COUNTED` of each candidate."""
    n_worlds = training.worlds
    keys = jax.random.split(jax.random.fold_in(jax.random.key(training.seed), generation), n_worlds)
    own = jax.tree.map(lambda a: jnp.broadcast_to(a, (len(candidates) * n_worlds, *jnp.shape(a))), made)
    own = replace(own, weights=jnp.asarray(np.repeat(candidates, n_worlds, axis=0), jnp.float32))
    found = rollout(
        training.config,
        own,
        jnp.tile(keys, len(candidates)),
        n_robots=training.robots,
        steps=training.steps,
        engine=engine,
        strategy_per_world=True,
        task=task,
        every=EVERY,
    )
    faulty = {fault.world for fault in found.faults}
    faults = [world in faulty for world in range(len(own.weights))]
    every = np.stack([points(found), found.picked, found.delivered_after[:, -1], found.collisions, faults], axis=1)
    return every.reshape(len(candidates), n_worlds, -1).mean(axis=1).tolist()


def _row(generation: int, found: np.ndarray, spread: float) -> dict[str, Any]:
    fitness = found[:, 0]
    values = {"best": fitness.max(), "mean": fitness.mean(), "worst": fitness.min()}
    values |= dict(zip(COUNTED, found[:, 1:].mean(axis=0), strict=True))
    return {"generation": generation + 1, **{name: float(value) for name, value in values.items()}, "spread": spread}
