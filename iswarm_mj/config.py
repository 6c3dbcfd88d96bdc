"""The configuration of a cleaning run: every number that is not evolved.

Defaults are the paper's Table 1 (Valdastri et al. 2006) where a docstring says so. The others are choices of
this simulator where the paper is silent; none is presented as the paper's.
"""

import math
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.serialization import later


def check(name: str, value: Any, allowed: str, ok: bool) -> None:
    """Raise a one-sentence UserError unless `ok`."""
    finite = not isinstance(value, float) or math.isfinite(value)
    if not (ok and finite):
        flag = "--" + name.replace("_", "-")
        raise UserError(f"{flag} was {value}; it must be {allowed}: choose such a value.")


@dataclass(frozen=True)
class ArenaConfig:
    """The floor, the dump, the dust. Lengths in robot diameters [rd] unless said otherwise."""

    size: float = 49.0
    """Edge of the square arena (Table 1) [rd]."""
    dump_size: float = 5.0
    """Edge of the square dump at the centre [rd]."""
    dust_area_size: float = 6.0
    """Edge of each of the two square dust areas [rd]."""
    dust_area_offset: float = 16.0
    """Distance of the dust areas' centres from the arena's centre, along the x axis [rd]."""
    n_dust: int = 72
    """Number of dust particles (Table 1), half of them in each area."""
    ball_radius_min: float = 15e-6
    """Smallest radius of a solder ball (section 3.2.2) [m]."""
    ball_radius_max: float = 25e-6
    """Largest radius of a solder ball (section 3.2.2) [m]."""

    def __post_init__(self):
        check("arena.size", self.size, "between 10 and 150 rd", 10 <= self.size <= 150)
        check(
            "arena.dump_size",
            self.dump_size,
            "between 1 rd and half the arena",
            1 <= self.dump_size <= self.size / 2,
        )
        check("arena.dust_area_size", self.dust_area_size, "positive", self.dust_area_size > 0)
        reach = self.dust_area_offset + self.dust_area_size / 2
        check("arena.dust_area_offset", self.dust_area_offset, "such that the dust areas lie inside the walls",
              self.dust_area_offset >= 0 and reach <= self.size / 2)  # fmt: skip
        check("arena.dust_area_offset", self.dust_area_offset, "such that the dust areas lie outside the dump",
              self.dust_area_offset - self.dust_area_size / 2 >= self.dump_size / 2)  # fmt: skip
        check("arena.n_dust", self.n_dust, "between 1 and 2500", 1 <= self.n_dust <= 2500)
        check(
            "arena.ball_radius_min",
            self.ball_radius_min,
            "between 1e-6 and 1e-4 m",
            1e-6 <= self.ball_radius_min <= 1e-4,
        )
        check("arena.ball_radius_max", self.ball_radius_max, "between ball-radius-min and 1e-4 m",
              self.ball_radius_min <= self.ball_radius_max <= 1e-4)  # fmt: skip


@dataclass(frozen=True)
class DriveConfig:
    """How a robot moves in one control step: it turns on the spot, then walks straight."""

    step_length: float = 0.5
    """Distance walked in one control step (Table 1) [rd]."""
    control_period: float = 1.0
    """Duration of a control step [s]."""
    turn_substeps: int = 4
    """Physics steps of a control step spent turning."""
    walk_substeps: int = 6
    """Physics steps of a control step spent walking."""
    max_turn: float = 90.0
    """Largest turn in one control step [deg]."""

    def __post_init__(self):
        check("drive.step_length", self.step_length, "above 0 and at most 1 rd", 0 < self.step_length <= 1)
        check(
            "drive.control_period",
            self.control_period,
            "between 0.1 and 100 s",
            0.1 <= self.control_period <= 100,
        )
        check("drive.turn_substeps", self.turn_substeps, "between 1 and 100", 1 <= self.turn_substeps <= 100)
        check("drive.walk_substeps", self.walk_substeps, "between 1 and 100", 1 <= self.walk_substeps <= 100)
        check("drive.max_turn", self.max_turn, "above 0 and at most 180 deg", 0 < self.max_turn <= 180)

    @property
    def timestep(self) -> float:
        """Duration of a physics step [s]."""
        return self.control_period / (self.turn_substeps + self.walk_substeps)


