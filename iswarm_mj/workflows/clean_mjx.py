"""The main job in MJX: a batch of cleaning runs with its files, its progress and its summary."""

import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from iswarm_mj.config import SwarmConfig
from iswarm_mj.output import results
from iswarm_mj.simulation.distributed import ALONE, Hosts, numbered
from iswarm_mj.simulation.metrics import Measures
from iswarm_mj.simulation.run_mjx import BatchRun
from iswarm_mj.simulation.run_mujoco import RunSettings
from iswarm_mj.simulation.views_mjx import start_view, views
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.files import make_output_directory
from iswarm_mj.utils.profiling import Stopwatch
from iswarm_mj.workflows.clean import Recorder, summary


@dataclass
class Told:
    """A batched run as `results` and `Recorder` know runs; what it came to is known when `gather` is through."""

    batch: BatchRun
    genome: Genome
    settings: RunSettings
    watch: Stopwatch = field(default_factory=Stopwatch)
    step: int = 0
    """Control steps taken."""
    n_devices: int = 0
    """On all hosts."""
    found: dict[int, Measures] = field(default_factory=dict)
    """Measures of each world."""

    @property
    def config(self) -> SwarmConfig:
        """Configuration that all worlds share."""
        return self.batch.config

    def measures(self, world: int) -> Measures:
        """Measures of a world."""
        return self.found[world]

    def gather(self, hosts: Hosts) -> None:
        """Bring together what the worlds of all processes came to."""
        batch = self.batch
        own = [(world.index, batch.measures(place)) for place, world in enumerate(batch.worlds)]
        for step, n_devices, found in hosts.gathered("results", (batch.last_step, batch.mesh.size, own)):
            self.step = max(self.step, step)
            self.n_devices += n_devices
            self.found |= {world: Measures(*measures) for world, measures in found}


def clean(
    batch: BatchRun, genome: Genome, settings: RunSettings, out: Path, hosts: Hosts = ALONE
) -> dict[str, Any] | None:
    """Run a batch, write its results into `out`, print a summary; return the content of result.json.

    Of several processes the first writes and prints, and alone returns something.

    Args:
        batch: at its start; this process's share of the worlds.
        genome: of all worlds.
        settings: as a run on a CPU has them, of the worlds of all processes.
        out: result.json and the first recorded world go here, each further one into world-N.
        hosts: the processes that share the worlds.

    Raises:
        UserError: `out` cannot be written to.
        SimulationFault: the run had to stop; what was recorded so far is in `out`.
    """
    started = time.perf_counter()
    told = Told(batch, genome, settings)
    content = None
    if hosts.index > 0:
        _advance(told, [], hosts)
        told.gather(hosts)
    else:
        _record(told, out, hosts)
        told.gather(hosts)
        content = results.result(told, "mjx", time.perf_counter() - started)
        kind = batch.mesh.devices.flat[0].device_kind
        content |= {"impl": batch.settings.impl, "devices": f"{told.n_devices} x {kind}"}
        results.write_result(out, content)
    hosts.gathered("written", None)
    if content is not None:
        print(summary(content, out))
    return content


def _record(told: Told, out: Path, hosts: Hosts) -> None:
    """Take all chunks and write what is recorded."""
    batch = told.batch
    recorded = [batch.worlds[place].index for place in batch.settings.record_worlds]
    places = [out if k == 0 else out / f"world-{world}" for k, world in enumerate(recorded)] or [out]
    for place in places:
        make_output_directory(place)
    with ExitStack() as stack:
        recorders = []
        if recorded:
            start = start_view(batch)
            recorders = [stack.enter_context(Recorder(told, place, start, k)) for k, place in enumerate(places)]
        for place in places:
            results.clear(place, bool(recorded))
        _advance(told, recorders, hosts)


def _advance(told: Told, recorders: list[Recorder], hosts: Hosts) -> None:
    """Take all chunks, with a progress bar on a terminal."""
    batch = told.batch
    goal = (batch.settings.stop_at or batch.config.arena.n_dust) * len(batch.worlds)
    hidden = not sys.stderr.isatty() or hosts.index > 0
    with tqdm(total=batch.settings.steps, unit="step", disable=hidden) as bar:
        bar.set_postfix_str("compiling", refresh=True)
        while not batch.is_over:
            first = batch.step
            with told.watch("advance"), numbered([world.index for world in batch.worlds]):
                chunk = batch.advance()
            hosts.look()
            for view in views(batch, first, chunk) if chunk is not None else ():
                for recorder in recorders:
                    recorder.add(view)
            bar.update(batch.step - first)
            bar.set_postfix_str(f"delivered {int(batch.delivered().sum())} of {goal}", refresh=False)
        if hosts.count > 1:
            bar.set_postfix_str("the other processes may take longer", refresh=True)
