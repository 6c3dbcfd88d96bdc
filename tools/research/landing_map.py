"""Which balls stay where they land: a map over impact speed and restitution, and shares over the
voltage's cut.

python tools/research/landing_map.py
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import run_trials
from iswarm_mj.gripper.bench.trial import Contacts, Trial, draw
from iswarm_mj.gripper.laws.detachment import BALL_DENSITY, WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT
from iswarm_mj.gripper.laws.restitution import MODULUS_PLATE, sticking_speed

RADIUS = 20e-6
"""Of the ball of a map [m]."""
HEIGHT = 0.1e-6
"""From which balls are thrown [m]; over this the field adds to their speed."""


class Landing(NamedTuple):
    """One cell of the map."""

    speed: float
    """Of the impact [m/s]."""
    restitution: float
    """Without adhesion."""
    stays: bool
    """On the bench, under a voltage that pulls a ball on the plate up."""
    criterion: float
    """Restitution up to which a ball stays, by energy (`capture_restitution`)."""


def capture_restitution(speed: float, sticks_at: float) -> float:
    """Greatest restitution with which a ball stays at its first impact, v_s / v, under a field that
    pulls it away.

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
        voltage: of the tool, 5 um above the ball's top; the ball has the plate's potential from its
            landing on [V].
    """
    places = [(speed, ratio) for speed in speeds for ratio in restitutions]
    trials = [
        Trial(
            RADIUS,
            WORK_TOOL_OBJECT,
            WORK_OBJECT_SUBSTRATE,
            contacts=Contacts(leak=0.0, restitution=ratio),
        )
        for _, ratio in places
    ]
    bench = MujocoBench(trials, 5e-6)
    bench.throw(HEIGHT, np.array([speed for speed, _ in places]))
    watch = bench.move("fall", HEIGHT / min(speeds) + 0.5e-3, 5e-6, voltage)
    sticks_at = float(sticking_speed(WORK_OBJECT_SUBSTRATE, RADIUS, MODULUS_PLATE, BALL_DENSITY))
    return [
        Landing(float(speed), ratio, bool(gap <= 0), capture_restitution(float(speed), sticks_at))
        for speed, (_, ratio), gap in zip(watch.landing_speed, places, watch.gap_plate, strict=True)
    ]


def shares(protocols: Sequence[Protocol], count: int) -> list[tuple[int, int]]:
    """Balls that stay and balls released, of `count` trials with each protocol at 10 % RH."""
    trials = [draw(0, radius, 10.0, i) for i, radius in enumerate(np.linspace(15e-6, 25e-6, count))]
    found = []
    for protocol in protocols:
        (release,) = run_trials(trials, replace(protocol, step_voltage=2.0)).release.values()
        found.append((int(release.landed.sum()), int(np.isfinite(release.voltage).sum())))
    return found


def main() -> None:
    """Print the map and the shares."""
    from scipy.stats import binomtest

    cells = landing_map(
        (0.005, 0.01, 0.02, 0.05, 0.1, 0.15), (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3)
    )
    print("speed [m/s], restitution, stays, restitution up to which it should")
    for cell in cells:
        print(
            f"{cell.speed:.4f}, {cell.restitution:g}, {'yes' if cell.stays else 'no'}, {cell.criterion:.4f}"
        )
    agree = sum(cell.stays == (cell.restitution <= cell.criterion) for cell in cells)
    print(f"{agree} of {len(cells)} as the criterion says")
    cuts = {
        f"cut {1e3 * delay:g} ms after the release": Protocol(cut_delay=delay)
        for delay in (0.0, 0.1e-3, 0.3e-3)
    }
    cuts["held"] = Protocol(after_release="held", flight_limit=5e-3)
    for name, (stay, total) in zip(cuts, shares(list(cuts.values()), 50), strict=True):
        low, high = binomtest(stay, total).proportion_ci(method="exact")
        print(f"{name}: {stay} of {total} stay, {100 * low:.0f} to {100 * high:.0f} %")


if __name__ == "__main__":
    main()
