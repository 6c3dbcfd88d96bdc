"""The statements on the gripper: of section 3.2.1, which the laws decide without runs, and of
section 3.2.3 (Figs. 6 to 11) and section 5, by trials on the bench.

Of the laws only the peak of the force is predicted, by boundary elements. The others repeat what is
put in or compare the paper with its own equations. Of the trials nothing is predicted: the works of
adhesion, their spreads and the electrical gap of a contact are fitted to these very experiments
(`gripper.laws.detachment`), so that what concerns the level of a voltage is fitted. Adhesion and
the electrical force are both proportional to the radius, but for 1 % of the latter, so that flat
voltages are algebra; with roughness they would not be. The rise with humidity is put in. The
voltage at which a ball melts is that at which the tool's oxide breaks down, whose thickness is
fitted to it, if the heat then suffices while the tool touches the ball; the resistances that decide
this are choices. Whether a ball stays where it lands follows from restitution by plastic yield, and
from the voltage after the release, which is a choice: it is cut at once.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np

from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off, humidity_factor, jkr_pull_off
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
from iswarm_mj.gripper.laws.melting import melting_time, melts
from iswarm_mj.gripper.reference import (
    PAPER_FIG_6,
    PAPER_GRASP,
    PAPER_HUMIDITY,
    PAPER_NO_CONTACT,
    PAPER_ON_BOARD,
    PAPER_RELEASE,
)
from iswarm_mj.paper.analysis.findings import (
    FAILS,
    HOLDS,
    UNDECIDED,
    Judged,
    Test,
    named,
    number,
    stated,
)
from iswarm_mj.paper.analysis.judge import (
    RARE,
    Estimate,
    always,
    averages,
    differences,
    judged,
    shares,
)
from iswarm_mj.paper.analysis.measures import VOLTAGE, values
from iswarm_mj.paper.analysis.statistics import Interval, difference, slope
from iswarm_mj.search.rows import Rows, by, select
from iswarm_mj.tasks.measures import Measures, fitness

_R, _V = 20e-6, 40.0
"""A ball in the middle of the range, and a voltage of the range [m], [V]."""
NEARLY = (0.9, 1.1)
"""A radius of the tool between these multiples of the ball's is nearly the ball's."""
FLAT = 0.2
"""A voltage does not depend on the radius if its slope is less than this, a fifth of the paper's
band from its least to its largest ball [V/um]."""
_MOST = (0.95, np.inf)
"""Limits of the share of the trials that lie within a range that the paper gives."""
TRANSPORT = 50e-6
"""Distance of the target, to which balls are carried [m]; of a ball's diameter or more."""
_UM = 1e6
_MELTED = 15e-6
"""Radius of the ball that was seen to melt [m]."""


# --- Laws; they need no results. What is found, and whether the statement holds ---

Fact = tuple[str, bool | np.bool_]


def peak() -> Fact:
    """Where both forces are largest over the radius of the tool; at an end of the range they have
    no peak."""
    ratios, said, near = np.linspace(0.65, 2.0, 271), [], []
    for name, law in (("release", release_force), ("pick", pick_force)):
        place = int(np.asarray(law(_V, RELEASE_GAP, _R, ratios * _R)).argmax())
        has_peak = 0 < place < len(ratios) - 1
        said.append(
            f"{name}: {'peak' if has_peak else 'no peak, largest'} at R_m = {ratios[place]:.2f} R"
        )
        near.append(has_peak and NEARLY[0] <= ratios[place] <= NEARLY[1])
    return "; ".join(said), all(near)


