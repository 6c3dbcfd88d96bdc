"""Settings of the gripper's experiments, and the trials that follow from them."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from iswarm_mj.gripper.bench.protocol import Gaps, Protocol
from iswarm_mj.gripper.bench.trial import Contacts, Trial, draw
from iswarm_mj.gripper.laws import adhesion, detachment, materials
from iswarm_mj.gripper.laws.roughness import Surface, effective_work
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.gripper.units import UM
from iswarm_mj.utils.constraints import Within, check, spaced, validate
from iswarm_mj.utils.errors import ConfigError, UserError, shown
from iswarm_mj.utils.files import read_toml

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
"""Constants of `detachment` that tables record; four of them are also settings."""
FITTED: dict[str, Any] = {
    "ball_material": materials.BALL,
    "tool_material": materials.TOOL,
    "plate_material": materials.PLATE,
    "work_tool_object": None,
    "work_object_substrate": None,
    "spread_tool_object": detachment.VARIATION_TOOL_OBJECT,
    "spread_object_substrate": detachment.VARIATION_OBJECT_SUBSTRATE,
    "humidity_doubling": adhesion.HUMIDITY_DOUBLING,
    "humidity_fall": adhesion.HUMIDITY_FALL,
    "electrical_gap": detachment.CONTACT_GAP,
    "probe_radius": detachment.PROBE_RADIUS,
    "tip_curvature": None,
    "tip": None,
}
"""Settings of the paper's experiments, to which works of adhesion and spreads are fitted."""
FITTED_GROUPS = {
    "contacts": Contacts()._asdict(),
    "tool": Surface()._asdict(),
    "plate": Surface()._asdict(),
}
"""Contacts and surfaces with which they are fitted."""
FITTED_RADII = (15e-6, 25e-6)
"""Least and greatest radius of the paper's balls [m]."""
VALID_HUMIDITIES = (5.0, 90.0)
"""Range in which the factor of `laws.adhesion` is valid [%]."""
MAX_TRIALS = 1_000_000
"""Maximum number of trials of a run."""
_GAP = Within(0.5e-6, 50e-6, "m")
_PERCENT = 1.0


class EffectiveProperties(NamedTuple):
    """Properties of trials that follow from the materials, where they are not set. SI units."""

    work_tool_object: float
    """Median work of adhesion between tool and ball at 10 % RH [J/m^2]."""
    work_object_substrate: float
    """Median work of adhesion between ball and plate at 10 % RH [J/m^2]."""
    ball_density: float
    """Density of the balls [kg/m^3]."""
    contacts: Contacts


