"""`iswarm fit`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from iswarm_mj.utils.constraints import Within, validate
from iswarm_mj.utils.errors import ConfigError, UserError

EXAMPLE = "example"
"""Name of the table that ships: the paper's voltages."""


@dataclass(frozen=True)
class Fit:
    """Fit works of adhesion to measured voltages; writes fit.toml, result.json and figures."""

    table: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE.csv")] = Path(EXAMPLE)
    """Table of measurements with units in its header, as `kind, radius [um], humidity [%], voltage
    [V]`; by default that of the paper."""
    units: tuple[str, ...] = ()
    """Units of columns without one in the header, as radius=um humidity=% voltage=V."""
    free: tuple[str, ...] = ()
    """Further parameters to estimate, as electrical_gap or plate_roughness; a wrong name lists them."""
    hold: tuple[str, ...] = ()
    """Parameters that are not estimated, with their values in SI, as electrical_gap=1e-7."""
    prior: tuple[str, ...] = ()
    """Other priors: median in SI, and factor within which 95 % of the prior lie, as
    work_tool_object=1.4e-3:3."""
    radius: Annotated[tuple[float, ...], Within(2e-6, 100e-6, "m")] = ()
    """Radii of balls for which voltages are predicted; by default the median of the table's [m]."""
    rh: Annotated[tuple[float, ...], Within(0, 100, "%")] = ()
    """Relative humidities of the predictions; by default those of the table [%]."""
    gap: Annotated[tuple[float, ...], Within(0.5e-6, 50e-6, "m")] = (5e-6,)
    """Gaps to the plate at which releases are predicted [m]."""
    trials: Annotated[int, Within(0, 10_000)] = 0
    """Number of trials of the bench at each radius and humidity, beside the laws."""
    out: Path = Path("runs/fit")
    """Directory for the results; those of an earlier fit in it are replaced."""

    def __post_init__(self):
        validate(self)

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.gripper.fitting.fit import fit
        from iswarm_mj.gripper.fitting.table import example_table
        from iswarm_mj.workflows.fit import Places, run_fit

        is_example = self.table == Path(EXAMPLE) and not self.table.exists()
        table = example_table() if is_example else self.table
        fitted = fit(
            table,
            units=dict(_pair("units", text) for text in self.units),
            free=[name.replace("-", "_") for name in self.free],
            hold={name: _number("hold", text) for name, text in self._pairs("hold")},
            priors={name: _prior(text) for name, text in self._pairs("prior")},
        )
        places = Places(self.radius, self.rh, self.gap)
        run_fit(fitted, places, self.trials, self.out, source=str(self.table))

    def _pairs(self, setting: str) -> list[tuple[str, str]]:
        """Return names and texts of a setting, each name once."""
        pairs = [_pair(setting, text) for text in getattr(self, setting)]
        names = [name for name, _ in pairs]
        if len(set(names)) < len(names):
            raise UserError(f"`{setting}` names a parameter twice; give it once")
        return pairs


def _pair(setting: str, text: str) -> tuple[str, str]:
    """Return what stands on both sides of an equals sign."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise ConfigError(setting, text, "NAME=VALUE")
    return name.replace("-", "_"), value


def _number(setting: str, text: str) -> float:
    """Return a number."""
    try:
        return float(text)
    except ValueError:
        raise ConfigError(setting, text, "a number in SI") from None


def _prior(text: str) -> tuple[float, float]:
    """Return median and factor of a prior."""
    median, colon, factor = text.partition(":")
    if not colon:
        raise ConfigError("prior", text, "NAME=MEDIAN:FACTOR, as work_tool_object=1.4e-3:3")
    return _number("prior", median), _number("prior", factor)
