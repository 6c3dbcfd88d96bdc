"""What decides about attempts in the swarm: the balance of the forces, or trials on the bench."""

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import GripperConfig
from iswarm_mj.gripper.attempts import Attempts, Decider, Outcomes, by_balance
from iswarm_mj.gripper.bench import attempt_log


def decider_for(gripper: GripperConfig) -> Decider:
    """What decides with these settings."""
    if gripper.resolution == "quasi-static":
        return by_balance
    if gripper.bench == "mjx":
        from iswarm_mj.gripper.bench.batch_trials import by_batch

        return by_batch
    return by_host


def by_host(gripper: GripperConfig, attempts: Attempts) -> Outcomes:
    """Outcomes of trials in MuJoCo's C engine; inside a program of JAX, which calls the host for them.

    Only attempts that are made become trials; a step without any costs a call.
    """
    shape = attempts.lifts.shape
    flags, floats = jax.ShapeDtypeStruct(shape, bool), jax.ShapeDtypeStruct(shape, jnp.float32)
    shapes = Outcomes(flags, flags, flags, floats, floats)

    def call(*arrays: jax.Array) -> Outcomes:
        from iswarm_mj.gripper.bench.swarm_trials import outcomes

        attempts = Attempts(*map(np.asarray, arrays))
        if not (attempts.lifts | attempts.releases).any():
            none = np.zeros(attempts.lifts.shape, bool)
            return Outcomes(none, none, none, none.astype(np.float32), none.astype(np.float32))
        found = outcomes(gripper.release_gap, attempts)
        attempt_log.note(attempts, found)
        return found

    return jax.pure_callback(call, shapes, *attempts, vmap_method="expand_dims")
