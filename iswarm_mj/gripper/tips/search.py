"""Search for the tip with the lowest voltages, by CMA-ES over profiles that can be made.

A profile is a chain of arcs from the axis, described by numbers from 0 to 1: the heading at the end
of each arc and the arc's length. Arcs that turn more sharply than the least radius of curvature are
lengthened; the chain ends in an arc of that radius that turns it up into the wall, at the greatest
radius or within it. So all profiles keep both limits. Profiles above the greatest height cost more
than any other. The field and the hold of the ball are kept by penalties.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.tips.profile import Profile, chain_of
from iswarm_mj.gripper.tips.voltages import (
    AIR_STRENGTH,
    Conditions,
    forces_of,
    misplaced,
    voltages_of,
)
from iswarm_mj.utils.constraints import Within, check, validate
from iswarm_mj.utils.pool import unordered

_STEEPEST = math.radians(75)
"""Steepest heading of an arc [rad]."""
_SHORTEST, _LONGEST = 0.3e-6, 12e-6
"""Lengths of arcs, before they are lengthened [m]."""
_PENALTY = 200.0
"""Voltage that an excess over a limit by its own size costs [V]."""
_MOST_VOLTAGE = 2000.0
"""Voltage above which no further volt costs anything [V]."""
_TOO_HIGH = 1e6
"""Cost from which profiles above the greatest height begin, and at which that of others ends [V]."""
_SIGMA = 0.25
"""Standard deviation of the first generation, as a share of the ranges."""


@dataclass(frozen=True)
class Limits:
    """Limits of manufacture and of use, in SI units."""

    curvature_radius: Annotated[float, Within(0.2e-6, 20e-6, "m")] = 2e-6
    """Least radius of curvature, of bumps and hollows alike [m]."""
    radius: Annotated[float, Within(5e-6, 80e-6, "m")] = 13e-6
    """Greatest radius of the tip [m]."""
    height: Annotated[float, Within(0.5e-6, 30e-6, "m")] = 10e-6
    """Greatest height of the face from its lowest to its highest point [m]."""
    hold: Annotated[float, Within(1.0, 100.0)] = 8.0
    """Least adhesion to the tool over the ball's weight, so that the ball stays at the tool while it
    is carried; a choice: the bench's greatest acceleration takes 5, and spreads the rest."""
    field: Annotated[float, Within(1e6, 1e10, "V/m")] = AIR_STRENGTH
    """Greatest field at the release; by default that which breaks down air in gaps below 1 um
    [V/m]."""
    misplacement: Annotated[float, Within(0, 5e-6, "m")] = 0.0
    """Misplacement of the balls from the tip's axis up to which the voltages count [m]."""
    arcs: Annotated[int, Within(2, 12)] = 5
    """Number of arcs of a profile."""

    def __post_init__(self):
        validate(self, "limits")
        fits = 2 * self.curvature_radius <= self.radius
        rule = "at most half of `limits.radius`"
        check("limits.curvature_radius", self.curvature_radius, rule, fits)


class Candidate(NamedTuple):
    """A profile of the search."""

    numbers: tuple[float, ...]
    """Headings and lengths of its arcs, 0 to 1."""
    cost: float
    """Highest voltage, plus penalties; above `_TOO_HIGH` if the profile cannot be made [V]."""
    voltage: float
    """Highest of the voltages of grasp and release of all balls [V]."""


def profile_of(numbers: Float[np.ndarray, "2k"], limits: Limits) -> Profile:
    """Return the profile that numbers from 0 to 1 describe.

    Args:
        numbers: headings at the ends of the k arcs, 0.5 for level; then their lengths.
        limits: of manufacture.
    """
    n_arcs = len(numbers) // 2
    headings = (2 * np.asarray(numbers[:n_arcs]) - 1) * _STEEPEST
    lengths = _SHORTEST * (_LONGEST / _SHORTEST) ** np.asarray(numbers[n_arcs:])
    edge = limits.curvature_radius

    pieces: list[tuple[float, float]] = []
    heading = 0.0
    r = 0.0
    for end_heading, given_length in zip(headings, lengths, strict=True):
        turn = end_heading - heading
        length = max(given_length, abs(turn) * edge)
        curvature = turn / length
        room = _room_for(r, heading, length, curvature, limits)
        is_last = room < length
        if room > 0:
            pieces.append((room, curvature))
            r += _advance(heading, room, curvature)
            heading += room * curvature
        if is_last:
            break

    pieces.append((edge * (math.pi / 2 - heading), 1 / edge))
    apex_curvature = pieces[0][1]
    return Profile("optimised", chain_of(pieces), apex_curvature)