@cache
def laws() -> dict[str, Fact]:
    """Facts by the names of their statements."""
    sizes = np.array([RELEASE_GAP, _R, PROBE_RADIUS])
    forces = release_force, pick_force
    square = float(release_force(2 * _V, *sizes) / release_force(_V, *sizes))
    scale = max(abs(float(law(_V, *(2 * sizes)) / law(_V, *sizes)) - 1) for law in forces)
    near = [float(law(_V, *sizes) / asymptotic_force(_V, RELEASE_GAP, _R)) for law in forces]
    low, high = (float(law(_R, WORK_OBJECT_SUBSTRATE)) for law in (jkr_pull_off, dmt_pull_off))
    right, printed = (
        [float(detachment_voltage(w, RELEASE_GAP, constant)) for w in (0.01, 1.0)]
        for constant in (EQ3_CONSTANT, PRINTED_EQ3_CONSTANT)
    )
    weight = [
        float(ball_weight(r) / dmt_pull_off(r, WORK_OBJECT_SUBSTRATE)) for r in (15e-6, 25e-6)
    ]
    half = [1 / float(humidity_factor(rh)) for rh in (90.0, 70.0)]
    drier = [seen / float(humidity_factor(rh)) ** 0.5 for seen, rh in ((100, 90.0), (500, 70.0))]
    most = fitness(Measures(71, 72, 0, None, None), 280, 72, 800)
    best = fitness(Measures(72, 72, 0, None, 250), 280, 72, 800)
    return {
        "voltage squared": (
            f"twice the voltage gives {number(square, 6)} times the force",
            abs(square - 4) < 1e-9,
        ),
        "scale": (f"twice the size changes the force by {100 * scale:.1g} %", scale < 1e-9),
        "peak": peak(),
        "small gaps": (
            f"release {near[0]:.3f}, pick {near[1]:.3f} of it",
            all(abs(f - 1) < 0.1 for f in near),
        ),
        "pull-off bounds": (
            f"{1e6 * low:.3f} to {1e6 * high:.3f} µN for 20 µm and W of {1e3 * WORK_OBJECT_SUBSTRATE:g} mJ/m^2",
            low < high,
        ),
        "constant": (f"{EQ3_CONSTANT:.3e}", abs(EQ3_CONSTANT / PRINTED_EQ3_CONSTANT - 1) < 0.01),
        "release range": (
            f"{right[0]:.0f} to {right[1]:.0f} V; {printed[0]:.0f} to {printed[1]:.0f} V with the printed constant",
            abs(right[0] / 120 - 1) < 0.05 and abs(right[1] / 1200 - 1) < 0.05,
        ),
        "gravity": (
            f"the weight is {100 * weight[0]:.2f} to {100 * weight[1]:.2f} % of the pull-off force for 15 to 25 µm",
            max(weight) < 0.01,
        ),
        "half adhesion": (f"{half[0]:.2f} to {half[1]:.2f} of it", 0.4 < half[0] < half[1] < 0.6),
        "drier air": (
            f"{drier[0]:.0f} to {drier[1]:.0f} V",
            abs(drier[0] / 70 - 1) < 0.1 and abs(drier[1] / 350 - 1) < 0.1,
        ),
        "points": (f"{most:.0f} and {best:.0f}", most == 2860 and best == 8360),
    }


def _melting() -> Fact:
    """Whether the oxide breaks down, and the heat melts the ball, while the tool touches it."""
    contacts, time = Contacts(), Protocol().contact_time
    does = bool(melts(MELTING_VOLTAGE, _MELTED, contacts.breaks_at, contacts.supply, time))
    takes = 1e3 * float(melting_time(MELTING_VOLTAGE, _MELTED, contacts.supply))
    return (
        f"breakdown at {contacts.breaks_at:g} V, heat enough after {takes:.2f} ms of {1e3 * time:.2f}",
        does,
    )


def _law(fact: Callable[[], Fact]) -> Test:
    def test(_: object) -> Judged:
        ours, holds = fact()
        return Judged(ours, "", HOLDS if holds else FAILS)

    return test


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
    is_open = min(row["limit_voltage"] for row in tried) < PAPER_NO_CONTACT
    return found._replace(verdict=UNDECIDED) if is_open else found


