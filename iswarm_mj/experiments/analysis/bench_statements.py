"""The statements on the gripper: of section 3.2.1, which the laws decide without runs, and of section 3.2.3 (Figs. 6 to
11) and section 5, by trials on the bench.

Of the laws only the peak of the force is predicted, by boundary elements. The others repeat what is put in or compare
the paper with its own equations. Of the trials nothing is predicted: the works of adhesion, their spreads and the
electrical gap of a contact are fitted to these very experiments (`gripper.laws.detachment`), so that what concerns the
level of a voltage is fitted. Adhesion and the electrical force are both proportional to the radius, but for 1 % of the
latter, so that flat voltages are algebra; with roughness they would not be. The rise with humidity is put in. The
voltage at which a ball melts is that at which the tool's oxide breaks down, whose thickness is fitted to it, if the
heat then suffices while the tool touches the ball; the resistances that decide this are choices. Whether a ball stays
where it lands follows from restitution by plastic yield, and from the voltage after the release, which is a choice: it
is cut at once.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, UNDECIDED, Judged, Rows, number, stated
from iswarm_mj.experiments.analysis.judge import RARE, Estimate, always, averages, differences, judged, shares
from iswarm_mj.experiments.analysis.measures import VOLTAGE, by, select, values
from iswarm_mj.experiments.analysis.statistics import Interval, difference, slope
from iswarm_mj.gripper.bench.contacts import Contacts
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off, jkr_pull_off
from iswarm_mj.gripper.laws.detachment import (
    EQ3_CONSTANT,
    MELTING_VOLTAGE,
    PRINTED_EQ3_CONSTANT,
    PROBE_RADIUS,
    RELEASE_GAP,
    WORK_OBJECT_SUBSTRATE,
    ball_weight,
    detachment_voltage,
)
from iswarm_mj.gripper.laws.electrostatics import asymptotic_force, pick_force, release_force
from iswarm_mj.gripper.laws.humidity import humidity_factor
from iswarm_mj.gripper.laws.melting import melting_time, melts
from iswarm_mj.gripper.reference import (
    PAPER_FIG_6,
    PAPER_GRASP,
    PAPER_HUMIDITY,
    PAPER_NO_CONTACT,
    PAPER_ON_BOARD,
    PAPER_RELEASE,
)
from iswarm_mj.tasks.measures import Measures, fitness
from iswarm_mj.utils.arrays import Array

_R, _V = 20e-6, 40.0
"""A ball in the middle of the range, and a voltage of the range [m], [V]."""
NEARLY = (0.9, 1.1)
"""A radius of the tool between these multiples of the ball's is nearly the ball's."""
FLAT = 0.2
"""A voltage does not depend on the radius if its slope is less than this, a fifth of the paper's band from its least to
its largest ball [V/um]."""
_MOST = (0.95, np.inf)
"""Limits of the share of the trials that lie within a range that the paper gives."""
TRANSPORT = 50e-6
"""Distance of the target, to which balls are carried [m]; of a ball's diameter or more."""
_UM = 1e6
_MELTED = 15e-6
"""Radius of the ball that was seen to melt [m]."""


# --- Laws; they need no results. What is found, and whether the statement holds ---

Fact = tuple[str, bool | np.bool_]


def _law(fact: Callable[[], Fact], _: object) -> Judged:
    ours, holds = fact()
    return Judged(ours, "", HOLDS if holds else FAILS)


def _square() -> Fact:
    ratio = float(
        release_force(2 * _V, RELEASE_GAP, _R, PROBE_RADIUS) / release_force(_V, RELEASE_GAP, _R, PROBE_RADIUS)
    )
    return f"twice the voltage gives {number(ratio, 6)} times the force", abs(ratio - 4) < 1e-9


def _scale() -> Fact:
    sizes = np.array([RELEASE_GAP, _R, PROBE_RADIUS])
    worst = max(abs(float(law(_V, *(2 * sizes)) / law(_V, *sizes)) - 1) for law in (pick_force, release_force))
    return f"twice the size changes the force by {100 * worst:.1g} %", worst < 1e-9


def _peak() -> Fact:
    """Of both forces over the radius of the tool; a peak at an end of the range is none."""
    ratios, said, near = np.linspace(0.65, 2.0, 271), [], []
    for name, law in (("release", release_force), ("pick", pick_force)):
        place = int(np.asarray(law(_V, RELEASE_GAP, _R, ratios * _R)).argmax())
        has_peak = 0 < place < len(ratios) - 1
        said.append(f"{name}: {'peak' if has_peak else 'no peak, largest'} at R_m = {ratios[place]:.2f} R")
        near.append(has_peak and NEARLY[0] <= ratios[place] <= NEARLY[1])
    return "; ".join(said), all(near)


