"""Settings of a run."""

from dataclasses import dataclass
from typing import Annotated

from iswarm_mj.utils.constraints import Within, check, validate


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run of B worlds; world w of seed s has its own random numbers."""

    n_robots: Annotated[int, Within(1)]
    """Number of robots N in the largest world."""
    steps: Annotated[int, Within(1, 1_000_000)]
    """Maximum number of control steps."""
    seed: Annotated[int, Within(0, 2**32 - 2)] = 0
    """Seed of all random numbers."""
    n_worlds: Annotated[int, Within(1)] = 1
    """Number B of independent worlds, simulated at once."""
    stop_at: Annotated[int | None, Within(1)] = None
    """Progress of the task that finishes a world, in cleaning the number of balls delivered; None
    for the task's goal."""
    failed_fraction: Annotated[float, Within(0, 1)] = 0.0
    """Share of robots that are dead from the start and only stand in the way."""
    failing: str | None = None
    """Share of the robots that fail, and the control step at which they do, as `0.1:400`."""
    capacity: Annotated[int | None, Within(1)] = None
    """Robots for which compiled programs have room, at least `n_robots`; None for exactly those.

    Runs with the same capacity share a compiled program, whatever their number of robots.
    """
    record_worlds: tuple[int, ...] = (0,)
    """Worlds whose steps `Run.advance` returns."""

    def __post_init__(self):
        validate(self)
        if self.capacity is not None:
            has_room = self.capacity >= self.n_robots
            check("capacity", self.capacity, "at least the number of robots", has_room)

        recorded = self.record_worlds
        allowed = f"distinct worlds from 0 to {self.n_worlds - 1}"
        are_worlds = isinstance(recorded, tuple) and all(
            world in range(self.n_worlds) for world in recorded
        )
        if self.n_worlds == 1:
            allowed = "0, the only world"
        are_distinct = are_worlds and len(set(recorded)) == len(recorded)
        check("record_worlds", recorded, allowed, are_distinct)
