"""`iswarm grasp`."""

from dataclasses import dataclass, field
from pathlib import Path

from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import UserError


@dataclass(frozen=True)
class Grasp:
    """Grasp and release single balls on the bench; writes trials.parquet, trials.csv, figures and recordings."""

    radius: tuple[str, ...] = ("15e-6:25e-6:5",)
    """Radii of the balls, a list or start:stop:count [m]."""
    rh: tuple[float, ...] = (10.0, 30.0, 50.0)
    """Relative humidities [%]."""
    repeats: int = 5
    """Trials at each radius and humidity, each with works of adhesion of its own."""
    seed: int = 0
    """Seed of the works of adhesion."""
    gap: tuple[float, ...] = (5e-6,)
    """Gaps to the plate at which a ball is released [m]."""
    no_contact_gap: tuple[float, ...] = (1e-6, 2e-6, 5e-6)
    """Gaps to the ball at which the tool stops in attempts without contact [m]."""
    engine: str = "mujoco"
    """Physics engine: mujoco (C, on CPUs) or mjx (JAX)."""
    impl: str = "jax"
    """Implementation of MJX: jax or warp."""
    threads: int = 0
    """Threads of the C engine, 0 for one a core; the results do not depend on it."""
    record: tuple[int, ...] = (0,)
    """Numbers of the trials to record, by radius, then humidity, then repeat; none if empty."""
    force_curve: bool = False
    """Write force-distance curves instead, of the radii at the first humidity; trials are not run."""
    voltages: tuple[float, ...] = (0.0, 10.0, 20.0)
    """Voltages of the force-distance curves [V]."""
    out: Path = Path("runs/grasp")
    """Directory for the results; those of an earlier run in it are replaced."""
    protocol: Protocol = field(default_factory=Protocol)

    def run(self) -> None:
        """Run the command."""
        radii = _radii(self.radius)
        check("repeats", self.repeats, "between 1 and 100000", 1 <= self.repeats <= 100_000)
        check("seed", self.seed, "between 0 and 2^32 - 1", 0 <= self.seed < 2**32)
        check("threads", self.threads, "between 0 and 1024", 0 <= self.threads <= 1024)
        check("engine", self.engine, "mujoco or mjx", self.engine in ("mujoco", "mjx"))
        check("impl", self.impl, "jax or warp", self.impl in ("jax", "warp"))
        if not self.rh:
            raise UserError("--rh was empty; it must be one or more humidities from 0 to 100 %: give at least one.")
        for rh in self.rh:
            check("rh", rh, "a relative humidity from 0 to 100 %", 0 <= rh <= 100)
        for name, gaps in (("gap", self.gap), ("no_contact_gap", self.no_contact_gap)):
            for gap in gaps:
                check(name, gap, "between 0.5e-6 and 50e-6 m", 0.5e-6 <= gap <= 50e-6)
                check(name, gap, "at most 4 times the least radius", gap <= 4 * min(radii))
        humidities = tuple(dict.fromkeys(self.rh))
        count = len(radii) * len(humidities) * self.repeats
        check("repeats", self.repeats, "so that there are at most 1000000 trials", count <= 1_000_000)
        for number in self.record:
            check("record", number, f"the number of a trial, 0 to {count - 1}", 0 <= number < count)
        for voltage in self.voltages:
            check("voltages", voltage, "between 0 and 200 V", 0 <= voltage <= 200)
        if self.force_curve and len(radii) * len(self.voltages) not in range(1, 101):
            raise UserError(
                f"--voltages and --radius ask for {len(radii) * len(self.voltages)} force-distance curves; "
                "from 1 to 100 are possible: choose fewer."
            )
        from iswarm_mj.workflows.grasp import GraspSettings, run_force_curves, run_grasp

        settings = GraspSettings(
            radii, humidities, self.repeats, self.seed, self.gap, self.no_contact_gap,
            self.engine, self.impl, self.threads, self.protocol,
        )  # fmt: skip
        if self.force_curve:
            run_force_curves(settings, self.voltages, self.out)
        else:
            run_grasp(settings, self.out, tuple(dict.fromkeys(self.record)))


def _radii(given: tuple[str, ...]) -> tuple[float, ...]:
    """Radii from numbers and ranges start:stop:count, each once [m].

    Raises:
        UserError: it is neither, or out of range.
    """
    allowed = "radii from 10e-6 to 50e-6 m, numbers or start:stop:count"
    if not given:
        raise UserError(f"--radius was empty; it must be {allowed}: give at least one.")
    radii: list[float] = []
    for text in given:
        parts = text.split(":")
        try:
            if len(parts) == 1:
                radii.append(float(text))
            else:
                start, stop, count = float(parts[0]), float(parts[1]), int(parts[2])
                check(
                    "radius", text, f"{allowed}, with a count from 1 to 10000", len(parts) == 3 and 1 <= count <= 10000
                )
                step = (stop - start) / max(1, count - 1)
                radii += [round(start + i * step, 15) for i in range(count)]
        except (ValueError, IndexError):
            check("radius", text, allowed, False)
    for radius in radii:
        check("radius", radius, allowed, 10e-6 <= radius <= 50e-6)
    return tuple(dict.fromkeys(radii))
