"""The likelihood of a table under the laws, with censored values and ranges, and its information."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr

from iswarm_mj.gripper.fitting.model import LoadModel, Loads
from iswarm_mj.gripper.fitting.parameters import Model
from iswarm_mj.gripper.fitting.table import Measurements

_STEP = 1e-4
"""Step of numerical derivatives, in standard deviations of the prior."""


class Likelihood:
    """Minus the logarithm of likelihood and prior of a model's free parameters."""

    def __init__(self, measurements: Measurements, model: Model):
        """Sort the rows by what they say.

        Args:
            measurements: rows of the table.
            model: which parameters are free, and their priors.
        """
        self.model = model
        self.load_model = LoadModel(measurements)
        self._known = np.flatnonzero(measurements.is_known)
        self._ranges = np.flatnonzero(measurements.is_range)
        is_bound = ~(measurements.is_known | measurements.is_range)
        self._bounds = np.flatnonzero(is_bound)

    def objective(self, places: Float[np.ndarray, "P"]) -> float:
        """Return minus the logarithm of likelihood times prior, up to a constant.

        Args:
            places: of the free parameters in their priors, in standard deviations.
        """
        log_likelihood = self.log_likelihood(self.model.values(places))
        return 0.5 * float(places @ places) - log_likelihood

    def log_likelihood(self, values: Mapping[str, float]) -> float:
        """Return the logarithm of the likelihood.

        Args:
            values: parameters by name, in SI.
        """
        loads = self.load_model.loads(values)
        total = 0.0
        if len(self._known):
            total += self._log_density_of_known(loads)
        if len(self._ranges):
            total += self._log_density_of_ranges(loads)
        if len(self._bounds):
            total += self._log_probability_of_bounds(loads)
        return total

    def _log_density_of_known(self, loads: Loads) -> float:
        """Return the log density of means of balls, up to a constant.

        The scatter of means falls with the number of balls, the uncertainty of readings does not.
        """
        rows = self.load_model.measurements
        known = self._known
        deviation = self._deviation(loads, rows.high, rows.repeats)[known]
        load = self.load_model.load_of(rows.high, loads)[known]
        slope = self.load_model.slope_of(rows.high, loads)[known]
        residual = (load - loads.mean[known]) / deviation
        return float(np.sum(np.log(slope / deviation) - 0.5 * residual**2))

    def _log_density_of_ranges(self, loads: Loads) -> float:
        """Return the log density of least and greatest of n balls, with n - 2 between them."""
        rows = self.load_model.measurements
        ranges = self._ranges
        n = rows.repeats[ranges]
        low, high, log_between = self._standardised_bounds(loads)

        log_density = np.zeros(len(ranges))
        for value, standardised in ((rows.low, low), (rows.high, high)):
            deviation = self._deviation(loads, value, 1)[ranges]
            slope = self.load_model.slope_of(value, loads)[ranges]
            log_density += np.log(slope / deviation) - 0.5 * standardised[ranges] ** 2

        # n (n - 1) pairs of balls may be the least and the greatest.
        orderings = np.log(n * (n - 1))
        return float(np.sum(orderings + log_density + (n - 2) * log_between[ranges]))

    def _log_probability_of_bounds(self, loads: Loads) -> float:
        """Return the log probability that all balls of bounds, and of intervals of one ball, hold."""
        _, _, log_between = self._standardised_bounds(loads)
        repeats = self.load_model.measurements.repeats
        return float(np.sum(repeats[self._bounds] * log_between[self._bounds]))

    def _deviation(self, loads: Loads, value: np.ndarray, n: np.ndarray | int) -> np.ndarray:
        """Return the standard deviation of the load that the mean of n balls shows.

        Args:
            loads: loads of all rows.
            value: voltage or force at which the uncertainty of readings becomes one of loads.
            n: number of balls.
        """
        rows = self.load_model.measurements
        finite = np.where(np.isfinite(value), value, 0.0)
        reading = self.load_model.slope_of(finite, loads) * rows.uncertainty
        return np.hypot(loads.deviation / np.sqrt(n), reading)

    def _standardised_bounds(self, loads: Loads) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return least and greatest load in standard deviations, and log P of what lies between."""
        rows = self.load_model.measurements
        ends = []
        for value in (rows.low, rows.high):
            load = self.load_model.load_of(np.where(np.isfinite(value), value, 0.0), loads)
            deviation = self._deviation(loads, value, 1)
            ends.append((load - loads.mean) / deviation)
        low = np.where(rows.low > 0, ends[0], -np.inf)
        high = np.where(np.isfinite(rows.high), ends[1], np.inf)

        # Intervals above the mean are mirrored: logarithms are accurate in the lower tail alone.
        is_upper = low > 0
        left = np.where(is_upper, -high, low)
        right = np.where(is_upper, -low, high)
        log_right = log_ndtr(right)
        ratio = np.exp(np.minimum(log_ndtr(left) - log_right, -1e-12))
        return low, high, log_right + np.log1p(-ratio)

    def residuals(self, values: Mapping[str, float]) -> np.ndarray:
        """Return (N,) standardised residuals of loads; nan where no value is known."""
        rows = self.load_model.measurements
        loads = self.load_model.loads(values)
        load = self.load_model.load_of(np.where(np.isfinite(rows.high), rows.high, 0.0), loads)
        deviation = self._deviation(loads, rows.high, rows.repeats)
        return np.where(rows.is_known, (load - loads.mean) / deviation, np.nan)

    def information(self, places: np.ndarray, *, of_mean: bool = False) -> np.ndarray:
        """Return the expected information of known values and ranges on the free parameters.

        A range counts as its two ends; bounds count for nothing.

        Args:
            places: of the free parameters.
            of_mean: leave out what the scatter says.

        Returns:
            (P, P) matrix, in which the prior of each parameter has the information 1.
        """
        rows = self.load_model.measurements
        n = np.where(rows.is_range, 1, rows.repeats)
        weight = np.where(rows.is_range, 2.0, np.where(rows.is_known, 1.0, 0.0))

        def mean_and_deviation(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Return what is observed, in units that do not depend on parameters but for k."""
            loads = self.load_model.loads(self.model.values(at))
            deviation = self._deviation(loads, self.load_model.value_of(loads.mean, loads), n)
            return loads.mean / loads.per_volt2, deviation / loads.per_volt2

        _, deviation = mean_and_deviation(places)
        of_means = []
        of_deviations = []
        for index in range(len(places)):
            step = np.zeros(len(places))
            step[index] = _STEP
            mean_above, deviation_above = mean_and_deviation(places + step)
            mean_below, deviation_below = mean_and_deviation(places - step)
            of_means.append((mean_above - mean_below) / (2 * _STEP) / deviation)
            of_deviations.append((deviation_above - deviation_below) / (2 * _STEP) / deviation)
        means = np.array(of_means)
        matrix = (means * weight) @ means.T
        if of_mean:
            return matrix
        deviations = np.array(of_deviations)
        return matrix + 2 * (deviations * weight) @ deviations.T
