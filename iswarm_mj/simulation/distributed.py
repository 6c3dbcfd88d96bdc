"""Processes on several hosts that share the worlds of a run; they meet only to hand in results and to report faults.

Each computes its own worlds by a program of its own. Nothing that JAX compiles spans two processes: all have to start
such a program at about the same time, while they may be through with their shares hours apart.
"""

import json
import os
import re
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import jax

from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import SimulationFault, UserError

HEARTBEAT_S = 60
"""JAX ends all processes when one has been silent for so long."""
PARTING_S = 900
"""For so long a process that is through waits for the others to be."""
POLL_S = 2.0
_GIVEN = ("JAX_COORDINATOR_ADDRESS", "JAX_NUM_PROCESSES", "JAX_PROCESS_ID")


@dataclass(frozen=True)
class Hosts:
    """The processes of a job; by default this one alone."""

    index: int = 0
    """Number of this process; 0 writes the results."""
    count: int = 1
    """Number of processes."""

    def share(self, n_worlds: int, recorded: Sequence[int] = ()) -> list[int]:
        """Return the numbers of this process's worlds.

        Args:
            n_worlds: of all processes together.
            recorded: worlds that process 0 has to have.

        Raises:
            UserError: there are fewer worlds than processes, or more are recorded than process 0 can have.
        """
        if self.count == 1:
            return list(range(n_worlds))
        check("worlds", n_worlds, f"at least {self.count}, one for each process", n_worlds >= self.count)
        most = -(-n_worlds // self.count)
        said = f"at most {most} worlds, the share of the process that writes the results"
        check("record_worlds", tuple(recorded), said, len(recorded) <= most)
        order = [*recorded, *(world for world in range(n_worlds) if world not in recorded)]
        each, more = divmod(n_worlds, self.count)
        first = self.index * each + min(self.index, more)
        return sorted(order[first : first + each + (self.index < more)])

    def gathered(self, name: str, mine: Any) -> list[Any]:
        """Hand something in, wait until all processes have, and return what they handed in, in their order.

        Args:
            name: of the occasion, another each time.
            mine: what JSON can hold.

        Raises:
            SimulationFault: another process cannot go on.
        """
        if self.count == 1:
            return [mine]
        _service().key_value_set(f"iswarm/{name}/{self.index}", json.dumps(mine))
        return [json.loads(self._waited_for(f"iswarm/{name}/{process}")) for process in range(self.count)]

    def _waited_for(self, key: str) -> str:
        while True:
            try:  # before others are looked for: what all have handed in reaches all
                return _service().blocking_key_value_get(key, round(1e3 * POLL_S))
            except jax.errors.JaxRuntimeError as error:
                if "DEADLINE_EXCEEDED" not in str(error):
                    raise
            self.look()

    def agree(self, settings: dict[str, Any]) -> None:
        """See that all processes were given the same; each of them finds out if not.

        Args:
            settings: what decides the run, by names, as JSON can hold it.

        Raises:
            UserError: another process was given something else.
        """
        first, *others = map(_flat, self.gathered("settings", settings))
        for process, other in enumerate(others, 1):
            names = [name for name in first | other if first.get(name) != other.get(name)]
            if names:
                differences = [f"{name} {other.get(name)} instead of {first.get(name)}" for name in names[:3]]
                more = f" and {len(names) - 3} more" * (len(names) > 3)
                raise UserError(
                    f"--hosts was given, but process {process} of {self.count} has {', '.join(differences)}{more}, "
                    "unlike process 0; start all of them with the same settings and versions."
                )

    def look(self) -> None:
        """See whether the other processes are well.

        Raises:
            SimulationFault: one of them cannot go on.
        """
        if self.count == 1:
            return
        for _, said in _service().key_value_dir_get("iswarm/fault/"):
            process, reason = json.loads(said)
            if process != self.index:
                raise SimulationFault(f"process {process} of {self.count} could not go on: {reason}")

    @contextmanager
    def together(self) -> Iterator[None]:
        """Let the other processes know if the block ends by an error, so that they end too."""
        try:
            yield
        except BaseException as error:
            if self.count > 1:
                self._report(_reason(error))
            raise

    def _report(self, reason: str) -> None:
        """Report the fault of this process, if it is the first and the service is still there."""
        with suppress(jax.errors.JaxRuntimeError):
            _service().key_value_set("iswarm/fault/first", json.dumps((self.index, reason)))


ALONE = Hosts()
"""No other process."""


def join(timeout_s: float) -> Hosts:
    """Join the other processes of a job, by `jax.distributed`; to be called before JAX sees its devices.

    They are found by JAX_COORDINATOR_ADDRESS (host:port of process 0), JAX_NUM_PROCESSES and JAX_PROCESS_ID, or by what
    Slurm, Open MPI or Kubernetes tell a process.

    Args:
        timeout_s: for how long to wait for the others.

    Raises:
        UserError: nothing tells of the others, or they cannot be reached.
    """
    given = _given()
    jax.config.update("jax_enable_preemption_service", False)  # or SIGTERM would not end a process
    failures: list[Exception] = []

    def initialize() -> None:
        try:
            jax.distributed.initialize(
                *given,
                initialization_timeout=round(timeout_s) + 3600,
                heartbeat_timeout_seconds=HEARTBEAT_S,
                shutdown_timeout_seconds=PARTING_S,
            )
            jax.local_devices()  # asks for those of the others
        except Exception as error:
            failures.append(error)

    # JAX aborts the process when its own time limit is over; so that one is longer, and this one counts.
    attempt = threading.Thread(target=initialize, daemon=True)
    attempt.start()
    attempt.join(timeout_s)
    if attempt.is_alive():
        where = f" at {given[0]}" if given[0] else ""
        raise _refusal(f"not all of the processes{where} were there within {timeout_s:g} s")
    if failures:
        raise _refusal(str(failures[0]).splitlines()[0].rstrip("."))
    return Hosts(jax.process_index(), jax.process_count())


def _given() -> tuple[str | None, int | None, int | None]:
    """Address, number of processes and number of this one, where the environment gives them.

    Raises:
        UserError: they are not what they should be.
    """
    address, count, index = (os.environ.get(name) or None for name in _GIVEN)
    for name, value in zip(_GIVEN[1:], (count, index), strict=True):
        if value is not None and not (value.isascii() and value.isdecimal()):
            raise UserError(f"{name} was {value}; it must be a whole number, processes counted from 0: set it anew.")
    if address is not None:
        port = re.fullmatch(r".+:([0-9]{1,5})", address)
        if port is None or int(port[1]) > 65535:
            raise UserError(
                f"{_GIVEN[0]} was {address}; it must be host:port of process 0, as node1:4321: set it anew."
            )
        if index is not None and int(index) == 0:
            _see_that_it_is_free(int(port[1]))
    return address, None if count is None else int(count), None if index is None else int(index)


def _see_that_it_is_free(port: int) -> None:
    """See that process 0 can listen there; JAX 0.10 dies with a segmentation fault where it cannot."""
    try:
        socket.create_server(("", port)).close()
    except OSError as error:
        raise _refusal(f"port {port} cannot be listened at: {error.strerror}") from None


def _refusal(reason: str) -> UserError:
    return UserError(
        f"--hosts was given, but this process could not join the others ({reason}); start all of them by Slurm, Open "
        f"MPI or Kubernetes, or with {_GIVEN[0]}, {_GIVEN[1]} and {_GIVEN[2]}."
    )


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "it was interrupted"
    return str(error) if isinstance(error, (UserError, SimulationFault)) else repr(error)


def _flat(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Settings within settings by their full names, as arena.size."""
    found = {}
    for name, value in settings.items():
        found |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return found


def _service() -> Any:
    """Return JAX's coordination service, which keeps texts by keys.

    It has no public name. What has one, `multihost_utils.process_allgather`, is a program that spans the processes, and
    wants as many devices of each.
    """
    from jax._src.distributed import global_state

    return global_state.client


def devices(count: str) -> list[Any]:
    """Return the devices to use.

    Args:
        count: "all", or how many of the visible ones.

    Raises:
        UserError: there are not so many, or it is no number.
    """
    visible = jax.local_devices()
    if count == "all":
        return visible
    if not (count.isascii() and count.isdecimal()) or not 1 <= int(count) <= len(visible):
        raise UserError(
            f"--devices was {count}; JAX sees {len(visible)} ({visible[0].device_kind}): give all, or 1 to "
            f"{len(visible)}."
        )
    return visible[: int(count)]
