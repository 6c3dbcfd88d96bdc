"""What the force laws say on the theory of section 3.2.1, and the fitness formula on section 4.6; no runs needed.

Only the peak of the force is predicted, by boundary elements. The other statements repeat what is put in (the square of
the voltage, the ratio of the pull-off forces, the factor of humidity) or compare the paper with its own equations.
"""

import numpy as np

from iswarm_mj.experiments.analysis.findings import (
    CONSTRUCTED,
    FITTED,
    PREDICTED,
    SLIP,
    Claim,
    Finding,
    number,
)
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off, jkr_pull_off
from iswarm_mj.gripper.laws.detachment import (
    EQ3_CONSTANT,
    PRINTED_EQ3_CONSTANT,
    PROBE_RADIUS,
    RELEASE_GAP,
    WORK_OBJECT_SUBSTRATE,
    ball_weight,
    detachment_voltage,
)
from iswarm_mj.gripper.laws.electrostatics import asymptotic_force, pick_force, release_force
from iswarm_mj.gripper.laws.humidity import humidity_factor
from iswarm_mj.tasks.measures import Measures, fitness

_WHERE = "section 3.2.1"
_R, _V = 20e-6, 40.0
"""A ball in the middle of the range, and a voltage of the range [m], [V]."""
NEARLY = (0.9, 1.1)
"""A radius of the tool between these multiples of the ball's is nearly the ball's."""

SQUARE = Claim("The Coulomb force is proportional to the voltage squared", _WHERE, "V^2", CONSTRUCTED)
SCALE = Claim("It depends on the shape of the system, not on its size", _WHERE, "shape factor alone", CONSTRUCTED)
PEAK = Claim("It has a peak where the tool's radius is nearly the ball's", _WHERE, "R_m close to R_s", PREDICTED)
ASYMPTOTE = Claim(
    "Eq. 2, for small gaps, gives the force at 5 µm", f"{_WHERE}, Eq. 2", "valid for D below R_s, going to zero", SLIP
)
BOUNDS = Claim("The pull-off force lies between JKR and DMT", f"{_WHERE}, Eq. 1", "3/2 to 2 pi R W", CONSTRUCTED)
CONSTANT = Claim("The constant of Eq. 3 is 5.49e5", f"{_WHERE}, Eq. 3", "5.49e5", SLIP)
RANGE = Claim(
    "Releasing across 5 µm takes 120 to 1200 V for W of 0.01 to 1 J/m^2", f"{_WHERE}, Eq. 4", "120 to 1200 V", SLIP
)
GRAVITY = Claim("Gravity is negligible beside adhesion", "section 3.2.3", "yes", FITTED)
DRIER = Claim(
    "At 10 % RH releasing takes 70 to 350 V instead of the 100 to 500 V in air", _WHERE, "70 to 350 V", CONSTRUCTED
)
HALF = Claim(
    "Adhesion at 10 % RH is around half of that in air of 70 to 90 % RH",
    _WHERE,
    "around half, after ref. 54",
    CONSTRUCTED,
)
POINTS = Claim(
    "Fitness is at most 2860 unless all dust is delivered, and 8360 in 250 steps", "section 4.6", "2860, 8360", SLIP
)


def findings() -> list[Finding]:
    """Statements that the laws decide."""
    return [
        _square(),
        _scale(),
        _peak(),
        _asymptote(),
        _bounds(),
        _constant(),
        _range(),
        _gravity(),
        _half(),
        _drier(),
        _points(),
    ]


def _square() -> Finding:
    ratio = float(
        release_force(2 * _V, RELEASE_GAP, _R, PROBE_RADIUS) / release_force(_V, RELEASE_GAP, _R, PROBE_RADIUS)
    )
    return SQUARE.found(
        f"twice the voltage gives {number(ratio, 6)} times the force", "by construction", abs(ratio - 4) < 1e-9
    )


def _scale() -> Finding:
    sizes = np.array([RELEASE_GAP, _R, PROBE_RADIUS])
    worst = max(abs(float(law(_V, *(2 * sizes)) / law(_V, *sizes)) - 1) for law in (pick_force, release_force))
    return SCALE.found(f"twice the size changes the force by {100 * worst:.1g} %", "by construction", worst < 1e-9)


