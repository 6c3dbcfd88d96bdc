"""Measure how deep robots overlap, after each physics step and with geometry of its own.

    python tools/research/measure_overlaps.py --engine planar --density 0.118
    python tools/research/measure_overlaps.py --engine mujoco --density 0.3 --steps 150
    python tools/research/measure_overlaps.py --engine planar --jam --seed 3
    python tools/research/measure_overlaps.py --engine warp --steps 30

It prints a row per seed: shares of robots that are deeper than 0.05, 0.1 and 0.2 mm in another one
or in a wall, over all physics steps, and the deepest overlap.

`warp` is the planar engine's implementation for GPUs, `mjx` is MJX's for JAX. Both take the physics
steps of runs whose light is that of `planar`. With --jam all robots turn and walk towards the
middle of the arena, and the processor time of a control step's motion is printed, too, for engines
on the host.

The steps are taken one by one, so that `planar` begins each without the impulses of the one before,
as it does in the first step of each phase. --accuracy is that of `planar` and `warp`.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from scipy.spatial import cKDTree

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.base import Motion, Phase, set_points
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.engine import MujocoEngine, add_partners
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.settings import REFINEMENT, EngineSettings, ModelSpec
from iswarm_mj.simulation.actuate import drive_phases
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.layout import place_robots, robots_for
from iswarm_mj.utils.units import mm_from_rd

DEPTHS = (0.05, 0.1, 0.2)
"""Depths of which the shares of robots that are deeper are printed [mm]."""
HALF_EDGE = 1.0
"""Half the edge of the paper's robot [mm]."""
CLASSES = {"planar": PlanarEngine, "mujoco": MujocoEngine}
"""Classes of engines on the host, by the names of their settings."""

Observe = Callable[[np.ndarray], None]
"""Function that takes the poses (N, 3) after a physics step [mm, rad]."""


class Overlaps:
    """Depths of robots in each other and in walls, collected after physics steps."""

    def __init__(self, half_extent: float):
        """Begin without steps.

        Args:
            half_extent: distance of the walls of a square arena from its centre [mm].
        """
        self._half_extent = half_extent
        self._n_deeper = np.zeros(len(DEPTHS))
        self._n_robots = 0
        self.deepest = 0.0
        """Deepest overlap [mm]."""

    def add(self, poses: np.ndarray) -> None:
        """Add the poses (N, 3) after a physics step."""
        depth = np.maximum(depths_in_robots(poses), self._depths_in_walls(poses))
        self._n_deeper += [(depth > limit).sum() for limit in DEPTHS]
        self._n_robots += len(poses)
        self.deepest = max(self.deepest, float(depth.max()))

    def _depths_in_walls(self, poses: np.ndarray) -> np.ndarray:
        """Return how far each robot (N,) reaches beyond the walls, 0 if it does not."""
        farthest = np.abs(corners_of(poses)).max(axis=(1, 2))
        return np.maximum(0.0, farthest - self._half_extent)

    @property
    def shares(self) -> np.ndarray:
        """Shares of robots that are deeper than `DEPTHS`."""
        return self._n_deeper / self._n_robots


def corners_of(poses: np.ndarray) -> np.ndarray:
    """Return the corners (N, 4, 2) of robots at poses (N, 3)."""
    cos = np.cos(poses[:, 2])
    sin = np.sin(poses[:, 2])
    ahead = HALF_EDGE * np.stack([cos, sin], axis=-1)[:, None]
    left = HALF_EDGE * np.stack([-sin, cos], axis=-1)[:, None]
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])[..., None]
    return poses[:, None, :2] + signs[:, 0] * ahead + signs[:, 1] * left


