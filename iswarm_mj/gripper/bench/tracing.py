"""Traces of trials, sample by sample, from the states that a bench recorded."""

from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.attempts import tip_of
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.model import STATE, layout
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import hang, release, rung, touch
from iswarm_mj.gripper.bench.script import hangs, is_lifted
from iswarm_mj.gripper.bench.swarm_trials import TIMESTEP, protocol_of, radius_of, ramp_to
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.handling import Tried
from iswarm_mj.gripper.units import MS, NN, UM

States = Float[np.ndarray, "T n"]

PHASES = ("approach", "contact", "voltage", "retract", "lift", "off", "ramp", "flight", "rest")
"""Phases of lifts, then those of releases, in their order."""


class Trace(NamedTuple):
    """T samples of one trial, at increasing times, in SI units.

    The z axis points up; the plate's surface is at z = 0.
    """

    time: Float[np.ndarray, "T"]
    """Time since the trial began [s]."""
    phase: Int[np.ndarray, "T"]
    """Indices into `phases`."""
    phases: tuple[str, ...]
    """Names of the phases: approach, ramp, ..."""
    voltage: Float[np.ndarray, "T"]
    """Voltage of the probe against the plate [V]."""
    probe: Float[np.ndarray, "T 3"]
    """Centre of the tip's face [m]."""
    ball: Float[np.ndarray, "T 3"]
    """Centre of the ball [m]."""
    ball_quaternion: Float[np.ndarray, "T 4"]
    """Orientation of the ball, w first."""
    gap_tool: Float[np.ndarray, "T"]
    """Gap between probe and ball, negative where they are pressed together [m]."""
    gap_plate: Float[np.ndarray, "T"]
    """Gap between ball and plate, negative where they are pressed together [m]."""
    adhesion_tool: Float[np.ndarray, "T"]
    """Attraction of the ball by the probe, at least 0 [N]."""
    adhesion_plate: Float[np.ndarray, "T"]
    """Attraction of the ball by the plate, at least 0 [N]."""
    electrostatic: Float[np.ndarray, "T"]
    """Force on the ball, positive towards the probe, negative towards the plate [N]."""
    contact_tool: Float[np.ndarray, "T"]
    """Normal force between probe and ball, at least 0 [N]."""
    contact_plate: Float[np.ndarray, "T"]
    """Normal force between ball and plate, at least 0 [N]."""
    on_plate_potential: Bool[np.ndarray, "T"]
    """True if the ball has the plate's potential; otherwise it has the probe's."""
    ball_voltage: Float[np.ndarray, "T"]
    """Voltage of the ball against the plate [V]."""
    broken: Bool[np.ndarray, "T"]
    """True if the oxide of the tool's contact is broken down."""
    drive: Float[np.ndarray, "T"]
    """Force of the drive on the tool, upwards [N]."""
    impact_loss: Float[np.ndarray, "T"]
    """Energy lost in an impact from which the ball rebounds [J]; 0 where there is none."""
    radius: float
    """Radius of the ball [m]."""
    probe_radius: float
    """Radius of the probe [m]."""
    weight: float
    """Weight of the ball [N]."""
    probe_weight: float
    """Weight of the probe with its carriage [N]."""


def thinned(trace: Trace, limit: int) -> Trace:
    """Return a trace of about `limit` samples at most.

    It is dense where the ball moves or the electrostatic force changes: samples are kept at even
    distances along a path to which time, the ball's height and the force contribute a third each.
    The first sample of each phase and the last one of the trace are also kept.
    """
    if len(trace.time) <= limit:
        return trace

    path = np.zeros(len(trace.time))
    for values in (trace.time, trace.ball[:, 2], trace.electrostatic):
        length = np.cumsum(np.abs(np.diff(values, prepend=values[0])))
        path += length / max(length[-1], np.finfo(float).tiny)

    cell = np.floor(path / path[-1] * (limit - 1))
    enters_cell = np.diff(cell, prepend=-1) > 0
    enters_phase = np.diff(trace.phase, prepend=-1) != 0
    is_kept = enters_cell | enters_phase
    is_kept[-1] = True

    samples = {}
    for name, value in trace._asdict().items():
        if isinstance(value, np.ndarray):
            samples[name] = value[is_kept]
    return trace._replace(**samples)


