"""`iswarm grasp`."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from iswarm_mj.commands.flags import changed, refuse
from iswarm_mj.gripper.bench.contacts import Contacts
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.laws.roughness import Surface
from iswarm_mj.utils.constraints import Needs, Within, check, validate

OF_CURVES = {"start_gap", "approach_time", "press", "dwell", "rise_time", "peel", "peel_time"}
"""Settings of the protocol that force-distance curves follow."""
_OF_TRIALS = Needs("force_curve", (False,))
_GAP = Within(0.5e-6, 50e-6, "m")


@dataclass(frozen=True)
class Grasp:
    """Grasp and release single balls on the bench; writes trials.parquet, trials.csv, figures and recordings."""

    MAIN: ClassVar = ("radius", "rh", "repeats", "seed", "engine", "record", "force_curve", "voltages", "out")

    radius: tuple[str, ...] = ("15e-6:25e-6:5",)
    """Radii of the balls, a list or start:stop:count [m]."""
    rh: Annotated[tuple[float, ...], Within(0, 100, "%")] = (10.0, 30.0, 50.0)
    """Relative humidities [%]."""
    repeats: Annotated[int, Within(1, 100_000), _OF_TRIALS] = 5
    """Trials at each radius and humidity, each with its own works of adhesion."""
    seed: Annotated[int, Within(0, 2**32 - 1), _OF_TRIALS] = 0
    """Seed of the works of adhesion."""
    gap: Annotated[tuple[float, ...], _GAP, _OF_TRIALS] = (5e-6,)
    """Gaps to the plate at which a ball is released [m]."""
    no_contact_gap: Annotated[tuple[float, ...], _GAP, _OF_TRIALS] = (1e-6, 2e-6, 5e-6)
    """Gaps to the ball at which the tool stops in attempts without contact [m]."""
    engine: Annotated[Literal["mujoco", "mjx"], _OF_TRIALS] = "mujoco"
    """Physics engine: mujoco (C, on CPUs), or mjx (JAX, on GPUs and CPUs)."""
    impl: Annotated[Literal["jax", "warp"], _OF_TRIALS, Needs("engine", ("mjx",))] = "jax"
    """Implementation of mjx."""
    threads: Annotated[int, Within(0, 1024), _OF_TRIALS, Needs("engine", ("mujoco",))] = 0
    """Threads of the C engine, 0 for one per core; the results do not depend on it."""
    record: Annotated[tuple[int, ...], Within(0), _OF_TRIALS] = (0,)
    """Indices of the trials to record, ordered by radius, then humidity, then repeat; none if empty."""
    force_curve: bool = False
    """Write force-distance curves of the radii at the first humidity instead of running trials."""
    voltages: Annotated[tuple[float, ...], Within(0, 200, "V"), Needs("force_curve")] = (0.0, 10.0, 20.0)
    """Voltages of the force-distance curves [V]."""
    out: Path = Path("runs/grasp")
    """Directory for the results; those of an earlier run in it are replaced."""
    protocol: Protocol = field(default_factory=Protocol)
    contacts: Contacts = field(default_factory=Contacts)
    """Conduction, breakdown and impacts of the ball's contacts."""
    tool: Surface = field(default_factory=Surface)
    """Roughness, preload and hysteresis of the tool's contact."""
    plate: Surface = field(default_factory=Surface)
    """Of the plate's contact."""

    def __post_init__(self):
        validate(self)

    def run(self) -> None:
        """Run the command."""
        self._check_effects()
        radii, humidities = parse_radii(self.radius), tuple(dict.fromkeys(self.rh))
        self._check_trials(radii)
        self._check_output(len(radii) * len(humidities) * self.repeats, len(radii) * len(self.voltages))
        from iswarm_mj.workflows.grasp import run_force_curves, run_grasp
        from iswarm_mj.workflows.grasp_settings import GraspSettings

        settings = GraspSettings(
            radii=radii,
            humidities=humidities,
            repeats=self.repeats,
            seed=self.seed,
            release_gaps=self.gap,
            no_contact_gaps=self.no_contact_gap,
            engine=self.engine,
            impl=self.impl,
            threads=self.threads,
            protocol=self.protocol,
            contacts=self.contacts,
            tool=self.tool,
            plate=self.plate,
        )
        if self.force_curve:
            run_force_curves(settings, self.voltages, self.out)
        else:
            run_grasp(settings, self.out, tuple(dict.fromkeys(self.record)))

    def _check_effects(self) -> None:
        """Refuse what force-distance curves do not use."""
        if self.force_curve:
            speeds = [f"protocol.{f.name}" for f in fields(Protocol) if f.name not in OF_CURVES]
            groups = ("contacts", "tool", "plate")
            contacts = [f"{name}.{part}" for name in groups for part in getattr(self, name)._fields]
            refuse(self, [*speeds, *contacts], "with `force_curve`")
        many = self.force_curve and len(self.rh) > 1 and "rh" in changed(self)
        check("rh", self.rh, "one relative humidity with `force_curve`", not many)

    def _check_trials(self, radii: tuple[float, ...]) -> None:
        """Check the conditions of the trials."""
        check("rh", self.rh, "one or more relative humidities from 0 to 100 %", len(self.rh) > 0)
        for name, gaps in (("gap", self.gap), ("no_contact_gap", self.no_contact_gap)):
            for gap in gaps:
                check(name, gap, "at most 4 times the least radius", gap <= 4 * min(radii))

    def _check_output(self, n_trials: int, n_curves: int) -> None:
        """Check the numbers of trials and curves, and the trials to record."""
        check("repeats", self.repeats, "such that there are at most 1000000 trials", n_trials <= 1_000_000)
        for number in self.record:
            check("record", number, f"the index of a trial, 0 to {n_trials - 1}", 0 <= number < n_trials)
        if self.force_curve:
            check("voltages", self.voltages, "such that there are 1 to 100 curves in all", 1 <= n_curves <= 100)


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
    parts = text.split(":")
    check("radius", text, _RADII, len(parts) in (1, 3))
    try:
        if len(parts) == 1:
            return [float(text)]
        start, stop, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        check("radius", text, _RADII, False)
        raise
    check("radius", text, f"{_RADII}, with a count from 1 to 10000", 1 <= count <= 10_000)
    step = (stop - start) / max(1, count - 1)
    return [round(start + i * step, 15) for i in range(count)]
