"""Maximum of a likelihood, and intervals by profiles of it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import stats
from scipy.optimize import Bounds, minimize

from iswarm_mj.gripper.fitting.likelihood import Likelihood

CONFIDENCE = 0.95
"""Confidence of all intervals."""
FARTHEST = 8.0
"""Largest distance of a parameter from the median of its prior, in standard deviations."""
PRIOR_VALUES = 2
"""Number of values that say as much of the scatter as its prior does: 1 / (2 sd^2) with sd 0.47."""
_STEP = 1e-3
"""Step of numerical derivatives, in standard deviations of the prior."""

_MANY_ROWS = 1000
"""Number of rows from which on intervals are tried by the covariance first."""
_QUADRATIC_TOLERANCE = 0.05
"""Deviation from a quadratic objective up to which they hold, in the cut."""
_MOST_RESTARTS = 5
"""Largest number of times that the search for the end of an interval starts again."""
_TOLERANCE = 1e-3
"""Precision of that search, in the logarithm of the quantity and in the cut."""

Quantity = Callable[[dict[str, float]], float]
"""A quantity that follows from the parameters by name, in SI."""


class Interval(NamedTuple):
    """An estimate and its 95 % interval.

    An end that no search found is nan.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Maximum:
    """The parameters that agree best with data and prior, and how sharply."""

    likelihood: Likelihood
    places: Float[np.ndarray, "P"]
    """Free parameters in standard deviations of their priors."""
    objective: float
    """Minus the logarithm of likelihood times prior."""
    covariance: Float[np.ndarray, "P P"]
    """Inverse of the second derivatives of the objective."""
    cut: float
    """How far twice the objective may rise within an interval of one quantity."""

    @property
    def values(self) -> dict[str, float]:
        """All parameters by name, in SI."""
        return self.likelihood.model.values(self.places)

    def gradient(self, quantity: Quantity) -> np.ndarray:
        """Return the derivatives of a quantity by the free parameters."""
        values = self.likelihood.model.values
        gradient = []
        for index in range(len(self.places)):
            step = np.zeros(len(self.places))
            step[index] = _STEP
            above = quantity(values(self.places + step))
            below = quantity(values(self.places - step))
            gradient.append((above - below) / (2 * _STEP))
        return np.array(gradient)

    def share_of_prior(self, quantity: Quantity) -> float:
        """Return the standard deviation of a quantity over that by the prior alone, 0 to 1."""
        gradient = self.gradient(quantity)
        prior = gradient @ gradient
        return float(np.sqrt(gradient @ self.covariance @ gradient / prior)) if prior else 0.0

    def interval(self, quantity: Quantity) -> Interval:
        """Return the profile interval of a quantity.

        Its ends are the least and the greatest value where twice the objective is at most `cut`
        above its minimum (Neale and Miller 1997).
        """
        best = quantity(self.values)
        gradient = self.gradient(quantity)
        deviation = float(np.sqrt(max(gradient @ self.covariance @ gradient, 0.0)))
        if deviation == 0:
            return Interval(best, best, best)
        direction = self.covariance @ gradient / deviation
        ends = []
        for sign in (-1.0, 1.0):
            end = self._end_of_many_rows(quantity, sign * direction)
            ends.append(self._end(quantity, sign, sign * direction) if end is None else end)
        low, high = ends
        return Interval(best, float(np.minimum(low, best)), float(np.maximum(high, best)))

    def _end_of_many_rows(self, quantity: Quantity, direction: np.ndarray) -> float | None:
        """Return the end of an interval by the covariance, where it is as good as a search.

        With many rows the objective is quadratic within an interval, and each of its values takes
        long.

        Args:
            quantity: the quantity.
            direction: where the quantity changes most for its cost.

        Returns:
            None with few rows, or where the objective is not quadratic.
        """
        if len(self.likelihood.load_model.measurements) < _MANY_ROWS:
            return None
        for share in (0.5, 1.0):
            end = self.places + share * np.sqrt(self.cut) * direction
            rise = 2 * (self.likelihood.objective(end) - self.objective)
            if abs(rise - share**2 * self.cut) > _QUADRATIC_TOLERANCE * self.cut:
                return None
        return quantity(self.likelihood.model.values(end))

    def _end(self, quantity: Quantity, sign: float, direction: np.ndarray) -> float:
        """Return the least or the greatest value of a quantity within the cut.

        Args:
            quantity: the quantity.
            sign: -1 for the least value, 1 for the greatest.
            direction: where the quantity changes most for its cost, by the covariance.

        Returns:
            The end of the interval; nan where no search ends within the cut.
        """
        values = self.likelihood.model.values
        gradient = self.gradient(quantity)
        scale = abs(quantity(self.values)) or float(np.linalg.norm(gradient))

        def goal(places: np.ndarray) -> float:
            # Linear near 0 and logarithmic beyond: quantities grow exponentially with places.
            return -sign * float(np.arcsinh(10 * quantity(values(places)) / scale))

        constraint = {
            "type": "ineq",
            "fun": lambda places: (
                self.cut - 2 * (self.likelihood.objective(places) - self.objective)
            ),
        }

        def search(start: np.ndarray) -> Any:
            return minimize(
                goal,
                np.clip(start, -FARTHEST, FARTHEST),
                method="SLSQP",
                bounds=Bounds(-FARTHEST, FARTHEST),
                constraints=[constraint],
                options={"maxiter": 300, "ftol": 1e-8},
            )

        # SLSQP may leave what is allowed from a distant start, and stops early along the ridges of
        # parameters that the data hardly determine: it starts again where it stopped.
        best_goal = goal(self.places)
        for length in (0.9, 0.5, 0.2):
            found = search(self.places + length * np.sqrt(self.cut) * direction)
            for _ in range(_MOST_RESTARTS):
                further = search(found.x)
                has_improved = further.fun < found.fun - _TOLERANCE
                if not (has_improved and constraint["fun"](further.x) > -_TOLERANCE):
                    break
                found = further
            if constraint["fun"](found.x) > -_TOLERANCE and found.fun <= best_goal:
                return quantity(values(found.x))
        return np.nan

    def profile(self, name: str, places: np.ndarray) -> np.ndarray:
        """Return twice the rise of the objective with one parameter fixed.

        The other parameters minimise it; with many rows they follow from the covariance.

        Args:
            name: of the parameter, which is free.
            places: where it is fixed, in standard deviations of its prior.
        """
        index = self.likelihood.model.free.index(name)
        others = np.delete(np.arange(len(self.places)), index)
        slope = self.covariance[others, index] / self.covariance[index, index]

        rises = []
        for place in places:

            def objective(of_others: np.ndarray, place: float = float(place)) -> float:
                return self.likelihood.objective(np.insert(of_others, index, place))

            start = self.places[others] + slope * (place - self.places[index])
            is_quadratic = len(self.likelihood.load_model.measurements) >= _MANY_ROWS
            if is_quadratic or len(others) == 0:
                least = objective(start)
            else:
                least = minimize(objective, start, method="BFGS").fun
            rises.append(2 * (least - self.objective))
        return np.maximum(rises, 0.0)


