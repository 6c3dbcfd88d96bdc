"""The main job in MJX: a batch of cleaning runs with its files, its progress and its summary."""

import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from iswarm_mj import results
from iswarm_mj.batched import BatchRun
from iswarm_mj.batched_views import start_view, views
from iswarm_mj.cleaning import Recorder, summary
from iswarm_mj.config import SwarmConfig
from iswarm_mj.files import prepare
from iswarm_mj.metrics import Measures
from iswarm_mj.rollout import RunSettings
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.timing import Stopwatch


@dataclass
class Told:
    """A batched run as `results` and `Recorder` know runs."""

    batch: BatchRun
    genome: Genome
    settings: RunSettings
    watch: Stopwatch = field(default_factory=Stopwatch)

    @property
    def config(self) -> SwarmConfig:
        """Configuration that all worlds share."""
        return self.batch.config

    @property
    def step(self) -> int:
        """Control steps taken."""
        return self.batch.last_step

    def measures(self, world: int) -> Measures:
        """Measures of a world so far."""
        return self.batch.measures(world)


def clean(batch: BatchRun, genome: Genome, settings: RunSettings, out: Path) -> dict[str, Any]:
    """Run a batch, write its results into `out`, print a summary; return the content of result.json.

    Args:
        batch: at its start.
        genome: of all worlds.
        settings: as a run on a CPU has them.
        out: result.json and the first recorded world go here, each further one into world-N.

    Raises:
        UserError: `out` cannot be written to.
        SimulationFault: the run had to stop; what was recorded so far is in `out`.
    """
    started = time.perf_counter()
    told = Told(batch, genome, settings)
    recorded = batch.settings.record_worlds
    places = [out if k == 0 else out / f"world-{world}" for k, world in enumerate(recorded)] or [out]
    for place in places:
        prepare(place)
    with ExitStack() as stack:
        recorders = []
        if recorded:
            start = start_view(batch)
            recorders = [stack.enter_context(Recorder(told, place, start, k)) for k, place in enumerate(places)]
        for place in places:
            results.clear(place, bool(recorded))
        _advance(told, recorders)
    content = results.result(told, "mjx", time.perf_counter() - started)
    content |= {"impl": batch.settings.impl, "devices": f"{batch.mesh.size} x {batch.mesh.devices.flat[0].device_kind}"}
    results.write_result(out, content)
    print(summary(content, out))
    return content


def _advance(told: Told, recorders: list[Recorder]) -> None:
    """Take all chunks, with a progress bar on a terminal."""
    batch = told.batch
    goal = (batch.settings.stop_at or batch.config.arena.n_dust) * len(batch.worlds)
    with tqdm(total=batch.settings.steps, unit="step", disable=not sys.stderr.isatty()) as bar:
        bar.set_postfix_str("compiling", refresh=True)
        while not batch.is_over:
            first = batch.step
            with told.watch("advance"):
                chunk = batch.advance()
            for view in views(batch, first, chunk) if chunk is not None else ():
                for recorder in recorders:
                    recorder.add(view)
            bar.update(batch.step - first)
            bar.set_postfix_str(f"delivered {int(batch.delivered().sum())} of {goal}", refresh=False)