def _peak() -> Finding:
    ratios = np.linspace(0.65, 2.0, 271)
    forces = {"release": release_force, "pick": pick_force}
    said, verdicts = [], []
    for name, law in forces.items():
        force = np.asarray(law(_V, RELEASE_GAP, _R, ratios * _R))
        place = int(force.argmax())
        gain = 100 * float(force[place] / force[np.abs(ratios - 1).argmin()] - 1)
        has_peak = 0 < place < len(ratios) - 1
        said.append(
            f"{name}: peak at R_m = {ratios[place]:.2f} R, {gain:.1f} % above the force at R_m = R"
            if has_peak
            else f"{name}: largest at the end of the range, R_m = {ratios[place]:.2f} R, no peak"
        )
        verdicts.append(bool(has_peak and NEARLY[0] <= ratios[place] <= NEARLY[1]))
    tested = (
        "boundary elements, D = 5 µm, R = 20 µm, R_m = 0.65 to 2 R; holds if both forces have a peak at "
        f"{NEARLY[0]:g} to {NEARLY[1]:g} R, does not if one has none or has it outside"
    )
    return PEAK.found("; ".join(said), tested, all(verdicts))


def _asymptote() -> Finding:
    asymptote = asymptotic_force(_V, RELEASE_GAP, _R)
    exact = [float(law(_V, RELEASE_GAP, _R, PROBE_RADIUS) / asymptote) for law in (release_force, pick_force)]
    ours = f"release {exact[0]:.3f}, pick {exact[1]:.3f} of it, with the tool of 13 µm and a ball of 20 µm"
    return ASYMPTOTE.found(
        ours, "boundary elements; holds if within 10 % for both", all(abs(f - 1) < 0.1 for f in exact)
    )


def _bounds() -> Finding:
    low, high = (float(law(_R, WORK_OBJECT_SUBSTRATE)) for law in (jkr_pull_off, dmt_pull_off))
    ours = (
        f"{1e6 * low:.3f} to {1e6 * high:.3f} µN for 20 µm and W of {1e3 * WORK_OBJECT_SUBSTRATE:g} mJ/m^2; DMT is used"
    )
    return BOUNDS.found(ours, "ratio 4/3; stiff contacts with weak adhesion are near DMT", low < high)


def _constant() -> Finding:
    ours = f"sqrt(2 / eps0) = {EQ3_CONSTANT:.3e}, as Eqs. 1 and 2 give"
    return CONSTANT.found(
        ours, "5.49e5 is sqrt(8 / (3 eps0)); holds if within 1 %", abs(EQ3_CONSTANT / PRINTED_EQ3_CONSTANT - 1) < 0.01
    )


def _range() -> Finding:
    right, printed = (
        [float(detachment_voltage(w, RELEASE_GAP, c)) for w in (0.01, 1.0)]
        for c in (EQ3_CONSTANT, PRINTED_EQ3_CONSTANT)
    )
    ours = f"{right[0]:.0f} to {right[1]:.0f} V; {printed[0]:.0f} to {printed[1]:.0f} V with the printed constant"
    return RANGE.found(
        ours, "Eq. 3; holds if within 5 %", abs(right[0] / 120 - 1) < 0.05 and abs(right[1] / 1200 - 1) < 0.05
    )


def _gravity() -> Finding:
    share = [float(ball_weight(r) / dmt_pull_off(r, WORK_OBJECT_SUBSTRATE)) for r in (15e-6, 25e-6)]
    ours = f"the weight is {100 * share[0]:.2f} to {100 * share[1]:.2f} % of the pull-off force for 15 to 25 µm"
    return GRAVITY.found(ours, "with the work of adhesion fitted here; holds if below 1 %", max(share) < 0.01)


def _half() -> Finding:
    found = [1 / float(humidity_factor(rh)) for rh in (90.0, 70.0)]
    return HALF.found(
        f"{found[0]:.2f} to {found[1]:.2f} of it",
        "put in, after the paper's reading of its ref. 54",
        0.4 < found[0] < found[1] < 0.6,
    )


def _drier() -> Finding:
    ratios = [1 / float(humidity_factor(rh)) ** 0.5 for rh in (90.0, 70.0)]
    ours = f"{100 * ratios[0]:.0f} to {500 * ratios[1]:.0f} V"
    tested = "the voltages seen in air times the root of the ratio of adhesion, an empirical range; holds within 10 %"
    return DRIER.found(ours, tested, bool(abs(100 * ratios[0] / 70 - 1) < 0.1 and abs(500 * ratios[1] / 350 - 1) < 0.1))


def _points() -> Finding:
    most = fitness(Measures(71, 72, 0, None, None), 280, 72, 800)
    best = fitness(Measures(72, 72, 0, None, 250), 280, 72, 800)
    return POINTS.found(
        f"{most:.0f} and {best:.0f}", "the paper's formula; 72 x 40 + 550 x 10 = 8380", most == 2860 and best == 8360
    )
