"""Settings of the design of a tip: its shape or the search for it, balls, adhesion and gaps."""

from dataclasses import dataclass, field
from functools import cached_property
from math import radians
from pathlib import Path
from typing import Annotated

from iswarm_mj.gripper.laws import detachment, materials
from iswarm_mj.gripper.laws.adhesion import HUMIDITY_DOUBLING, HUMIDITY_FALL, humidity_factor
from iswarm_mj.gripper.laws.roughness import Surface, effective_work
from iswarm_mj.gripper.tips import shapes
from iswarm_mj.gripper.tips.profile import Profile
from iswarm_mj.gripper.tips.search import Limits
from iswarm_mj.gripper.tips.voltages import Conditions
from iswarm_mj.utils.constraints import Needs, Within, check, constraint_of, validate
from iswarm_mj.workflows.grasp_settings import GraspSettings

ROUNDED_CURVATURE = 30e-6
CONE_CURVATURE = 5e-6
"""Radii of curvature of rounded tips and of cones, unless they are given [m]."""
_LENGTH = Within(0.1e-6, 200e-6, "m")


def _of_grasp(name: str) -> Within | None:
    return constraint_of(GraspSettings, name)


@dataclass(frozen=True)
class TipSettings:
    """The tip and what it handles. SI units; a ConfigError says which values are out of range."""

    shape: shapes.Shape | None = None
    """Shape of the tip; by default rounded with a `tip_curvature`, otherwise flat."""
    profile: Path | None = None
    """CSV file of points of another shape, from the axis to the wall; its header states units:
    r [um],z [um]."""
    probe_radius: Annotated[
        float,
        _of_grasp("probe_radius"),
        Needs("has_named_shape", why="with a profile of its own radius"),
    ] = detachment.PROBE_RADIUS
    """Radius of the tip, where its wall begins [m]."""
    tip_curvature: Annotated[
        float | None,
        Within(0.5e-6, 1e-3, "m"),
        Needs("kind", ("rounded", "cone"), why="without the shape rounded or cone"),
    ] = None
    """Radius of curvature of a rounded tip, 30e-6 by default, or of a cone's apex, 5e-6 [m]."""
    half_angle: Annotated[
        float, Within(5, 85, "degrees"), Needs("kind", ("cone",), why="without the shape cone")
    ] = 60.0
    """Angle between axis and side of a cone [degrees]."""
    cup_radius: Annotated[float, _LENGTH, Needs("kind", ("cup",), why="without the shape cup")] = (
        30e-6
    )
    """Radius of the hollow sphere of a cup [m]."""
    hole_radius: Annotated[
        float, _LENGTH, Needs("kind", ("ring",), why="without the shape ring")
    ] = 6e-6
    """Radius of the hole of a ring [m]."""
    hole_depth: Annotated[
        float, _LENGTH, Needs("kind", ("ring",), why="without the shape ring")
    ] = 5e-6
    """Depth of the hole of a ring [m]."""
    edge_radius: Annotated[
        float,
        Within(0.1e-6, 20e-6, "m"),
        Needs("kind", ("cup", "ring"), why="without the shape cup or ring"),
    ] = 0.5e-6
    """Radius of curvature of the edges of cups and rings; others have a sharp edge [m]."""
    radius: tuple[str, ...] = ("15e-6", "20e-6", "25e-6")
    """Radii of the balls, a list or start:stop:count [m]."""
    rh: Annotated[tuple[float, ...], _of_grasp("rh")] = (10.0,)
    """Relative humidities [%]."""
    gap: Annotated[tuple[float, ...], _of_grasp("gap")] = (detachment.RELEASE_GAP,)
    """Gaps to the plate at which a ball is released [m]."""
    electrical_gap: Annotated[float, _of_grasp("electrical_gap")] = detachment.CONTACT_GAP
    """Effective electrical gap between a touching tool and the ball [m]."""
    reach: Annotated[float | None, Within(0.1e-9, 10e-6, "m")] = None
    """Reach of the adhesion: gaps up to it count as contact; a choice, by default the electrical
    gap, 0.2e-6, as for surfaces as rough as that; 0.3e-9 for smooth ones [m]."""
    ball_material: str = materials.BALL
    """Material of the balls, by name or by its surface energy; a wrong name lists the others
    [J/m^2]."""
    tool_material: str = materials.TOOL
    """Material of the tool."""
    plate_material: str = materials.PLATE
    """Material of the plate."""
    work_tool_object: Annotated[float | None, _of_grasp("work_tool_object")] = None
    """Median work of adhesion between a flat tool and the ball at 10 % RH; by default the fitted
    1.41e-3, scaled to the materials [J/m^2]."""
    work_object_substrate: Annotated[float | None, _of_grasp("work_object_substrate")] = None
    """Median work of adhesion between ball and plate at 10 % RH; by default the fitted 14.7e-3,
    scaled to the materials [J/m^2]."""
    humidity_doubling: Annotated[float, _of_grasp("humidity_doubling")] = HUMIDITY_DOUBLING
    """Excess of relative humidity over 10 % that doubles adhesion [%]."""
    humidity_fall: Annotated[float, _of_grasp("humidity_fall")] = HUMIDITY_FALL
    """Growth of adhesion per percent of relative humidity below 10 % [1/%]."""
    ball_density: Annotated[float | None, _of_grasp("ball_density")] = None
    """Density of the balls; by default that of their material [kg/m^3]."""
    tool: Surface = field(default_factory=Surface)
    """Roughness, preload and hysteresis of the tool's contact."""
    plate: Surface = field(default_factory=Surface)
    """Roughness, preload and hysteresis of the plate's contact."""
    table: bool = False
    """Write tip.json, too, the table of forces with which `iswarm grasp --tip` runs trials."""
    optimise: bool = False
    """Search for the profile with the lowest of the highest voltage of all balls, within `limits`,
    at the first humidity of `rh` and the first gap of `gap` alone."""
    limits: Limits = field(default_factory=Limits)
    """Limits of manufacture and use in the search."""
    generations: Annotated[int, Within(1, 10_000), Needs("optimise")] = 100
    """Generations of the search."""
    population: Annotated[int, Within(4, 1000), Needs("optimise")] = 16
    """Profiles in a generation."""
    seed: Annotated[int, Within(0, 2**32 - 1), Needs("optimise")] = 0
    """Seed of the search."""
    workers: Annotated[int, Within(0, 1024)] = 0
    """Worker processes, 0 for one per core; the results do not depend on it."""

    def __post_init__(self):
        validate(self)
        check("gap", self.gap, "one or more gaps", len(self.gap) > 0)
        _ = self.grasp  # raises a ConfigError for balls and materials that are not allowed
        if self.has_named_shape:
            _ = self.named_profile  # raises one for a shape that does not exist

    @property
    def kind(self) -> str:
        """Kind of tip: a named shape, points, or optimised."""
        if self.optimise:
            return "optimised"
        if self.profile is not None:
            return "points"
        return self.shape or ("rounded" if self.tip_curvature else "flat")

    @property
    def adhesion_reach(self) -> float:
        """Reach of the adhesion, by default the electrical gap [m]."""
        return self.electrical_gap if self.reach is None else self.reach

    @property
    def has_named_shape(self) -> bool:
        """The tip has one of the named shapes."""
        return self.kind in shapes.SHAPES

    @cached_property
    def grasp(self) -> GraspSettings:
        """Settings of the bench with the same balls, air, materials and surfaces."""
        return GraspSettings(
            radius=self.radius,
            rh=self.rh,
            gap=self.gap,
            ball_material=self.ball_material,
            tool_material=self.tool_material,
            plate_material=self.plate_material,
            work_tool_object=self.work_tool_object,
            work_object_substrate=self.work_object_substrate,
            electrical_gap=self.electrical_gap,
            humidity_doubling=self.humidity_doubling,
            humidity_fall=self.humidity_fall,
            ball_density=self.ball_density,
            tool=self.tool,
            plate=self.plate,
        )

    @cached_property
    def named_profile(self) -> Profile:
        """Profile of the named shape."""
        radius = self.probe_radius
        match self.kind:
            case "rounded":
                return shapes.rounded(radius, self.tip_curvature or ROUNDED_CURVATURE)
            case "cone":
                curvature = self.tip_curvature or CONE_CURVATURE
                return shapes.cone(radius, curvature, radians(self.half_angle))
            case "cup":
                return shapes.cup(radius, self.cup_radius, self.edge_radius)
            case "ring":
                return shapes.ring(radius, self.hole_radius, self.hole_depth, self.edge_radius)
        return shapes.flat(radius)

    def conditions(self, radius: float, humidity: float) -> Conditions:
        """Return what a ball of a radius [m] meets at a relative humidity [%]."""
        effective = self.grasp.effective
        factor = float(humidity_factor(humidity, self.humidity_doubling, self.humidity_fall))
        work_tool = float(effective_work(effective.work_tool_object, radius, self.tool))
        work_plate = float(effective_work(effective.work_object_substrate, radius, self.plate))
        return Conditions(
            radius=radius,
            density=effective.ball_density,
            work_tool=work_tool * factor,
            work_plate=work_plate * factor,
            contact_gap=self.electrical_gap,
            reach=self.adhesion_reach,
        )