@dataclass(frozen=True)
class OpticsConfig:
    """Light messages between robots: four LEDs with beams, photodiodes in four sectors."""

    mode: Literal["sector", "power"] = "sector"
    """`sector`: range and cones decide, as in the paper. `power`: the received power decides."""
    communication_radius: float = 3.5
    """Range on the axis of a beam (Table 1) [rd]."""
    led_beam_aperture: float = 60.0
    """Full opening angle of a LED's beam (Table 1) [deg]."""
    photodiode_aperture: float = 90.0
    """Full width of a side's photodiode sector in `sector` mode [deg]."""
    photodiode_splay: float = 30.0
    """Angle by which each of a side's two photodiodes looks away from the side's normal in `power` mode [deg]."""
    line_of_sight: bool = True
    """A robot that stands between two others cuts their link."""
    error_distance_measure: float = 0.10
    """Relative standard deviation of a measured distance (Table 1: 10 %)."""
    error_in_communication: float = 0.10
    """Probability that a message arrives with a wrong bit (Table 1: 10 %)."""
    independent_bit_errors: bool = False
    """Bits flip independently, so that some messages have two wrong bits and pass the parity; else one at most."""
    p_communication_break: float = 0.10
    """Probability per step that a link fails (Table 1)."""
    wall_range: float = 1.5
    """Distance over which a robot sees its own light reflected by a wall [rd]."""

    def __post_init__(self):
        check("optics.mode", self.mode, "sector or power", self.mode in ("sector", "power"))
        check("optics.communication_radius", self.communication_radius, "above 0 and at most 20 rd",
              0 < self.communication_radius <= 20)  # fmt: skip
        check("optics.led_beam_aperture", self.led_beam_aperture, "above 0 and at most 90 deg",
              0 < self.led_beam_aperture <= 90)  # fmt: skip
        check("optics.photodiode_aperture", self.photodiode_aperture, "above 0 and at most 90 deg",
              0 < self.photodiode_aperture <= 90)  # fmt: skip
        check(
            "optics.photodiode_splay",
            self.photodiode_splay,
            "between 1 and 44 deg",
            1 <= self.photodiode_splay <= 44,
        )
        check("optics.error_distance_measure", self.error_distance_measure, "within 0 to 1",
              0 <= self.error_distance_measure <= 1)  # fmt: skip
        check("optics.error_in_communication", self.error_in_communication, "within 0 to 0.9",
              0 <= self.error_in_communication <= 0.9)  # fmt: skip
        check("optics.p_communication_break", self.p_communication_break, "within 0 to 1",
              0 <= self.p_communication_break <= 1)  # fmt: skip
        check("optics.wall_range", self.wall_range, "within 0 to 10 rd", 0 <= self.wall_range <= 10)


@dataclass(frozen=True)
class GripperConfig:
    """The electrostatic tool, and the calibrated adhesion (section 3.2 of the paper). SI units."""

    grasp_voltage: float = 40.0
    """Voltage while lifting a ball [V]: the upper end of the 20-40 V that the paper holds feasible on board."""
    release_voltage: float = 55.0
    """Voltage while releasing a ball [V]: above the 37-47 V that releases took, below the 70 V that melts."""
    relative_humidity: float = 10.0
    """Relative humidity of the air [%]."""
    release_gap: float = 5e-6
    """Gap between ball and floor while releasing (section 3.2.3) [m]."""
    tool_reach: float = 0.2e-3
    """How far the two-degree-of-freedom tool reaches from its place of rest [m]."""
    work_tool_object: float = 1.41e-3
    """Median work of adhesion between tool and ball at 10 % RH, calibrated [J/m^2]."""
    work_object_substrate: float = 14.7e-3
    """Median work of adhesion between ball and floor at 10 % RH, calibrated [J/m^2]."""
    spread_tool_object: float = 0.12
    """Coefficient of variation of `work_tool_object` over the balls (log-normal)."""
    spread_object_substrate: float = 0.16
    """Coefficient of variation of `work_object_substrate` over the balls (log-normal)."""
    drop_rate: float = 0.0
    """Probability per step that a carried ball falls."""

    def __post_init__(self):
        for name in ("grasp_voltage", "release_voltage"):
            check(
                f"gripper.{name}",
                getattr(self, name),
                "within 0 to 69 V, since 70 V melts the ball",
                0 <= getattr(self, name) <= 69,
            )
        check(
            "gripper.relative_humidity",
            self.relative_humidity,
            "within 0 to 100 %",
            0 <= self.relative_humidity <= 100,
        )
        check(
            "gripper.release_gap",
            self.release_gap,
            "between 1e-6 and 2e-5 m",
            1e-6 <= self.release_gap <= 2e-5,
        )
        check("gripper.tool_reach", self.tool_reach, "above 0 and at most 1e-3 m", 0 < self.tool_reach <= 1e-3)
        for name in ("work_tool_object", "work_object_substrate"):
            check(
                f"gripper.{name}",
                getattr(self, name),
                "above 0 and at most 10 J/m^2",
                0 < getattr(self, name) <= 10,
            )
        for name in ("spread_tool_object", "spread_object_substrate"):
            check(f"gripper.{name}", getattr(self, name), "within 0 to 2", 0 <= getattr(self, name) <= 2)
        check("gripper.drop_rate", self.drop_rate, "within 0 to 1", 0 <= self.drop_rate <= 1)


