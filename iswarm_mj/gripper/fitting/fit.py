"""Fit the gripper's laws to a table: estimates, what is not identifiable, predictions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from iswarm_mj.gripper.fitting.estimate import (
    Interval,
    Maximum,
    Quantity,
    maximise,
    student,
)
from iswarm_mj.gripper.fitting.likelihood import Likelihood
from iswarm_mj.gripper.fitting.model import LoadModel
from iswarm_mj.gripper.fitting.parameters import (
    FREE_IF_DETERMINED,
    NORMAL_95,
    Model,
    known_parameter,
)
from iswarm_mj.gripper.fitting.table import (
    ACROSS_GAPS,
    ELECTRICAL,
    FORCES,
    KINDS,
    MAX_GAP_RATIO,
    MIN_GAP_RATIO,
    PROBE_RATIOS,
    Measurements,
    like_first,
    read_measurements,
    single_row,
)
from iswarm_mj.gripper.laws.detachment import RELEASE_GAP
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import ConfigError, UserError

DETERMINED_SPAN = 2.0
"""Largest ratio of the ends of an interval whose quantity counts as determined."""
SIGNIFICANCE = 0.05
"""Probability below which data contradict the shape of the law."""
NO_CONTACT_GAP = 1e-6
"""Gap of a lift without contact that is proposed [m]."""
LARGEST_BALL = 25e-6
"""Largest of the paper's balls, of which trials are by default [m]."""
_EQUAL_SCORES = 0.05
"""Difference of the summed logarithms of widths up to which measurements are equally good."""
_EQUAL_VALUES = 0.05
"""Relative difference up to which expected voltages or forces are equally low."""
_HALF = 0.5
"""Share of the prior's width below which an estimate is informed by the data."""


class Estimate(NamedTuple):
    """An estimate of a parameter, or of a combination of parameters."""

    interval: Interval
    """Value and 95 % interval, in SI."""
    is_informed: bool
    """The data at least halve the width that the prior alone allows."""
    is_determined: bool
    """It is informed, and its interval spans less than a factor of 2."""


class Prediction(NamedTuple):
    """A voltage [V] or a force [N] that was not measured."""

    kind: str
    radius: float
    """Radius of the ball [m]."""
    humidity: float
    """Relative humidity [%]."""
    gap: float
    """Gap to the plate in a release, to the tool without contact [m]."""
    median: Interval
    """Median of the balls, with the 95 % interval of it."""
    balls_low: float
    balls_high: float
    """Between these are 95 % of the balls, with the estimated parameters."""


class Proposal(NamedTuple):
    """The next measurement that would help most."""

    prediction: Prediction
    """The measurement, and the value that the fit expects."""
    target: str
    """Name of the parameter that it would narrow most."""
    before: Interval
    """Interval of that parameter now."""
    after: Interval
    """Interval that the measurement would leave if it has the expected value."""


class ShapeTest(NamedTuple):
    """Test of the law's dependence on radius or humidity."""

    variable: str
    """"radius" or "humidity"."""
    exponent: float
    """Power of the variable by which adhesion differs from the law."""
    p_value: float
    """Probability of such a deviation, or a larger one, if the law holds."""


def difference_of_works(values: Mapping[str, float]) -> float:
    """Return W_plate - W_tool, on which grasps depend [J/m^2]."""
    return values["work_object_substrate"] - values["work_tool_object"]


