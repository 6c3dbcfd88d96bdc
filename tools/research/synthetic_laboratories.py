"""Fit tables of laboratories whose works of adhesion are known, and count how often intervals hold.

    python tools/research/synthetic_laboratories.py

Each laboratory draws its works, their spreads and its table: 5 to 60 rows at two humidities, of
single balls or means of five, half of the tables without releases, and with voltages beyond the
limit of its supply as bounds. Balls draw log-normal works, as on the bench. Afterwards the
laboratory makes the measurement that its fit proposes.
"""

import argparse
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.fitting.estimate import Interval
from iswarm_mj.gripper.fitting.fit import NO_CONTACT_GAP, Fit, difference_of_works, fit
from iswarm_mj.gripper.laws.adhesion import HUMIDITY_DOUBLING, humidity_factor
from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage, scattered_work

HEADER = ("kind", "radius [um]", "humidity [%]", "voltage [V]", "repeats", "gap [um]")
RADII = (15.0, 20.0, 25.0)
"""Radii of the balls [um]."""
WORKS = ("work_tool_object", "work_object_substrate")
QUARTILES = (0.25, 0.5, 0.75)


class Laboratory(NamedTuple):
    """A laboratory and what is true there."""

    truth: dict[str, float]
    """Parameters in SI."""
    limit: float
    """Greatest voltage of its supply [V]."""
    rows: list[tuple]
    """Its table."""
    random: np.random.Generator

    def measure(self, kind: str, radius: float, humidity: float, repeats: int) -> tuple:
        """Return a row: the mean voltage of balls, or that none moved up to the limit.

        Args:
            kind: "grasp", "release", or "no_contact" at 1 um.
            radius: of the balls [um].
            humidity: relative humidity [%].
            repeats: number of balls.
        """
        truth = self.truth
        normal = self.random.standard_normal((2, repeats))
        factor = humidity_factor(humidity)
        work_tool = factor * scattered_work(
            truth["work_tool_object"], truth["spread_tool_object"], normal[0]
        )
        work_plate = factor * scattered_work(
            truth["work_object_substrate"], truth["spread_object_substrate"], normal[1]
        )
        if kind == "grasp":
            voltages = grasp_voltage(radius * 1e-6, work_tool, work_plate)
        elif kind == "release":
            voltages = release_voltage(radius * 1e-6, work_tool)
        else:
            voltages = grasp_voltage(radius * 1e-6, 0.0, work_plate, NO_CONTACT_GAP)
        gap = {"release": 5.0, "no_contact": NO_CONTACT_GAP * 1e6}.get(kind, "")
        # The supply of a laboratory with repeats has no limit: means leave out no ball.
        if repeats == 1 and voltages.item() > self.limit:
            return (kind, radius, humidity, f">{self.limit:g}", 1, gap)
        return (kind, radius, humidity, f"{np.mean(voltages):.2f}", repeats, gap)


def laboratory(seed: int) -> Laboratory:
    """Return a laboratory with its table."""
    random = np.random.default_rng([20260, seed])
    work_tool = math.exp(random.uniform(math.log(0.5e-3), math.log(5e-3)))
    work_difference = math.exp(random.uniform(math.log(5e-3), math.log(30e-3)))
    truth = {
        "work_tool_object": work_tool,
        "work_object_substrate": work_tool + work_difference,
        "spread_tool_object": random.uniform(0.08, 0.25),
        "spread_object_substrate": random.uniform(0.08, 0.25),
        "humidity_doubling": HUMIDITY_DOUBLING,
    }
    lab = Laboratory(truth, limit=60.0, rows=[], random=random)
    n_rows = int(random.integers(5, 61))
    humidities = (10.0, float(random.choice([30.0, 50.0])))
    share_of_releases = float(random.choice([0.0, 0.4]))
    repeats = int(random.choice([1, 5]))
    for _ in range(n_rows):
        kind = "release" if random.random() < share_of_releases else "grasp"
        radius = float(random.choice(RADII))
        lab.rows.append(lab.measure(kind, radius, float(random.choice(humidities)), repeats))
    return lab


def fit_rows(rows: list[tuple]) -> Fit:
    """Return the fit of a table."""
    return fit([dict(zip(HEADER, row, strict=True)) for row in rows])