def _asymptote() -> Fact:
    asymptote = asymptotic_force(_V, RELEASE_GAP, _R)
    exact = [float(law(_V, RELEASE_GAP, _R, PROBE_RADIUS) / asymptote) for law in (release_force, pick_force)]
    return f"release {exact[0]:.3f}, pick {exact[1]:.3f} of it", all(abs(f - 1) < 0.1 for f in exact)


def _bounds() -> Fact:
    low, high = (float(law(_R, WORK_OBJECT_SUBSTRATE)) for law in (jkr_pull_off, dmt_pull_off))
    work = 1e3 * WORK_OBJECT_SUBSTRATE
    return f"{1e6 * low:.3f} to {1e6 * high:.3f} µN for 20 µm and W of {work:g} mJ/m^2", low < high


def _constant() -> Fact:
    return f"{EQ3_CONSTANT:.3e}", abs(EQ3_CONSTANT / PRINTED_EQ3_CONSTANT - 1) < 0.01


def _range() -> Fact:
    right, printed = (
        [float(detachment_voltage(w, RELEASE_GAP, c)) for w in (0.01, 1.0)]
        for c in (EQ3_CONSTANT, PRINTED_EQ3_CONSTANT)
    )
    ours = f"{right[0]:.0f} to {right[1]:.0f} V; {printed[0]:.0f} to {printed[1]:.0f} V with the printed constant"
    return ours, abs(right[0] / 120 - 1) < 0.05 and abs(right[1] / 1200 - 1) < 0.05


def _gravity() -> Fact:
    part = [float(ball_weight(r) / dmt_pull_off(r, WORK_OBJECT_SUBSTRATE)) for r in (15e-6, 25e-6)]
    ours = f"the weight is {100 * part[0]:.2f} to {100 * part[1]:.2f} % of the pull-off force for 15 to 25 µm"
    return ours, max(part) < 0.01


def _half() -> Fact:
    found = [1 / float(humidity_factor(rh)) for rh in (90.0, 70.0)]
    return f"{found[0]:.2f} to {found[1]:.2f} of it", 0.4 < found[0] < found[1] < 0.6


def _drier() -> Fact:
    found = [seen / float(humidity_factor(rh)) ** 0.5 for seen, rh in ((100, 90.0), (500, 70.0))]
    return f"{found[0]:.0f} to {found[1]:.0f} V", abs(found[0] / 70 - 1) < 0.1 and abs(found[1] / 350 - 1) < 0.1


def _points() -> Fact:
    most = fitness(Measures(71, 72, 0, None, None), 280, 72, 800)
    best = fitness(Measures(72, 72, 0, None, 250), 280, 72, 800)
    return f"{most:.0f} and {best:.0f}", most == 2860 and best == 8360


# --- Trials, those at the paper's humidity in front ---


def _trials(rows: Rows, experiment: str) -> Rows:
    """Trials that are not faulty; at the paper's humidity, and of releases at its gap."""
    found = select(rows, experiment=experiment, faulty=False, relative_humidity=PAPER_HUMIDITY)
    return [row for row in found if experiment != "release" or np.isclose(row["gap"], RELEASE_GAP)]


def _without_contact(rows: Rows) -> Judged | None:
    """That no trial lifts a ball; undecided if the trials ended below the paper's voltage."""
    tried = _trials(rows, "no_contact")
    if not tried:
        return None
    low = int((values(tried, VOLTAGE) < PAPER_NO_CONTACT).sum())
    found = always(len(tried) - low, len(tried), " not lifted below 50 V")
    return (
        found if min(row["limit_voltage"] for row in tried) >= PAPER_NO_CONTACT else found._replace(verdict=UNDECIDED)
    )


def _always(rows: Rows) -> Judged | None:
    tried = select(rows, experiment="grasp", faulty=False)
    return always(len(values(tried, VOLTAGE)), len(tried), ", at all humidities") if tried else None


def _inside(found: Array, band: Sequence[float]) -> int:
    """Number of voltages in a band; they are multiples of a step, of which rounding makes 36.999... V."""
    rounded = np.round(np.asarray(found), 6)
    return int(((rounded >= band[0]) & (rounded <= band[1])).sum())


def _grasp_band(rows: Rows) -> Judged | None:
    """Whether the means at each radius, which the paper plots, lie in its band."""
    groups = sorted(by(_trials(rows, "grasp"), "radius").items())
    return averages({f"{r * _UM:g} µm": values(runs, VOLTAGE) for r, runs in groups}, PAPER_GRASP, "V")


def _release_band(rows: Rows) -> Judged | None:
    """Whether single trials lie in the paper's band, where it gives no means."""
    found = values(_trials(rows, "release"), VOLTAGE)
    return shares({"": (_inside(found, PAPER_RELEASE), len(found))}, _MOST) if len(found) else None