@dataclass(frozen=True)
class GraspSettings:
    """The trials; also flags of their command. SI units.

    A ConfigError says which values are out of range.
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
    """Largest deviation of a trial's humidity from `rh`; by default the accuracy of the paper's
    chamber [%]."""
    ball_material: str = materials.BALL
    """Material of the balls, by name or by its surface energy; a wrong name lists the others
    [J/m^2]."""
    tool_material: str = materials.TOOL
    """Material of the tool."""
    plate_material: str = materials.PLATE
    """Material of the plate."""
    work_tool_object: Annotated[float | None, Within(1e-6, 10.0, "J/m^2")] = None
    """Median work of adhesion between tool and ball at 10 % RH; by default the fitted 1.41e-3,
    scaled to the materials [J/m^2]."""
    work_object_substrate: Annotated[float | None, Within(1e-6, 10.0, "J/m^2")] = None
    """Median work of adhesion between ball and plate at 10 % RH; by default the fitted 14.7e-3,
    scaled to the materials [J/m^2]."""
    spread_tool_object: Annotated[float, Within(0, 2)] = detachment.VARIATION_TOOL_OBJECT
    """Coefficient of variation of the work to the tool from trial to trial, log-normal."""
    spread_object_substrate: Annotated[float, Within(0, 2)] = detachment.VARIATION_OBJECT_SUBSTRATE
    """Coefficient of variation of the work to the plate from trial to trial, log-normal."""
    humidity_doubling: Annotated[float, Within(1, 1e6, "%")] = adhesion.HUMIDITY_DOUBLING
    """Excess of relative humidity over 10 % that doubles adhesion [%]."""
    humidity_fall: Annotated[float, Within(0, 1, "1/%")] = adhesion.HUMIDITY_FALL
    """Growth of adhesion per percent of relative humidity below 10 % [1/%]."""
    electrical_gap: Annotated[float, Within(1e-8, 10e-6, "m")] = detachment.CONTACT_GAP
    """Effective electrical gap between a touching tool and the ball [m]."""
    probe_radius: Annotated[float, Within(2e-6, 80e-6, "m")] = detachment.PROBE_RADIUS
    """Radius of the tool, a wire [m]."""
    tip_curvature: Annotated[float | None, Within(5e-6, 1e-3, "m")] = None
    """Radius of curvature of a rounded tip; by default it is flat [m]."""
    tip: Path | None = None
    """Table of the forces of another tip, the tip.json of `iswarm tip --table`."""
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
        rule = "one or more relative humidities from 0 to 100 %"
        check("rh", self.rh, rule, len(self.rh) > 0)
        if self.tip_curvature and self.no_contact_gap != type(self).no_contact_gap:
            raise ConfigError(
                "no_contact_gap", self.no_contact_gap, "left out with a `tip_curvature`"
            )
        for name, gaps in (("gap", self.gap), ("no_contact_gap", self.no_contact_gap)):
            for gap in gaps:
                fits = gap <= 4 * min(self.radii)
                check(name, gap, "at most 4 times the least radius", fits)
        if self.tip is not None:
            read_table(self.tip)  # raises a UserError for a file that is none
            for name in ("tip_curvature", "probe_radius"):
                value = getattr(self, name)
                is_default = value == getattr(type(self), name)
                check(name, value, "left out with a `tip`, which has its own", is_default)
        fits = self.electrical_gap >= max(self.radii) / 512
        rule = "at least 1/512 of the greatest radius, since laws have no smaller gaps"
        check("electrical_gap", self.electrical_gap, rule, fits)
        assert self.effective  # raises a ConfigError for unknown materials
        rule = f"such that there are at most {MAX_TRIALS} trials"
        check("repeats", self.repeats, rule, self.n_trials <= MAX_TRIALS)

    @cached_property
    def effective(self) -> EffectiveProperties:
        """Properties that the trials have: settings where they are set, or those of the materials.

        Works of adhesion [J/m^2] that are not set are those fitted to the paper's materials, times
        the ratio of the work between these materials to that between the paper's.
        """
        ball = materials.material("ball_material", self.ball_material, materials.BALL)
        tool = materials.material("tool_material", self.tool_material, materials.TOOL)
        plate = materials.material("plate_material", self.plate_material, materials.PLATE)

        # Works of adhesion of the ball (object) to the tool and to the plate (substrate).
        work_tool = self.work_tool_object
        if work_tool is None:
            ratio = materials.work_ratio(ball, tool, materials.BALL, materials.TOOL)
            work_tool = detachment.WORK_TOOL_OBJECT * ratio

        work_plate = self.work_object_substrate
        if work_plate is None:
            ratio = materials.work_ratio(ball, plate, materials.BALL, materials.PLATE)
            work_plate = detachment.WORK_OBJECT_SUBSTRATE * ratio

        density = ball.density if self.ball_density is None else self.ball_density
        return EffectiveProperties(
            work_tool_object=work_tool,
            work_object_substrate=work_plate,
            ball_density=density,
            contacts=self._effective_contacts(ball, tool, plate),
        )

    def _effective_contacts(self, ball: Any, tool: Any, plate: Any) -> Contacts:
        """Return the contacts of these materials; values that differ from the defaults stay.

        Values of the paper's materials are the defaults of `Contacts`, not computed.
        """
        paper_ball = materials.MATERIALS[materials.BALL]
        paper_tool = materials.MATERIALS[materials.TOOL]
        paper_plate = materials.MATERIALS[materials.PLATE]
        of_materials = {"breakdown": tool.breakdown}
        if ball != paper_ball:
            of_materials["yield_pressure"] = ball.yield_pressure
        if ball != paper_ball or tool != paper_tool:
            of_materials["probe_modulus"] = materials.reduced_modulus(ball, tool)
        if ball != paper_ball or plate != paper_plate:
            of_materials["plate_modulus"] = materials.reduced_modulus(ball, plate)

        default = Contacts()
        replaced = {
            name: value
            for name, value in of_materials.items()
            if value and getattr(self.contacts, name) == getattr(default, name)
        }
        return self.contacts._replace(**replaced)

    @property
    def beyond_the_fit(self) -> list[str]:
        """Settings outside of the experiments to which works, gap and spreads are fitted.

        Works of adhesion that are both set, as by a fit.toml, rest on no fit of the paper. Only the
        law of humidity and the forces of a tip's table can then be beyond what was fitted.
        """
        of_humidity = _beyond("rh", self.humidities, VALID_HUMIDITIES, _PERCENT, "%")
        if self.has_own_works:
            of_tip = [f"tip {self.tip}"] if self.tip is not None else []
            return [*of_humidity, *of_tip]
        of_radius = _beyond("radius", self.radii, FITTED_RADII, UM, "um")
        return [*of_radius, *of_humidity, *self._unlike_fitted()]

    @property
    def has_own_works(self) -> bool:
        """True if both works of adhesion are set, so that none is that of the paper's fit."""
        return self.work_tool_object is not None and self.work_object_substrate is not None

    @property
    def own_values(self) -> list[str]:
        """Settings in place of the paper's, with works of one's own; the table of a tip aside."""
        if not self.has_own_works:
            return []
        return [text for text in self._unlike_fitted() if not text.startswith("tip ")]

    def _unlike_fitted(self) -> list[str]:
        """Return the settings that differ from those of the paper's fit, with their values."""
        texts = []
        for name, fitted in FITTED.items():
            value = getattr(self, name)
            if value != fitted:
                texts.append(f"{name} {value}")
        for group, fitted_values in FITTED_GROUPS.items():
            values = getattr(self, group)._asdict()
            texts += [
                f"{group}.{name} {value}"
                for name, value in values.items()
                if value != fitted_values[name]
            ]
        return texts

    @cached_property
    def radii(self) -> tuple[float, ...]:
        """Radii, each once [m]."""
        try:
            texts = []
            for text in self.radius:
                texts += spaced(text) if ":" in text else [text]
            radii = tuple(dict.fromkeys(float(text) for text in texts))
        except ValueError:
            radii = ()
        rule = (
            "radii from 10e-6 to 50e-6 m, numbers or start:stop:count, with a count from 1 to 10000"
        )
        are_valid = len(radii) > 0 and all(10e-6 <= radius <= 50e-6 for radius in radii)
        check("radius", " ".join(self.radius), rule, are_valid)
        return radii

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
        """Gaps of releases and of attempts without contact, each once.

        There are no attempts without contact with a rounded tip.
        """
        no_contact = () if self.tip_curvature else tuple(dict.fromkeys(self.no_contact_gap))
        return Gaps(tuple(dict.fromkeys(self.gap)), no_contact)

    def metadata(self) -> dict[str, Any]:
        """Return everything that determines the rows of a table, for its metadata."""
        content = {
            "radii": self.radii,
            "humidities": self.humidities,
            "humidity_spread": self.rh_spread,
            "repeats": self.repeats,
            "seed": self.seed,
            "release_gaps": self.gap,
            "no_contact_gaps": self.no_contact_gap,
            "protocol": asdict(self.protocol),
            "contacts": self.effective.contacts._asdict(),
            "tool": self.tool._asdict(),
            "plate": self.plate._asdict(),
        }
        for name in ("tip_curvature", "humidity_doubling", "humidity_fall"):
            value = getattr(self, name)
            if value != FITTED[name]:
                content[name] = value
        if self.tip is not None:
            content["tip"] = str(self.tip)
        if self.beyond_the_fit:
            content["beyond_the_fit"] = self.beyond_the_fit

        calibration = {name: getattr(detachment, name) for name in CALIBRATION}
        for name in ("work_tool_object", "work_object_substrate", "ball_density"):
            calibration[name.upper()] = getattr(self.effective, name)
        calibration["PROBE_RADIUS"] = self.probe_radius
        calibration["VARIATION_TOOL_OBJECT"] = self.spread_tool_object
        calibration["VARIATION_OBJECT_SUBSTRATE"] = self.spread_object_substrate
        calibration["CONTACT_GAP"] = self.electrical_gap
        content["calibration"] = calibration
        return content