class Verdict(NamedTuple):
    """What the fit of one laboratory says, and what is true."""

    n_rows: int
    n_releases: int
    """Number of measured releases."""
    covered: dict[str, bool]
    """The interval of a quantity contains its true value."""
    determined: dict[str, bool]
    """The fit calls a work of adhesion determined."""
    p_values: dict[str, float]
    """Tests of the law's dependence on radius and humidity, which holds here."""
    predicted_width: float
    """Width of the target's interval that the proposal predicts, in logarithms."""
    width: float
    """That width once the laboratory has made the proposed measurement."""
    width_before: float


def judge(seed: int) -> Verdict:
    """Return the verdict on a laboratory.

    Args:
        seed: number of the laboratory.
    """
    lab = laboratory(seed)
    fitted = fit_rows(lab.rows)

    covered = {
        name: contains(estimate.interval, lab.truth[name])
        for name, estimate in fitted.estimates.items()
    }
    covered["difference"] = contains(fitted.difference.interval, difference_of_works(lab.truth))
    for humidity in (10.0, 50.0):
        work = lab.truth["work_tool_object"] * humidity_factor(humidity)
        spread = lab.truth["spread_tool_object"]
        interval = fitted.predict("release", 20e-6, humidity).median
        # The prediction is that of normal works, whose median is the mean of log-normal ones.
        voltage = float(release_voltage(20e-6, work * math.hypot(1, spread)))
        covered[f"release at {humidity:g} % RH"] = contains(interval, voltage)

    proposal = fitted.proposal
    assert proposal is not None, "works of laboratories need voltages"
    proposed = proposal.prediction
    with_any_supply = lab._replace(limit=math.inf)
    row = with_any_supply.measure(
        proposed.kind, proposed.radius * 1e6, proposed.humidity, repeats=1
    )
    after = fit_rows([*lab.rows, row]).estimates[proposal.target].interval
    return Verdict(
        n_rows=len(lab.rows),
        n_releases=sum(row[0] == "release" and not row[3].startswith(">") for row in lab.rows),
        covered=covered,
        determined={name: fitted.estimates[name].is_determined for name in WORKS},
        p_values={test.variable: test.p_value for test in fitted.shape_tests},
        predicted_width=math.log(proposal.after.high / proposal.after.low),
        width=math.log(after.high / after.low),
        width_before=math.log(proposal.before.high / proposal.before.low),
    )


def contains(interval: Interval, value: float) -> bool:
    """Return whether an interval contains a value."""
    return bool(interval.low <= value <= interval.high)


def coverage(verdicts: Sequence[Verdict]) -> dict[str, tuple[int, int]]:
    """Return by quantity how many intervals contain the truth, and how many there are."""
    names = dict.fromkeys(name for verdict in verdicts for name in verdict.covered)
    counts = {}
    for name in names:
        outcomes = [verdict.covered[name] for verdict in verdicts if name in verdict.covered]
        counts[name] = (sum(outcomes), len(outcomes))
    return counts


def main() -> None:
    """Print how often intervals hold, and whether proposals narrow them as predicted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laboratories", type=int, default=50)
    verdicts = [judge(seed) for seed in range(parser.parse_args().laboratories)]

    print("95 % intervals that contain the truth")
    counts = coverage(verdicts)
    for name, (n_covered, n) in counts.items():
        print(f"  {name:28} {n_covered:4} of {n:4}  {n_covered / n:6.1%}")
    n_covered = sum(covered for covered, _ in counts.values())
    n = sum(total for _, total in counts.values())
    print(f"  {'all':28} {n_covered:4} of {n:4}  {n_covered / n:6.1%}")

    without = [verdict for verdict in verdicts if verdict.n_releases == 0]
    n_confident = sum(verdict.determined["work_tool_object"] for verdict in without)
    print(f"without releases: W_tool called determined in {n_confident} of {len(without)}")
    p_values = [p for verdict in verdicts for p in verdict.p_values.values()]
    n_rejected = sum(p < 0.05 for p in p_values)
    print(f"tests of the shape with p < 0.05: {n_rejected} of {len(p_values)}")

    ratios = np.array([verdict.width / verdict.predicted_width for verdict in verdicts])
    quartiles = ", ".join(f"{quartile:.2f}" for quartile in np.quantile(ratios, QUARTILES))
    print(f"width after the proposed measurement over that predicted, quartiles: {quartiles}")
    narrowing = np.median([verdict.width / verdict.width_before for verdict in without])
    print(f"without releases: width after it over that before, median: {narrowing:.2f}")


if __name__ == "__main__":
    main()
