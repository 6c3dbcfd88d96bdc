"""Limits of settings, their sentences, and which fields of a dataclass are checked."""

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
import pytest

from iswarm_mj.utils.constraints import Above, Within, validate
from iswarm_mj.utils.errors import ConfigError

NEVER_ALLOWED = [math.nan, math.inf, -math.inf, np.float32(np.inf), 10**400]


@pytest.mark.parametrize(
    ("constraint", "text", "inside", "outside"),
    [
        (Within(10, 150, "rd"), "between 10 and 150 rd", [10, 150], [9.99, 151]),
        (Within(1e-6, 2e-5, "m"), "between 1e-06 and 2e-05 m", [1e-6], [9e-7]),
        (Within(1), "at least 1", [1, 1e300], [0]),
        (Above(0, 1, "rd"), "above 0 and at most 1 rd", [1e-9, 1], [0, -1, 1.1, 1e-300, 5e-324]),
        (
            Within(0, 69, "V", "70 V melts the ball"),
            "between 0 and 69 V, since 70 V melts the ball",
            [69],
            [70],
        ),
    ],
)
def test_limits(constraint, text, inside, outside):
    assert str(constraint) == text
    assert all(constraint.allows(value) for value in inside)
    assert not any(constraint.allows(value) for value in [*outside, *NEVER_ALLOWED])


@dataclass(frozen=True)
class Motor:
    """Settings of every kind that is checked."""

    length: Annotated[float, Within(0, 10, "m")] = 1.0
    count: Annotated[int, Within(1, 5)] = 1
    mode: Literal["fast", "slow"] = "fast"
    is_on: bool = True
    anything: Any = None
    width: Annotated[float | None, Within(0, 10)] = None
    most: Annotated[int | None, Within(1)] = None

    def __post_init__(self):
        validate(self, "motor")


@pytest.mark.parametrize(
    "values",
    [
        {"length": 3},
        {"length": np.float32(3)},
        {"count": np.int64(3)},
        {"most": np.int64(3)},
        {"width": 2.5},
        {"mode": "slow"},
        {"anything": math.nan},
    ],
)
def test_allowed(values):
    assert vars(Motor(**values)) == vars(Motor()) | values


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"length": "3"}, "motor.length must be between 0 and 10 m (got '3')"),
        ({"count": 2.0}, "motor.count must be a whole number between 1 and 5 (got 2.0)"),
        ({"most": True}, "motor.most must be a whole number at least 1 (got True)"),
        ({"mode": "still"}, "motor.mode must be fast or slow (got 'still')"),
        ({"is_on": 1}, "motor.is_on must be true or false (got 1)"),
    ],
)
def test_refused(values, message):
    with pytest.raises(ConfigError) as caught:
        Motor(**values)
    assert str(caught.value) == message