def _beyond(
    name: str,
    values: tuple[float, ...],
    limits: tuple[float, float],
    unit: float,
    unit_name: str,
) -> list[str]:
    """Return a sentence if values exceed the range of the fit, in a list.

    Args:
        name: name of the setting.
        values: its values in SI.
        limits: least and greatest value of the fit in SI.
        unit: unit of the sentence in SI.
        unit_name: name of that unit.
    """
    low, high = limits
    tolerance = 1e-9
    if min(values) >= low * (1 - tolerance) and max(values) <= high * (1 + tolerance):
        return []
    span = f"{min(values) / unit:g} to {max(values) / unit:g} {unit_name}"
    return [f"{name} {span}, not {low / unit:g} to {high / unit:g}"]


def settings_of(values: Mapping[str, Any], source: str) -> GraspSettings:
    """Return the settings that values by the names of flags describe, as `contacts.oxide`.

    Args:
        values: by names; lists stand for tuples.
        source: what states them, for messages.

    Raises:
        UserError: a name is no setting, or a value is not allowed.
    """
    default = GraspSettings()
    settings: dict[str, Any] = {}
    fields_of_group: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        group, _, field_name = name.rpartition(".")
        owner = getattr(default, group, None) if group else default
        if owner is None or not hasattr(owner, field_name):
            raise UserError(f"{source} names {shown(name)}, which iswarm grasp does not know")

        kept = tuple(value) if isinstance(value, list) else value
        if group:
            fields_of_group.setdefault(group, {})[field_name] = kept
        elif name == "radius":  # whose ranges are texts
            settings[name] = tuple(str(radius) for radius in kept)
        else:
            settings[name] = kept

    for group, fields_of in fields_of_group.items():
        settings[group] = type(getattr(default, group))(**fields_of)
    return GraspSettings(**settings)


