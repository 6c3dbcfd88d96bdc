"""Settings that programs are compiled for, which all worlds of a run share.

Programs take everything else as arrays (`sensors.conditions`, `sensors.arena`, `strategy.rules`),
so runs of different settings share a compiled program, and a control step can only read the values
of its own world. The classes of `config.swarm` derive from those here and add the settings that may
differ between worlds.

Lengths in rd are in robot diameters, the unit of the paper (`utils.units.ROBOT_DIAMETER`).
"""

import math
import os
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal

from iswarm_mj.config.energy import EnergyConfig
from iswarm_mj.utils.constraints import Above, Needs, Within, check, validate

LONGEST_STEP = 0.085
"""Longest distance that a robot may move in one physics step [rd].

Contacts separate robots that overlap by pushing them back the way they came. MuJoCo pushes them up
instead where they overlap by more than their height. Within these limits that does not happen, even
in crowds that fill the arena and press upon each other at full speed
(`tests/engines/test_longest_steps.py`); with 0.092 rd, or turns of 45 degrees, robots come out on
the other side.
"""
LARGEST_TURN = 30.0
"""Largest turn of a robot in one physics step [deg], for the same reason."""
_ROUNDING = 1e-9
"""Part of a physics step by which a number of steps may exceed a whole number."""


@dataclass(frozen=True)
class StaticDrive:
    """Motion of a robot in a control step: the settings that are compiled in."""

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
    locations: Literal["free", "cells"] = "free"
    """Robots walk wherever contacts let them (`free`), or only into empty squares of 1 rd
    (`cells`), one of which is centred in the arena: a robot whose step would end in a cell where
    another one stands stays where it is, which counts as a collision. Section 4.6.2: "49 x 49
    = 2401 possible robot locations"; it does not say more."""

    def __post_init__(self):
        validate(self, "drive")
        self._check_substeps("walk_substeps", "step_length", LONGEST_STEP, "rd")
        self._check_substeps("turn_substeps", "max_turn", LARGEST_TURN, "deg")

    def _check_substeps(self, name: str, motion_name: str, largest: float, unit: str) -> None:
        """Check that a robot does not move too far in one physics step.

        Args:
            name: setting with the number of physics steps.
            motion_name: setting with the largest motion in all of them.
            largest: largest motion in one of them.
            unit: unit of the motion.
        """
        n_steps = getattr(self, name)
        motion = getattr(self, motion_name)

        # A quotient that is whole but for rounding needs no further step.
        fewest = math.ceil(motion / largest - _ROUNDING)

        reason = f"so that a robot moves by at most {largest:g} {unit} in a physics step"
        limit = f"at least {fewest} with `drive.{motion_name}` {motion:g}, {reason}"
        check(f"drive.{name}", n_steps, limit, n_steps >= fewest)

    @property
    def timestep(self) -> float:
        """Duration of a physics step [s]."""
        return self.control_period / (self.turn_substeps + self.walk_substeps)

    @property
    def walk_time(self) -> float:
        """Part of a control step in which a robot walks; it covers `step_length` in it [s]."""
        return self.walk_substeps * self.timestep


N_LEDS = 4
"""LEDs of a robot, one a side (Table 1)."""
MESSAGE_BITS = 32
"""Length of a message (Table 1)."""
SENDERS_IN_SIGHT = 5
"""Number of senders that engines report to each side of a robot where messages take time.

They are the nearest ones in sight; others neither jam nor are heard. Of the sides that hear any, at
most one in 10,000 has more (`tests/studies/test_senders_in_sight.py`)."""
_NEEDS_SLOTS = Needs("baud_rate")
"""Settings of slots have an effect where messages take time, at any bit rate but 0."""
_NEEDS_TRIALS = Needs("resolution", ("dynamic",))
"""Settings of trials have an effect where attempts of the gripper are trials."""


@dataclass(frozen=True)
class StaticOptics:
    """Reach, beams and timing of the light: the settings that are compiled in."""

    mode: Literal["sector", "power"] = "sector"
    """Rule that decides about links: range and beam cones as in the paper (`sector`), or received
    power (`power`)."""
    communication_radius: Annotated[float, Above(0, 20, "rd")] = 3.5
    """Range on the axis of a beam (Table 1) [rd]."""
    led_beam_aperture: Annotated[float, Within(1, 90, "deg")] = 60.0
    """Full opening angle of an LED's beam (Table 1) [deg]."""
    photodiode_aperture: Annotated[float, Within(1, 90, "deg"), Needs("mode", ("sector",))] = 90.0
    """Full width of a side's photodiode sector in `sector` mode [deg]."""
    photodiode_splay: Annotated[float, Within(1, 44, "deg"), Needs("mode", ("power",))] = 30.0
    """Angle between each of a side's two photodiodes and the side's normal in `power` mode
    [deg]."""
    line_of_sight: bool = True
    """A robot between two others blocks their link."""
    wall_range: Annotated[float, Within(0, 10, "rd")] = 1.5
    """Distance at which a robot detects walls by its own reflected light [rd]."""
    baud_rate: Annotated[float, Within(0, 1e6, "bit/s")] = 0.0
    """Bit rate of an LED [bit/s]. 0: messages take no time and do not interfere. Otherwise all
    robots stop in each control step for a window of `slots`, each as long as one message ("they
    frequently stop in order to emit some light impulses", section 4.1). The paper gives no rate."""
    slots: Annotated[int, Within(4, 64), _NEEDS_SLOTS] = 8
    """Slots of the window for messages. A robot lights its LEDs in four consecutive slots ("the
    LEDs will be serially activated", section 4.1); it draws the first in each control step."""
    photodiodes_while_emitting: Annotated[Literal["front", "none", "all"], _NEEDS_SLOTS] = "front"
    """Sides that listen while a robot emits ("all photodiodes off, except those on the front side
    of the robot in order to detect an obstacle", section 4.1). In the slot of its own LED a side
    detects walls but receives no message."""
    serial_photodiodes: Annotated[bool, _NEEDS_SLOTS] = False
    """A silent robot listens with one side after the other, a slot each, instead of with all."""
    capture_ratio: Annotated[float, Within(0, 100), _NEEDS_SLOTS] = 0.0
    """The nearest of several senders in a slot is heard if the others are at least this many times
    as far away; 0: never."""

    def __post_init__(self):
        validate(self, "optics")
        is_ratio = self.capture_ratio == 0 or self.capture_ratio >= 1
        check("optics.capture_ratio", self.capture_ratio, "0 or at least 1", is_ratio)
        ever_listens = self.slots > N_LEDS or self.photodiodes_while_emitting != "none"
        check(
            "optics.slots",
            self.slots,
            "at least 5, for robots that do not listen while they emit",
            ever_listens,
        )

    @property
    def window(self) -> float:
        """Part of a control step in which robots stand still and exchange messages [s]."""
        return self.slots * MESSAGE_BITS / self.baud_rate if self.baud_rate else 0.0

    @property
    def n_senders(self) -> int:
        """Number of nearest senders in sight of a side that engines report."""
        return SENDERS_IN_SIGHT if self.baud_rate else 1


