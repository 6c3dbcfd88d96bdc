"""Swarms whose grasps are trials on the bench against swarms whose grasps the balance of the forces decides: pairs of
runs with the same seed, at several humidities and voltages of the tool."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from iswarm_mj.experiments.analysis.findings import (
    NOT_IN_PAPER,
    PREDICTED,
    TOO_FEW,
    Claim,
    Finding,
    Row,
    Rows,
    in_words,
    rule_of,
    span,
    verdict_of,
)
from iswarm_mj.experiments.analysis.measures import TIME, Measure, finished, quartiles, select, values
from iswarm_mj.experiments.analysis.plots import Quantity, draw_curves
from iswarm_mj.experiments.analysis.statistics import Interval, compare, interval
from iswarm_mj.experiments.analysis.verdicts import EQUAL, LEAST, all_of, enough, within
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.experiments.runner.variation import Values, varied
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.arrays import Array

REPEATS = 24
"""Pairs of runs of each setting."""
TYPES = ("type1", "type2")
HUMIDITIES = (10.0, 30.0, 50.0)
"""Relative humidities [%]."""
VOLTAGES = (30.0, 40.0, 55.0)
"""Of the tool while it lifts [V]; balls are released at the configuration's voltage."""
BALANCE, TRIALS = "quasi-static", "dynamic"
ATTEMPT_TIME = 1.0
"""For which a robot stays at a ball that it lifts or releases, a control step [s]; a choice, the paper tells none."""
OF_ATTEMPTS: Values = {
    "gripper.tool_error": 4e-6,
    "gripper.grasp_time": ATTEMPT_TIME,
    "gripper.release_time": ATTEMPT_TIME,
}
"""Of attempts, beside the calibrated spread of adhesion."""

ATTEMPTS = Measure(
    "attempts", "attempts per ball", "per ball", lambda row: row["attempts"] / max(row["picked"], 1), False
)
FAILED = Measure("failed", "failed grasps", "a run", lambda row: float(row["failed_grasps"]), False)
STUCK = Measure("stuck", "failed releases", "a run", lambda row: float(row["failed_releases"]), False)
BROKEN = Measure("broken", "attempts broken off", "a run", lambda row: float(row["broken_off"]), False)
"""Among the failed ones."""
LOST = Measure(
    "lost",
    "time lost by attempts in vain [robot s]",
    "robot s",
    lambda row: row["lost_time"],
    False,
)
"""Of all robots, at attempts to lift and to release: what they waited, and what the trials took."""
COUNTS = (ATTEMPTS, FAILED, STUCK, BROKEN, LOST)


def entries(plan: Plan) -> list[Entry]:
    """Pairs of runs of both types at all humidities and voltages."""
    repeats, steps = (2, 100) if plan.quick else (REPEATS, TIME_LIMIT)
    humidities, voltages = (HUMIDITIES[-1:], VOLTAGES[::2]) if plan.quick else (HUMIDITIES, VOLTAGES)
    listed = []
    for number, name in enumerate(TYPES):
        genome = PRESETS[name]
        n_robots = robots_for(plan.config.arena, genome.density_of_robots)
        for humidity in humidities:
            for voltage in voltages:
                for resolution in (BALANCE, TRIALS):
                    setting = {"relative_humidity": humidity, "grasp_voltage": voltage, "resolution": resolution}
                    own = {f"gripper.{key}": value for key, value in setting.items()}
                    config = varied(plan.config, {**OF_ATTEMPTS, **own})
                    for repeat in range(repeats):
                        seed = run_seed(plan.seed, number, round(humidity), round(voltage), repeat)
                        labels = {"type": name, **setting, "repeat": repeat}
                        listed.append(Entry(labels, Job(config, genome, n_robots, seed, steps, plan.goal)))
    return listed


def findings(rows: Rows) -> list[Finding]:
    """Whether trials and the balance agree in time and attempts, and what humidity and voltage cost."""
    found = []
    for name in TYPES:
        mine = select(rows, type=name)
        found += [_same(mine, name, measure, voltage) for measure in (TIME, ATTEMPTS) for voltage in VOLTAGES]
        found += [_damp(mine, name), _low(mine, name)]
    return found


def pairs(rows: Rows, measure: Measure) -> Float[Array, "2 R"]:
    """Values of a measure by the balance and by trials, of runs with the same seed."""
    by_seed: dict[str, dict[int, Row]] = {
        kind: {row["seed"]: row for row in select(rows, resolution=kind)} for kind in (BALANCE, TRIALS)
    }
    both = sorted(by_seed[BALANCE].keys() & by_seed[TRIALS].keys())
    sides = [values([by_seed[kind][seed] for seed in both], measure) for kind in (BALANCE, TRIALS)]
    return np.array(sides)


