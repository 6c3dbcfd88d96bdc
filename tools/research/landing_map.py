"""Print which balls stay where they land.

    python tools/research/landing_map.py

It prints a map over impact speed and restitution, and shares of balls over how long after the
release the voltage is cut.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import run_trials
from iswarm_mj.gripper.bench.trial import Contacts, Trial, draw
from iswarm_mj.gripper.laws.detachment import BALL_DENSITY, WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT
from iswarm_mj.gripper.laws.restitution import MODULUS_PLATE, sticking_speed

RADIUS = 20e-6
"""Radius of the balls of a map [m]."""
HEIGHT = 0.1e-6
"""Height from which balls are thrown [m]; over this the field adds to their speed."""
TOOL_GAP = 5e-6
"""Distance of the tool above a ball's top [m]."""
SPEEDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.15)
"""Speeds of impact of the map [m/s]."""
RESTITUTIONS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3)
"""Restitutions of the map, without adhesion."""
CUT_DELAYS = (0.0, 0.1e-3, 0.3e-3)
"""Times after the release at which the voltage is cut [s]."""
N_TRIALS = 50
"""Number of trials of each protocol."""


class Landing(NamedTuple):
    """One cell of the map."""

    speed: float
    """Speed of the impact [m/s]."""
    restitution: float
    """Restitution without adhesion."""
    stays: bool
    """Whether the ball stays on the bench, under a voltage that pulls it up."""
    criterion: float
    """Restitution up to which a ball stays, by energy (`capture_restitution`)."""


class Share(NamedTuple):
    """Result of trials with one protocol."""

    n_staying: int
    """Number of balls that stay where they land."""
    n_released: int


def capture_restitution(speed: float, sticks_at: float) -> float:
    """Return the greatest restitution with which a ball stays at its first impact, v_s / v.

    The field pulls the ball away.

    Args:
        speed: speed v of the impact [m/s].
        sticks_at: speed v_s below which adhesion holds a ball [m/s].

    Source: `contact.rebound_ratio`.
    """
    return sticks_at / speed


def landing_map(
    speeds: Sequence[float], restitutions: Sequence[float], voltage: float = 42.0
) -> list[Landing]:
    """Throw balls at the plate beneath a live tool.

    Args:
        speeds: with which they are thrown [m/s].
        restitutions: without adhesion.
        voltage: of the tool; the ball has the plate's potential from its landing on [V].
    """
    cells = [(speed, restitution) for speed in speeds for restitution in restitutions]
    trials = []
    for _, restitution in cells:
        contacts = Contacts(leak=0.0, restitution=restitution)
        trials.append(Trial(RADIUS, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=contacts))

    bench = MujocoBench(trials, TOOL_GAP)
    bench.throw(HEIGHT, np.array([speed for speed, _ in cells]))
    duration = HEIGHT / min(speeds) + 0.5e-3
    watch = bench.move("fall", duration, TOOL_GAP, voltage)

    sticks_at = float(sticking_speed(WORK_OBJECT_SUBSTRATE, RADIUS, MODULUS_PLATE, BALL_DENSITY))
    landings = []
    for (_, restitution), landing_speed, gap in zip(
        cells, watch.landing_speed, watch.gap_plate, strict=True
    ):
        speed = float(landing_speed)
        criterion = capture_restitution(speed, sticks_at)
        landings.append(Landing(speed, restitution, bool(gap <= 0), criterion))
    return landings


def shares(protocols: Sequence[Protocol], n_trials: int) -> list[Share]:
    """Return how many balls stay with each protocol, at 10 % RH."""
    radii = np.linspace(15e-6, 25e-6, n_trials)
    trials = [draw(0, radius, 10.0, number) for number, radius in enumerate(radii)]
    results = []
    for protocol in protocols:
        (release,) = run_trials(trials, replace(protocol, step_voltage=2.0)).release.values()
        n_released = int(np.isfinite(release.voltage).sum())
        results.append(Share(int(release.landed.sum()), n_released))
    return results


def print_map() -> None:
    """Print the cells of the map, and how many are as the criterion says."""
    landings = landing_map(SPEEDS, RESTITUTIONS)
    print("speed [m/s], restitution, stays, restitution up to which it should")
    for landing in landings:
        stays = "yes" if landing.stays else "no"
        print(f"{landing.speed:.4f}, {landing.restitution:g}, {stays}, {landing.criterion:.4f}")
    n_agreeing = sum(
        landing.stays == (landing.restitution <= landing.criterion) for landing in landings
    )
    print(f"{n_agreeing} of {len(landings)} as the criterion says")


def print_shares() -> None:
    """Print the shares of balls that stay, with 95 % intervals."""
    protocols = {}
    for delay in CUT_DELAYS:
        protocols[f"cut {1e3 * delay:g} ms after the release"] = Protocol(cut_delay=delay)
    protocols["held"] = Protocol(after_release="held", flight_limit=5e-3)

    results = shares(list(protocols.values()), N_TRIALS)
    for name, share in zip(protocols, results, strict=True):
        test = binomtest(share.n_staying, share.n_released)
        low, high = test.proportion_ci(method="exact")
        interval = f"{100 * low:.0f} to {100 * high:.0f} %"
        print(f"{name}: {share.n_staying} of {share.n_released} stay, {interval}")


def main() -> None:
    """Print the map and the shares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.parse_args()
    print_map()
    print_shares()


if __name__ == "__main__":
    main()
