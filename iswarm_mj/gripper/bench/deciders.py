"""Deciders of attempts in the swarm by trials on the bench."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap

from iswarm_mj.config import GripperConfig
from iswarm_mj.gripper.attempts import Attempts, Decider, Outcomes
from iswarm_mj.utils.arrays import Array


def decider_for(gripper: GripperConfig) -> Decider:
    """The decider by trials that these settings name."""
    if gripper.bench == "mjx":
        from iswarm_mj.gripper.bench.batch_trials import by_batch

        return by_batch
    return by_host


def by_host(gripper: GripperConfig, attempts: Attempts) -> Outcomes:
    """Outcomes of trials in MuJoCo's C engine, by a callback from a program of JAX.

    The callback is skipped in steps in which no world makes an attempt. All numbers go as one array and come back as
    one, since each array costs time.
    """

    def call(numbers: jax.Array) -> np.ndarray:
        from iswarm_mj.gripper.bench.swarm_trials import outcomes

        lifts, releases, *others = np.asarray(numbers)
        found = outcomes(gripper.release_gap, Attempts(lifts > 0, releases > 0, *others))
        return np.stack(found).astype(np.float32)

    def on_host(numbers: Array) -> Array:
        return jax.pure_callback(call, _places(numbers), numbers)

    @custom_vmap
    def decide(numbers: Array) -> Array:
        return jax.lax.cond(numbers[:2].any(), on_host, lambda a: jnp.zeros_like(a, shape=_places(a).shape), numbers)

    @decide.def_vmap
    def _(count: int, is_batched: list[bool], numbers: Array) -> tuple[Array, bool]:
        del count, is_batched
        return jnp.moveaxis(decide(jnp.moveaxis(numbers, 0, 1)), 1, 0), True

    lifted, released, postponed, *others = decide(jnp.stack([jnp.asarray(a, jnp.float32) for a in attempts]))
    return Outcomes(lifted > 0, released > 0, postponed > 0, *others)


def _places(numbers: Array) -> jax.ShapeDtypeStruct:
    """Shape (5, ..., K) of the outcomes of attempts (7, ..., K)."""
    return jax.ShapeDtypeStruct((len(Outcomes._fields), *numbers.shape[1:]), jnp.float32)
