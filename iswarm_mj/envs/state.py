"""State of an environment, as `reset` and `step` return it."""

from typing import Any, NamedTuple

from jaxtyping import Bool, Float, Int

from iswarm_mj.simulation.state import WorldState
from iswarm_mj.utils.arrays import Array


class Episode(NamedTuple):
    """What goes on in a world; robots do not know it."""

    world: WorldState
    key: Array
    """Random key of the world's noise."""
    next_key: Array
    """That begins the next episode."""
    step: Int[Array, "*B"]
    """Control steps taken."""
    waits: Bool[Array, "*B N"]
    """The robot stays where it is in the next step, see `Observation.waits`."""
    tool_voltage_squared: Float[Array, "*B N"]
    """See `tasks.protocol.Sensed` [V^2]."""


class State(NamedTuple):
    """State of an environment with N robots; of B worlds all arrays have a leading axis of worlds."""

    data: Episode
    obs: Float[Array, "*B N D"]
    """What each robot may know, see `Env.observations`."""
    reward: Float[Array, "*B N"]
    """Of each robot for the last step, by its task."""
    done: Bool[Array, "*B"]
    """The episode has ended: the goal is reached, the time is up, or something went wrong. The next `step` begins a new
    one, whatever the action."""
    metrics: dict[str, Array]
    """Those of the task; `progress` of it; `collisions` so far."""
    info: dict[str, Any]
    """`step` of the episode; `is_finished`, the goal is reached; `truncated`, the time is up; `fault`, bits of
    `FaultKind`, 0 if nothing went wrong."""
