"""What trials on the gripper's bench say on the statements of section 3.2.3 (Figs. 6 to 11).

None is predicted. The works of adhesion, their spreads and the electrical gap of a contact are fitted to these very
experiments (`gripper.laws.detachment`), so that what concerns the level of a voltage is fitted. Adhesion and the
electrical force are both proportional to the radius, but for 1 % of the latter, so that flat voltages are algebra; with
roughness (`gripper.laws.roughness`) they would not be. The rise with humidity is put in (`gripper.laws.humidity`). The
voltage at which a ball melts is that at which the tool's oxide breaks down, whose thickness is fitted to it, if the
heat then suffices while the tool touches the ball; the resistances that decide this are choices. Whether a ball stays
where it lands follows from restitution by plastic yield, and from the voltage after the release, which is a choice: it
is cut at once.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from iswarm_mj.experiments.analysis.findings import (
    CONSTRUCTED,
    FITTED,
    NOT_IN_PAPER,
    UNDECIDED,
    Claim,
    Finding,
    Row,
    Rows,
    in_words,
    number,
    percent,
    rule_of,
    span,
    verdict_of,
)
from iswarm_mj.experiments.analysis.statistics import Interval, compare, difference, interval, mean, share, slope
from iswarm_mj.experiments.analysis.verdicts import all_of, always, enough, within
from iswarm_mj.gripper.bench.contacts import Contacts
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.laws.capacitance import capacitance
from iswarm_mj.gripper.laws.detachment import (
    CONTACT_GAP,
    MELTING_VOLTAGE,
    PROBE_RADIUS,
    RELEASE_GAP,
    WORK_TOOL_OBJECT,
    detachment_voltage,
)
from iswarm_mj.gripper.laws.melting import melting_energy, melting_time, melts
from iswarm_mj.gripper.reference import PAPER_GRASP, PAPER_HUMIDITY, PAPER_NO_CONTACT, PAPER_RELEASE
from iswarm_mj.utils.arrays import Array

FLAT = 0.2
"""A voltage does not depend on the radius if its slope is less than this, a fifth of the paper's band from its least to
its largest ball [V/um]."""
MOST = 0.95
"""Share of the trials that lie within a range that the paper gives."""
_UM = 1e6
_MELTED = 15e-6
"""Radius of the ball that was seen to melt [m]."""
_WHERE = "section 3.2.3"

PURE = Claim("Without contact no ball is lifted below 50 V, even at 10 % RH", _WHERE, "none", FITTED)
ALWAYS = Claim("With contact, grasping is achieved all the times", _WHERE, "all", FITTED)
GRASP = Claim("The grasp voltage at 10 % RH ranges from 20 to 30 V", f"{_WHERE}, Fig. 8", "20 to 30 V", FITTED)
FLAT_GRASP = Claim(
    "The radius does not really influence the grasp voltage", f"{_WHERE}, Figs. 8 and 9", "no trend", CONSTRUCTED
)
HUMID = Claim(
    "The grasp voltage is higher at {rh:g} % RH than at 10 %", f"{_WHERE}, Fig. 9", "optimum at 10 % RH", CONSTRUCTED
)
RELEASE = Claim("The release voltage at 10 % RH and 5 µm ranges from 37 to 47 V", _WHERE, "37 to 47 V", FITTED)
RELIABLE = Claim("The release is highly reliable and repeatable", _WHERE, "highly", FITTED)
THEORY = Claim("The release voltage is smaller than the theory's 70 V", _WHERE, "37 to 47 V instead of 70 V", FITTED)
FLAT_RELEASE = Claim("The radius does not influence the release voltage", NOT_IN_PAPER, "not reported", CONSTRUCTED)
ALIKE = Claim(
    "Grasping and releasing take voltages of the same typical amplitude", "section 3.2.1", "by symmetry", FITTED
)
MELTS = Claim("A ball of 15 µm melts at 70 V in contact", f"{_WHERE}, Fig. 10", "70 V", FITTED)


def findings(rows: Rows) -> list[Finding]:
    """All statements on grasp and release; rows of faulty trials are left out."""
    sound = [row for row in rows if not row["faulty"]]
    grasp, release, attempts = (
        [row for row in sound if row["experiment"] == name] for name in ("grasp", "release", "no_contact")
    )
    dry = [row for row in grasp if row["relative_humidity"] == PAPER_HUMIDITY]
    let_go = [r for r in release if r["relative_humidity"] == PAPER_HUMIDITY and np.isclose(r["gap"], RELEASE_GAP)]
    return [
        _without_contact([r for r in attempts if r["relative_humidity"] == PAPER_HUMIDITY]),
        _always(grasp),
        _means_within(GRASP, dry, PAPER_GRASP),
        _flat(FLAT_GRASP, dry),
        *_humidity(dry, grasp),
        _trials_within(RELEASE, let_go, PAPER_RELEASE),
        _reliable(let_go),
        _below_theory(let_go),
        _flat(FLAT_RELEASE, let_go),
        _alike(dry, let_go),
        _melting(sound),
    ]


def voltages(rows: Rows) -> Float[Array, "R"]:
    """Voltages of the trials that reached one [V]."""
    return np.array([row["voltage"] for row in rows if row["voltage"] is not None], float)


def _without_contact(rows: Rows) -> Finding:
    if not rows:
        return PURE.not_run()
    low = [row for row in rows if row["voltage"] is not None and row["voltage"] < PAPER_NO_CONTACT]
    limit = min(row["limit_voltage"] for row in rows)
    gaps = ", ".join(f"{gap * _UM:g}" for gap in sorted({row["gap"] for row in rows}))
    ours = f"{len(low)} of {len(rows)} lifted below 50 V, at gaps of {gaps} µm"
    tested = f"{_exact(len(low), len(rows))}; tried up to {limit:g} V; {_rule('none is')}"
    verdict = always(len(rows) - len(low), len(rows))
    return PURE.found(ours, tested, UNDECIDED if limit < PAPER_NO_CONTACT else verdict)


def _always(rows: Rows) -> Finding:
    if not rows:
        return ALWAYS.not_run()
    lifted, limit = len(voltages(rows)), max(row["limit_voltage"] for row in rows)
    tested = f"{_exact(lifted, len(rows))}, up to {limit:g} V, all humidities; {_rule('all are')}"
    return ALWAYS.found(f"{lifted} of {len(rows)}", tested, always(lifted, len(rows)))


def _means_within(claim: Claim, rows: Rows, band: Sequence[float]) -> Finding:
    """Whether the means at each radius, which the paper plots, lie in its band."""
    found = voltages(rows)
    if not len(found):
        return claim.not_run()
    groups = [sample for group in _by_radius(rows) if len(sample := voltages(group))]
    means = [float(sample.mean()) for sample in groups]
    tested = (
        f"n = {len(found)} trials at {len(means)} radii, {percent(share(_inside(found, band), len(found)))} within; "
        "holds if the intervals of all means at a radius, which the paper plots, lie within, does not if one lies "
        "outside; the model is fitted to this range"
    )
    ours = f"{_spread(found)}; means at each radius {min(means):.1f} to {max(means):.1f} V"
    return claim.found(ours, tested, all_of(enough(within(interval(g), *band), len(g)) for g in groups))


def _trials_within(claim: Claim, rows: Rows, band: Sequence[float]) -> Finding:
    """Whether single trials lie in the paper's band, where it gives no means."""
    found = voltages(rows)
    if not len(found):
        return claim.not_run()
    inside, n = _inside(found, band), len(found)
    tested = (
        f"{_exact(inside, n)}; holds if the interval of the share of trials within lies above {100 * MOST:.0f} %, does "
        "not if it lies below; the model is fitted to this range"
    )
    ours = f"{inside} of {n} trials within; {_spread(found)}"
    return claim.found(ours, tested, enough(within(share(inside, n, "exact"), low=MOST), n))


