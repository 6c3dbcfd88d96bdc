"""Teams: several strategies in one swarm, each with robots, memory and message fields of its own."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int32

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.base import Strategy, makes_strategies, overrides
from iswarm_mj.strategy.declared import payload_of, recorded_of
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.pytrees import as_strategy
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import ConfigError, UserError

_EXAMPLE = '{"red": (0.7, Walk()), "blue": (0.3, Gossip())}'


class Team(NamedTuple):
    """Robots with the same strategy."""

    name: str
    share: float | int
    """Of the robots as a float, or their number as an int."""
    strategy: Any


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True)
class Teams(Strategy):
    """A strategy that gives each team of robots a strategy: `Teams({"red": (0.7, Walk()), "blue": (0.3, Gossip())})`.

    The robots of a team have consecutive numbers, in the order of the teams. A strategy acts on the robots of its team,
    which it numbers from 0, but they see and hear all others. Messages have the fields of all teams; fields of one name
    must be equal. Robots send 0 in fields that their strategy lacks, and of a vector that they know none.

    The memory is a dictionary by the teams' names, with 0 for the robots of other teams.
    """

    teams: Any
    """Share and strategy of each team by its name; kept as a tuple of `Team`. Shares are floats that add up to 1, or
    ints that add up to the number of robots. A strategy may be a `Genome`, or have `for_world`."""

    def __post_init__(self):
        given = self.teams.items() if isinstance(self.teams, Mapping) else ()
        if not given or not all(isinstance(value, tuple) and len(value) == 2 for _, value in given):
            raise UserError(f"teams are a dictionary of shares and strategies, as {_EXAMPLE} (got {self.teams!r})")
        shares = [share for _, (share, _) in given]
        for name, (share, _) in given:
            if not isinstance(name, str) or not name.isidentifier():
                raise UserError(f"a team cannot be called {name!r}; give it a name as of a variable")
            is_share = isinstance(share, float) and 0 < share <= 1
            if not is_share and (not isinstance(share, int) or isinstance(share, bool) or share < 1):
                raise ConfigError(f"share of team {name}", share, "a float above 0 and at most 1, or a whole number")
        if len(are_floats := {isinstance(share, float) for share in shares}) > 1:
            raise UserError("shares of teams must all be floats, or all be numbers of robots; give one kind")
        if are_floats == {True} and abs(sum(shares) - 1) > 1e-6:
            raise ConfigError("shares of the teams", round(sum(shares), 6), "such that they add up to 1")
        object.__setattr__(self, "teams", tuple(Team(name, share, _usable(own)) for name, (share, own) in given))
        _ = self.payload

    def tree_flatten(self) -> tuple[tuple[Any, ...], Any]:
        """Return the strategies, and what is compiled in."""
        return tuple(team.strategy for team in self.teams), tuple(team[:2] for team in self.teams)

    @classmethod
    def tree_unflatten(cls, about: Any, strategies: Any) -> "Teams":
        """Return the teams that `tree_flatten` took apart, unchecked."""
        made = object.__new__(cls)
        teams = tuple(Team(name, share, own) for (name, share), own in zip(about, strategies, strict=True))
        object.__setattr__(made, "teams", teams)
        return made

    def for_world(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "Teams":
        """Return the teams of a world, with the number of robots of each as its share.

        Raises:
            UserError: a team has no robot, or they have not `n_robots` robots together.
        """
        total = sum(team.share for team in self.teams)
        if isinstance(total, int) and total != n_robots:
            remedy = f"set `n_robots` to {total}, or give shares as 0.5"
            raise ConfigError("robots in teams", total, f"as many as there are robots, {n_robots}", remedy)
        found = {}
        sizes = self.sizes(n_robots)
        for (name, share, strategy), size, end in zip(self.teams, sizes, accumulate(sizes), strict=True):
            if not size:
                raise ConfigError(f"share of team {name}", share, f"enough for one of {n_robots} robots")
            found[name] = size, _in_world(strategy, config, robot.part(end - size, size), size)
        return Teams(found)

    def sizes(self, n_robots: int) -> tuple[int, ...]:
        """Return the number of robots of each team; places for robots that a world lacks are those of the last."""
        shares = [team.share for team in self.teams]
        scale = n_robots if isinstance(shares[0], float) else 1
        edges = [0, *(math.floor(edge * scale + 0.5) for edge in np.cumsum(shares[:-1])), n_robots]
        return tuple(np.diff(edges).tolist())

    def _each(self, n_robots: int) -> Iterator[tuple[str, Any, slice]]:
        """Name, strategy and robots of each team."""
        last = 0
        for team, size in zip(self.teams, self.sizes(n_robots), strict=True):
            yield team.name, team.strategy, slice(last, last := last + size)

    @property
    def payload(self) -> Payload:
        """Fields of all teams.

        Raises:
            UserError: two teams have different fields of the same name, or checks; or the fields have no room.
        """
        own = [payload_of(team.strategy) for team in self.teams]
        pairs = dict.fromkeys(pair for payload in own for pair in payload.fields)
        fields = dict([*pairs])
        checks = dict.fromkeys(payload.check for payload in own if payload.fields)
        if len(fields) < len(pairs) or len(checks) > 1:
            what = "check messages alike" if len(checks) > 1 else "have equal fields of the same name"
            found = "; ".join(f"{team.name}: {payload}" for team, payload in zip(self.teams, own, strict=True))
            raise UserError(f"teams share one channel, and must {what} (got {found})")
        return Payload(fields, *checks)

    @property
    def recorded(self) -> dict[str, str]:
        """What the teams record, with their names before it."""
        each = ((team.name, recorded_of(team.strategy)) for team in self.teams)
        return {f"{name}.{part}": unit for name, parts in each for part, unit in parts.items()}

    def init(self, n_robots: int, key: Array) -> dict[str, Any]:
        """See `Strategy.init`."""
        return {
            name: _placed(strategy.init(robots.stop - robots.start, jax.random.fold_in(key, k)), robots, n_robots)
            for k, (name, strategy, robots) in enumerate(self._each(n_robots))
        }

    def picks(self, memory: dict[str, Any]) -> Bool[Array, "N"]:
        """See `Strategy.picks`."""
        return self._chosen("picks", memory)

    def releases(self, memory: dict[str, Any]) -> Bool[Array, "N"]:
        """See `Strategy.releases`; robots of teams without it release balls over the dump alone."""
        return self._chosen("releases", memory, default=False)

    def led_power(self, memory: dict[str, Any]) -> Float[Array, "N"]:
        """See `Strategy.led_power`; robots of teams without it send at full power."""
        return self._chosen("led_power", memory, default=1.0)

    def _chosen(self, method: str, memory: dict[str, Any], default: bool | float = False) -> Array:
        """Return what a method of each team's strategy returns, and the default where that is None."""
        n_robots = len(jax.tree.leaves(memory)[0])
        parts = []
        for name, strategy, robots in self._each(n_robots):
            chosen = getattr(strategy, method)(_of(memory[name], robots))
            parts.append(jnp.full(robots.stop - robots.start, default) if chosen is None else chosen)
        return jnp.concatenate(parts)

    def say(self, memory: dict[str, Any], is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """See `Strategy.say`."""
        nothing = self.payload.shapes(len(is_loaded))
        all_said = jax.tree.map(lambda its: jnp.zeros(its.shape, its.dtype), nothing)
        for name, strategy, robots in self._each(len(is_loaded)):
            if not payload_of(strategy).fields:
                continue
            own = strategy.say(_of(memory[name], robots), is_loaded[robots])
            here = {field: all_said[field] for field in own}
            all_said |= jax.tree.map(lambda a, mine, at=robots: a.at[at].set(mine), here, own)
        return all_said

    def listen(self, memory: dict[str, Any], observation: Observation, key: Array) -> dict[str, Any]:
        """See `Strategy.listen`; teams whose strategy cannot pass on what they just heard do not."""
        heard = dict(memory)
        for k, (name, strategy, robots) in enumerate(self._each(len(observation.waits))):
            if overrides(strategy, Strategy, "listen"):
                own = _of(memory[name], robots), _seen(strategy, observation, robots), jax.random.fold_in(key, k)
                heard[name] = _placed(strategy.listen(*own), robots, len(observation.waits))
        return heard

    def correct_odometry(self, memory: dict[str, Any], shortfall: Float[Array, "N"]) -> dict[str, Any]:
        """See `Strategy.correct_odometry`."""
        known = dict(memory)
        for name, strategy, robots in self._each(len(shortfall)):
            own = strategy.correct_odometry(_of(memory[name], robots), shortfall[robots])
            known[name] = _placed(own, robots, len(shortfall))
        return known

    def act(self, memory: dict[str, Any], observation: Observation, key: Array) -> tuple[dict[str, Any], Command]:
        """See `Strategy.act`."""
        n_robots, commands, next_memory = len(observation.waits), [], {}
        for k, (name, strategy, robots) in enumerate(self._each(n_robots)):
            own = _of(memory[name], robots), _seen(strategy, observation, robots), jax.random.fold_in(key, k)
            after, command = strategy.act(*own)
            next_memory[name] = _placed(after, robots, n_robots)
            commands.append(command)
        return next_memory, jax.tree.map(lambda *parts: jnp.concatenate(parts), *commands)


def team_sizes(strategy: Any, n_robots: int) -> dict[str, int]:
    """Return the number of robots of each team by its name; empty without teams."""
    teams = strategy.teams if isinstance(strategy, Teams) else ()
    return dict(zip((team.name for team in teams), strategy.sizes(n_robots) if teams else (), strict=True))


def team_numbers(strategy: Any, n_robots: int) -> Int32[np.ndarray, "N"]:
    """Return the number of each robot's team, from 0; without teams, robots are one."""
    sizes = [*team_sizes(strategy, n_robots).values()] or [n_robots]
    return np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)


