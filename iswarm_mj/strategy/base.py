"""What a strategy is: the rules by which robots speak and move, given what they sense.

A strategy of your own derives from `Strategy` and writes `init`, `picks` and `act`; every other method has a default:

    @dataclass(frozen=True)
    class Walk(Strategy):
        turn: float = 10.0

        def init(self, n_robots, key):
            return jnp.zeros(n_robots)

        def picks(self, memory):
            return memory < 0

        def act(self, memory, observation, key):
            side = jax.random.uniform(key, memory.shape, minval=-1.0)
            return memory, Command(jnp.deg2rad(self.turn) * side, jnp.full(memory.shape, 0.8))
"""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from jaxtyping import Bool, Float

from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.utils.arrays import Array


class StrategyFactory(ABC):
    """What makes the strategy of each world, for example from a file of weights."""

    @abstractmethod
    def for_world(self, config: Any, robot: Any, n_robots: int) -> "Strategy":
        """Return the strategy of one world.

        The strategies of all worlds of a run must be of one class, with the same static fields and shapes.

        Args:
            config: `SwarmConfig` of the world.
            robot: `Robots`, their geometry.
            n_robots: N.
        """


class Strategy(StrategyFactory):
    """Rules of N robots of one world, in pure JAX: all methods run under `jit` and `vmap`.

    A strategy is a pytree: a dataclass is made one (`strategy.pytrees.as_pytree`). Its numbers are arrays, which may
    differ from world to world; its static fields are compiled in. Its memory is a pytree of arrays with the robots as
    first axis; store random keys as `jax.random.key_data`. Methods set no attributes, and draw random numbers only from
    their key.


    Two attributes, of the class or the object, may be set. `payload`: the fields of its messages by name
    (`sensors.fields`), or a `Payload`; without it, messages carry the number of the LED alone. `recorded`: names of
    parts of the memory that recordings show, as `("state", "home.vector")`, or a dictionary of names and units.
    """

    ATTRIBUTES: ClassVar[tuple[str, ...]] = ("payload", "recorded")
    """Names of these attributes, which have no default: dataclasses would take it for one of their fields."""
    batch_invariant: ClassVar[bool] = False
    """The compiled program was seen to round alike for one world and for more; otherwise the decisions of a single
    world are computed twice."""

    @abstractmethod
    def init(self, n_robots: int, key: Array) -> Any:
        """Return the initial memory of N robots.

        Args:
            n_robots: N.
            key: random key of the world.
        """

    @abstractmethod
    def picks(self, memory: Any) -> Bool[Array, "N"]:
        """Return whether each robot picks up balls within reach."""

    @abstractmethod
    def act(self, memory: Any, observation: Observation, key: Array) -> tuple[Any, Command]:
        """Return the next memory and the commands.

        Args:
            memory: of the previous step.
            observation: what the robots sense now.
            key: random key of this world and step.

        Returns:
            The memory, with the same shapes and types, and the commands.
        """

    def say(self, memory: Any, is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return the message of each robot: arrays (N,) by field name, of the types of the fields of `payload`.

        Args:
            memory: from the step before.
            is_loaded: the robot holds a ball.
        """
        return {}

    def listen(self, memory: Any, observation: Observation, key: Array) -> Any:
        """Return the memory from which robots speak, after they heard and before they move.

        Sequential updates (`strategy.update_order`) need it. The memory of a robot may depend only on what that robot
        senses.

        Args:
            memory: from the step before.
            observation: as for `act`, which is called later with the same memory and key.
            key: of `act`.
        """
        return memory

    def releases(self, memory: Any) -> Bool[Array, "N"] | None:
        """Return whether each robot releases the ball that it holds, wherever it is.

        None: robots release balls over the dump alone, as all do there.
        """
        return None

    def led_power(self, memory: Any) -> Float[Array, "N"] | None:
        """Return the power with which each robot sends its next message, from 0, silent, to 1, full power.

        Light of a share p of the full power reaches p^(1/2) as far. A robot sees walls at any power. None: all send at
        full power.
        """
        return None

    def correct_odometry(self, memory: Any, shortfall: Float[Array, "N"]) -> Any:
        """Return the memory after a step that was shorter than commanded.

        Args:
            memory: from `act`.
            shortfall: distance commanded that the drive did not walk, see `simulation.actuate.DriveOutput` [mm].
        """
        return memory

    def for_world(self, config: Any, robot: Any, n_robots: int) -> "Strategy":
        """Return the strategy of one world, by default this one; see `StrategyFactory.for_world`."""
        return self


def makes_strategies(given: Any) -> bool:
    """Return whether the strategy of a world is not the object itself, but what its `for_world` returns."""
    cls = type(given)
    return issubclass(cls, StrategyFactory) and cls.for_world is not Strategy.for_world


def overrides(given: Any, base: type, method: str) -> bool:
    """Return whether an object or a class has a method of its own in place of the default of a base class."""
    cls = given if isinstance(given, type) else type(given)
    return getattr(cls, method) is not getattr(base, method)
