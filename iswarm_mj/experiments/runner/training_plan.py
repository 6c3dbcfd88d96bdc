"""What a training is to do, as numbers: settings of the training itself, and flags of its command."""

from dataclasses import dataclass
from typing import Annotated

from iswarm_mj.arena_config import ArenaConfig
from iswarm_mj.experiments.runner.limits import Generations, Population, Repeats, Seed, Steps
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.utils.constraints import Above, constraint_of


@dataclass(frozen=True)
class TrainingPlan:
    """How many robots, for how long, and how the weights are searched for."""

    robots: Annotated[tuple[int, ...], constraint_of(RunSettings, "n_robots")] = (160, 280)
    """Numbers of robots, of which the worlds of a candidate have one each, in turn."""
    sizes: Annotated[tuple[float, ...], constraint_of(ArenaConfig, "size")] = ()
    """Edges of the arenas in which each candidate's worlds run, one after the other, with as many robots per area; by
    default that of `arena.size` [rd]."""
    steps: Steps = 200
    """Control steps of a world."""
    generations: Generations = 30
    """Total generations; to continue a finished training, pass more."""
    population: Population = 16
    """Candidates in a generation."""
    worlds: Repeats = 2
    """Worlds per candidate, the same for all of a generation; its fitness is their mean."""
    validation: Repeats = 8
    """Worlds in which the mean of the search is tried after each tenth generation; the best mean is kept."""
    spread: Annotated[float, Above(0, 100)] = 0.1
    """Standard deviation of the weights at the start."""
    seed: Seed = 0
    """Seed of all random numbers."""