@dataclass(frozen=True)
class Fit:
    """A fit of the laws to a table. All values are in SI."""

    measurements: Measurements
    maximum: Maximum
    is_gap_bounded: bool = False
    """The table asks for an electrical gap below that of the laws, at which it is held."""

    @property
    def model(self) -> Model:
        """The parameters, which of them were estimated, and their priors."""
        return self.maximum.likelihood.model

    @property
    def values(self) -> dict[str, float]:
        """Values of all parameters by name: estimated ones, and those that were held."""
        return self.maximum.values

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Estimates of the parameters that were estimated, by name."""
        return {
            name: self._estimate(lambda values, name=name: values[name]) for name in self.model.free
        }

    @cached_property
    def difference(self) -> Estimate:
        """Estimate of W_plate - W_tool, on which grasps depend [J/m^2]."""
        return self._estimate(difference_of_works)

    def _estimate(self, quantity: Quantity) -> Estimate:
        """Return the estimate of a quantity."""
        interval = self.maximum.interval(quantity)
        is_narrow = 0 < interval.high < DETERMINED_SPAN * interval.low
        is_informed = self.maximum.share_of_prior(quantity) < _HALF
        return Estimate(interval, is_informed, bool(is_narrow and is_informed))

    @cached_property
    def residuals(self) -> np.ndarray:
        """(N,) residuals in standard deviations of the row; nan where no value is known."""
        return self.maximum.likelihood.residuals(self.values)

    def predict(
        self,
        kind: str = "release",
        radius: float = 20e-6,
        humidity: float = 10.0,
        gap: float = RELEASE_GAP,
    ) -> Prediction:
        """Return what a measurement would show, with tip and ball of the table's first row.

        Args:
            kind: one of "grasp", "release", "no_contact", "pull_off_tool", "pull_off_plate",
                "melting".
            radius: of the ball [m].
            humidity: relative humidity [%].
            gap: to the plate in a release, to the tool without contact [m].

        Raises:
            ConfigError: there is no such kind, or a number is out of range.
        """
        check("kind", kind, f"one of {', '.join(KINDS)}", kind in KINDS)
        if kind == "no_contact" and self._has_rounded_tip:
            raise ConfigError("kind", kind, "another than no_contact with a rounded tip")
        check("radius", radius, "between 2e-6 and 100e-6 m", 2e-6 <= radius <= 100e-6)
        check("humidity", humidity, "between 0 and 100 %", 0 <= humidity <= 100)
        is_near = 0.5e-6 <= gap <= min(50e-6, 4 * radius)
        check("gap", gap, "between 0.5e-6 and 50e-6 m, and at most 4 times the radius", is_near)
        row = like_first(self.measurements, single_row(kind, radius, humidity, gap))
        load_model = LoadModel(row)

        def load_at(values: Mapping[str, float], deviations: float = 0.0) -> float:
            """Return a force [N], or the square of a voltage [V^2]; below 0 where none is needed."""
            loads = load_model.loads(values)
            load = loads.mean + deviations * loads.deviation
            return (load / loads.per_volt2).item()

        def value_of(load: float) -> float:
            """Return the force or the voltage, 0 where none is needed."""
            needed = np.maximum(load, 0.0)
            return float(needed if kind in FORCES else np.sqrt(needed))

        # The interval is that of the load: a voltage of 0 has no derivatives.
        ends_of_load = self.maximum.interval(load_at)
        return Prediction(
            kind,
            radius,
            humidity,
            gap,
            median=Interval(*(value_of(load) for load in ends_of_load)),
            balls_low=value_of(load_at(self.values, -NORMAL_95)),
            balls_high=value_of(load_at(self.values, NORMAL_95)),
        )

    def has_laws(self, kind: str, radius: float, gap: float) -> bool:
        """Return whether the laws hold for a measurement with the tip of the table's first row.

        Args:
            kind: of the measurement.
            radius: of the ball [m].
            gap: to the plate in a release, to the tool without contact [m].
        """
        if kind in ACROSS_GAPS and gap > MAX_GAP_RATIO * radius:
            return False
        if kind == "no_contact" and self._has_rounded_tip:
            return False
        probe_ratio = self.measurements.probe_radius[0].item() / radius
        return kind not in ELECTRICAL or PROBE_RATIOS.allows(probe_ratio)

    @property
    def _has_rounded_tip(self) -> bool:
        """Whether the tip of the table's first row is rounded."""
        return bool(np.isfinite(self.measurements.tip_curvature[0]))

    @cached_property
    def proposal(self) -> Proposal | None:
        """The next measurement that would help most, of one ball.

        It is the one that narrows the parameters most, apart from spreads, by its information at
        the estimate. The interval that it would leave is that of a fit which has it.
        None where all balls would move without a voltage, or melt.
        """
        candidates = sorted(self._candidates(), key=self._rank)
        if not candidates:
            return None

        names = [name for name in self.model.free if not name.startswith("spread")]
        names = names or list(self.model.free)
        indices = [self.model.free.index(name) for name in names]
        precision = np.linalg.inv(self.maximum.covariance)

        def deviations(row: Measurements) -> np.ndarray:
            """Return standard deviations of the parameters after a measurement."""
            likelihood = Likelihood(row, self.model)
            information = likelihood.information(self.maximum.places)
            return np.sqrt(np.diag(np.linalg.inv(precision + information)))[indices]

        # The first of about equally good ones.
        after = [deviations(row) for row in candidates]
        scores = np.array([np.sum(np.log(widths)) for widths in after])
        best = int(np.argmax(scores < scores.min() + _EQUAL_SCORES))
        now = np.sqrt(np.diag(self.maximum.covariance))[indices]
        target = names[int(np.argmin(after[best] / now))]

        row = candidates[best]
        kind, radius, humidity, gap = (
            getattr(row, name).item() for name in ("kind", "radius", "humidity", "gap")
        )
        prediction = self.predict(kind, radius, humidity, gap)
        expected = np.array([prediction.median.value])
        table = self.measurements.joined(replace(row, low=expected, high=expected))
        likelihood = Likelihood(table, self.model)
        fit_with_row = Fit(table, maximise(likelihood, near=self.maximum))
        return Proposal(
            prediction,
            target,
            before=self.estimates[target].interval,
            after=fit_with_row.estimates[target].interval,
        )

    def _candidates(self) -> list[Measurements]:
        """Return measurements that a laboratory with this table could add."""
        rows = self.measurements
        radii = dict.fromkeys(np.quantile(rows.radius, [0.5, 0.0, 1.0], method="nearest").tolist())
        humidities = dict.fromkeys([rows.humidity.min().item(), rows.humidity.max().item()])
        release_gaps = rows.gap[rows.kind == "release"]
        release_gap = release_gaps[0].item() if len(release_gaps) else RELEASE_GAP
        kinds = {"grasp": RELEASE_GAP, "release": release_gap, "no_contact": NO_CONTACT_GAP}
        if np.isin(rows.kind, FORCES).any():
            kinds |= dict.fromkeys(FORCES, RELEASE_GAP)

        candidates = []
        for kind, gap in kinds.items():
            for humidity in humidities:
                for radius in radii:
                    if not self.has_laws(kind, radius, gap):
                        continue
                    row = like_first(rows, single_row(kind, radius, humidity, gap))
                    if kind in FORCES or self._melts_nothing(row):
                        candidates.append(row)
        return candidates

    def _rank(self, row: Measurements) -> tuple[bool, int]:
        """Return the place of a candidate among equally good ones.

        Voltages come before forces, and low values first: the supply may end there.
        """
        is_force = row.kind.item() in FORCES
        return is_force, round(np.log(self._expected_value(row)) / _EQUAL_VALUES)

    def _expected_value(self, row: Measurements) -> float:
        """Return the voltage or the force that a row would show."""
        load_model = LoadModel(row)
        loads = load_model.loads(self.values)
        return load_model.value_of(loads.mean, loads).item()

    def _melts_nothing(self, row: Measurements) -> bool:
        """Return whether a row needs a voltage, and none that melts a ball on the plate."""
        voltage = self._expected_value(row)
        most = np.inf if row.kind.item() == "release" else self.values["breakdown_voltage"]
        return 0 < voltage < most

    @cached_property
    def shape_tests(self) -> list[ShapeTest]:
        """Tests whether radius and humidity act as in the law, where the table varies them."""
        rows = self.measurements
        has_value = (rows.is_known | rows.is_range) & (rows.kind != "melting")
        tests = []
        for variable in ("radius", "humidity"):
            if len(np.unique(getattr(rows, variable)[has_value])) > 1:
                tests.append(self._shape_test(variable))
        return tests

    def _shape_test(self, variable: str) -> ShapeTest:
        """Return the test by the ratio of likelihoods, with the F distribution of few values.

        The law's growth with humidity is not estimated here, since it could imitate an exponent.
        """
        name = f"{variable}_exponent"
        law = self.maximum
        growths = ("humidity_doubling", "humidity_fall")
        if variable == "humidity" and set(growths) & set(self.model.free):
            names = tuple(name for name in self.model.free if name not in growths)
            law_likelihood = Likelihood(self.measurements, replace(self.model, free=names))
            law = maximise(law_likelihood, near=self.maximum)

        likelihood = Likelihood(self.measurements, law.likelihood.model.with_free(name))
        free = maximise(likelihood, near=law)
        distribution = student(likelihood, free.places)
        rise = max(0.0, 2 * (law.objective - free.objective))
        p_value = stats.f.sf(distribution.t_squared_of(rise), 1, distribution.freedom)
        return ShapeTest(variable, free.values[name], float(p_value))