@dataclass(frozen=True)
class StaticGripper:
    """Attempts to pick up and to release balls: the settings that are compiled in."""

    release_gap: Annotated[float, Within(1e-6, 2e-5, "m")] = 5e-6
    """Gap between ball and floor at release (section 3.2.3) [m]."""
    tip: str | None = None
    """Table of the forces of another tip than the paper's, the tip.json of `iswarm tip --table`; see
    docs/design-a-tip.md."""
    cut_delay: Annotated[float, Within(0, 1e-3, "s"), _NEEDS_TRIALS] = 0.0
    """Delay from the moment at which a released ball has left the tool until its voltage is cut, in
    trials [s]: a ball that has not landed by then may return to a hollow tip."""
    tool_reach: Annotated[float, Above(0, 1e-3, "m")] = 0.2e-3
    """Reach of the tool from its rest position, in two degrees of freedom [m]."""
    resolution: Literal["quasi-static", "dynamic"] = "quasi-static"
    """Model of attempts to pick up and release: a force balance (`quasi-static`), or trials that
    MuJoCo simulates (`dynamic`)."""
    bench: Annotated[Literal["auto", "c", "mjx"], _NEEDS_TRIALS] = "auto"
    """Program that runs trials: MuJoCo in C (`c`), or a batch in MJX (`mjx`); `auto`: C with
    engines on the CPU, MJX with compiled ones."""
    bench_capacity: Annotated[int, Within(1, 1024), _NEEDS_TRIALS] = 8
    """Trials per world and control step in MJX; further robots try again in the next step."""
    tool_error: Annotated[float, Within(0, 1e-4, "m")] = 0.0
    """Standard deviation of the tool's position relative to the ball, per axis and attempt [m]; see
    docs/swarm-grasps.md."""
    grasp_time: Annotated[float, Within(0, 1000, "s")] = 0.0
    """Time of an attempt to pick up a ball, charging the tool included [s]; rounded to whole
    control steps."""
    release_time: Annotated[float, Within(0, 1000, "s")] = 0.0
    """Time of an attempt to release a ball [s]."""

    def __post_init__(self):
        validate(self, "gripper")
        if self.tip is not None:
            is_name = (
                isinstance(self.tip, str | os.PathLike)
                and str(self.tip)
                and "\0" not in str(self.tip)
            )
            check("gripper.tip", self.tip, "the name of a file", bool(is_name))
            object.__setattr__(self, "tip", os.path.abspath(self.tip))


@dataclass(frozen=True)
class StaticStrategy:
    """Form and order of the messages: the settings that are compiled in."""

    message_range: Annotated[float, Above(0, 1000, "rd")] = 49.0
    """Longest vector that a message can carry [rd]."""
    update_order: Literal["synchronous", "sequential"] = "synchronous"
    """`synchronous`: robots receive the messages of the previous control step. `sequential`: they
    receive, decide and send one after the other, in a random order each step, so they also hear
    messages of the same step. All move at the same time."""

    def __post_init__(self):
        validate(self, "strategy")


@dataclass(frozen=True)
class StaticConfig:
    """All settings that control steps are compiled for.

    It has no arena, noise, voltages or rules: these may differ between worlds, and steps read them
    from `TaskInputs`, `Conditions` and `Rules`.
    """

    drive: StaticDrive
    optics: StaticOptics
    gripper: StaticGripper
    strategy: StaticStrategy
    energy: EnergyConfig
    tip_changed: int = 0
    """Time of the last change of the file `gripper.tip` [ns], so that programs for an earlier table
    are not used for a new one."""

    @property
    def step_length(self) -> float:
        """`drive.step_length`, shortened by the time in which robots exchange messages [rd]."""
        return step_length(self.drive, self.optics)


def step_length(drive: StaticDrive, optics: StaticOptics) -> float:
    """Return `drive.step_length`, shortened by the time in which robots exchange messages [rd].

    `SwarmConfig` checks that messages take less time than the robots have to walk.
    """
    return drive.step_length * (1.0 - optics.window / drive.walk_time)


def static_part(settings: Any, cls: type) -> Any:
    """Return the settings of a group that are compiled in.

    Args:
        settings: a group of a configuration, such as a `DriveConfig`.
        cls: the class that it derives from, such as `StaticDrive`.
    """
    values = {field.name: getattr(settings, field.name) for field in fields(cls)}
    return cls(**values)