def _advance(heading: float, length: Any, curvature: float) -> Any:
    """Return by how much r grows along an arc."""
    half_turn = curvature * length / 2
    return length * np.sinc(half_turn / np.pi) * np.cos(heading + half_turn)


def _room_for(r: float, heading: float, length: float, curvature: float, limits: Limits) -> float:
    """Return the length of an arc at which the final arc still ends within the greatest radius.

    It is the whole length if all of it fits, and 0 if next to nothing does.
    """
    way = np.linspace(0, length, 400)
    end_heading = heading + curvature * way
    final_advance = limits.curvature_radius * (1 - np.sin(end_heading))
    reach = r + _advance(heading, way, curvature) + final_advance
    is_beyond = reach > limits.radius
    is_beyond[0] = False
    if not is_beyond.any():
        return length
    return float(way[int(is_beyond.argmax()) - 1])


def cost_of(
    numbers: tuple[float, ...], balls: tuple[Conditions, ...], gap: float, limits: Limits
) -> Candidate:
    """Return a profile's highest voltage and its cost.

    Args:
        numbers: see `profile_of`.
        balls: conditions of each ball that the tip is for.
        gap: between ball and plate at the release [m].
        limits: of manufacture and use.
    """
    profile = profile_of(np.array(numbers), limits)
    if profile.height > limits.height:  # it cannot be made, and needs no forces
        return Candidate(numbers, _TOO_HIGH * profile.height / limits.height, math.inf)

    excess = 0.0
    highest = 0.0
    for conditions in balls:
        on_axis = forces_of(profile, conditions, gap, halvings=0)
        all_forces = [on_axis]
        if limits.misplacement > 0:
            all_forces.append(misplaced(profile, on_axis, conditions, limits.misplacement))
        for forces in all_forces:
            voltages = voltages_of(forces, conditions)
            highest = max(highest, voltages.higher)
            excess += max(0.0, limits.hold / voltages.holds - 1)
            excess += max(0.0, voltages.release_field / limits.field - 1)

    # A field that pulls the ball back to the tip makes voltage and excess infinite.
    cost = min(highest, _MOST_VOLTAGE) + _PENALTY * excess
    return Candidate(numbers, min(cost, _TOO_HIGH), highest)


def search(
    balls: tuple[Conditions, ...],
    gap: float,
    limits: Limits,
    *,
    generations: int,
    population: int,
    seed: int,
    workers: int = 0,
    note: Callable[[list[Candidate]], None] = lambda candidates: None,
) -> tuple[Candidate, list[float]]:
    """Return the best profile of a search, and the lowest cost after each generation [V].

    Args:
        balls: conditions of each ball that the tip is for.
        gap: between ball and plate at the release [m].
        limits: of manufacture and use.
        generations: number of generations.
        population: profiles of a generation.
        seed: of the search.
        workers: processes; the result does not depend on it.
        note: called with each generation.
    """
    from cmaes import CMA  # it imports scipy.stats, which takes long

    n_numbers = 2 * limits.arcs
    bounds = np.tile([0.0, 1.0], (n_numbers, 1))
    strategy = CMA(
        mean=np.full(n_numbers, 0.5),
        sigma=_SIGMA,
        bounds=bounds,
        seed=seed,
        population_size=population,
    )
    best = Candidate((), math.inf, math.inf)
    history = []
    for _ in range(generations):
        asked = [tuple(strategy.ask().tolist()) for _ in range(population)]
        jobs: Iterable[tuple[Any, ...]] = [(each, balls, gap, limits) for each in asked]
        by_numbers = {each.numbers: each for each in unordered(cost_of, jobs, workers)}
        candidates = [by_numbers[each] for each in asked]
        strategy.tell([(np.array(each.numbers), each.cost) for each in candidates])

        best = min([best, *candidates], key=lambda each: each.cost)
        history.append(best.cost)
        note(candidates)
        if strategy.should_stop():
            break
    return best, history