def trace_trial(
    trial: Trial,
    protocol: Protocol,
    voltage: float | None,
    gap: float,
    timestep: float | None = None,
) -> Trace:
    """Return the trace of a trial, from the approach to a ball that rests again.

    Args:
        trial: the ball.
        protocol: what the tool does.
        voltage: at which it lifts [V]; None: the highest rung is tried, and the ball is released
            only if that lifts it.
        gap: to the plate at which the ball is released [m].
        timestep: instead of that of the model [s].
    """
    if voltage is None:
        voltage = protocol.highest_rung * protocol.step_voltage
    bench = MujocoBench([trial], protocol.start_gap, threads=1, timestep=timestep, is_recorded=True)
    touch(bench, protocol)
    watch = rung(bench, protocol, voltage)
    if is_lifted(protocol, watch)[0]:
        hang(bench, protocol, gap)
        release(bench, protocol, np.array([True]), gap, to_the_end=True)
    return trace_of(bench)


def trace_attempt(tried: Tried, gripper: StaticGripper) -> tuple[Trace, bool]:
    """Trace an attempt that a swarm made.

    Args:
        tried: the attempt.
        gripper: gap, tip and protocol of the swarm's attempts.

    Returns:
        The trace, whose phases are `PHASES`, and whether the attempt succeeded.
    """
    protocol = protocol_of(gripper)
    gap = gripper.release_gap
    trial = Trial(
        radius=tried.radius,
        work_tool_object=tried.work_tool_object,
        work_object_substrate=tried.work_object_substrate,
        relative_humidity=10.0,  # at which the works are, since its factor is 1
        probe_radius=radius_of(tip_of(gripper)),
        misalignment=tried.misalignment,
        tip=gripper.tip,
    )
    bench = MujocoBench(
        [trial],
        protocol.start_gap,
        threads=1,
        timestep=TIMESTEP,
        is_recorded=True,
        hanging=None if tried.is_lift else gap,
    )
    if tried.is_lift:
        touch(bench, protocol)
        watch = rung(bench, protocol, tried.voltage)
        succeeded = hangs(watch.gap_tool, watch.gap_plate, protocol)
    else:
        outcome = release(bench, protocol, np.array([True]), gap, ramp_to(tried.voltage))
        succeeded = outcome.landed

    trace = trace_of(bench)
    index_in_phases = np.array([PHASES.index(name) for name in trace.phases])
    trace = trace._replace(phase=index_in_phases[trace.phase], phases=PHASES)
    return trace, bool(succeeded[0])