def _always(rows: Rows) -> Judged | None:
    tried = select(rows, experiment="grasp", faulty=False)
    return always(len(values(tried, VOLTAGE)), len(tried), ", at all humidities") if tried else None


def _grasp_band(rows: Rows) -> Judged | None:
    """Whether the means at each radius, which the paper plots, lie in its band."""
    groups = sorted(by(_trials(rows, "grasp"), "radius").items())
    return averages(
        {f"{r * _UM:g} µm": values(runs, VOLTAGE) for r, runs in groups}, PAPER_GRASP, "V"
    )


def _within(
    experiments: Sequence[str], band: Sequence[float], limits: tuple[float, float], rows: Rows
) -> Judged | None:
    """Whether the share of single trials in a band lies within limits; voltages are multiples of a
    step, of which rounding makes 36.999... V."""
    groups = {name: np.round(values(_trials(rows, name), VOLTAGE), 6) for name in experiments}
    counts = {
        name * (len(groups) > 1): (int(((band[0] <= found) & (found <= band[1])).sum()), len(found))
        for name, found in groups.items()
        if len(found)
    }
    return shares(counts, limits)


def _flat(experiment: str, rows: Rows) -> Judged | None:
    pairs = [
        (r["radius"] * _UM, r["voltage"])
        for r in _trials(rows, experiment)
        if r["voltage"] is not None
    ]
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
    return always(
        landed, len(let_go), f" landed and stayed; coefficient of variation {100 * spread:.1f} %"
    )


def _alike(rows: Rows) -> Judged | None:
    lift, drop = (values(_trials(rows, name), VOLTAGE) for name in ("grasp", "release"))
    if not len(lift) or not len(drop):
        return None
    ratio = Interval(*map(float, np.exp(difference(np.log(drop), np.log(lift), np.mean))))
    said = f"release {drop.mean():.1f} V, grasp {lift.mean():.1f} V on average, ratio "
    return judged([Estimate(ratio, (len(drop), len(lift)), 0.5, 2.0, said=said)], "geometric means")


def _transported(rows: Rows) -> Judged | None:
    """Whether each grasped ball ends within its radius of the target aside."""
    dry = select(rows, relative_humidity=PAPER_HUMIDITY)
    balls = by(
        [row for row in dry if row["experiment"] != "no_contact"], "radius", "repeat"
    ).values()
    tried = [ball for ball in balls if not any(row["faulty"] for row in ball)]
    releases = [
        row for ball in tried for row in ball if row.get("transport") == TRANSPORT
    ]  # earlier tables lack it
    off = [row["off_target"] / row["radius"] if row["landed"] else np.inf for row in releases]
    said = f" balls, at most {number(max(off))} radii from the target" if off else ""
    return always(sum(each <= 1 for each in off), len(tried), said) if off else None


TRIALS: dict[str, Test] = {
    "no contact": _without_contact,
    "always lifts": _always,
    "grasp band": _grasp_band,
    "grasp flat": partial(_flat, "grasp"),
    "humid 5": partial(_humid, 5.0),
    "humid 30": partial(_humid, 30.0),
    "humid 50": partial(_humid, 50.0),
    "release band": partial(
        _within, ["release"], PAPER_RELEASE, _MOST
    ),  # where the paper gives no means
    "reliable": _reliable,
    "below theory": lambda rows: averages(
        {"": values(_trials(rows, "release"), VOLTAGE)}, (-np.inf, 70.0), "V"
    ),
    "release flat": partial(_flat, "release"),
    "alike voltages": _alike,
    "melting": _law(_melting),
    "on board": partial(_within, ["grasp", "release"], PAPER_ON_BOARD, _MOST),
    "figure 6": partial(_within, ["grasp"], (0.0, PAPER_FIG_6), (RARE, np.inf)),
    "transport": _transported,
}
STATEMENTS = stated({name: _law(lambda name=name: laws()[name]) for name in named("laws")} | TRIALS)
