"""Teams: several strategies in one swarm, each with its own robots, memory and messages."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int32

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.attributes import payload_of, recorded_of
from iswarm_mj.strategy.base import Strategy, makes_strategies, overrides
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.validation import as_strategy, check_strategy
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import ConfigError, UserError

_EXAMPLE = '{"red": (0.7, Walk()), "blue": (0.3, Gossip())}'


class Team(NamedTuple):
    """Robots with the same strategy."""

    name: str
    share: float | int
    """Share of the robots as a float, or their number as an int."""
    strategy: Any


class Member(NamedTuple):
    """A team in a world of N robots."""

    number: int
    """Number of the team, from 0."""
    name: str
    strategy: Any
    robots: slice
    """Numbers of the team's robots in the world."""

    @property
    def size(self) -> int:
        """Number of robots."""
        return self.robots.stop - self.robots.start

    def key(self, key: Array) -> Array:
        """Return the team's own random key."""
        return jax.random.fold_in(key, self.number)


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True)
class Teams(Strategy):
    """A strategy for each team: `Teams({"red": (0.7, Walk()), "blue": (0.3, Gossip())})`.

    The robots of a team have consecutive numbers, in the order of the teams. A strategy acts on the
    robots of its team, which it numbers from 0, but they see and hear all others.

    Messages have the fields of all teams; fields of the same name must be equal. Robots send 0 in
    fields that their strategy lacks, and vectors as unknown.

    The memory is a dictionary by the teams' names, with 0 for the robots of other teams.
    """

    teams: Any = field(metadata={"is_setting": False})
    """Share and strategy of each team by its name; kept as a tuple of `Team`.

    Shares are floats that add up to 1, or ints that add up to the number of robots. A strategy may
    be a `Genome`, or have `for_world`."""

    def __post_init__(self):
        _check_teams(self.teams)
        teams = []
        for name, (share, strategy) in self.teams.items():
            teams.append(Team(name, share, _usable(strategy)))
        object.__setattr__(self, "teams", tuple(teams))  # the dataclass is frozen
        _ = self.payload  # raises an error where the fields of teams do not go together

    def strategy_of(self, name: str) -> Any:
        """Return the strategy of a team; None if there is no such team."""
        return next((team.strategy for team in self.teams if team.name == name), None)

    def with_strategy(self, name: str, strategy: Any) -> "Teams":
        """Return the teams with another strategy of one of them."""
        teams = {team.name: (team.share, team.strategy) for team in self.teams}
        share, _ = teams[name]
        return Teams(teams | {name: (share, strategy)})

    def tree_flatten(self) -> tuple[tuple[Any, ...], Any]:
        """Return the strategies, and what is compiled in: names and shares."""
        strategies = tuple(team.strategy for team in self.teams)
        names_and_shares = tuple((team.name, team.share) for team in self.teams)
        return strategies, names_and_shares

    @classmethod
    def tree_unflatten(cls, names_and_shares: Any, strategies: Any) -> "Teams":
        """Return the teams that `tree_flatten` took apart, without checks."""
        teams = []
        for (name, share), strategy in zip(names_and_shares, strategies, strict=True):
            teams.append(Team(name, share, strategy))
        unchecked = object.__new__(cls)
        object.__setattr__(unchecked, "teams", tuple(teams))
        return unchecked

    def for_world(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "Teams":
        """Return the teams of a world, with the number of robots of each as its share.

        Raises:
            UserError: a team has no robot, or together they do not have `n_robots` robots.
        """
        total = sum(team.share for team in self.teams)
        if isinstance(total, int) and total != n_robots:
            raise UserError(
                f"teams must have {n_robots} robots together, all that there are (got {total}); "
                f"set `n_robots` to {total}, or give shares as 0.5"
            )

        teams = {}
        sizes = self.sizes(n_robots)
        for team, size, end in zip(self.teams, sizes, accumulate(sizes), strict=True):
            if not size:
                constraint = f"enough for one of {n_robots} robots"
                raise ConfigError(f"share of team {team.name}", team.share, constraint)
            robots = robot.part(end - size, size)
            teams[team.name] = size, _strategy_in_world(team.strategy, config, robots, size)
        return Teams(teams)

    def sizes(self, n_robots: int) -> tuple[int, ...]:
        """Return the number of robots of each team.

        The last team also has the places of robots that a world lacks.
        """
        shares = [team.share for team in self.teams]
        scale = n_robots if isinstance(shares[0], float) else 1
        ends = [math.floor(end * scale + 0.5) for end in np.cumsum(shares[:-1])]
        return tuple(np.diff([0, *ends, n_robots]).tolist())

    def _members(self, n_robots: int) -> Iterator[Member]:
        """Yield each team with its robots."""
        first = 0
        for number, size in enumerate(self.sizes(n_robots)):
            team = self.teams[number]
            yield Member(number, team.name, team.strategy, slice(first, first + size))
            first += size

    @property
    def payload(self) -> Payload:
        """Message fields of all teams.

        Raises:
            UserError: two teams have different fields of the same name, or different checks; or
                the fields do not fit into a message.
        """
        payloads = {team.name: payload_of(team.strategy) for team in self.teams}
        fields: dict[str, Any] = {}
        checks: dict[str, None] = {}  # a dictionary keeps the order
        requirement = None
        for payload in payloads.values():
            for name, kind in payload.fields:
                if fields.setdefault(name, kind) != kind:
                    requirement = "have equal fields of the same name"
            if payload.fields:
                checks[payload.check] = None
        if len(checks) > 1:
            requirement = "check messages alike"

        if requirement is not None:
            described = "; ".join(f"{team}: {payload}" for team, payload in payloads.items())
            raise UserError(f"teams share one channel, and must {requirement} (got {described})")
        return Payload(fields, *checks)

    @property
    def recorded(self) -> dict[str, str]:
        """Recorded parts of the teams' memories, as TEAM.PART, and their units."""
        units = {}
        for team in self.teams:
            for part, unit in recorded_of(team.strategy).items():
                units[f"{team.name}.{part}"] = unit
        return units

    def init(self, n_robots: int, key: Array) -> dict[str, Any]:
        """Return the initial memories of all teams, see `Strategy.init`."""
        memory = {}
        for team in self._members(n_robots):
            of_team = team.strategy.init(team.size, team.key(key))
            memory[team.name] = _scatter(of_team, team.robots, n_robots)
        return memory

    def picks(self, memory: dict[str, Any]) -> Bool[Array, "N"]:
        """Return whether each robot picks up balls."""
        return self._collect("picks", memory, default=False)

    def releases(self, memory: dict[str, Any]) -> Bool[Array, "N"]:
        """Return whether each robot releases its ball, wherever it is.

        Robots of teams whose strategies do not say so release balls only over the dump.
        """
        return self._collect("releases", memory, default=False)

    def led_power(self, memory: dict[str, Any]) -> Float[Array, "N"]:
        """Return each robot's power, 1 in teams whose strategies set none."""
        return self._collect("led_power", memory, default=1.0)

    def _collect(self, method: str, memory: dict[str, Any], *, default: bool | float) -> Array:
        """Return the results (N,) of a method of each team, with a default for None."""
        n_robots = len(jax.tree.leaves(memory)[0])
        parts = []
        for team in self._members(n_robots):
            of_team = getattr(team.strategy, method)(_gather(memory[team.name], team.robots))
            parts.append(jnp.full(team.size, default) if of_team is None else of_team)
        return jnp.concatenate(parts)

    def say(self, memory: dict[str, Any], is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return the message of each robot, with 0 in fields that its team lacks."""
        n_robots = len(is_loaded)
        shapes = self.payload.shapes(n_robots)
        messages = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
        for team in self._members(n_robots):
            if not payload_of(team.strategy).fields:
                continue
            of_team = team.strategy.say(
                _gather(memory[team.name], team.robots),
                is_loaded[team.robots],
            )
            for name, values in of_team.items():
                messages[name] = _place(values, messages[name], team.robots)
        return messages

    def listen(
        self,
        memory: dict[str, Any],
        observation: Observation,
        key: Array,
    ) -> dict[str, Any]:
        """Return the memories from which robots speak, see `Strategy.listen`.

        Teams whose strategies do not define `listen` speak from the memory of the step before.
        """
        n_robots = len(observation.waits)
        updated = dict(memory)
        for team in self._members(n_robots):
            if not overrides(team.strategy, Strategy, "listen"):
                continue
            of_team = team.strategy.listen(
                _gather(memory[team.name], team.robots),
                _observation_of(team, observation),
                team.key(key),
            )
            updated[team.name] = _scatter(of_team, team.robots, n_robots)
        return updated

    def correct_odometry(
        self,
        memory: dict[str, Any],
        shortfall: Float[Array, "N"],
    ) -> dict[str, Any]:
        """Return the memories after robots walked less than commanded."""
        n_robots = len(shortfall)
        updated = dict(memory)
        for team in self._members(n_robots):
            of_team = team.strategy.correct_odometry(
                _gather(memory[team.name], team.robots),
                shortfall[team.robots],
            )
            updated[team.name] = _scatter(of_team, team.robots, n_robots)
        return updated

    def act(
        self,
        memory: dict[str, Any],
        observation: Observation,
        key: Array,
    ) -> tuple[dict[str, Any], Command]:
        """Return the next memories of all teams, and the commands of all robots."""
        n_robots = len(observation.waits)
        next_memory = {}
        commands = []
        for team in self._members(n_robots):
            of_team, command = team.strategy.act(
                _gather(memory[team.name], team.robots),
                _observation_of(team, observation),
                team.key(key),
            )
            next_memory[team.name] = _scatter(of_team, team.robots, n_robots)
            commands.append(command)
        all_commands = jax.tree.map(lambda *parts: jnp.concatenate(parts), *commands)
        return next_memory, all_commands


def team_sizes(strategy: Any, n_robots: int) -> dict[str, int]:
    """Return the number of robots of each team by its name; empty without teams."""
    if not isinstance(strategy, Teams):
        return {}
    names = [team.name for team in strategy.teams]
    return dict(zip(names, strategy.sizes(n_robots), strict=True))


def team_numbers(strategy: Any, n_robots: int) -> Int32[np.ndarray, "N"]:
    """Return the number of each robot's team, from 0; without teams all robots are one."""
    sizes = [*team_sizes(strategy, n_robots).values()] or [n_robots]
    return np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)


def check_strategies(strategies: Any, n_robots: int, n_sides: int = 4, sensed: Any = None) -> Any:
    """Check the strategy of a run, or that of each of its teams, by `check_strategy`.

    The strategy of the first world stands for all, which have equal classes, fields and shapes.

    Args:
        strategies: strategy or teams; arrays have a first axis of worlds.
        n_robots: number of robots N.
        n_sides: number of sides S of each robot.
        sensed: shapes and types of the arrays (N, ...) that the task adds to what robots sense, by
            name; None for none.

    Returns:
        Shapes and types of the memory of a world's robots; None with teams, whose memories are
        checked one by one.

    Raises:
        UserError: a strategy is wrong, or the fields of all teams do not fit into a message.
    """
    strategy = jax.tree.map(lambda values: values[0], strategies)
    if not isinstance(strategy, Teams):
        return check_strategy(strategy, n_robots, n_sides, sensed)

    # A team senses the rows of its own robots.
    for team, size in zip(strategy.teams, strategy.sizes(n_robots), strict=True):
        sensed_by_team = {}
        for name, array in (sensed or {}).items():
            shape = (size, *array.shape[1:])
            sensed_by_team[name] = jax.ShapeDtypeStruct(shape, array.dtype)
        check_strategy(team.strategy, size, n_sides, sensed_by_team)

    # Teams share one channel, so the fields of all must fit into a message together.
    strategy.payload.check_room(n_sides)
    return None


def _check_teams(teams: Any) -> None:
    """Raise a UserError unless this is a dictionary of names, shares and strategies."""
    is_mapping = isinstance(teams, Mapping) and len(teams) > 0
    if not is_mapping or not all(map(_is_pair, teams.values())):
        raise UserError(
            f"teams are a dictionary of shares and strategies, as {_EXAMPLE} (got {teams!r})",
        )

    for name, (share, _) in teams.items():
        if not isinstance(name, str) or not name.isidentifier():
            raise UserError(f"a team cannot be called {name!r}; give it a name as of a variable")
        if not _is_fraction(share) and not _is_number_of_robots(share):
            constraint = "a float above 0 and at most 1, or a whole number"
            raise ConfigError(f"share of team {name}", share, constraint)

    shares = [share for share, _ in teams.values()]
    are_fractions = {isinstance(share, float) for share in shares}
    if len(are_fractions) > 1:
        raise UserError(
            "teams must all have shares, as 0.5, or all have numbers of robots, as 20; give one kind",
        )
    if are_fractions == {True} and abs(sum(shares) - 1) > 1e-6:
        total = round(sum(shares), 6)
        raise UserError(f"shares of teams must add up to 1 (got {total})")


def _is_pair(value: Any) -> bool:
    """Return whether a value is a tuple of two."""
    return isinstance(value, tuple) and len(value) == 2


def _is_fraction(share: Any) -> bool:
    """Return whether a share is a fraction of the robots."""
    return isinstance(share, float) and 0 < share <= 1


def _is_number_of_robots(share: Any) -> bool:
    """Return whether a share is a number of robots; True and False are none."""
    return isinstance(share, int) and not isinstance(share, bool) and share >= 1


def _usable(strategy: Any) -> Any:
    """Return a strategy as a pytree, unless `for_world` makes it later."""
    if isinstance(strategy, Genome) or makes_strategies(strategy):
        return strategy
    return as_strategy(strategy)


def _strategy_in_world(strategy: Any, config: SwarmConfig, robot: Robots, n_robots: int) -> Any:
    """Return a team's strategy in a world of this configuration, for its number of robots."""
    if isinstance(strategy, Genome):
        rules = rules_of(strategy, config.strategy)
        n_scouts = round(strategy.fraction_scouts * n_robots)
        return VectorStrategy(rules, n_scouts, config.static, robot)
    if makes_strategies(strategy):
        strategy = strategy.for_world(config, robot, n_robots)
    return as_strategy(strategy)


def _gather(tree: Any, robots: slice) -> Any:
    """Return the rows of a team's robots."""
    return jax.tree.map(lambda values: values[robots], tree)


def _scatter(tree: Any, robots: slice, n_robots: int) -> Any:
    """Return arrays of all N robots with the rows of a team, and 0 for all others."""

    def scatter(values: Array) -> Array:
        zeros = jnp.zeros((n_robots, *values.shape[1:]), values.dtype)
        return zeros.at[robots].set(values)

    return jax.tree.map(scatter, tree)


def _place(tree: Any, into: Any, robots: slice) -> Any:
    """Return arrays of all robots in which a team's rows are replaced."""
    return jax.tree.map(lambda everyone, values: everyone.at[robots].set(values), into, tree)


def _observation_of(team: Member, observation: Observation) -> Observation:
    """Return what a team observes, with only the message fields that its strategy knows."""
    names = [name for name, _ in payload_of(team.strategy).fields]
    payload = {name: observation.payload[name] for name in names}
    return _gather(observation._replace(payload=payload), team.robots)
