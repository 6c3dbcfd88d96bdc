"""What a strategy is: the rules by which robots speak and move, given what they sense."""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Bool, Float

from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.utils.arrays import Array


@runtime_checkable
class Strategy(Protocol):
    """Rules of N robots of one world, in pure JAX: all methods run under `jit` and `vmap`.

    A strategy is a pytree (`jax.tree_util.register_dataclass`): its arrays may differ from world to world, and its
    static fields are compiled in. Its memory is a pytree of arrays with the robots as first axis; store random keys as
    `jax.random.key_data`. Methods set no attributes, and draw random numbers only from their key.

    A strategy that sends messages is a `SpeakingStrategy`; others send only the number of the LED.
    """

    def init(self, n_robots: int, key: Array) -> Any:
        """Return the initial memory of N robots.

        Args:
            n_robots: N.
            key: random key of the world.
        """
        ...

    def picks(self, memory: Any) -> Bool[Array, "N"]:
        """Return whether each robot picks up balls within reach."""
        ...

    def act(self, memory: Any, observation: Observation, key: Array) -> tuple[Any, Command]:
        """Return the next memory and the commands.

        Args:
            memory: of the previous step.
            observation: what the robots sense now.
            key: random key of this world and step.

        Returns:
            The memory, with the same shapes and types, and the commands.
        """
        ...


@runtime_checkable
class ReleasingStrategy(Strategy, Protocol):
    """A strategy whose robots also release balls when they want to; all release them over the dump."""

    def releases(self, memory: Any) -> Bool[Array, "N"]:
        """Return whether each robot releases the ball that it holds, wherever it is; see `picks`."""
        ...


@runtime_checkable
class DimmingStrategy(Strategy, Protocol):
    """A strategy whose robots choose the power of their LEDs."""

    def led_power(self, memory: Any) -> Float[Array, "N"]:
        """Return the power with which each robot sends its next message, from 0, silent, to 1, full power.

        Light of a share p of the full power reaches p^(1/2) as far. A robot sees walls at any power.
        """
        ...


@runtime_checkable
class ReckoningStrategy(Strategy, Protocol):
    """A strategy whose robots learn that they did not walk as far as they meant to."""

    def fell_short(self, memory: Any, shortfall: Float[Array, "N"]) -> Any:
        """Return the memory after a step that was shorter than commanded.

        Args:
            memory: from `act`.
            shortfall: distance commanded that the drive did not walk, see `simulation.actuate.Actuated` [mm].
        """
        ...


@runtime_checkable
class SpeakingStrategy(Strategy, Protocol):
    """A strategy with its own message fields."""

    @property
    def payload(self) -> Payload | Mapping[str, Any]:
        """Fields of the messages: names and `sensors.fields`, or a `Payload`."""
        ...

    def say(self, memory: Any, is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return the message of each robot: arrays (N,) by field name, of the fields' types.

        Args:
            memory: from the step before.
            is_loaded: the robot holds a ball.
        """
        ...


@runtime_checkable
class RelayingStrategy(SpeakingStrategy, Protocol):
    """A strategy whose robots can pass on what they just heard, which sequential updates need."""

    def listen(self, memory: Any, observation: Observation, key: Array) -> Any:
        """Return the memory from which robots speak, after they heard and before they move.

        The memory of a robot may depend only on what that robot senses.

        Args:
            memory: from the step before.
            observation: as for `act`, which is called later with the same memory and key.
            key: of `act`.
        """
        ...
