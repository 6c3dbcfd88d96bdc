"""The configuration of a run: all parameters that are not evolved, with their limits and units.

Defaults marked "Table 1" are those of the paper (Valdastri et al. 2006). The others are choices of
this simulator where the paper gives no value. An object outside its limits raises `ConfigError`.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from iswarm_mj.config.arena import ArenaConfig
from iswarm_mj.config.energy import EnergyConfig
from iswarm_mj.config.static import (
    StaticConfig,
    StaticDrive,
    StaticGripper,
    StaticOptics,
    StaticStrategy,
    static_part,
    step_length,
)
from iswarm_mj.utils.constraints import Above, Within, check, validate


@dataclass(frozen=True)
class DriveConfig(StaticDrive):
    """Motion of a robot in one control step: it turns on the spot, then walks straight ahead."""

    error_turn: Annotated[float, Within(0, 180, "deg")] = 0.0
    """Standard deviation of the executed turn about the command [deg]. The paper has no such
    error."""
    error_step: Annotated[float, Within(0, 1)] = 0.0
    """Relative standard deviation of the distance walked, clipped at `step_length`. The paper has
    no such error."""
    stop_share: Annotated[float, Within(0, 1)] = 0.0
    """Probability that a robot stays where it is in a control step, to emit: "they frequently stop
    in order to emit some light impulses" (section 4.1). The paper gives no rate."""
    turn_share: Annotated[float, Within(0, 1)] = 0.0
    """Share of a control step that a turn of `max_turn` takes, and smaller turns in proportion; the
    robot walks in the rest. 0: it walks as far however it turns. The paper does not say."""
    loaded_speed: Annotated[float, Above(0, 1)] = 1.0
    """Speed of a robot that carries a ball, relative to that of others. The paper does not say."""


@dataclass(frozen=True)
class OpticsConfig(StaticOptics):
    """Optical messages between robots, which have an LED and photodiodes on each of four sides."""

    error_distance_measure: Annotated[float, Within(0, 1)] = 0.10
    """Relative standard deviation of a measured distance (Table 1: 10 %)."""
    error_in_communication: Annotated[float, Within(0, 0.9)] = 0.10
    """Probability that a message arrives with a wrong bit (Table 1: 10 %)."""
    independent_bit_errors: bool = False
    """Bits flip independently, so that messages with two wrong bits pass the parity check;
    otherwise at most one bit flips. The paper does not say."""
    parity_check: bool = True
    """Robots discard messages whose parity, or another check that the strategy declares, fails;
    otherwise they accept damaged messages. Not in the paper; docs/readings.md supports it."""
    p_communication_break: Annotated[float, Within(0, 1)] = 0.10
    """Probability per step that a link fails (Table 1)."""


@dataclass(frozen=True)
class GripperConfig(StaticGripper):
    """Electrostatic tool and calibrated adhesion (section 3.2 of the paper), in SI units."""

    grasp_voltage: Annotated[float, Within(0, 69, "V", "70 V melts the ball")] = 40.0
    """Voltage for picking up a ball [V]: the upper end of the 20-40 V that the paper considers
    feasible on board."""
    release_voltage: Annotated[float, Within(0, 69, "V", "70 V melts the ball")] = 55.0
    """Voltage for releasing a ball [V]: above the 37-47 V that releases took, below the 70 V that
    melts the ball."""
    relative_humidity: Annotated[float, Within(0, 100, "%")] = 10.0
    """Relative humidity of the air [%]: 10 % is "the optimal condition" (section 3.2.3)."""
    work_tool_object: Annotated[float, Above(0, 10, "J/m^2")] = 1.41e-3
    """Median work of adhesion between tool and ball at 10 % RH, calibrated [J/m^2]."""
    work_object_substrate: Annotated[float, Above(0, 10, "J/m^2")] = 14.7e-3
    """Median work of adhesion between ball and floor at 10 % RH, calibrated [J/m^2]."""
    spread_tool_object: Annotated[float, Within(0, 2)] = 0.12
    """Coefficient of variation of `work_tool_object` from attempt to attempt (log-normal),
    calibrated."""
    spread_object_substrate: Annotated[float, Within(0, 2)] = 0.16
    """Coefficient of variation of `work_object_substrate` from attempt to attempt (log-normal),
    calibrated."""
    humidity_doubling: Annotated[float, Within(1, 1e6, "%")] = 70.0
    """Excess of relative humidity over 10 % that doubles adhesion [%]: twice as much at 70 to 90 %
    RH as at 10 %, after ref. 54."""
    humidity_fall: Annotated[float, Within(0, 1, "1/%")] = 0.04
    """Growth of adhesion per percent of relative humidity below 10 % [1/%]; of it only the sign is
    known."""
    drop_rate: Annotated[float, Within(0, 1)] = 0.0
    """Probability per step that a carried ball falls. Section 4.2: "there is the risk of dropping
    the particle", without a rate; see docs/readings.md."""


