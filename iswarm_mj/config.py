"""The configuration of a cleaning run: every parameter that is not evolved, with its limits and unit.

Defaults marked "Table 1" are those of the paper (Valdastri et al. 2006). The others are choices of this simulator
where the paper gives no value. An object outside its limits raises `ConfigError`.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

from iswarm_mj.arena_config import ArenaConfig
from iswarm_mj.utils.constraints import PER_WORLD, Above, Needs, Within, check, validate
from iswarm_mj.utils.energy import EnergyConfig

LONGEST_STEP, LARGEST_TURN = 0.085, 30.0
"""Motion of a robot in one physics step at most [rd, deg].

Contacts part robots that overlap, by pushing them back the way they came, unless in MuJoCo they overlap by more than
their height: then it pushes them up. Within these limits crowds that fill the arena and press upon each other at full
speed do not (`tests/engines/test_longest_steps.py`); with 0.092 rd, or 45 degrees, robots come out on the other side.
"""


@dataclass(frozen=True)
class DriveConfig:
    """Motion of a robot in one control step: it turns on the spot, then walks straight ahead."""

    step_length: Annotated[float, Above(0, 1, "rd")] = 0.5
    """Distance walked in one control step (Table 1) [rd]."""
    control_period: Annotated[float, Within(0.1, 100, "s")] = 1.0
    """Duration of a control step [s]."""
    turn_substeps: Annotated[int, Within(1, 100)] = 4
    """Physics steps of a control step in which the robot turns."""
    walk_substeps: Annotated[int, Within(1, 100)] = 6
    """Physics steps of a control step in which the robot walks."""
    max_turn: Annotated[float, Above(0, 180, "deg")] = 90.0
    """Largest turn in one control step [deg]; a choice."""
    error_turn: Annotated[float, Within(0, 180, "deg"), PER_WORLD] = 0.0
    """Standard deviation of the executed turn about the command [deg]. The paper has no such error."""
    error_step: Annotated[float, Within(0, 1), PER_WORLD] = 0.0
    """Relative standard deviation of the distance walked, clipped at `step_length`. The paper has no such error."""
    stop_share: Annotated[float, Within(0, 1), PER_WORLD] = 0.0
    """Probability that a robot stays where it is in a control step, to emit: "they frequently stop in order to emit
    some light impulses" (section 4.1). The paper gives no rate."""
    turn_share: Annotated[float, Within(0, 1), PER_WORLD] = 0.0
    """Share of a control step that a turn of `max_turn` takes, and smaller turns in proportion; the robot walks in the
    rest. 0: it walks as far however it turns. The paper does not say."""
    loaded_speed: Annotated[float, Above(0, 1), PER_WORLD] = 1.0
    """Speed of a robot that carries a ball, relative to that of others. The paper does not say."""
    locations: Literal["free", "cells"] = "free"
    """Robots walk wherever contacts let them (`free`); or there is one robot in each of the arena's `cells` of 1 rd, of
    which one lies about the centre: a robot whose step would end in a cell where another one stands stays where it is,
    which counts as a collision. Section 4.6.2: "49 x 49 = 2401 possible robot locations"; it does not say more."""

    def __post_init__(self):
        validate(self, "drive")
        self._check_substeps("walk_substeps", "step_length", LONGEST_STEP, "rd")
        self._check_substeps("turn_substeps", "max_turn", LARGEST_TURN, "deg")

    def _check_substeps(self, name: str, whole: str, largest: float, unit: str) -> None:
        """Check that physics steps are short enough for what a robot moves in all of them."""
        n_steps, amount = getattr(self, name), getattr(self, whole)
        least = math.ceil(amount / largest - 1e-9)
        limit = f"so that a robot moves by at most {largest:g} {unit} in a physics step"
        check(f"drive.{name}", n_steps, f"at least {least} with `drive.{whole}` {amount:g}, {limit}", n_steps >= least)

    @property
    def timestep(self) -> float:
        """Duration of a physics step [s]."""
        return self.control_period / (self.turn_substeps + self.walk_substeps)

    @property
    def walk_time(self) -> float:
        """Part of a control step in which a robot walks, at the speed of `step_length` in that time [s]."""
        return self.walk_substeps * self.timestep


