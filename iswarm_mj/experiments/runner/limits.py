"""Limits of settings of many runs: types of fields, for the settings themselves and for their flags."""

from typing import Annotated

from iswarm_mj.utils.constraints import Within

Seed = Annotated[int, Within(0, 2**32 - 2)]
Steps = Annotated[int, Within(1, 1_000_000)]
Workers = Annotated[int, Within(0, 1024)]
Generations = Annotated[int, Within(1, 100_000)]
Population = Annotated[int, Within(2, 10_000)]
Repeats = Annotated[int, Within(1, 1000)]
