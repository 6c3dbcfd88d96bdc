"""`iswarm grasp`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from iswarm_mj.commands.command_settings import changed_names, refuse_changed
from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.gripper.laws.roughness import Surface
from iswarm_mj.utils.constraints import Needs, Within, check
from iswarm_mj.workflows.grasp_settings import GraspSettings

_BALL_OF_CURVES = (
    "radius",
    "rh",
    "work_tool_object",
    "work_object_substrate",
    "probe_radius",
    "ball_density",
    "ball_material",
    "tool_material",
    "plate_material",
    "tip_curvature",
    "tip",
)
_PROTOCOL_OF_CURVES = (
    "start_gap",
    "approach_time",
    "press",
    "dwell",
    "rise_time",
    "peel",
    "peel_time",
)
OF_CURVES = {
    *_BALL_OF_CURVES,
    "force_curve",
    "voltages",
    "out",
    *(f"protocol.{name}" for name in _PROTOCOL_OF_CURVES),
    *(f"tool.{name}" for name in Surface._fields),
    *(f"plate.{name}" for name in Surface._fields),
    *(f"contacts.{name}" for name in Contacts._fields),
}
"""Settings that force-distance curves follow."""


@dataclass(frozen=True)
class Grasp(GraspSettings):
    """Grasp and release balls on the bench; writes trials.parquet and trials.csv, and figures."""

    MAIN: ClassVar = ("radius", "rh", "repeats", "seed", "record", "force_curve", "voltages", "out")

    record: Annotated[tuple[int, ...], Within(0)] = (0,)
    """Indices of the trials to record, ordered by radius, then humidity, then repeat; none if
    empty."""
    force_curve: bool = False
    """Write force-distance curves of the radii at the first humidity instead of running trials."""
    voltages: Annotated[tuple[float, ...], Within(0, 200, "V"), Needs("force_curve")] = (
        0.0,
        10.0,
        20.0,
    )
    """Voltages of the force-distance curves [V]."""
    out: Path | None = None
    """Directory for the results, in which those of an earlier run are replaced; runs/grasp by default,
    and runs/force-curve with --force-curve."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.workflows.grasp import run_force_curves, run_grasp

        if self.force_curve:
            self._check_curves()
            run_force_curves(self, self.voltages, self.out or Path("runs/force-curve"))
            return

        last_trial = self.n_trials - 1
        for number in self.record:
            check(
                "record", number, f"the index of a trial, 0 to {last_trial}", number <= last_trial
            )
        run_grasp(self, self.out or Path("runs/grasp"), tuple(dict.fromkeys(self.record)))

    def _check_curves(self) -> None:
        """Refuse settings that force-distance curves do not follow, and too many curves."""
        changed = changed_names(self)
        without_effect = [name for name in changed if name not in OF_CURVES]
        refuse_changed(self, without_effect, "with `force_curve`")

        # By default the first of several humidities is that of the curves.
        is_one = len(self.rh) == 1 or "rh" not in changed
        check("rh", self.rh, "one relative humidity with `force_curve`", is_one)
        flat_tips = "left out with `force_curve`, whose forces at a distance are those of flat tips"
        check("tip_curvature", self.tip_curvature, flat_tips, self.tip_curvature is None)
        n_curves = len(self.radii) * len(self.voltages)
        few_curves = "such that there are 1 to 100 curves in all"
        check("voltages", self.voltages, few_curves, 1 <= n_curves <= 100)