def depths_in_robots(poses: np.ndarray) -> np.ndarray:
    """Return the depth of each robot (N,) in the one that it overlaps most, 0 for none.

    It is the least overlap of the corners' projections on the normals of both robots' sides.
    """
    reach = 2 * np.sqrt(2) * HALF_EDGE
    pairs = cKDTree(poses[:, :2]).query_pairs(reach, output_type="ndarray")
    first, second = corners_of(poses)[pairs.T]
    depth_of_pair = np.full(len(pairs), np.inf)
    for robots in pairs.T:
        for turn in (0.0, np.pi / 2):
            angle = poses[robots, 2] + turn
            axis = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            along_first = np.einsum("pki,pi->pk", first, axis)
            along_second = np.einsum("pki,pi->pk", second, axis)
            overlap = np.minimum(
                along_first.max(axis=1) - along_second.min(axis=1),
                along_second.max(axis=1) - along_first.min(axis=1),
            )
            depth_of_pair = np.minimum(depth_of_pair, overlap)

    depths = np.zeros(len(poses))
    for robots in pairs.T:
        np.maximum.at(depths, robots, depth_of_pair)
    return depths


@contextmanager
def watched(engine_class: Any, observe: Observe, mover: Any = None) -> Iterator[None]:
    """Let engines of one world take their physics steps one by one, and look at each.

    Args:
        engine_class: class of engines on the host.
        observe: function that is shown the poses after each physics step.
        mover: engine that moves the bodies instead.
    """
    move_at_once = engine_class.move

    def move(engine: Any, bodies: Any, phases: Sequence[Phase], is_running: Any) -> Motion:
        touching_of_phases = []
        motion: Any = None
        for phase in phases:
            velocity = set_points(phase, bodies.poses, engine.poses(bodies).shape[1])
            step = phase._replace(n_substeps=1, velocity=lambda _, held=velocity: held)
            for _ in range(phase.n_substeps):
                motion = (
                    mover.move(bodies, step, is_running)
                    if mover
                    else move_at_once(engine, bodies, [step], is_running)
                )
                assert not motion.fault.any()
                bodies = motion.bodies
                observe(engine.poses(bodies)[0])
            touching_of_phases.append(motion.touching)
        return motion._replace(touching=all_partners(touching_of_phases))

    engine_class.move = move
    try:
        yield
    finally:
        engine_class.move = move_at_once


def all_partners(touching_of_phases: Sequence[np.ndarray]) -> np.ndarray:
    """Return the partners (1, K, N) of robots that touch at the end of any phase."""
    partners = np.array(touching_of_phases[0])
    for touching in touching_of_phases[1:]:
        rank, robot = np.nonzero(touching[0] > 0)
        add_partners(partners[0], robot, touching[0][rank, robot])
    return partners


class JaxMover:
    """Engine in programs of JAX that moves the bodies of the planar engine on the host."""

    def __init__(self, settings: EngineSettings, model: ModelSpec):
        """Make the engine for one world."""
        platform = jax.default_backend()
        self._engine = settings.compiled_engine(model, 1, platform)
        self._is_batch = self._engine.mapping(platform) == "batch"
        self._programs: dict[int, Any] = {}

    def move(self, bodies: Any, step: Phase, is_running: Any) -> Motion:
        """Take a physics step; see `Engine.move`."""
        velocity = step.velocity(bodies.poses)
        state = (bodies.poses, bodies.velocity, velocity)
        program = self._program(step.parts)
        outcome = program(*map(np.float32, state), bodies.is_present, is_running)
        poses, new_velocity, touching, fault, robot = map(np.array, outcome)
        moved = bodies._replace(poses=poses.astype(float), velocity=new_velocity.astype(float))
        return Motion(moved, touching, fault, robot)

    def _program(self, parts: int) -> Any:
        """Return the program of a physics step in parts, compiled once for each number."""
        engine = self._engine

        def take_step(poses: Any, velocity: Any, target: Any, is_present: Any, runs: Any) -> Any:
            bodies = engine.place(poses, is_present)._replace(velocity=velocity)
            phase = Phase(1, lambda _: target, parts=parts)
            moved, *rest = engine.move(bodies, [phase], runs)
            return moved.poses, moved.velocity, *rest

        if parts not in self._programs:
            function = take_step if self._is_batch else jax.vmap(take_step)
            self._programs[parts] = jax.jit(function)
        return self._programs[parts]