N_LEDS = 4
"""LEDs of a robot, one a side (Table 1)."""
MESSAGE_BITS = 32
"""Length of a message (Table 1)."""
SENDERS_IN_SIGHT = 5
"""Nearest senders in sight of a side that engines report where messages take time; others neither jam nor are heard."""
_IN_SLOTS = Needs("baud_rate")
_IN_TRIALS = Needs("resolution", ("dynamic",))


@dataclass(frozen=True)
class OpticsConfig:
    """Optical messages between robots, which have an LED and photodiodes on each of four sides."""

    mode: Literal["sector", "power"] = "sector"
    """How links are decided: by range and beam cones as in the paper (`sector`), or by received power (`power`)."""
    communication_radius: Annotated[float, Above(0, 20, "rd")] = 3.5
    """Range on the axis of a beam (Table 1) [rd]."""
    led_beam_aperture: Annotated[float, Within(1, 90, "deg")] = 60.0
    """Full opening angle of an LED's beam (Table 1) [deg]."""
    photodiode_aperture: Annotated[float, Within(1, 90, "deg"), Needs("mode", ("sector",))] = 90.0
    """Full width of a side's photodiode sector in `sector` mode [deg]."""
    photodiode_splay: Annotated[float, Within(1, 44, "deg"), Needs("mode", ("power",))] = 30.0
    """Angle between each of a side's two photodiodes and the side's normal in `power` mode [deg]."""
    line_of_sight: bool = True
    """A robot between two others blocks their link."""
    error_distance_measure: Annotated[float, Within(0, 1), PER_WORLD] = 0.10
    """Relative standard deviation of a measured distance (Table 1: 10 %)."""
    error_in_communication: Annotated[float, Within(0, 0.9), PER_WORLD] = 0.10
    """Probability that a message arrives with a wrong bit (Table 1: 10 %)."""
    independent_bit_errors: Annotated[bool, PER_WORLD] = False
    """Bits flip independently, so that messages with two wrong bits pass the parity check; otherwise at most one bit
    flips. The paper does not say."""
    parity_check: Annotated[bool, PER_WORLD] = True
    """Robots discard messages whose parity, or another check that the strategy declares, fails; otherwise they accept
    damaged messages. Not in the paper; docs/readings.md supports it."""
    p_communication_break: Annotated[float, Within(0, 1), PER_WORLD] = 0.10
    """Probability per step that a link fails (Table 1)."""
    wall_range: Annotated[float, Within(0, 10, "rd")] = 1.5
    """Distance at which a robot detects walls by its own reflected light [rd]."""
    baud_rate: Annotated[float, Within(0, 1e6, "bit/s")] = 0.0
    """Bit rate of an LED [bit/s]. 0: messages take no time and do not interfere. Otherwise all robots stop in each
    control step for a window of `slots`, each as long as one message ("they frequently stop in order to emit some light
    impulses", section 4.1). The paper gives no rate."""
    slots: Annotated[int, Within(4, 64), _IN_SLOTS] = 8
    """Slots of the window for messages. A robot lights its LEDs in four consecutive slots ("the LEDs will be serially
    activated", section 4.1); it draws the first in each control step."""
    photodiodes_while_emitting: Annotated[Literal["front", "none", "all"], _IN_SLOTS] = "front"
    """Sides that listen while a robot emits ("all photodiodes off, except those on the front side of the robot in order
    to detect an obstacle", section 4.1). A side whose own LED is lit detects walls but receives no message."""
    serial_photodiodes: Annotated[bool, _IN_SLOTS] = False
    """A silent robot listens with one side after the other, a slot each, instead of with all."""
    capture_ratio: Annotated[float, Within(0, 100), _IN_SLOTS] = 0.0
    """The nearest of several senders in a slot is heard if the others are at least this many times as far away; 0:
    never."""

    def __post_init__(self):
        validate(self, "optics")
        check("optics.capture_ratio", self.capture_ratio, "0 or at least 1", not 0 < self.capture_ratio < 1)
        ever_listens = self.slots > N_LEDS or self.photodiodes_while_emitting != "none"
        check("optics.slots", self.slots, "at least 5, for robots that do not listen while they emit", ever_listens)

    @property
    def window(self) -> float:
        """Part of a control step in which robots stand still and exchange messages [s]."""
        return self.slots * MESSAGE_BITS / self.baud_rate if self.baud_rate else 0.0

    @property
    def n_senders(self) -> int:
        """Number of nearest senders in sight of a side that engines report."""
        return SENDERS_IN_SIGHT if self.baud_rate else 1