def maximise(likelihood: Likelihood, near: Maximum | None = None) -> Maximum:
    """Return the maximum of likelihood times prior.

    Args:
        likelihood: the likelihood.
        near: maximum of a similar likelihood, where the search starts; by default it starts at two
            places.
    """
    n_free = len(likelihood.model.free)
    if near is None:
        starts = [np.zeros(n_free), np.ones(n_free)]
    else:
        starts = [_places_near(likelihood, near)]
    searches = [minimize(likelihood.objective, start, method="BFGS") for start in starts]
    places = min(searches, key=lambda search: search.fun).x

    # Newton's steps where BFGS stopped for want of precision, as it does with many rows.
    for _ in range(3):
        gradient, hessian = _derivatives(likelihood.objective, places)
        step = np.linalg.solve(hessian, gradient)
        if likelihood.objective(places - step) > likelihood.objective(places):
            break
        places = places - step
    _, hessian = _derivatives(likelihood.objective, places)
    return Maximum(
        likelihood=likelihood,
        places=places,
        objective=likelihood.objective(places),
        covariance=np.linalg.inv(_positive(hessian)),
        cut=_cut(likelihood, places),
    )


def _places_near(likelihood: Likelihood, near: Maximum) -> np.ndarray:
    """Return the free parameters at another maximum, at which some of them may be held."""
    model = likelihood.model
    values = near.values
    return np.array([model.parameters[name].place_of(values[name]) for name in model.free])


class Student(NamedTuple):
    """Student's t of a mean whose scatter is estimated, too, and the rise of the objective for it.

    With N normal values, p parameters of their mean and the scatter estimated with them, twice the
    objective is N log(RSS) in the sum RSS of the squared residuals. A t of n = N - p degrees of
    freedom makes RSS larger by 1 + t^2 / n, so that the objective rises by (n + p) log(1 + t^2 / n),
    which is exact (Seber and Lee 2003, chapter 4). The prior of the scatter adds to N.
    """

    freedom: int
    """Degrees of freedom n."""
    used: int
    """Number p of parameters of the mean."""

    def rise_of(self, t_squared: float) -> float:
        """Return how far twice the objective rises at a square of t."""
        return float((self.freedom + self.used) * np.log1p(t_squared / self.freedom))

    def t_squared_of(self, rise: float) -> float:
        """Return the square of t at which twice the objective rises that far."""
        return float(self.freedom * np.expm1(rise / (self.freedom + self.used)))


def student(likelihood: Likelihood, places: np.ndarray) -> Student:
    """Return the distribution of a likelihood's deviations.

    A parameter is used up where the data say more of its mean than its prior does.
    """
    rows = likelihood.load_model.measurements
    n_values = int(np.sum(rows.is_known) + 2 * np.sum(rows.is_range))
    information = likelihood.information(places, of_mean=True)
    n_used = int(np.sum(np.linalg.eigvalsh(information) > 1))
    return Student(max(1, n_values - n_used) + PRIOR_VALUES, n_used)


def _cut(likelihood: Likelihood, places: np.ndarray) -> float:
    """Return how far twice the objective may rise in an interval, 3.84 for many values."""
    distribution = student(likelihood, places)
    t = float(stats.t.ppf(0.5 + CONFIDENCE / 2, distribution.freedom))
    return distribution.rise_of(t**2)


def _positive(matrix: np.ndarray) -> np.ndarray:
    """Return a symmetric matrix with eigenvalues of at least 1e-3."""
    eigenvalues, vectors = np.linalg.eigh(matrix)
    return (vectors * np.maximum(eigenvalues, 1e-3)) @ vectors.T


def _derivatives(
    function: Callable[[np.ndarray], float], at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivatives, by central differences."""
    n = len(at)
    steps = _STEP * np.eye(n)
    middle = function(at)
    above = np.array([function(at + step) for step in steps])
    below = np.array([function(at - step) for step in steps])
    gradient = (above - below) / (2 * _STEP)
    hessian = np.diag((above - 2 * middle + below) / _STEP**2)
    for i in range(n):
        for j in range(i):
            corners = (
                function(at + steps[i] + steps[j])
                - function(at + steps[i] - steps[j])
                - function(at - steps[i] + steps[j])
                + function(at - steps[i] - steps[j])
            )
            hessian[i, j] = hessian[j, i] = corners / (4 * _STEP**2)
    return gradient, hessian
