"""Parameters of the robots' rules that may differ between worlds, as arrays."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.swarm import StrategyConfig
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.constraints import choices

_GENES = {f.name for f in fields(Genome)}


class Rules(NamedTuple):
    """Values of a genome and of a `StrategyConfig`: scalars, or arrays (B,) of B worlds.

    Each field is the parameter of the same name, in its unit. Parameters that are words are stored
    as indices, see `has_interpretation`.
    """

    density_of_robots: Float[Array, "*B"]
    """`Genome.density_of_robots`."""
    fraction_scouts: Float[Array, "*B"]
    """`Genome.fraction_scouts`."""
    p_vector_forget: Float[Array, "*B"]
    """`Genome.p_vector_forget`."""
    use_hop_count: Bool[Array, "*B"]
    """`Genome.use_hop_count`."""
    priority_coll_avoid_dist: Float[Array, "*B"]
    """`Genome.priority_coll_avoid_dist` [sr]."""
    empty_coll_avoid_dist: Float[Array, "*B"]
    """`Genome.empty_coll_avoid_dist` [sr]."""
    loaded_coll_avoid_dist: Float[Array, "*B"]
    """`Genome.loaded_coll_avoid_dist` [sr]."""
    priority_signal_scouts: Bool[Array, "*B"]
    """`Genome.priority_signal_scouts`."""
    priority_signal_loaded: Bool[Array, "*B"]
    """`Genome.priority_signal_loaded`."""
    weight_find_dust: Float[Array, "*B"]
    """`Genome.weight_find_dust`."""
    weight_find_dump: Float[Array, "*B"]
    """`Genome.weight_find_dump`."""
    avoidance_sides: Int[Array, "*B"]
    """`strategy.avoidance_sides` (index of a word)."""
    avoidance_course: Int[Array, "*B"]
    """`strategy.avoidance_course` (index of a word)."""
    priority_repulsion: Int[Array, "*B"]
    """`strategy.priority_repulsion` (index of a word)."""
    avoids_at_dust: Bool[Array, "*B"]
    """`strategy.avoids_at_dust`."""
    random_turn: Float[Array, "*B"]
    """`strategy.random_turn` [deg]."""
    scouts_pick: Bool[Array, "*B"]
    """`strategy.scouts_pick`."""
    avoidance_gain: Float[Array, "*B"]
    """`strategy.avoidance_gain`."""
    priority_factor: Float[Array, "*B"]
    """`strategy.priority_factor`."""
    wall_gain: Float[Array, "*B"]
    """`strategy.wall_gain`."""
    forget_on_arrival: Bool[Array, "*B"]
    """`strategy.forget_on_arrival`."""
    odometry_error_turn: Float[Array, "*B"]
    """`strategy.odometry_error_turn` [deg]."""
    odometry_error_step: Float[Array, "*B"]
    """`strategy.odometry_error_step`."""


def has_interpretation(rules: Rules, name: str, word: str) -> Bool[Array, "*B"]:
    """Return whether the rules interpret an ambiguous statement of the paper in this way.

    Args:
        rules: rules of one world, or of B worlds.
        name: field of `StrategyConfig` that allows several words, as "avoidance_course".
        word: one of them, as "crossing".
    """
    return getattr(rules, name) == choices(StrategyConfig, name).index(word)


def rules_of(genome: Genome, strategy: StrategyConfig | None = None) -> Rules:
    """Return the rules of one world, as JAX scalars.

    Arrays, unlike Python numbers, let other values run without another compilation.

    Args:
        genome: evolved parameters.
        strategy: interpretations of the paper; None for the defaults.
    """
    of_one_world = rules_of_worlds([genome], [strategy or StrategyConfig()])
    return jax.tree.map(lambda column: jnp.asarray(column[0]), of_one_world)


def rules_of_worlds(genomes: Sequence[Genome], strategies: Sequence[StrategyConfig]) -> Rules:
    """Return the rules of B worlds: Boolean, float32 and int32 arrays (B,)."""
    columns = {}
    for name in Rules._fields:
        sources: Sequence[Any] = genomes if name in _GENES else strategies
        columns[name] = _column(name, [getattr(source, name) for source in sources])
    return Rules(**columns)


def _column(name: str, values: Sequence[Any]) -> np.ndarray:
    """Return the values of a parameter in B worlds as an array.

    A word is stored as its index among the words that the parameter allows.
    """
    words = choices(StrategyConfig, name)
    if words:
        return np.array([words.index(value) for value in values], np.int32)
    dtype = bool if isinstance(values[0], bool) else np.float32
    return np.array(values, dtype)