@dataclass(frozen=True)
class GripperConfig:
    """Electrostatic tool and calibrated adhesion (section 3.2 of the paper), in SI units."""

    grasp_voltage: Annotated[float, Within(0, 69, "V", "70 V melts the ball"), PER_WORLD] = 40.0
    """Voltage for picking up a ball [V]: the upper end of the 20-40 V that the paper considers feasible on board."""
    release_voltage: Annotated[float, Within(0, 69, "V", "70 V melts the ball"), PER_WORLD] = 55.0
    """Voltage for releasing a ball [V]: above the 37-47 V that releases took, below the 70 V that melts the ball."""
    relative_humidity: Annotated[float, Within(0, 100, "%")] = 10.0
    """Relative humidity of the air [%]: 10 % is "the optimal condition" (section 3.2.3)."""
    release_gap: Annotated[float, Within(1e-6, 2e-5, "m")] = 5e-6
    """Gap between ball and floor at release (section 3.2.3) [m]."""
    tool_reach: Annotated[float, Above(0, 1e-3, "m")] = 0.2e-3
    """Reach of the tool from its rest position, in two degrees of freedom [m]."""
    work_tool_object: Annotated[float, Above(0, 10, "J/m^2")] = 1.41e-3
    """Median work of adhesion between tool and ball at 10 % RH, calibrated [J/m^2]."""
    work_object_substrate: Annotated[float, Above(0, 10, "J/m^2")] = 14.7e-3
    """Median work of adhesion between ball and floor at 10 % RH, calibrated [J/m^2]."""
    spread_tool_object: Annotated[float, Within(0, 2), PER_WORLD] = 0.12
    """Coefficient of variation of `work_tool_object` from attempt to attempt (log-normal), calibrated."""
    spread_object_substrate: Annotated[float, Within(0, 2), PER_WORLD] = 0.16
    """Coefficient of variation of `work_object_substrate` from attempt to attempt (log-normal), calibrated."""
    drop_rate: Annotated[float, Within(0, 1), PER_WORLD] = 0.0
    """Probability per step that a carried ball falls. Section 4.2: "there is the risk of dropping the particle",
    without a rate; see docs/readings.md."""
    resolution: Literal["quasi-static", "dynamic"] = "quasi-static"
    """What decides about attempts to pick up and release: a force balance (`quasi-static`) or trials (`dynamic`)."""
    bench: Annotated[Literal["auto", "c", "mjx"], _IN_TRIALS] = "auto"
    """Where trials run: MuJoCo in C, or a batch in MJX; `auto`: C with engines on the CPU, MJX with compiled ones."""
    bench_capacity: Annotated[int, Within(1, 1024), _IN_TRIALS] = 8
    """Trials per world and control step in MJX; further robots try again in the next step."""
    tool_error: Annotated[float, Within(0, 1e-4, "m")] = 0.0
    """Standard deviation of the tool's position relative to the ball, per axis and attempt [m]; see docs/gripper.md."""
    grasp_time: Annotated[float, Within(0, 1000, "s")] = 0.0
    """Time of an attempt to pick up a ball, charging the tool included [s]; rounded to whole control steps."""
    release_time: Annotated[float, Within(0, 1000, "s")] = 0.0
    """Time of an attempt to release a ball [s]."""

    def __post_init__(self):
        validate(self, "gripper")


