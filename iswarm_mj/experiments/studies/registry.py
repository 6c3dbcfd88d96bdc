"""All experiments by their names."""

from difflib import get_close_matches

from iswarm_mj.experiments.runner.experiment import Experiment
from iswarm_mj.experiments.studies import (
    density,
    hop_count,
    infer,
    message_time,
    resolved_grasps,
    robustness,
    sensitivity,
    swarm_types,
    time_step,
)
from iswarm_mj.utils.errors import UserError, shown

EXPERIMENTS = {
    module.EXPERIMENT.name: module.EXPERIMENT
    for module in (
        hop_count,
        density,
        swarm_types,
        sensitivity,
        robustness,
        time_step,
        message_time,
        resolved_grasps,
        infer,
    )
}


def experiment(name: str) -> Experiment:
    """Return an experiment by its name.

    Raises:
        UserError: there is none of this name.
    """
    if name not in EXPERIMENTS:
        similar = "".join(f"; perhaps you meant {match}" for match in get_close_matches(name, EXPERIMENTS, 1))
        raise UserError(f"there is no experiment {shown(name)!r}{similar}; choose {', '.join(EXPERIMENTS)}")
    return EXPERIMENTS[name]


def listing() -> str:
    """Names and titles, a line each."""
    width = max(map(len, EXPERIMENTS))
    return "\n".join(f"{e.name:{width}}  {e.source}: {e.title}" for e in EXPERIMENTS.values())