def fit(
    table: Any,
    *,
    units: Mapping[str, str] | None = None,
    free: Sequence[str] = (),
    hold: Mapping[str, float] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
) -> Fit:
    """Fit the gripper's laws to measured voltages and forces.

    Works of adhesion and their spreads are estimated, and further parameters where the table
    determines them: it at least halves the width of the prior.

    Args:
        table: path of a CSV file, a mapping of columns, a pandas.DataFrame, or a sequence of
            mappings; docs/calibrate.md lists the columns. Columns have their units in their names,
            as `radius [um]`.
        units: units of columns whose names have none, as {"radius": "um"}.
        free: names of further parameters to estimate, whether the table determines them or not.
        hold: values in SI of parameters that are not estimated.
        priors: median in SI, and factor within which 95 % of the prior lie, by parameter.

    Returns:
        Estimates with 95 % intervals, predictions, tests and the next measurement to make.

    Raises:
        UserError: a row of the table, or a name or value of a parameter is not allowed.
    """
    measurements = read_measurements(table, units)
    model = Model().with_least_gap(least_gap(measurements))
    for name, (median, factor) in (priors or {}).items():
        model = model.with_prior(name, median, factor)
    for name in free:
        known_parameter(name, "free")
    held = hold or {}
    for name, value in held.items():
        if name in free:
            raise ConfigError("hold", name, "left out, since `free` names it")
        model = model.with_held(name, value)
    model = model.with_free(*free)
    if not model.free:
        raise ConfigError(
            "hold", ", ".join(held), "fewer parameters, since none is left to estimate"
        )

    maximum = maximise(Likelihood(measurements, model))
    candidates = [
        name
        for name in FREE_IF_DETERMINED
        if name not in held and name not in free and _has_evidence(measurements, name)
    ]
    determined = _determined(measurements, maximum, candidates)
    if determined:
        likelihood = Likelihood(measurements, model.with_free(*determined))
        maximum = maximise(likelihood, near=maximum)
    return _with_gap_of_laws(Fit(measurements, maximum))


