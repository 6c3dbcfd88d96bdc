"""From chunks of a batched run to the views that recorders take."""

from collections.abc import Iterator

import jax
import numpy as np

from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.optics import N_SIDES
from iswarm_mj.simulation import step as swarm
from iswarm_mj.simulation.run_mjx import BatchRun
from iswarm_mj.simulation.run_mujoco import StepView
from iswarm_mj.simulation.step_mjx import StepRecord


def start_view(run: BatchRun) -> StepView:
    """View of the start of the recorded worlds; only before the first chunk."""
    recorded = np.array(run.settings.record_worlds, int)
    state = jax.tree.map(lambda a: np.asarray(a)[recorded], run.swarm_state())
    poses = np.stack([run.starts[w].poses for w in recorded])
    shape = (*poses.shape[:2], N_SIDES)
    nobody = Links(np.zeros(shape, np.int32), np.zeros(shape, bool), np.zeros(shape, np.int32), *[np.zeros(shape)] * 2)
    zero = np.zeros(len(recorded))
    return StepView(
        0, poses, state, nobody, np.zeros(poses.shape[:2], bool), _balls(run, state, poses), zero.astype(int), zero
    )


def views(run: BatchRun, first: int, chunk: StepRecord) -> Iterator[StepView]:
    """Views of the steps of a chunk, as far as the run went; its worlds are the recorded ones.

    Args:
        run: after the chunk.
        first: steps taken before the chunk.
        chunk: what `BatchRun.advance` returned, with axes steps and recorded worlds.
    """
    for k in range(min(len(chunk.speed), run.last_step - first)):
        step: StepRecord = jax.tree.map(lambda a, k=k: a[k], chunk)
        balls = _balls(run, step.swarm, step.poses)
        yield StepView(
            first + k + 1, step.poses, step.swarm, step.links, step.has_priority, balls, step.collisions, step.speed
        )


def _balls(run: BatchRun, state: swarm.SwarmState, poses: np.ndarray) -> np.ndarray:
    return swarm.ball_centres(state, poses.astype(float), np.array(run.arena.probe), run.arena.tip_height)