@dataclass(frozen=True)
class StrategyConfig(StaticStrategy):
    """The robots' rules: interpretations of the paper, and parameters that it does not specify."""

    dust_range: Annotated[float, Above(0, 5, "rd")] = 0.75
    """Distance from the robot's centre within which it senses a ball [rd]."""
    error_in_sensing: Annotated[float, Within(0, 1)] = 0.0
    """Probability per step that a robot senses neither the dust nor the dump that it is at. Section
    4.2: the simulator "allows one to simulate noise" on sensing; Table 1 has no such error."""
    avoidance_sides: Literal["front", "all"] = "front"
    """Sides used to avoid robots and walls. Section 4.1: "each robot will keep all photodiodes off,
    except those on the front side of the robot in order to detect an obstacle"."""
    avoidance_course: Literal["any", "crossing", "oncoming"] = "any"
    """Neighbours that a robot avoids, by the LED that it sees: `any`; `oncoming`, which show their
    front; `crossing`, which adds those that show a side. Section 4.1: the "LED-codes received
    inform the robots about the walking direction", and robots turn "if a collision route is
    detected"; it does not say which codes mean one."""
    priority_repulsion: Literal["higher", "scaled"] = "higher"
    """Repulsion by robots with the priority flag: `higher` than that by others wherever there is
    one, or `scaled` with their shorter distance to keep, so higher only near contact. Section 4.1:
    they "have higher repellent forces"."""
    avoids_at_dust: bool = False
    """Robots that approach a ball avoid others. The paper does not say; crowds then keep them away
    from balls."""
    random_turn: Annotated[float, Within(0, 180, "deg")] = 30.0
    """Largest turn of a random move, to either side [deg]. Section 4.1: "walk often randomly"."""
    scouts_pick: bool = False
    """Scouts pick up balls, too."""
    avoidance_gain: Annotated[float, Within(0, 100)] = 8.0
    """Weight of the repulsion relative to the desired direction, which has weight 1."""
    priority_factor: Annotated[float, Within(0, 100)] = 2.0
    """Repulsion from robots with the priority flag, relative to that from others."""
    wall_gain: Annotated[float, Within(0, 100)] = 2.0
    """Weight of a wall's repulsion on a robot that follows no vector."""
    forget_on_arrival: bool = True
    """A robot forgets a vector that led it to a place without dust or dump."""
    odometry_error_turn: Annotated[float, Within(0, 180, "deg")] = 0.0
    """Standard deviation of the turn in a robot's dead reckoning [deg]. The paper has no such
    error."""
    odometry_error_step: Annotated[float, Within(0, 1)] = 0.0
    """Relative standard deviation of the distance in a robot's dead reckoning. The paper has no
    such error."""


@dataclass(frozen=True)
class SwarmConfig:
    """Complete configuration of a run, except the genome and the settings of the run itself."""

    arena: ArenaConfig = field(default_factory=ArenaConfig)
    drive: DriveConfig = field(default_factory=DriveConfig)
    optics: OpticsConfig = field(default_factory=OpticsConfig)
    gripper: GripperConfig = field(default_factory=GripperConfig)
    strategy: StrategyConfig = field(default_factory=StrategyConfig)
    energy: EnergyConfig = field(default_factory=EnergyConfig)

    def __post_init__(self):
        validate(self)
        window = self.optics.window
        walk_time = self.drive.walk_time
        limit = (
            f"high enough for {self.optics.slots} slots to take less than the {walk_time:g} s "
            f"in which robots walk, and not {window:g} s"
        )
        check("optics.baud_rate", self.optics.baud_rate, limit, window < walk_time)
        self.energy.check_step(self.drive.control_period)

    @property
    def step_length(self) -> float:
        """Longest distance of a control step, shortened by the window for messages [rd]."""
        return step_length(self.drive, self.optics)

    @property
    def static(self) -> StaticConfig:
        """Settings that control steps are compiled for, which all worlds of a run share."""
        return StaticConfig(
            drive=static_part(self.drive, StaticDrive),
            optics=static_part(self.optics, StaticOptics),
            gripper=static_part(self.gripper, StaticGripper),
            strategy=static_part(self.strategy, StaticStrategy),
            energy=self.energy,
        )


INTERPRETATIONS = {
    "paper": SwarmConfig(),
    "initial": SwarmConfig(
        arena=ArenaConfig(dust_area_offset=16.0),
        strategy=StrategyConfig(avoidance_sides="all", priority_repulsion="scaled"),
    ),
    "selected": SwarmConfig(
        strategy=StrategyConfig(avoidance_course="crossing"),
        gripper=GripperConfig(drop_rate=0.01),
    ),
}
"""Interpretations of the paper's rules, by name.

`paper`: as the paper states them. `initial`: as in the first version of this simulator. `selected`:
as Fig. 17 and the penalties in Table 2 select them, by the rule in docs/readings.md.
"""
