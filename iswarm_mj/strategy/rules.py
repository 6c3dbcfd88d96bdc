"""The parameters of the robots' rules that may differ from world to world: genome and readings, as arrays."""

from collections import namedtuple
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from iswarm_mj.config import StrategyConfig
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.constraints import choices

NON_STRATEGY_FIELDS = {"dust_range", "error_in_sensing", "message_range", "update_order"}
"""Settings of `StrategyConfig` that sensors and channel apply."""

_FIELDS = [(cls, f) for cls in (Genome, StrategyConfig) for f in fields(cls) if f.name not in NON_STRATEGY_FIELDS]

Rules = namedtuple("Rules", [f.name for _, f in _FIELDS])
"""Values of a genome and of a `StrategyConfig`, as scalars or as arrays (B,) of worlds: flags as bool, numbers as
float32, and one of several words as int32, its place among them."""

_CODES = {f.name: choices(cls, f.name) for cls, f in _FIELDS}
_TYPES = [bool if f.type is bool else np.int32 if _CODES[f.name] else np.float32 for _, f in _FIELDS]


def reads(rules: Any, name: str, word: str) -> Bool[Array, "*B"]:
    """Whether rules have this word of the several that a reading may have."""
    return getattr(rules, name) == _CODES[name].index(word)


def rules_of(genome: Genome, strategy: StrategyConfig | None = None) -> Rules:
    """Return the rules as JAX scalars, so that others need no compilation; the readings are the default's if None."""
    return Rules(*(jnp.asarray(column[0]) for column in rules_of_worlds([genome], [strategy or StrategyConfig()])))


def rules_of_worlds(genomes: Sequence[Genome], strategies: Sequence[StrategyConfig]) -> Rules:
    """Return the rules of B worlds, NumPy arrays (B,)."""
    parts = {Genome: genomes, StrategyConfig: strategies}
    columns = {f.name: [getattr(one, f.name) for one in parts[cls]] for cls, f in _FIELDS}
    coded = ([codes.index(v) for v in columns[name]] if codes else columns[name] for name, codes in _CODES.items())
    return Rules(*(np.array(column, kind) for column, kind in zip(coded, _TYPES, strict=True)))
