"""Traces of trials, sample by sample, from the states that a bench recorded; also of attempts that a swarm made."""

from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.model import STATE, layout
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import hang, release, rung, touch
from iswarm_mj.gripper.bench.script import hangs, is_lifted
from iswarm_mj.gripper.bench.swarm_trials import PROTOCOL, TIMESTEP, ramp_to
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.handling import Tried
from iswarm_mj.gripper.units import MS, NN, UM

States = Float[np.ndarray, "T n"]

PHASES = ("approach", "contact", "voltage", "retract", "lift", "off", "ramp", "flight", "rest")
"""Of lifts, then of releases, in their order."""


class Trace(NamedTuple):
    """T samples of one trial, at increasing times. SI units throughout; z up, the plate's surface at z = 0."""

    time: Float[np.ndarray, "T"]
    """Since the trial began [s]."""
    phase: Int[np.ndarray, "T"]
    """Indices into `phases`."""
    phases: tuple[str, ...]
    """Names of the phases: approach, ramp, ..."""
    voltage: Float[np.ndarray, "T"]
    """Of the probe against the plate [V]."""
    probe: Float[np.ndarray, "T 3"]
    """Centre of the tip's face [m]."""
    ball: Float[np.ndarray, "T 3"]
    """Centre of the ball [m]."""
    ball_quaternion: Float[np.ndarray, "T 4"]
    """Orientation of the ball, w first."""
    gap_tool: Float[np.ndarray, "T"]
    """Between probe and ball, negative where they are pressed together [m]."""
    gap_plate: Float[np.ndarray, "T"]
    """Between ball and plate, negative where they are pressed together [m]."""
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
    """Whether the ball has the plate's potential; otherwise it has the probe's."""
    ball_voltage: Float[np.ndarray, "T"]
    """Of the ball against the plate [V]."""
    broken: Bool[np.ndarray, "T"]
    """Whether the oxide of the tool's contact is broken down."""
    drive: Float[np.ndarray, "T"]
    """Force of the drive on the tool, upwards [N]."""
    impact_loss: Float[np.ndarray, "T"]
    """Energy lost in an impact from which the ball rebounds [J]; 0 where there is none."""
    radius: float
    """Of the ball [m]."""
    probe_radius: float
    """[m]"""
    weight: float
    """Of the ball [N]."""
    probe_weight: float
    """Of the probe and what carries it [N]."""


def thinned(trace: Trace, limit: int) -> Trace:
    """Return a trace of about `limit` samples at most, dense where the ball moves or the electrostatic force changes.

    Samples are kept at even distances along a path to which time, the ball's height and the force contribute a third
    each, and so are the first sample of each phase and the last one of the trace.
    """
    if len(trace.time) <= limit:
        return trace
    path = np.zeros(len(trace.time))
    for values in (trace.time, trace.ball[:, 2], trace.electrostatic):
        length = np.cumsum(np.abs(np.diff(values, prepend=values[0])))
        path += length / max(length[-1], np.finfo(float).tiny)
    cell = np.floor(path / path[-1] * (limit - 1))
    is_new = (np.diff(cell, prepend=-1) > 0) | (np.diff(trace.phase, prepend=-1) != 0)
    is_new[-1] = True
    arrays = {name: value[is_new] for name, value in trace._asdict().items() if isinstance(value, np.ndarray)}
    return trace._replace(**arrays)


def trace_trial(
    trial: Trial, protocol: Protocol, voltage: float | None, gap: float, timestep: float | None = None
) -> Trace:
    """Return the trace of a trial, from the approach to a ball that rests again.

    Args:
        trial: the ball.
        protocol: what the tool does.
        voltage: at which it lifts [V]; None: the highest rung is tried, and the ball is released only if that lifts it.
        gap: to the plate at which the ball is released [m].
        timestep: instead of that of the model [s].
    """
    bench = MujocoBench([trial], protocol.start_gap, 1, timestep=timestep, is_recorded=True)
    highest = protocol.highest_rung * protocol.step_voltage
    touch(bench, protocol)
    watch = rung(bench, protocol, highest if voltage is None else voltage)
    if is_lifted(protocol, watch)[0]:
        hang(bench, protocol, gap)
        release(bench, protocol, np.array([True]), gap, to_the_end=True)
    return trace_of(bench)