def _flat(claim: Claim, rows: Rows) -> Finding:
    pairs = [(row["radius"] * _UM, row["voltage"]) for row in rows if row["voltage"] is not None]
    found = slope(*zip(*pairs, strict=True)) if len(pairs) > 2 else None
    if found is None or np.isnan(found.estimate):
        return claim.not_run()
    radii = [radius for radius, _ in pairs]
    tested = (
        f"least squares, n = {len(pairs)} trials from {min(radii):g} to {max(radii):g} µm at 10 % RH; equivalence "
        f"test: holds if the interval is within ±{FLAT} V/µm, does not if it lies outside; both forces are "
        "proportional to the radius"
    )
    return claim.found(f"slope {span(found, 'V/µm', 2)}", tested, enough(within(found, -FLAT, FLAT), len(pairs)))


def _humidity(dry: Rows, rows: Rows) -> list[Finding]:
    humid = sorted({row["relative_humidity"] for row in rows if row["relative_humidity"] > PAPER_HUMIDITY})
    found = []
    for rh in humid or (30.0, 50.0):
        claim = HUMID._replace(text=HUMID.text.format(rh=rh))
        wet, less = voltages([row for row in rows if row["relative_humidity"] == rh]), voltages(dry)
        if not len(wet) or not len(less):
            found.append(claim.not_run())
            continue
        result = compare(wet, less)
        ours = f"mean {wet.mean():.1f} V against {less.mean():.1f} V"
        rule = f"{rule_of(True)}; the rise of adhesion with humidity is put in, after its ref. 54"
        tested = f"{in_words(result, 'V')}; {rule}"
        found.append(claim.found(ours, tested, verdict_of(result, True)))
    return found


