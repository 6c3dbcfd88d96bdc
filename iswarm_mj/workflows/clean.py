"""The main job: a cleaning run with its files, its progress and its summary."""

import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import jax
from tqdm import tqdm

from iswarm_mj import __version__
from iswarm_mj.config import SwarmConfig
from iswarm_mj.output import results
from iswarm_mj.output.frames import FrameBuffer, scene_of
from iswarm_mj.output.trajectory import RECORDING, Frames, Scene
from iswarm_mj.simulation.run_mujoco import Run, RunSettings, StepView
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.files import make_output_directory
from iswarm_mj.utils.jax_setup import configure_jax
from iswarm_mj.utils.profiling import Stopwatch

BLOCK = 64
"""Frames that are written at a time."""


def clean(
    config: SwarmConfig, genome: Genome, settings: RunSettings, engine: str, out: Path, recorded: Sequence[int]
) -> dict[str, Any]:
    """Run the swarm, write its results into `out`, print a summary; return the content of result.json.

    Raises:
        UserError: `out` cannot be written to.
        SimulationFault: the run had to stop; what was recorded so far is in `out`.
    """
    places = [(out if k == 0 else out / f"world-{world}", world) for k, world in enumerate(recorded)]
    for place, _ in places or [(out, 0)]:
        make_output_directory(place)
    configure_jax()
    started = time.perf_counter()
    with jax.default_device(jax.devices("cpu")[0]):
        run = Run(config, genome, settings)
        with ExitStack() as stack:
            recorders = [stack.enter_context(Recorder(run, p, run.start_view(), w)) for p, w in places]
            for place, _ in places or [(out, 0)]:
                results.clear(place, bool(places))
            _advance(run, recorders)
    content = results.result(run, engine, time.perf_counter() - started)
    results.write_result(out, content)
    print(summary(content, out))
    return content


def _advance(run: Run, recorders: "list[Recorder]") -> None:
    """Take all steps, with a progress bar on a terminal."""
    settings = run.settings
    goal = (settings.stop_at or run.config.arena.n_dust) * settings.n_worlds
    with tqdm(total=settings.steps, unit="step", disable=not sys.stderr.isatty()) as bar:
        while not run.is_over:
            view = run.advance()
            for recorder in recorders:
                recorder.add(view)
            bar.update()
            if run.step % 10 == 0:
                delivered = sum(run.measures(w).delivered for w in range(settings.n_worlds))
                bar.set_postfix_str(f"delivered {delivered} of {goal}", refresh=False)


class Recorded(Protocol):
    """What a recorder knows of a run."""

    genome: Genome
    settings: RunSettings
    watch: Stopwatch

    @property
    def config(self) -> SwarmConfig:
        """The configuration."""
        ...


class Recorder:
    """Records one world of a run; what it has is written on leaving, whatever the reason."""

    def __init__(self, run: Recorded, out: Path, start: StepView, world: int = 0):
        """Begin with the start.

        Args:
            run: settings and stopwatch.
            out: directory for the files.
            start: view of the start.
            world: which of those in the views.
        """
        from iswarm_mj.output.rerun_swarm import Recording

        self._run, self._out = run, out
        self._scene: Scene = scene_of(run.config, run.arena.robot, start, world)
        self._buffer = FrameBuffer(world)
        self._blocks: list[Frames] = []
        settings = {"genome": asdict(run.genome), "run": asdict(run.settings), **asdict(run.config)}
        self._recording = Recording(out / RECORDING, self._scene, settings, _properties(run))
        self._buffer.add(start)

    def __enter__(self) -> "Recorder":
        """Return the recorder."""
        return self

    def __exit__(self, *reason: Any) -> None:
        """Write what is left."""
        with self._run.watch("record"):
            try:
                self._write()
            finally:
                self._recording.__exit__(*reason)
                results.write_trajectory(self._out, self._scene, Frames.concatenate(self._blocks))

    def add(self, view: StepView) -> None:
        """Take in a step; write a block when there are enough."""
        with self._run.watch("record"):
            self._buffer.add(view)
            if len(self._buffer) >= BLOCK:
                self._write()

    def _write(self) -> None:
        if len(self._buffer):
            self._blocks.append(self._buffer.take())
            self._recording.append(self._blocks[-1])


def _properties(run: Recorded) -> Mapping[str, Any]:
    """What identifies a run among recordings."""
    return {"version": __version__, "seed": run.settings.seed, "n_robots": run.settings.n_robots}


def summary(content: Mapping[str, Any], out: Path) -> str:
    """Readable summary of result.json."""

    def show(name: str) -> str:
        values = content[name] if isinstance(content[name], list) else [content[name]]
        return ", ".join("-" if v is None else f"{v:z.1f}" if isinstance(v, float) else str(v) for v in values)

    lines = [
        ("robots", f"{content['n_robots']} in {content['n_worlds']} world(s), seed {content['seed']}"),
        ("delivered", f"{show('delivered')} of {content['n_dust']} balls; picked up {show('picked')}"),
        (
            "finished at",
            f"step {show('finished_at')} (goal {content['stop_at']}; ran {content['steps']} steps)",
        ),
        ("carriage", f"{show('mean_carriage_steps')} steps on average"),
        ("collisions", show("collisions")),
        ("fitness", show("fitness")),
        (
            "time",
            f"{content['wall_s']:.1f} s, {1e3 * content['wall_s'] / content['steps']:.1f} ms per control step",
        ),
        ("results", str(out)),
    ]
    return "\n".join(f"{name:>12}  {text}" for name, text in lines)
