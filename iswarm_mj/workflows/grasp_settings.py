"""Settings of the gripper's experiments."""

from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any, NamedTuple

from iswarm_mj.gripper.bench.contacts import Contacts
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import EngineChoice, Gaps
from iswarm_mj.gripper.bench.trial import Trial, draw
from iswarm_mj.gripper.laws import detachment
from iswarm_mj.gripper.laws.roughness import Surface, effective_work

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
"""Constants of `detachment` that tables record."""


@dataclass(frozen=True)
class GraspSettings:
    """The trials, and the engine in which they run. SI units."""

    radii: tuple[float, ...]
    """Of the balls [m]."""
    humidities: tuple[float, ...]
    """Relative humidities [%]."""
    repeats: int
    """Trials at each radius and humidity."""
    seed: int
    release_gaps: tuple[float, ...] = (detachment.RELEASE_GAP,)
    """Between ball and plate [m]."""
    no_contact_gaps: tuple[float, ...] = (1e-6,)
    """Between tool and ball [m]."""
    engine: str = "mujoco"
    impl: str = "jax"
    """Of MJX."""
    threads: int = 0
    protocol: Protocol = field(default_factory=Protocol)
    contacts: Contacts = field(default_factory=Contacts)
    """Conduction and impacts."""
    tool: Surface = field(default_factory=Surface)
    """Roughness, preload and hysteresis of the tool's contact; by default the calibrated work holds them all."""
    plate: Surface = field(default_factory=Surface)
    """Of the plate's contact."""

    @property
    def engine_choice(self) -> EngineChoice:
        """Where the trials run."""
        return EngineChoice(self.engine, self.impl, self.threads)

    @property
    def gaps(self) -> Gaps:
        """Gaps of releases and of attempts without contact."""
        return Gaps(self.release_gaps, self.no_contact_gaps)

    def metadata(self) -> dict[str, Any]:
        """Everything that determines the rows of a table, for its metadata."""
        settings = asdict(self)
        del settings["threads"]
        settings |= {name: getattr(self, name)._asdict() for name in ("contacts", "tool", "plate")}
        return {**settings, "calibration": {name: getattr(detachment, name) for name in CALIBRATION}}


class Case(NamedTuple):
    """A trial and its place in the table."""

    trial: Trial
    repeat: int


def cases(settings: GraspSettings) -> list[Case]:
    """All trials, by radius, then humidity, then repeat."""
    places = product(settings.radii, settings.humidities, range(settings.repeats))
    return [
        Case(_with_surfaces(settings, draw(settings.seed, radius, rh, repeat)), repeat) for radius, rh, repeat in places
    ]


def _with_surfaces(settings: GraspSettings, trial: Trial) -> Trial:
    """A trial with the contacts of the settings, and the works of adhesion that their surfaces leave."""
    works = (trial.work_tool_object, settings.tool), (trial.work_object_substrate, settings.plate)
    tool, plate = (float(effective_work(work, trial.radius, surface)) for work, surface in works)
    return trial._replace(work_tool_object=tool, work_object_substrate=plate, contacts=settings.contacts)
