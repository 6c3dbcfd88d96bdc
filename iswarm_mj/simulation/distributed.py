"""Processes on several hosts that share the worlds of a run; they communicate only results and faults.

Each process runs its own worlds with its own program. Nothing that JAX compiles spans two processes, since all would
have to start such a program at about the same time, while they may finish their shares hours apart.
"""

import json
import os
import re
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import jax

from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.deadline import ends_within
from iswarm_mj.utils.errors import ConfigError, SimulationFault, UserError

HEARTBEAT_S = 60
"""JAX ends all processes when one has been silent for this long."""
PARTING_S = 900
"""A process that has finished waits this long for the others."""
POLL_S = 2.0
_GIVEN = ("JAX_COORDINATOR_ADDRESS", "JAX_NUM_PROCESSES", "JAX_PROCESS_ID")


@dataclass(frozen=True)
class Hosts:
    """The processes of a job; by default only this one."""

    index: int = 0
    """Index of this process; process 0 writes the results."""
    count: int = 1
    """Number of processes."""

    def share(self, n_worlds: int, recorded: Sequence[int] = ()) -> list[int]:
        """Return the numbers of this process's worlds.

        Args:
            n_worlds: of all processes together.
            recorded: worlds that process 0 has to have.

        Raises:
            ConfigError: there are fewer worlds than processes, or more are recorded than process 0 can have.
        """
        if self.count == 1:
            return list(range(n_worlds))
        check("worlds", n_worlds, f"at least {self.count}, one for each process", n_worlds >= self.count)
        most = -(-n_worlds // self.count)
        allowed = f"at most {most} worlds, the share of the process that writes the results"
        check("record_worlds", tuple(recorded), allowed, len(recorded) <= most)
        order = [*recorded, *(world for world in range(n_worlds) if world not in recorded)]
        each, more = divmod(n_worlds, self.count)
        first = self.index * each + min(self.index, more)
        return sorted(order[first : first + each + (self.index < more)])

    def gathered(self, name: str, mine: Any) -> list[Any]:
        """Contribute a value, wait for those of all processes, and return them in the order of the processes.

        Args:
            name: of the exchange, unique within a job.
            mine: a value that JSON can represent.

        Raises:
            SimulationFault: another process cannot go on.
        """
        if self.count == 1:
            return [mine]
        _service().key_value_set(f"iswarm/{name}/{self.index}", json.dumps(mine))
        return [json.loads(self._waited_for(f"iswarm/{name}/{process}")) for process in range(self.count)]

    def _waited_for(self, key: str) -> str:
        while True:
            try:  # before looking for faults: what all have contributed reaches all
                return _service().blocking_key_value_get(key, round(1e3 * POLL_S))
            except jax.errors.JaxRuntimeError as error:
                if "DEADLINE_EXCEEDED" not in str(error):
                    raise
            self.look()

    def agree(self, settings: dict[str, Any]) -> None:
        """Check that all processes have the same settings; if not, each of them raises.

        Args:
            settings: everything that determines the run, by name, as JSON can represent it.

        Raises:
            UserError: the settings of another process differ.
        """
        first, *others = map(_flat, self.gathered("settings", settings))
        for process, other in enumerate(others, 1):
            names = [name for name in first | other if first.get(name) != other.get(name)]
            if names:
                differences = [f"{name} {other.get(name)} instead of {first.get(name)}" for name in names[:3]]
                more = f" and {len(names) - 3} more" * (len(names) > 3)
                raise UserError(
                    f"process {process} of {self.count} has {', '.join(differences)}{more}, unlike process 0; start "
                    "all processes with the same settings and versions"
                )

    def look(self) -> None:
        """Check that no other process has failed.

        Raises:
            SimulationFault: one of them cannot go on.
        """
        if self.count == 1:
            return
        for _, report in _service().key_value_dir_get("iswarm/fault/"):
            process, reason = json.loads(report)
            if process != self.index:
                raise SimulationFault(f"process {process} of {self.count} failed: {reason}")

    @contextmanager
    def together(self) -> Iterator[None]:
        """Report an error that leaves the block to the other processes, so that they end too."""
        try:
            yield
        except BaseException as error:
            if self.count > 1:
                self._report(_reason(error))
            raise

    def _report(self, reason: str) -> None:
        """Report the failure of this process, if it is the first one and the service still answers."""
        with suppress(jax.errors.JaxRuntimeError):
            _service().key_value_set("iswarm/fault/first", json.dumps((self.index, reason)))


ALONE = Hosts()
"""No other process."""


def join(timeout_s: float) -> Hosts:
    """Join the other processes of a job by `jax.distributed`; must be called before JAX initialises its devices.

    They are found through JAX_COORDINATOR_ADDRESS (host:port of process 0), JAX_NUM_PROCESSES and JAX_PROCESS_ID, or
    through the environment of Slurm, Open MPI or Kubernetes.

    Args:
        timeout_s: how long to wait for the others [s].

    Raises:
        UserError: the environment does not name the others, or they cannot be reached.
    """
    given = _given()
    jax.config.update("jax_enable_preemption_service", False)  # or SIGTERM would not end a process

    def initialize() -> None:
        jax.distributed.initialize(
            *given,
            initialization_timeout=round(timeout_s) + 3600,
            coordinator_bind_address=given[0] if _is_loopback(given[0]) else None,
            heartbeat_timeout_seconds=HEARTBEAT_S,
            shutdown_timeout_seconds=PARTING_S,
        )
        jax.local_devices()  # asks for those of the others

    # JAX aborts the process when its own time limit expires; so that one is longer, and this one decides.
    try:
        answered = ends_within(timeout_s, initialize)
    except Exception as error:
        raise _refusal(str(error).splitlines()[0].rstrip(".")) from None
    if not answered:
        where = f" at {given[0]}" if given[0] else ""
        raise _refusal(f"not all processes{where} answered within {timeout_s:g} s")
    return Hosts(jax.process_index(), jax.process_count())


def _given() -> tuple[str | None, int | None, int | None]:
    """Address, number of processes and number of this one, where the environment gives them.

    Raises:
        UserError: a value is malformed.
    """
    address, count, index = (os.environ.get(name) or None for name in _GIVEN)
    for name, value in zip(_GIVEN[1:], (count, index), strict=True):
        if value is not None and not (value.isascii() and value.isdecimal()):
            raise UserError(f"{name} must be a whole number, with processes counted from 0 (got {value})")
    if address is not None:
        port = re.fullmatch(r".+:([0-9]{1,5})", address)
        if port is None or int(port[1]) > 65535:
            raise UserError(f"{_GIVEN[0]} must be host:port of process 0, such as node1:4321 (got {address})")
        if index is not None and int(index) == 0:
            _check_port("localhost" if _is_loopback(address) else "", int(port[1]))
    return address, None if count is None else int(count), None if index is None else int(index)


def _is_loopback(address: str | None) -> bool:
    """Whether this is an address that only processes of this machine reach, so that the service listens there alone."""
    host = (address or "").rpartition(":")[0].strip("[]")
    return host in ("localhost", "::1") or re.fullmatch(r"127\.[0-9.]+", host) is not None


def _check_port(host: str, port: int) -> None:
    """Check that process 0 can bind the port; JAX 0.10 dies with a segmentation fault where it cannot."""
    try:
        socket.create_server((host, port)).close()
    except OSError as error:
        raise _refusal(f"cannot bind port {port}: {error.strerror}") from None


def _refusal(reason: str) -> UserError:
    return UserError(
        f"cannot join the other processes ({reason}); start all of them with Slurm, Open MPI or Kubernetes, or set "
        f"{_GIVEN[0]}, {_GIVEN[1]} and {_GIVEN[2]}"
    )


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "it was interrupted"
    return str(error) if isinstance(error, (UserError, SimulationFault)) else repr(error)


def _flat(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings by their full names, such as arena.size."""
    found = {}
    for name, value in settings.items():
        found |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return found


def _service() -> Any:
    """Return the client of JAX's coordination service, a store of texts by key.

    It has no public name. The public alternative, `multihost_utils.process_allgather`, is a program that spans the
    processes and needs the same number of devices in each.
    """
    from jax._src.distributed import global_state

    return global_state.client


def devices(count: str) -> list[Any]:
    """Return the devices to use.

    Args:
        count: "all", or how many of the visible ones.

    Raises:
        ConfigError: it is neither, or there are fewer devices.
    """
    visible = jax.local_devices()
    if count == "all":
        return visible
    if not (count.isascii() and count.isdecimal() and len(count) < 10) or not 1 <= int(count) <= len(visible):
        constraint = f"all, or between 1 and {len(visible)}, the number of devices that JAX sees"
        raise ConfigError("devices", count, f"{constraint} ({visible[0].device_kind})")
    return visible[: int(count)]