def trace_attempt(tried: Tried, gap: float) -> tuple[Trace, bool]:
    """Trace of an attempt, whose phases are `PHASES`, and whether it succeeded; releases are at a gap [m]."""
    works = tried.work_tool_object, tried.work_object_substrate
    trial = Trial(tried.radius, *works, 10.0, misalignment=tried.misalignment)  # whose factor of humidity is 1
    bench = MujocoBench(
        [trial], PROTOCOL.start_gap, 1, TIMESTEP, is_recorded=True, hanging=None if tried.is_lift else gap
    )
    if tried.is_lift:
        touch(bench, PROTOCOL)
        watch = rung(bench, PROTOCOL, tried.voltage)
        succeeded = hangs(watch.gap_tool, watch.gap_plate, PROTOCOL)
    else:
        succeeded = release(bench, PROTOCOL, np.array([True]), gap, ramp_to(tried.voltage)).landed
    trace = trace_of(bench)
    places = np.array([PHASES.index(name) for name in trace.phases])
    return trace._replace(phase=places[trace.phase], phases=PHASES), bool(succeeded[0])


def trace_of(bench: MujocoBench) -> Trace:
    """Trace of all physics steps of a recorded bench: each sample is a state, with the forces that act from it on."""
    recorded, model, where = bench.recorded or [], bench.model, layout(bench.model)
    before, after = (np.concatenate([part.states[cut] for part in recorded]) for cut in (np.s_[:-1], np.s_[1:]))
    names = [name for part in recorded for name in part.phases]
    phases = tuple(dict.fromkeys(names))
    qpos, control = _part(model, before, "QPOS"), _part(model, after, "CTRL")
    ball, aside = qpos[:, where.ball : where.ball + 7], qpos[:, where.aside]
    tip = qpos[:, where.slide] + where.tip_height

    def result(instance: str, field: str, states: States = after) -> Float[np.ndarray, "T"]:
        return _part(model, states, "PLUGIN")[:, plugin.state_index(model, instance, field)]

    def lost(instance: str) -> Float[np.ndarray, "T"]:
        """Energy that a rebound costs in each step [fJ], m v^2 (1 - e^2) / 2."""
        begins = (result(instance, "before", before) > 0) & (result(instance, "gap") <= 0)
        impulse, mass = result(instance, "impulse"), model.body("ball").mass[0]
        energy = impulse * (result(instance, "impact_speed") - impulse / mass / 2)
        return np.where(begins & (result(instance, "rebound") > 0), energy, 0.0)

    contacts, drive = _forces(model, before, control)
    weight, probe_weight = (-model.opt.gravity[2] * model.body(name).mass[0] for name in ("ball", "probe"))
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
        impact_loss=(lost("adhesion_probe") + lost("adhesion_plate")) * NN * UM,
        radius=float(model.geom("ball").size[0]) * UM,
        probe_radius=float(model.geom("probe").size[0]) * UM,
        weight=float(weight) * NN,
        probe_weight=float(probe_weight) * NN,
    )


def _part(model: mujoco.MjModel, states: States, name: str) -> Float[np.ndarray, "T k"]:
    """Columns of states that hold one of the parts of `mjtState`."""
    bit = int(getattr(mujoco.mjtState, f"mjSTATE_{name}"))
    first = mujoco.mj_stateSize(model, STATE & (bit - 1))
    return states[:, first : first + mujoco.mj_stateSize(model, bit)]


def _forces(
    model: mujoco.MjModel, states: States, control: Float[np.ndarray, "T nu"]
) -> tuple[Float[np.ndarray, "T 2"], Float[np.ndarray, "T nu"]]:
    """Normal forces of the ball's contacts with tool and plate, and forces of the actuators, in each state [nN]."""
    data, plate, force = mujoco.MjData(model), model.geom("plate").id, np.zeros(6)
    contacts, drives = np.zeros((len(states), 2)), np.zeros_like(control)
    for state, now, contact, drive in zip(states, control, contacts, drives, strict=True):
        mujoco.mj_setState(model, data, state, STATE)
        data.ctrl[:] = now
        mujoco.mj_forward(model, data)
        for i, geoms in enumerate(data.contact.geom):
            mujoco.mj_contactForce(model, data, i, force)
            contact[int(plate in geoms)] += max(0.0, force[0])
        drive[:] = data.actuator_force
    return contacts, drives