def _flat(experiment: str, rows: Rows) -> Judged | None:
    pairs = [(r["radius"] * _UM, r["voltage"]) for r in _trials(rows, experiment) if r["voltage"] is not None]
    found = slope(*zip(*pairs, strict=True)) if pairs else Interval(np.nan, np.nan, np.nan)
    estimates = [] if np.isnan(found.estimate) else [Estimate(found, (len(pairs),), -FLAT, FLAT)]
    return judged(estimates, "slope", "V/µm")


def _humid(humidity: float, rows: Rows) -> Judged | None:
    wet = select(rows, experiment="grasp", faulty=False, relative_humidity=humidity)
    return differences({"": (wet, _trials(rows, "grasp"))}, VOLTAGE)


def _reliable(rows: Rows) -> Judged | None:
    let_go = _trials(rows, "release")
    found, landed = values(let_go, VOLTAGE), sum(bool(row["landed"]) for row in let_go)
    if not len(found):
        return None
    spread = float(found.std(ddof=1) / found.mean()) if len(found) > 1 else 0.0
    return always(landed, len(let_go), f" landed and stayed; coefficient of variation {100 * spread:.1f} %")


def _below_theory(rows: Rows) -> Judged | None:
    return averages({"": values(_trials(rows, "release"), VOLTAGE)}, (-np.inf, 70.0), "V")


def _alike(rows: Rows) -> Judged | None:
    lift, drop = (values(_trials(rows, name), VOLTAGE) for name in ("grasp", "release"))
    if not len(lift) or not len(drop):
        return None
    ratio = Interval(*map(float, np.exp(difference(np.log(drop), np.log(lift), np.mean))))
    said = f"release {drop.mean():.1f} V, grasp {lift.mean():.1f} V on average, ratio "
    return judged([Estimate(ratio, (len(drop), len(lift)), 0.5, 2.0, said=said)], "geometric means")


def _on_board(rows: Rows) -> Judged | None:
    """Whether single grasps and single releases take the voltages that the paper has on board."""
    groups = {name: values(_trials(rows, name), VOLTAGE) for name in ("grasp", "release")}
    counts = {name: (_inside(found, PAPER_ON_BOARD), len(found)) for name, found in groups.items() if len(found)}
    return shares(counts, _MOST)


def _figure_6(rows: Rows) -> Judged | None:
    """Whether a ball that the paper's least voltage lifts is no exception, of all radii."""
    found = values(_trials(rows, "grasp"), VOLTAGE)
    return shares({"": (_inside(found, (0.0, PAPER_FIG_6)), len(found))}, (RARE, np.inf)) if len(found) else None


def _transported(rows: Rows) -> Judged | None:
    """Whether each grasped ball ends within its radius of the target aside."""
    dry = select(rows, relative_humidity=PAPER_HUMIDITY)
    balls = by([row for row in dry if row["experiment"] != "no_contact"], "radius", "repeat").values()
    tried = [ball for ball in balls if not any(row["faulty"] for row in ball)]
    releases = [row for ball in tried for row in ball if row.get("transport") == TRANSPORT]  # earlier tables lack it
    off = [row["off_target"] / row["radius"] if row["landed"] else np.inf for row in releases]
    said = f" balls, at most {number(max(off))} radii from the target" if off else ""
    return always(sum(each <= 1 for each in off), len(tried), said) if off else None


def _melting() -> Fact:
    """Whether the oxide breaks down, and the heat melts the ball, while the tool touches it."""
    contacts, time = Contacts(), Protocol().contact_time
    does = bool(melts(MELTING_VOLTAGE, _MELTED, contacts.breaks_at, contacts.supply, time))
    takes = 1e3 * float(melting_time(MELTING_VOLTAGE, _MELTED, contacts.supply))
    return f"breakdown at {contacts.breaks_at:g} V, heat enough after {takes:.2f} ms of {1e3 * time:.2f}", does


LAWS = {
    "voltage squared": _square,
    "scale": _scale,
    "peak": _peak,
    "small gaps": _asymptote,
    "pull-off bounds": _bounds,
    "constant": _constant,
    "release range": _range,
    "gravity": _gravity,
    "half adhesion": _half,
    "drier air": _drier,
    "points": _points,
}
TRIALS = {
    "no contact": _without_contact,
    "always lifts": _always,
    "grasp band": _grasp_band,
    "grasp flat": partial(_flat, "grasp"),
    "humid 5": partial(_humid, 5.0),
    "humid 30": partial(_humid, 30.0),
    "humid 50": partial(_humid, 50.0),
    "release band": _release_band,
    "reliable": _reliable,
    "below theory": _below_theory,
    "release flat": partial(_flat, "release"),
    "alike voltages": _alike,
    "melting": partial(_law, _melting),
    "on board": _on_board,
    "figure 6": _figure_6,
    "transport": _transported,
}
STATEMENTS = stated({name: partial(_law, fact) for name, fact in LAWS.items()} | TRIALS)