def _with_gap_of_laws(fitted: Fit) -> Fit:
    """Return a fit whose electrical gap is not below the least one of the laws, but held there.

    Raises:
        UserError: it is below, and was the only parameter that was estimated.
    """
    least = least_gap(fitted.measurements)
    if fitted.values["electrical_gap"] >= least:
        return fitted

    model = fitted.model.with_held("electrical_gap", least)
    if not model.free:
        raise UserError(
            f"the table asks for an electrical gap below {least:.3g} m, the least one of the laws; "
            "estimate another parameter, too"
        )
    maximum = maximise(Likelihood(fitted.measurements, model), near=fitted.maximum)
    return Fit(fitted.measurements, maximum, is_gap_bounded=True)


def least_gap(measurements: Measurements) -> float:
    """Return the least electrical gap of the laws, for balls of a table and of the paper [m].

    `iswarm grasp` refuses smaller ones for the same balls. This one is a little larger, since
    fit.toml has six digits of it.
    """
    greatest_radius = max(float(measurements.radius.max()), LARGEST_BALL)
    return greatest_radius * MIN_GAP_RATIO * (1 + 1e-5)


def _has_evidence(measurements: Measurements, name: str) -> bool:
    """Return whether a table has rows that tell a parameter from the others.

    Grasps tell the electrical gap from the work to the plate only by the small weight, which many
    rows would resolve, but no better than the law holds. Pull-off forces and lifts without contact
    depend on that work and not on the gap.
    """
    if name != "electrical_gap":
        return True
    of_plate = np.isin(measurements.kind, ("pull_off_plate", "no_contact"))
    return bool((of_plate & measurements.is_known).any())


def _determined(
    measurements: Measurements, maximum: Maximum, candidates: Sequence[str]
) -> list[str]:
    """Return the candidates that the table determines although all of them are estimated.

    Those that it determines least are left out one by one.
    """
    names = list(candidates)
    while names:
        model = maximum.likelihood.model.with_free(*names)
        likelihood = Likelihood(measurements, model)
        parameters = [model.parameters[name] for name in names]
        places = [parameter.place_of(parameter.usual) for parameter in parameters]
        information = likelihood.information(np.concatenate([maximum.places, places]))
        covariance = np.linalg.inv(information + np.eye(len(information)))
        shares = np.sqrt(np.diag(covariance))[-len(names) :]
        if shares.max() < _HALF:
            return names
        del names[int(np.argmax(shares))]
    return []
