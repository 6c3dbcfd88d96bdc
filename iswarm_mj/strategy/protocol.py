"""What a strategy is: the rules by which robots speak and move, given what they sense."""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Bool

from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.utils.arrays import Array


@runtime_checkable
class Strategy(Protocol):
    """Rules of N robots of one world, in pure JAX: all methods run under `jit` and `vmap`.

    A strategy is a pytree (`jax.tree_util.register_dataclass`): its arrays may differ from world to world, and its
    static fields are compiled in. Its memory is a pytree of arrays whose first axis is that of the robots, numbers and
    not random keys (`jax.random.key_data`). Methods set no attributes, and draw random numbers from their key alone.

    What its messages carry it declares by an attribute `payload`, a dictionary of names and `sensors.fields` or a
    `Payload`, and says by a method `say`, see `SpeakingStrategy`. Without both, messages carry the number of the LED
    that sends alone.
    """

    def init(self, n_robots: int, key: Array) -> Any:
        """Return the memory of N robots at the start.

        Args:
            n_robots: N.
            key: random key of the world.
        """
        ...

    def picks(self, memory: Any) -> Bool[Array, "N"]:
        """Return whether each robot picks up the balls that its tool reaches."""
        ...

    def act(self, memory: Any, observation: Observation, key: Array) -> tuple[Any, Command]:
        """Advance the memory by one control step, and decide what the robots do.

        Args:
            memory: from the step before.
            observation: what the robots sense now.
            key: random key of this world and step.

        Returns:
            The memory, with the same shapes and types, and the commands.
        """
        ...


@runtime_checkable
class SpeakingStrategy(Strategy, Protocol):
    """A strategy whose messages carry something."""

    @property
    def payload(self) -> Payload | Mapping[str, Any]:
        """Fields of the messages."""
        ...

    def say(self, memory: Any, is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return what each robot says to all sides: arrays (N,) by the names of the payload's fields, of their types.

        Args:
            memory: from the step before.
            is_loaded: the robot holds a ball.
        """
        ...


@runtime_checkable
class RelayingStrategy(SpeakingStrategy, Protocol):
    """A strategy whose robots can pass on what they have just heard, which sequential updates need."""

    def listen(self, memory: Any, observation: Observation, key: Array) -> Any:
        """Return the memory from which robots speak after they heard and before they move.

        What one robot remembers may depend only on what that robot senses.

        Args:
            memory: from the step before.
            observation: as for `act`, which is called later with the same memory and key.
            key: of `act`.
        """
        ...