def read_settings(path: Path) -> GraspSettings:
    """Return the settings in a TOML file, of its table [grasp] if it has one, such as a fit.toml.

    Raises:
        UserError: it cannot be read, or has other settings.
    """
    values = read_toml(path, "name a fit.toml of iswarm fit")
    of_grasp = {
        name.removeprefix("grasp."): value
        for name, value in values.items()
        if name.startswith("grasp.")
    }
    return settings_of(of_grasp or values, source=str(path))


class Case(NamedTuple):
    """A trial and its place in the table."""

    trial: Trial
    humidity: float
    """Relative humidity of the setting, from which the trial's deviates [%]."""
    repeat: int
    """Number of the trial at its radius and humidity."""


def cases(settings: GraspSettings) -> list[Case]:
    """Return all trials, by radius, then humidity, then repeat."""
    all_cases = []
    for radius, humidity, repeat in product(
        settings.radii, settings.humidities, range(settings.repeats)
    ):
        spreads = (settings.spread_tool_object, settings.spread_object_substrate)
        trial = draw(settings.seed, radius, humidity, repeat, settings.rh_spread, spreads)
        all_cases.append(Case(adapted(settings, trial), humidity, repeat))
    return all_cases


def adapted(settings: GraspSettings, trial: Trial) -> Trial:
    """Return a trial of the paper's materials adapted to the settings.

    A rounded tip of curvature R_c touches like a plane whose work is 1 / (1 + R / R_c) as large,
    and attracts like one that is (1 + R / R_c) as far, for gaps far below both radii (Derjaguin
    1934). A tip of a table has forces and an adhesion of its own, see `tips.table`.
    """
    effective = settings.effective
    ratio_tool = effective.work_tool_object / detachment.WORK_TOOL_OBJECT
    ratio_plate = effective.work_object_substrate / detachment.WORK_OBJECT_SUBSTRATE
    growth = _growth_over_law(settings, trial.relative_humidity)
    work_tool = trial.work_tool_object * ratio_tool * growth
    work_plate = trial.work_object_substrate * ratio_plate * growth
    curvature_factor = 1.0
    if settings.tip_curvature:
        curvature_factor = 1 + trial.radius / settings.tip_curvature
    adhesion_share = 1 / curvature_factor
    probe_radius = settings.probe_radius
    if settings.tip is not None:
        table = read_table(settings.tip)
        adhesion_share = table.adhesion_share(trial.radius)
        probe_radius = table.profile.radius
    rough_work_tool = float(effective_work(work_tool, trial.radius, settings.tool))
    return Trial(
        trial.radius,
        rough_work_tool * adhesion_share,
        float(effective_work(work_plate, trial.radius, settings.plate)),
        trial.relative_humidity,
        contact_gap=settings.electrical_gap * curvature_factor,
        probe_radius=probe_radius,
        density=effective.ball_density,
        contacts=effective.contacts,
        tip=None if settings.tip is None else str(settings.tip),
    )


def _growth_over_law(settings: GraspSettings, relative_humidity: float) -> float:
    """Return the factor of adhesion at a humidity by the settings, over that by the default law.

    The bench multiplies works by the latter.
    """
    growth = adhesion.humidity_factor(
        relative_humidity, settings.humidity_doubling, settings.humidity_fall
    )
    return float(growth / adhesion.humidity_factor(relative_humidity))
