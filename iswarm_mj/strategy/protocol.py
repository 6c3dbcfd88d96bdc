"""What a strategy is: the rules by which robots speak and move, from what they sense."""

from typing import Any, Protocol, runtime_checkable

from iswarm_mj.sensors.messages import Message
from iswarm_mj.strategy.controller import Command, Observation
from iswarm_mj.utils.arrays import Array


class Strategy(Protocol):
    """Rules of N robots of one world, in pure JAX: `jit` and `vmap` go through all methods.

    A strategy is a pytree (`jax.tree_util.register_dataclass`): its arrays may differ from world to world, what is
    static is compiled in. Its memory is a pytree of arrays with the robots first.
    """

    def init(self, n_robots: int, key: Array) -> Any:
        """Return the memory of N robots at the start.

        Args:
            n_robots: N.
            key: random key of the world.
        """
        ...

    def say(self, memory: Any, is_loaded: Array) -> Message:
        """Return what each robot says to all sides (N,); `led` is replaced by that of the LED that sends.

        Args:
            memory: from the step before.
            is_loaded: (N,) bool, the robot holds a ball.
        """
        ...

    def picks(self, memory: Any) -> Array:
        """Whether each robot picks up balls that its tool reaches (N,) bool."""
        ...

    def act(self, memory: Any, observation: Observation, key: Array) -> tuple[Any, Command]:
        """Advance the memory by one control step, and decide what the robots do.

        Args:
            memory: from the step before.
            observation: what the robots sense now.
            key: random key of this world and step.
        """
        ...


@runtime_checkable
class RelayingStrategy(Strategy, Protocol):
    """A strategy whose robots can pass on what they have just heard, as updates one after the other ask for."""

    def listen(self, memory: Any, observation: Observation, key: Array) -> Any:
        """Return the memory that robots speak from after they heard and before they move.

        What one robot remembers must depend on what that robot senses alone.

        Args:
            memory: from the step before.
            observation: as for `act`, which is called with the same memory and key later.
            key: likewise.
        """
        ...