def run_swarm(arguments: argparse.Namespace, seed: int, observe: Observe) -> None:
    """Run a cleaning swarm."""
    config = SwarmConfig()
    settings, mover = engine_of(arguments, config)
    scenario = Scenario(
        config,
        strategy=PRESETS[arguments.strategy],
        robots=robots_for(config.arena, arguments.density),
        engine=settings,
        seed=seed,
        steps=arguments.steps,
    )
    run = Run(scenario, record_worlds=())
    with watched(CLASSES[settings.name], observe, mover):
        while not run.is_over:
            run.advance()
    run.raise_faults()


def run_jam(arguments: argparse.Namespace, seed: int, observe: Observe) -> float:
    """Let all robots walk to the middle; return the median time of the latter half's motions [s].

    The time is that of whole motions, which are taken again and not looked at. It is NaN for
    engines in programs of JAX, which do not take whole motions here.
    """
    config = SwarmConfig()
    n_robots = robots_for(config.arena, arguments.density)
    settings, mover = engine_of(arguments, config)
    engine: Any = settings.host_engine(ModelSpec(config, n_robots, n_robots))(1, 1)
    is_running = np.ones(1, bool)

    def jam() -> list[float]:
        start = place_robots(config.arena, n_robots, np.random.default_rng(seed))
        bodies = engine.place(start[None], np.ones((1, n_robots), bool))
        seconds = []
        for _ in range(arguments.steps):
            phases = drive_phases(config.drive, towards_middle(engine.poses(bodies)))
            begin = time.process_time()
            motion = engine.move(bodies, phases, is_running)
            seconds.append(time.process_time() - begin)
            assert not motion.fault.any()
            bodies = motion.bodies
        return seconds

    seconds = [np.nan] if mover else jam()
    with watched(CLASSES[settings.name], observe, mover):
        jam()
    return float(np.median(seconds[len(seconds) // 2 :]))


def towards_middle(poses: np.ndarray) -> Command:
    """Return commands that turn robots at poses (B, N, 3) towards the middle and walk there."""
    angle = np.arctan2(-poses[..., 1], -poses[..., 0]) - poses[..., 2]
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    turn = np.clip(wrapped, -np.pi / 2, np.pi / 2)
    return Command(turn, np.full(turn.shape, mm_from_rd(0.5)))


def engine_of(arguments: argparse.Namespace, config: SwarmConfig) -> tuple[EngineSettings, Any]:
    """Return the settings of the engine on the host, and the engine that moves its bodies.

    The latter is None for engines on the host, which move their own.
    """
    planar = PlanarSettings(threads=1, refinement=arguments.refinement, accuracy=arguments.accuracy)
    if arguments.engine == "mujoco":
        return MujocoSettings(threads=1, refinement=arguments.refinement), None
    if arguments.engine == "planar":
        return planar, None

    moving = {
        "warp": replace(planar, threads=0, impl="warp"),
        "mjx": MjxSettings(contact_capacity=4.0, refinement=arguments.refinement),
    }
    n_robots = robots_for(config.arena, arguments.density)
    model = ModelSpec(config, n_robots, n_robots)
    return planar, JaxMover(moving[arguments.engine], model)


def main() -> None:
    """Print a row per seed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--engine", choices=("planar", "mujoco", "warp", "mjx"), default="planar")
    parser.add_argument("--strategy", choices=("type1", "type2"), default="type1")
    parser.add_argument("--density", type=float, default=0.118)
    parser.add_argument("--jam", action="store_true")
    parser.add_argument("--seed", type=int, nargs="+", default=[0])
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--refinement", type=int, default=REFINEMENT)
    parser.add_argument("--accuracy", type=float, default=PlanarSettings().accuracy)
    arguments = parser.parse_args()

    half_extent = mm_from_rd(SwarmConfig().arena.size) / 2
    print("seed", *(f">{depth} mm [%]" for depth in DEPTHS), "deepest [mm]", sep="\t")
    for seed in arguments.seed:
        overlaps = Overlaps(half_extent)
        if arguments.jam:
            seconds = run_jam(arguments, seed, overlaps.add)
            print(f"motion of a jam: {1e3 * seconds:.2f} ms")
        else:
            run_swarm(arguments, seed, overlaps.add)
        shares = (f"{100 * share:.3f}" for share in overlaps.shares)
        print(seed, *shares, f"{overlaps.deepest:.3f}", sep="\t", flush=True)


if __name__ == "__main__":
    main()