@dataclass(frozen=True)
class StrategyConfig:
    """The robots' rules: interpretations of the paper's sentences, and parameters that it does not specify."""

    dust_range: Annotated[float, Above(0, 5, "rd"), PER_WORLD] = 0.75
    """Distance from the robot's centre within which it senses a ball [rd]."""
    error_in_sensing: Annotated[float, Within(0, 1), PER_WORLD] = 0.0
    """Probability per step that a robot senses neither the dust nor the dump that it is at. Section 4.2: the simulator
    "allows one to simulate noise" on sensing; Table 1 has no such error."""
    avoidance_sides: Literal["front", "all"] = "front"
    """Sides used to avoid robots and walls. Section 4.1: "each robot will keep all photodiodes off, except those on the
    front side of the robot in order to detect an obstacle"."""
    avoidance_course: Literal["any", "crossing", "oncoming"] = "any"
    """Neighbours that a robot avoids, by the LED that it sees: `any`; `oncoming`, which show their front; `crossing`,
    which adds those that show a side. Section 4.1: the "LED-codes received inform the robots about the walking
    direction", and robots turn "if a collision route is detected"; it does not say which codes mean one."""
    priority_repulsion: Literal["higher", "scaled"] = "higher"
    """Repulsion by robots with the priority flag: `higher` than that by others wherever there is one, or `scaled` with
    their shorter distance to keep, so higher only near contact. Section 4.1: they "have higher repellent forces"."""
    avoids_at_dust: bool = False
    """Robots that approach a ball avoid others. The paper does not say; crowds then keep them away from balls."""
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
    message_range: Annotated[float, Above(0, 1000, "rd")] = 49.0
    """Longest vector that a message can carry [rd]."""
    odometry_error_turn: Annotated[float, Within(0, 180, "deg")] = 0.0
    """Standard deviation of the turn in a robot's dead reckoning [deg]. The paper has no such error."""
    odometry_error_step: Annotated[float, Within(0, 1)] = 0.0
    """Relative standard deviation of the distance in a robot's dead reckoning. The paper has no such error."""
    update_order: Literal["synchronous", "sequential"] = "synchronous"
    """`synchronous`: robots receive the messages of the previous control step. `sequential`: they receive, decide and
    send one after the other, in a random order each step, so they also hear messages of the same step. All move at the
    same time."""

    def __post_init__(self):
        validate(self, "strategy")


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
        window, walk = self.optics.window, self.drive.walk_time
        limit = f"high enough for {self.optics.slots} slots to take less than the {walk:g} s in which robots walk"
        check("optics.baud_rate", self.optics.baud_rate, f"{limit}, and not {window:g} s", window < walk)
        self.energy.check_step(self.drive.control_period)

    @property
    def step_length(self) -> float:
        """Longest distance of a control step, shortened by the window for messages [rd]."""
        return self.drive.step_length * (1.0 - self.optics.window / self.drive.walk_time)


READINGS = {
    "paper": SwarmConfig(),
    "initial": SwarmConfig(
        ArenaConfig(dust_area_offset=16.0), strategy=StrategyConfig(avoidance_sides="all", priority_repulsion="scaled")
    ),
    "selected": SwarmConfig(
        strategy=StrategyConfig(avoidance_course="crossing"), gripper=GripperConfig(drop_rate=0.01)
    ),
}
"""Interpretations of the paper's rules: as it states them, as in the first version of this simulator, and as Fig. 17
and the penalties in Table 2 select them by the rule in docs/readings.md."""