def trace_of(bench: MujocoBench) -> Trace:
    """Return the trace of all physics steps of a recorded bench.

    Each sample is a state, with the forces that act from it on.
    """
    recorded = bench.recorded or []
    model = bench.model
    where = layout(model)
    before = np.concatenate([part.states[:-1] for part in recorded])
    after = np.concatenate([part.states[1:] for part in recorded])
    names = [name for part in recorded for name in part.phases]
    phases = tuple(dict.fromkeys(names))

    qpos = _part(model, before, "QPOS")
    control = _part(model, after, "CTRL")
    ball = qpos[:, where.ball : where.ball + 7]
    aside = qpos[:, where.aside]
    tip = qpos[:, where.slide] + where.tip_height

    def result(instance: str, field: str) -> Float[np.ndarray, "T"]:
        return _result(model, after, instance, field)

    loss_at_probe = _impact_loss(model, before, after, "adhesion_probe")
    loss_at_plate = _impact_loss(model, before, after, "adhesion_plate")
    contacts, drive = _forces(model, before, control)
    gravity = -model.opt.gravity[2]
    weight = gravity * model.body("ball").mass[0]
    probe_weight = gravity * model.body("probe").mass[0]
    return Trace(
        time=_part(model, before, "TIME")[:, 0] * MS,
        phase=np.array([phases.index(name) for name in names]),
        phases=phases,
        voltage=control[:, where.voltage],
        probe=np.stack([aside, np.zeros_like(tip), tip], axis=1) * UM,
        ball=ball[:, :3] * UM,
        ball_quaternion=ball[:, 3:],
        gap_tool=result("electrostatic", "probe_gap") * UM,
        gap_plate=result("electrostatic", "plate_gap") * UM,
        adhesion_tool=result("adhesion_probe", "force") * NN,
        adhesion_plate=result("adhesion_plate", "force") * NN,
        electrostatic=result("electrostatic", "force") * NN,
        contact_tool=contacts[:, 0] * NN,
        contact_plate=contacts[:, 1] * NN,
        on_plate_potential=result("electrostatic", "potential") < 0.5,
        ball_voltage=result("electrostatic", "ball_voltage"),
        broken=result("electrostatic", "broken") > 0.5,
        drive=drive[:, where.tip] * NN,
        impact_loss=(loss_at_probe + loss_at_plate) * NN * UM,
        radius=float(model.geom("ball").size[0]) * UM,
        probe_radius=float(model.geom("probe").size[0]) * UM,
        weight=float(weight) * NN,
        probe_weight=float(probe_weight) * NN,
    )


def _result(
    model: mujoco.MjModel,
    states: States,
    instance: str,
    field: str,
) -> Float[np.ndarray, "T"]:
    """Return a number of a plugin instance in each state."""
    index = plugin.state_index(model, instance, field)
    return _part(model, states, "PLUGIN")[:, index]


def _impact_loss(
    model: mujoco.MjModel,
    before: States,
    after: States,
    instance: str,
) -> Float[np.ndarray, "T"]:
    """Return the energy that a rebound costs in each step, m v^2 (1 - e^2) / 2 [fJ]."""
    was_apart = _result(model, before, instance, "before") > 0
    touches = _result(model, after, instance, "gap") <= 0
    rebounds = _result(model, after, instance, "rebound") > 0
    speed = _result(model, after, instance, "impact_speed")
    impulse = _result(model, after, instance, "impulse")
    mass = model.body("ball").mass[0]
    # With the impulse m (1 + e) v.
    energy = impulse * (speed - impulse / mass / 2)
    return np.where(was_apart & touches & rebounds, energy, 0.0)


def _part(model: mujoco.MjModel, states: States, name: str) -> Float[np.ndarray, "T k"]:
    """Return the columns of states that hold one of the parts of `mjtState`."""
    bit = int(getattr(mujoco.mjtState, f"mjSTATE_{name}"))
    first = mujoco.mj_stateSize(model, STATE & (bit - 1))
    return states[:, first : first + mujoco.mj_stateSize(model, bit)]


def _forces(
    model: mujoco.MjModel, states: States, control: Float[np.ndarray, "T nu"]
) -> tuple[Float[np.ndarray, "T 2"], Float[np.ndarray, "T nu"]]:
    """Return the normal forces of the ball's contacts and the forces of the actuators [nN].

    Contacts are those with tool and plate.
    """
    data = mujoco.MjData(model)
    plate = model.geom("plate").id
    force = np.zeros(6)
    contact_forces = np.zeros((len(states), 2))
    actuator_forces = np.zeros_like(control)
    for k, state in enumerate(states):
        mujoco.mj_setState(model, data, state, STATE)
        data.ctrl[:] = control[k]
        mujoco.mj_forward(model, data)
        for i, geoms in enumerate(data.contact.geom):
            mujoco.mj_contactForce(model, data, i, force)
            contact_forces[k, int(plate in geoms)] += max(0.0, force[0])
        actuator_forces[k] = data.actuator_force
    return contact_forces, actuator_forces
