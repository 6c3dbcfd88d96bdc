"""Settings of the gripper's experiments."""

from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import product
from typing import Annotated, Any, NamedTuple

from iswarm_mj.gripper.bench.protocol import Gaps, Protocol
from iswarm_mj.gripper.bench.trial import Contacts, Trial, draw
from iswarm_mj.gripper.laws import detachment, materials
from iswarm_mj.gripper.laws.roughness import Surface, effective_work
from iswarm_mj.gripper.units import UM
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
_USUAL = (materials.BALL, materials.TOOL, materials.PLATE)
FITTED = dict(zip(("ball_material", "tool_material", "plate_material"), _USUAL, strict=True)) | {
    "work_tool_object": None,
    "work_object_substrate": None,
    "probe_radius": detachment.PROBE_RADIUS,
    "tip_curvature": None,
}
"""Settings of the paper's experiments, to which the works of adhesion and their spreads are fitted."""
_GAP = Within(0.5e-6, 50e-6, "m")


class Used(NamedTuple):
    """Numbers of trials that follow from materials, unless they are given. SI units."""

    work_tool_object: float
    work_object_substrate: float
    ball_density: float
    contacts: Contacts


@dataclass(frozen=True)
class GraspSettings:
    """The trials; also flags of their command. SI units. A ConfigError says which values are out of range."""

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
    ball_material: str = materials.BALL
    """Material of the balls, by name or by its surface energy; a wrong name lists the others [J/m^2]."""
    tool_material: str = materials.TOOL
    """Material of the tool."""
    plate_material: str = materials.PLATE
    """Material of the plate."""
    work_tool_object: Annotated[float | None, Within(1e-6, 10.0, "J/m^2")] = None
    """Median work of adhesion between tool and ball at 10 % RH; by default the fitted 1.41e-3, scaled to the materials
    [J/m^2]."""
    work_object_substrate: Annotated[float | None, Within(1e-6, 10.0, "J/m^2")] = None
    """Median work of adhesion between ball and plate at 10 % RH; by default the fitted 14.7e-3, scaled to the materials
    [J/m^2]."""
    probe_radius: Annotated[float, Within(2e-6, 80e-6, "m")] = detachment.PROBE_RADIUS
    """Radius of the tool, a wire [m]."""
    tip_curvature: Annotated[float | None, Within(5e-6, 1e-3, "m")] = None
    """Radius of curvature of a rounded tip; by default it is flat [m]."""
    ball_density: Annotated[float | None, Within(100.0, 25e3, "kg/m^3")] = None
    """Density of the balls; by default that of their material [kg/m^3]."""
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
        if self.tip_curvature and self.no_contact_gap != type(self).no_contact_gap:
            raise ConfigError("no_contact_gap", self.no_contact_gap, "left out with a `tip_curvature`")
        for name, gaps in (("gap", self.gap), ("no_contact_gap", self.no_contact_gap)):
            for gap in gaps:
                check(name, gap, "at most 4 times the least radius", gap <= 4 * min(self.radii))
        assert self.used  # which refuses unknown materials
        check("repeats", self.repeats, "such that there are at most 1000000 trials", self.n_trials <= 1_000_000)

    @cached_property
    def used(self) -> Used:
        """What the materials and what is given make of a trial; contacts that differ from the defaults stay."""
        ball, tool, plate = (
            materials.material(f"{part}_material", getattr(self, f"{part}_material"), usual)
            for part, usual in zip(("ball", "tool", "plate"), _USUAL, strict=True)
        )
        to_tool = materials.work_ratio(ball, tool, materials.BALL, materials.TOOL)
        to_plate = materials.work_ratio(ball, plate, materials.BALL, materials.PLATE)
        usual = [materials.MATERIALS[name] for name in _USUAL]
        own = {
            "yield_pressure": ball.yield_pressure if ball != usual[0] else None,
            "probe_modulus": materials.reduced_modulus(ball, tool) if [ball, tool] != usual[:2] else None,
            "plate_modulus": materials.reduced_modulus(ball, plate) if [ball, plate] != usual[::2] else None,
            "breakdown": tool.breakdown,
        }
        own = {name: v for name, v in own.items() if v and getattr(self.contacts, name) == getattr(Contacts(), name)}
        given = self.work_tool_object, self.work_object_substrate, self.ball_density
        fitted = detachment.WORK_TOOL_OBJECT * to_tool, detachment.WORK_OBJECT_SUBSTRATE * to_plate, ball.density
        tool, plate, density = (there if mine is None else mine for mine, there in zip(given, fitted, strict=True))
        return Used(tool, plate, density, self.contacts._replace(**own))

    @property
    def beyond_the_fit(self) -> list[str]:
        """What is not as in the experiments to which works, gap and spreads are fitted."""
        spans = (
            ("radius", self.radii, (15e-6, 25e-6), UM, "um"),  # of the paper's balls
            ("rh", self.humidities, (5.0, 90.0), 1.0, "%"),  # for which the factor of `laws.adhesion` is valid
        )
        found = [
            f"{name} {min(values) / unit:g} to {max(values) / unit:g} {text}, not {low / unit:g} to {high / unit:g}"
            for name, values, (low, high), unit, text in spans
            if min(values) < low * (1 - 1e-9) or max(values) > high * (1 + 1e-9)
        ]
        return found + [f"{name} {getattr(self, name)}" for name in FITTED if getattr(self, name) != FITTED[name]]

    @cached_property
    def radii(self) -> tuple[float, ...]:
        """Radii, each once [m]."""
        try:
            texts = [word for text in self.radius for word in (spaced(text) if ":" in text else [text])]
            radii = dict.fromkeys(map(float, texts))
        except ValueError:
            radii = {}
        rule = "radii from 10e-6 to 50e-6 m, numbers or start:stop:count, with a count from 1 to 10000"
        check("radius", " ".join(self.radius), rule, bool(radii) and all(10e-6 <= r <= 50e-6 for r in radii))
        return tuple(radii)

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
        """Gaps of releases and of attempts without contact, each once; with a rounded tip none of the latter."""
        without = () if self.tip_curvature else tuple(dict.fromkeys(self.no_contact_gap))
        return Gaps(tuple(dict.fromkeys(self.gap)), without)

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
            "contacts": self.used.contacts._asdict(),
            "tool": self.tool._asdict(),
            "plate": self.plate._asdict(),
            **({"tip_curvature": self.tip_curvature} if self.tip_curvature else {}),
            "calibration": {name: getattr(detachment, name) for name in CALIBRATION}
            | {name.upper(): value for name, value in self.used._asdict().items() if name != "contacts"}
            | {"PROBE_RADIUS": self.probe_radius},
        }


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
    """A trial of the default materials with those of the settings: works of adhesion, surfaces, contacts, tip.

    A rounded tip of curvature R_c touches like a plane whose work is 1 / (1 + R / R_c) as large, and attracts like one
    that is (1 + R / R_c) as far, for gaps far below both radii (Derjaguin 1934).
    """
    used = settings.used
    tool = trial.work_tool_object * (used.work_tool_object / detachment.WORK_TOOL_OBJECT)
    plate = trial.work_object_substrate * (used.work_object_substrate / detachment.WORK_OBJECT_SUBSTRATE)
    farther = 1 + trial.radius / settings.tip_curvature if settings.tip_curvature else 1.0
    return Trial(
        trial.radius,
        float(effective_work(tool, trial.radius, settings.tool)) / farther,
        float(effective_work(plate, trial.radius, settings.plate)),
        trial.relative_humidity,
        contact_gap=trial.contact_gap * farther,
        probe_radius=settings.probe_radius,
        density=used.ball_density,
        contacts=used.contacts,
    )