def _same(rows: Rows, name: str, measure: Measure, voltage: float) -> Finding:
    """Whether a measure is the same by trials as by the balance with a voltage, at each humidity by itself."""
    what = "finishing time" if measure is TIME else "number of attempts per ball"
    claim = Claim(
        f"At {voltage:g} V trials instead of the balance of the forces leave the {what} as it is, {name}",
        NOT_IN_PAPER,
        "not studied",
        PREDICTED,
    )
    ours, verdicts = [], []
    for humidity in HUMIDITIES:
        mine = select(rows, grasp_voltage=voltage, relative_humidity=humidity)
        found = pairs(mine, measure)
        static, dynamic = found[:, (found > 0).all(axis=0)]
        if not len(static):
            continue
        ratio = Interval(*np.exp(interval(np.log(dynamic / static))))
        told = measure is not TIME or finished(mine) >= LEAST
        ours.append(f"{span(ratio)} at {humidity:g} % RH ({len(static)} pairs)")
        verdicts.append(enough(within(ratio, 1 - EQUAL, 1 + EQUAL), len(static) if told else 0))
    if not ours:
        return claim.not_run()
    rule = (
        "geometric means of pairs of the same seed, a run that does not reach the goal with its time limit; holds if "
        f"the intervals of all humidities lie within {1 - EQUAL:g} to {1 + EQUAL:g}, does not if one lies outside"
    )
    verdict = all_of(verdicts) if len(ours) == len(HUMIDITIES) else TOO_FEW
    return claim.found(f"times that by the balance: {', '.join(ours)}", rule, verdict)


def _damp(rows: Rows, name: str) -> Finding:
    """Whether more grasps fail in damp air."""
    dry, damp = HUMIDITIES[0], HUMIDITIES[-1]
    claim = f"At {VOLTAGES[0]:g} V more grasps fail at {damp:g} % RH than at {dry:g} %, {name}"
    groups = {f"at {rh:g} % RH": {"grasp_voltage": VOLTAGES[0], "relative_humidity": rh} for rh in (damp, dry)}
    return _larger(rows, claim, FAILED, groups)


def _low(rows: Rows, name: str) -> Finding:
    """Whether a low voltage costs time."""
    damp = HUMIDITIES[-1]
    claim = f"At {damp:g} % RH a swarm with {VOLTAGES[0]:g} V takes longer than one with {VOLTAGES[-1]:g} V, {name}"
    groups = {f"with {v:g} V": {"grasp_voltage": v, "relative_humidity": damp} for v in (VOLTAGES[0], VOLTAGES[-1])}
    return _larger(rows, claim, TIME, groups)


def _larger(rows: Rows, text: str, measure: Measure, groups: Mapping[str, Mapping[str, float]]) -> Finding:
    """Whether the first group's median of a measure is larger than the second's, with trials."""
    claim = Claim(text, NOT_IN_PAPER, "not studied", PREDICTED)
    runs = {name: select(rows, resolution=TRIALS, **labels) for name, labels in groups.items()}
    samples = [values(mine, measure) for mine in runs.values()]
    if not all(map(len, samples)):
        return claim.not_run()
    ours = ", ".join(f"{quartiles(sample, measure.unit)} {name}" for name, sample in zip(runs, samples, strict=True))
    reached = " and ".join(f"{finished(mine)} of {len(mine)}" for mine in runs.values())
    result = compare(*samples)
    return claim.found(
        f"median {ours}; {reached} runs reached {rows[0]['goal']} balls",
        f"{in_words(result, measure.unit)}; {rule_of(is_larger=True)}",
        verdict_of(result, is_larger=True),
    )


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw time, attempts and failed grasps over the voltage in the dampest air, a figure for each type."""
    drawn, damp = [], max(row["relative_humidity"] for row in rows)
    voltage = Quantity(f"voltage while lifting [V], at {damp:g} % RH", lambda row: row["grasp_voltage"])
    for name in dict.fromkeys(row["type"] for row in rows):
        mine = select(rows, type=name, relative_humidity=damp)
        lines = {"balance of the forces": select(mine, resolution=BALANCE), "trials": select(mine, resolution=TRIALS)}
        drawn.append(draw_curves(lines, voltage, (TIME, ATTEMPTS, FAILED), out / f"resolved_grasps_{name}"))
    return drawn


EXPERIMENT = Experiment(
    name="resolved-grasps",
    title="grasps by trials and by the balance of the forces, three humidities and voltages, 24 pairs of runs each",
    source=NOT_IN_PAPER,
    entries=entries,
    findings=findings,
    draw=draw,
)
