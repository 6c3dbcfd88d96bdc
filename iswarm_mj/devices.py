"""The devices and hosts that a batched run is spread over."""

from typing import Any

import jax

from iswarm_mj.errors import UserError


def join_hosts() -> None:
    """Join the other processes of a job over several hosts.

    `jax.distributed` finds them by the cluster's environment (Slurm, Open MPI, Kubernetes, TPU), or by
    JAX_COORDINATOR_ADDRESS, JAX_NUM_PROCESSES and JAX_PROCESS_ID.

    Raises:
        UserError: the others cannot be found.
    """
    import os

    given = {
        "coordinator_address": os.environ.get("JAX_COORDINATOR_ADDRESS"),
        "num_processes": os.environ.get("JAX_NUM_PROCESSES"),
        "process_id": os.environ.get("JAX_PROCESS_ID"),
    }
    numbers = {name: int(value) for name, value in given.items() if value is not None and value.isdigit()}
    try:
        jax.distributed.initialize(
            given["coordinator_address"], numbers.get("num_processes"), numbers.get("process_id")
        )
    except (RuntimeError, ValueError) as error:
        raise UserError(
            f"--hosts was given, but this process could not join the others ({str(error).splitlines()[0]}); start it "
            "by a cluster's launcher, or set JAX_COORDINATOR_ADDRESS, JAX_NUM_PROCESSES and JAX_PROCESS_ID."
        ) from None


def devices(count: str) -> list[Any]:
    """Return the devices to use.

    Args:
        count: "all", or how many of the visible ones.

    Raises:
        UserError: there are not so many, or it is no number.
    """
    visible = jax.devices()
    if count == "all":
        return visible
    if not count.isdigit() or not 1 <= int(count) <= len(visible):
        raise UserError(
            f"--devices was {count}; JAX sees {len(visible)} ({visible[0].device_kind}): give all, or 1 to "
            f"{len(visible)}."
        )
    return visible[: int(count)]
