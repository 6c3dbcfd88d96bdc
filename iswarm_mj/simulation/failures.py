"""Robots that fail during a run: from a control step on they only stand in the way."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from jaxtyping import Int32

from iswarm_mj.utils.constraints import Within, validate
from iswarm_mj.utils.errors import ConfigError

NEVER = np.iinfo(np.int32).max
"""Number of the control step at which robots fail that do not fail."""
STREAM = 0x4641494C
"""Number that tells draws of failures from others of the same key or seed."""
_FORM = "SHARE:STEP, as 0.1:400 for a tenth of the robots at step 400"


@dataclass(frozen=True)
class Failures:
    """A share of the robots of each world fails at a control step."""

    share: Annotated[float, Within(0, 1)]
    """Share of the robots."""
    step: Annotated[int, Within(0, 1_000_000)]
    """Control steps that these robots take."""

    def __post_init__(self):
        validate(self)
        object.__setattr__(self, "share", float(self.share))  # also of NumPy, for the text
        object.__setattr__(self, "step", int(self.step))

    def __str__(self) -> str:
        return f"{self.share!r}:{self.step}"

    @classmethod
    def parse(cls, text: str) -> "Failures":
        """Return the failures that a text like `0.1:400` states.

        Raises:
            ConfigError: it states none, or a number is out of range.
        """
        share_text, _, step_text = text.partition(":")
        try:
            share = float(share_text)
            step = int(step_text)
        except ValueError:
            raise ConfigError("failing", text, _FORM) from None
        try:
            return cls(share, step)
        except ConfigError as error:
            allowed = f"{_FORM}, whose {error.field} is {error.constraint}"
            raise ConfigError("failing", text, allowed) from None


def as_failures(given: Any) -> Failures | None:
    """Return failures that somebody stated as such, or as a text.

    Raises:
        ConfigError: it is neither.
    """
    if given is None or isinstance(given, Failures):
        return given
    if not isinstance(given, str):
        raise ConfigError("failing", given, _FORM)
    return Failures.parse(given)


def failing_steps(
    failures: Failures | None, keys: Any, n_robots: Sequence[int], n_places: int
) -> Int32[np.ndarray, "B N"] | None:
    """Return the control step at which each robot of B worlds fails; None without failures.

    Which robots fail is drawn from the random key of the world, apart from all else that is drawn
    from it, so that a run with failures is that without them until then.

    Args:
        failures: share and step.
        keys: data of the worlds' random keys (B, 2).
        n_robots: number of robots of each world.
        n_places: places for robots N in each world.
    """
    if failures is None:
        return None
    steps = np.full((len(n_robots), n_places), NEVER, np.int32)
    for world, (key, number) in enumerate(zip(np.asarray(keys), n_robots, strict=True)):
        rng = np.random.default_rng([*key.tolist(), STREAM])
        n_failing = round(failures.share * number)
        steps[world, rng.permutation(number)[:n_failing]] = failures.step
    return steps