@dataclass(frozen=True)
class StrategyConfig:
    """What the paper leaves open of the robots' rules."""

    dust_range: float = 0.75
    """A ball is sensed within this distance of the robot's centre [rd]."""
    random_turn: float = 30.0
    """A random move turns by up to this angle to either side [deg]."""
    scouts_pick: bool = False
    """Scouts pick up dust too."""
    avoidance_gain: float = 8.0
    """Weight of the repulsion against the wish to go somewhere, which has weight 1."""
    priority_factor: float = 2.0
    """Repulsion by robots that send the priority flag, relative to that by others."""
    wall_gain: float = 2.0
    """Weight of a wall's repulsion on a robot that follows no vector."""
    forget_on_arrival: bool = True
    """A robot forgets a vector that led it to where there is nothing."""
    message_range: float = 49.0
    """Longest vector that a message can carry [rd]."""
    update_order: Literal["synchronous", "sequential"] = later("synchronous")
    """`synchronous`: in a control step all robots hear what all said at the end of the step before. `sequential`: they
    hear, decide and speak one after the other, in an order drawn anew in each step, and so hear what those before
    them have just said; all move at once in either case."""

    def __post_init__(self):
        check("strategy.dust_range", self.dust_range, "above 0 and at most 5 rd", 0 < self.dust_range <= 5)
        check("strategy.random_turn", self.random_turn, "within 0 to 180 deg", 0 <= self.random_turn <= 180)
        for name in ("avoidance_gain", "priority_factor", "wall_gain"):
            check(f"strategy.{name}", getattr(self, name), "within 0 to 100", 0 <= getattr(self, name) <= 100)
        check(
            "strategy.message_range",
            self.message_range,
            "above 0 and at most 1000 rd",
            0 < self.message_range <= 1000,
        )
        check("strategy.update_order", self.update_order, "synchronous or sequential",
              self.update_order in ("synchronous", "sequential"))  # fmt: skip


@dataclass(frozen=True)
class SwarmConfig:
    """Everything about a cleaning run but the genome and the run's own settings."""

    arena: ArenaConfig = field(default_factory=ArenaConfig)
    drive: DriveConfig = field(default_factory=DriveConfig)
    optics: OpticsConfig = field(default_factory=OpticsConfig)
    gripper: GripperConfig = field(default_factory=GripperConfig)
    strategy: StrategyConfig = field(default_factory=StrategyConfig)


class Conditions(NamedTuple):
    """Noise and voltages of one world, or of many with a leading axis; named as in the configuration."""

    error_distance_measure: Array
    """Standard deviation of a measured distance, relative."""
    error_in_communication: Array
    """Probability that a message arrives with a wrong bit."""
    p_communication_break: Array
    """Probability that a message does not arrive."""
    drop_rate: Array
    """Probability per control step that a held ball falls."""
    grasp_voltage: Array
    """[V]"""
    release_voltage: Array
    """[V]"""


def conditions_of(config: SwarmConfig) -> Conditions:
    """Return what a configuration says, as floats."""
    optics, gripper = config.optics, config.gripper
    return Conditions(
        optics.error_distance_measure, optics.error_in_communication, optics.p_communication_break,
        gripper.drop_rate, gripper.grasp_voltage, gripper.release_voltage,
    )  # fmt: skip