def _usable(strategy: Any) -> Any:
    """A strategy that is a pytree, if it need not be made first."""
    if isinstance(strategy, Genome) or makes_strategies(strategy):
        return strategy
    return as_strategy(strategy)


def _in_world(strategy: Any, config: SwarmConfig, robot: Robots, n_robots: int) -> Any:
    """A strategy in a world of this configuration, for so many robots."""
    if isinstance(strategy, Genome):
        n_scouts = round(strategy.fraction_scouts * n_robots)
        return VectorStrategy(rules_of(strategy, config.strategy), n_scouts, config.static, robot)
    made = strategy.for_world(config, robot, n_robots) if makes_strategies(strategy) else strategy
    return as_strategy(made)


def _of(tree: Any, robots: slice) -> Any:
    """Arrays of some robots."""
    return jax.tree.map(lambda a: a[robots], tree)


def _placed(tree: Any, robots: slice, n_robots: int) -> Any:
    """Arrays of some robots among those of N, with 0 for the others."""
    return jax.tree.map(lambda a: jnp.zeros((n_robots, *a.shape[1:]), a.dtype).at[robots].set(a), tree)


def _seen(strategy: Any, observation: Observation, robots: slice) -> Observation:
    """What some robots observe, with the fields of messages that their strategy knows."""
    payload = {name: observation.payload[name] for name, _ in payload_of(strategy).fields}
    return _of(observation._replace(payload=payload), robots)
