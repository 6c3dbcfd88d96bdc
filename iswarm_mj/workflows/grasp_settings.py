"""Settings of the gripper's experiments."""

from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Annotated, Any, NamedTuple

from iswarm_mj.gripper.bench.contacts import Contacts
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import Gaps
from iswarm_mj.gripper.bench.trial import Trial, draw
from iswarm_mj.gripper.laws import detachment
from iswarm_mj.gripper.laws.roughness import Surface, effective_work
from iswarm_mj.utils.constraints import Within, check, spaced, validate
from iswarm_mj.utils.errors import ConfigError

CALIBRATION = (
    "WORK_TOOL_OBJECT",
    "WORK_OBJECT_SUBSTRATE",
    "VARIATION_TOOL_OBJECT",
    "VARIATION_OBJECT_SUBSTRATE",
    "CONTACT_GAP",
    "PROBE_RADIUS",
    "MELTING_VOLTAGE",
    "BALL_DENSITY",
)
"""Constants of `detachment` that tables record, four of them settings by the same names."""
_GAP = Within(0.5e-6, 50e-6, "m")


@dataclass(frozen=True)
class GraspSettings:
    """The trials; also flags of their command. SI units.

    Raises:
        ConfigError: values out of range, no radius or humidity, or too many trials.
    """

    radius: tuple[str, ...] = ("15e-6:25e-6:5",)
    """Radii of the balls, a list or start:stop:count [m]."""
    rh: Annotated[tuple[float, ...], Within(0, 100, "%")] = (10.0, 30.0, 50.0)
    """Relative humidities [%]."""
    repeats: Annotated[int, Within(1, 100_000)] = 5
    """Trials at each radius and humidity, each with its own works of adhesion."""
    seed: Annotated[int, Within(0, 2**32 - 1)] = 0
    """Seed of the works of adhesion and humidities."""
    rh_spread: Annotated[float, Within(0, 10, "%")] = 3.0
    """Largest deviation of a trial's humidity from `rh`; by default the accuracy of the paper's chamber [%]."""
    work_tool_object: Annotated[float, Within(1e-6, 1.0, "J/m^2")] = detachment.WORK_TOOL_OBJECT
    """Median work of adhesion between tool and ball at 10 % RH [J/m^2]."""
    work_object_substrate: Annotated[float, Within(1e-6, 1.0, "J/m^2")] = detachment.WORK_OBJECT_SUBSTRATE
    """Median work of adhesion between ball and plate at 10 % RH [J/m^2]."""
    probe_radius: Annotated[float, Within(2e-6, 80e-6, "m")] = detachment.PROBE_RADIUS
    """Radius of the tool, a wire with a flat tip [m]."""
    ball_density: Annotated[float, Within(100.0, 25e3, "kg/m^3")] = detachment.BALL_DENSITY
    """Density of the balls [kg/m^3]."""
    gap: Annotated[tuple[float, ...], _GAP] = (detachment.RELEASE_GAP,)
    """Gaps to the plate at which a ball is released [m]."""
    no_contact_gap: Annotated[tuple[float, ...], _GAP] = (1e-6, 2e-6, 5e-6)
    """Gaps to the ball at which the tool stops in attempts without contact [m]."""
    threads: Annotated[int, Within(0, 1024)] = 0
    """Threads, 0 for one per core; the results do not depend on it."""
    protocol: Protocol = field(default_factory=Protocol)
    contacts: Contacts = field(default_factory=Contacts)
    """Conduction, breakdown and impacts of the ball's contacts."""
    tool: Surface = field(default_factory=Surface)
    """Roughness, preload and hysteresis of the tool's contact."""
    plate: Surface = field(default_factory=Surface)
    """Roughness, preload and hysteresis of the plate's contact."""

    def __post_init__(self):
        validate(self)
        check("rh", self.rh, "one or more relative humidities from 0 to 100 %", len(self.rh) > 0)
        for name, gaps in (("gap", self.gap), ("no_contact_gap", self.no_contact_gap)):
            for gap in gaps:
                check(name, gap, "at most 4 times the least radius", gap <= 4 * min(self.radii))
        check("repeats", self.repeats, "such that there are at most 1000000 trials", self.n_trials <= 1_000_000)

    @property
    def radii(self) -> tuple[float, ...]:
        """Radii, each once [m]."""
        return parse_radii(self.radius)

    @property
    def humidities(self) -> tuple[float, ...]:
        """Relative humidities, each once [%]."""
        return tuple(dict.fromkeys(self.rh))

    @property
    def n_trials(self) -> int:
        """Number of the trials."""
        return len(self.radii) * len(self.humidities) * self.repeats

    @property
    def gaps(self) -> Gaps:
        """Gaps of releases and of attempts without contact, each once."""
        return Gaps(tuple(dict.fromkeys(self.gap)), tuple(dict.fromkeys(self.no_contact_gap)))

    def metadata(self) -> dict[str, Any]:
        """Everything that determines the rows of a table, for its metadata."""
        return {
            "radii": self.radii,
            "humidities": self.humidities,
            "humidity_spread": self.rh_spread,
            "repeats": self.repeats,
            "seed": self.seed,
            "release_gaps": self.gap,
            "no_contact_gaps": self.no_contact_gap,
            "protocol": asdict(self.protocol),
            **{name: getattr(self, name)._asdict() for name in ("contacts", "tool", "plate")},
            "calibration": {name: getattr(self, name.lower(), getattr(detachment, name)) for name in CALIBRATION},
        }


_RADII = "radii from 10e-6 to 50e-6 m, numbers or start:stop:count"


def parse_radii(texts: tuple[str, ...]) -> tuple[float, ...]:
    """Radii from numbers and ranges start:stop:count, each once [m].

    Raises:
        ConfigError: a text is neither, or a radius is out of range.
    """
    check("radius", texts, f"one or more {_RADII}", len(texts) > 0)
    radii = [radius for text in texts for radius in _parse_range(text)]
    for radius in radii:
        check("radius", radius, _RADII, 10e-6 <= radius <= 50e-6)
    return tuple(dict.fromkeys(radii))


def _parse_range(text: str) -> list[float]:
    """Radii of one number or range [m]."""
    try:
        return list(map(float, spaced(text) if ":" in text else [text]))
    except ValueError:
        raise ConfigError("radius", text, f"{_RADII}, with a count from 1 to 10000") from None


class Case(NamedTuple):
    """A trial and its place in the table."""

    trial: Trial
    humidity: float
    """Of the setting, from which the trial's deviates [%]."""
    repeat: int


def cases(settings: GraspSettings) -> list[Case]:
    """All trials, by radius, then humidity, then repeat."""
    return [
        Case(of_settings(settings, draw(settings.seed, radius, rh, repeat, settings.rh_spread)), rh, repeat)
        for radius, rh, repeat in product(settings.radii, settings.humidities, range(settings.repeats))
    ]


def of_settings(settings: GraspSettings, trial: Trial) -> Trial:
    """A trial of the default materials with those of the settings: works of adhesion, surfaces, contacts, tip."""
    tool = trial.work_tool_object * (settings.work_tool_object / detachment.WORK_TOOL_OBJECT)
    plate = trial.work_object_substrate * (settings.work_object_substrate / detachment.WORK_OBJECT_SUBSTRATE)
    return Trial(
        trial.radius,
        float(effective_work(tool, trial.radius, settings.tool)),
        float(effective_work(plate, trial.radius, settings.plate)),
        trial.relative_humidity,
        probe_radius=settings.probe_radius,
        density=settings.ball_density,
        contacts=settings.contacts,
    )
