"""The base class of strategies: the rules by which robots speak and move, given what they sense.

A strategy of your own derives from `Strategy` and writes `init`, `picks` and `act`; all other
methods have a default:

    @dataclass(frozen=True)
    class Walk(Strategy):
        turn: float = 10.0

        def init(self, n_robots, key):
            return jnp.zeros(n_robots)

        def picks(self, memory):
            return memory < 0  # False for all: the memory stays 0

        def act(self, memory, observation, key):
            side = jax.random.uniform(key, memory.shape, minval=-1.0)
            turn = jnp.deg2rad(self.turn) * side
            return memory, Command(turn, forward=jnp.full(memory.shape, 0.8))
"""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from jaxtyping import Bool, Float

from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.utils.arrays import Array


class StrategyFactory(ABC):
    """Maker of each world's strategy, for example from a file of weights."""

    @abstractmethod
    def for_world(self, config: Any, robot: Any, n_robots: int) -> "Strategy":
        """Return the strategy of one world.

        The strategies of all worlds of a run must be of one class, with the same static fields and
        shapes.

        Args:
            config: `SwarmConfig` of the world.
            robot: geometry of the robots, `Robots`.
            n_robots: N.
        """


class Strategy(StrategyFactory):
    """Rules of N robots of one world, in pure JAX: all methods run under `jit` and `vmap`.

    A strategy is a pytree; a dataclass becomes one automatically (`strategy.pytrees.as_pytree`).
    Its numbers are arrays, which may differ between worlds; its static fields are compiled in.

    The memory is a pytree of arrays whose first axis is the robots; store random keys as
    `jax.random.key_data`. Methods set no attributes, and draw random numbers only from their key.

    A strategy may set two attributes, in the class or in the object:

    - `payload`: the fields of its messages by name (`sensors.fields`), or a `Payload`. Without it,
      messages carry only the number of the LED.
    - `recorded`: names of the parts of the memory that recordings show, as
      `("state", "home.vector")`, or a dictionary of names and units.
    """

    ATTRIBUTES: ClassVar[tuple[str, ...]] = ("payload", "recorded")
    """Names of these attributes. This class does not define them: a dataclass would take an
    annotated default for a field."""
    batch_invariant: ClassVar[bool] = False
    """Compiled programs round alike for one world and for several; set it only if measured.

    Without it, the decisions of a single world are computed twice, as a batch of two, so that they
    do not depend on the number of worlds (`simulation.decide.pad_singleton_batch`). Derived classes
    do not inherit it (`is_batch_invariant`)."""

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
            memory: memory after the previous step.
            observation: what the robots sense now.
            key: random key of this world and step.

        Returns:
            The memory, with the same shapes and types, and the commands.
        """

    def say(self, memory: Any, is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return the message of each robot: arrays (N,) by the names and types in `payload`.

        Args:
            memory: memory after the previous step.
            is_loaded: the robot holds a ball.
        """
        return {}

    def listen(self, memory: Any, observation: Observation, key: Array) -> Any:
        """Return the memory from which robots speak, given what they have just heard.

        Only sequential updates (`strategy.update_order`) call it: in each step robots take turns to
        hear, listen and speak, and then all of them act. The memory of a robot may depend only on
        what that robot senses.

        Args:
            memory: memory after the previous step.
            observation: as for `act`, which is called later with the same memory and key.
            key: key of `act`.
        """
        return memory

    def releases(self, memory: Any) -> Bool[Array, "N"] | None:
        """Return whether each robot releases its ball, wherever it is.

        Over the dump all robots release theirs. None: robots release balls only there.
        """
        return None

    def led_power(self, memory: Any) -> Float[Array, "N"] | None:
        """Return the power with which each robot sends its next message, 0 (silent) to 1 (full).

        Light of a share p of the full power reaches p^(1/2) as far. Robots see walls at any power.
        None: all send at full power.
        """
        return None

    def correct_odometry(self, memory: Any, shortfall: Float[Array, "N"]) -> Any:
        """Return the memory after robots walked less than they commanded in this step.

        Args:
            memory: memory that `act` returned.
            shortfall: commanded minus walked distance, both negative backwards; without the
                random errors of the drive [mm].
        """
        return memory

    def for_world(self, config: Any, robot: Any, n_robots: int) -> "Strategy":
        """Return the strategy of one world, by default this one; see `StrategyFactory`."""
        return self


def makes_strategies(strategy: Any) -> bool:
    """Return whether an object's `for_world` must be called for the strategy of a world.

    That holds for factories, and for strategies that override it to adapt themselves to a world.
    """
    cls = type(strategy)
    return issubclass(cls, StrategyFactory) and cls.for_world is not Strategy.for_world


def is_batch_invariant(strategy_or_task: Any) -> bool:
    """Return whether the very class of a strategy or task states that it rounds alike in any batch.

    A derived class computes something else, of which that was not measured.
    """
    return bool(vars(type(strategy_or_task)).get("batch_invariant", False))


def overrides(value: Any, base: type, method: str) -> bool:
    """Return whether an object or class overrides the default method of a base class.

    For a task that wraps another one (`tasks.rewarded`) the other one counts.
    """
    value = getattr(value, "wrapped_task", value)
    cls = value if isinstance(value, type) else type(value)
    return getattr(cls, method) is not getattr(base, method)