def _reliable(rows: Rows) -> Finding:
    found = voltages(rows)
    if not len(found):
        return RELIABLE.not_run()
    landed = sum(bool(row["landed"]) for row in rows)
    spread = float(found.std(ddof=1) / found.mean()) if len(found) > 1 else 0.0
    ours = f"{len(found)} of {len(rows)} released, {landed} landed; coefficient of variation {100 * spread:.1f} %"
    tested = (
        f"{_exact(landed, len(rows))}; {_rule('all landed and stayed')}; the spread, and so how repeatable a release "
        "is, is fitted; that balls stay follows from their restitution, given that the voltage is cut as they leave: "
        "if it is held, none does"
    )
    return RELIABLE.found(ours, tested, always(landed, len(rows)))


def _below_theory(rows: Rows) -> Finding:
    found = voltages(rows)
    if not len(found):
        return THEORY.not_run()
    law = float(detachment_voltage(WORK_TOOL_OBJECT, RELEASE_GAP))
    tested = (
        f"n = {len(found)}; 70 V is 100 V / sqrt(2), half the adhesion of that seen in air, and not Eq. 3, which "
        f"with the work of adhesion fitted here gives {law:.1f} V; holds if the interval of the mean lies below, does "
        "not if it lies above"
    )
    middle = interval(found)
    ours = f"mean {span(middle, 'V')}, {found.min():.1f} to {found.max():.1f} V"
    return THEORY.found(ours, tested, enough(within(middle, high=70.0), len(found)))


def _alike(dry: Rows, let_go: Rows) -> Finding:
    lift, drop = voltages(dry), voltages(let_go)
    if not len(lift) or not len(drop):
        return ALIKE.not_run()
    ratio = Interval(*map(float, np.exp(difference(np.log(drop), np.log(lift), mean))))
    ours = f"release {drop.mean():.1f} V, grasp {lift.mean():.1f} V on average, ratio of geometric means {span(ratio)}"
    tested = (
        f"n = {len(drop)} and {len(lift)}; both are fitted to the paper's ranges; equivalence test: holds if the "
        "interval lies within a factor of 2, does not if it lies outside"
    )
    return ALIKE.found(ours, tested, enough(within(ratio, 0.5, 2.0), len(drop), len(lift)))


def _melting(rows: Rows) -> Finding:
    if not rows:
        return MELTS.not_run()
    grasps = [row for row in rows if row["experiment"] == "grasp"]
    melted, highest = sum(bool(row["melted"]) for row in grasps), voltages(grasps).max(initial=0.0)
    contacts, time = Contacts(), Protocol().contact_time
    does = bool(melts(MELTING_VOLTAGE, _MELTED, contacts.breaks_at, contacts.supply, time))
    takes = 1e3 * float(melting_time(MELTING_VOLTAGE, _MELTED, contacts.supply))
    field = capacitance("pick", CONTACT_GAP, _MELTED, PROBE_RADIUS) * MELTING_VOLTAGE**2 / 2
    ours = (
        f"breakdown at {contacts.breaks_at:g} V, heat enough after {takes:.2f} ms of {1e3 * time:.2f}; {melted} of "
        f"{len(grasps)} grasps melted a ball, the highest at {number(float(highest))} V"
    )
    tested = (
        "by the law, no trial reaches 70 V; holds if the oxide breaks down at 70 V or below and the heat melts the "
        f"ball while the tool touches it; the oxide is as thick as breaks down at {MELTING_VOLTAGE:g} V, resistances "
        f"are choices; a ball of 15 µm takes {melting_energy(_MELTED) * 1e6:.1f} µJ, the field of the contact holds "
        f"{field * 1e12:.0f} pJ"
    )
    return MELTS.found(ours, tested, does)


def _exact(count: int, total: int) -> str:
    return f"{percent(share(count, total, 'exact'))}, exact"


def _rule(what: str) -> str:
    return f"holds if {what}, in so many trials that the interval is no wider than 10 %, does not otherwise"


def _inside(found: Float[Array, "R"], band: Sequence[float]) -> int:
    """Number of voltages in a band; they are multiples of a step, of which rounding makes 36.999... V."""
    rounded = np.round(found, 6)
    return int(((rounded >= band[0]) & (rounded <= band[1])).sum())


def _spread(found: Float[Array, "R"]) -> str:
    """Mean of the voltages, and where 95 % of them lie, in words."""
    ends = np.quantile(found, [0.025, 0.975])
    return f"mean {span(interval(found), 'V')}; 95 % of the trials {ends[0]:.1f} to {ends[1]:.1f} V"


def _by_radius(rows: Rows) -> list[list[Row]]:
    return [[row for row in rows if row["radius"] == radius] for radius in sorted({row["radius"] for row in rows})]
