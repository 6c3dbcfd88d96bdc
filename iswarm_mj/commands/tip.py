"""`iswarm tip`."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

from iswarm_mj.commands.command_settings import refuse_changed
from iswarm_mj.gripper.tips.search import Limits
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.extras import require
from iswarm_mj.workflows.tip_settings import TipSettings


@dataclass(frozen=True)
class Tip(TipSettings):
    """Voltages of a tip's shape, or the search for the best; writes a figure, STL and result.json."""

    MAIN: ClassVar = (
        "shape",
        "profile",
        "probe_radius",
        "tip_curvature",
        "radius",
        "rh",
        "gap",
        "table",
        "optimise",
        "limits",
        "out",
    )

    out: Path = Path("runs/tip")
    """Directory for the results; those of an earlier run in it are replaced."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.workflows.tip import design_tip

        if self.optimise:
            require("search")
            refuse_changed(self, ["shape"], "with `optimise`")
            check("profile", self.profile, "left out with `optimise`", self.profile is None)
        else:
            limits = [f"limits.{limit.name}" for limit in fields(Limits)]
            refuse_changed(self, limits, "without `optimise`")
        if self.profile is not None:
            refuse_changed(self, ["shape"], "with `profile`")
        design_tip(self, self.out)
