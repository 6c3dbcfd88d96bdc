"""What it costs that messages take time: hop counts on and off (Fig. 15) where robots stop to emit and disturb each
other, at several baud rates."""

from dataclasses import replace
from pathlib import Path

from iswarm_mj.experiments.analysis.findings import PREDICTED, Claim, Finding, Rows, in_words, rule_of, verdict_of
from iswarm_mj.experiments.analysis.measures import TIME, finished, quartiles, select, values
from iswarm_mj.experiments.analysis.plots import Quantity, draw_bars
from iswarm_mj.experiments.analysis.statistics import compare
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.experiments.studies import hop_count
from iswarm_mj.simulation.initial import robots_for

REPEATS = 12
BAUD_RATES = (0.0, 30000.0, 2000.0, 1000.0)
"""Rates of the LEDs [bit/s], 0 where messages take no time.

Kilobots, robots of 33 mm, send at 8 MHz / 269 = 29.7 kbit/s (kilolib, message_send.S). The paper tells no rate of its
robots. With the default 8 slots, 427 bit/s leave no time to walk; between these limits, the others are choices.
"""

_SLOWER = "Messages at {} bit/s slow a swarm with hop counts down"


def entries(plan: Plan) -> list[Entry]:
    """Runs with and without hop counts at all baud rates."""
    n_robots = robots_for(plan.config.arena, plan.genome.density_of_robots)
    repeats, steps = (3, 300) if plan.quick else (REPEATS, TIME_LIMIT)
    listed = []
    for rate in BAUD_RATES:
        config = replace(plan.config, optics=replace(plan.config.optics, baud_rate=rate))
        for use_hop_count in (True, False):
            genome = replace(plan.genome, use_hop_count=use_hop_count)
            for repeat in range(repeats):
                seed = run_seed(plan.seed, int(rate), int(use_hop_count), repeat)
                labels = {"baud_rate": rate, "use_hop_count": use_hop_count, "repeat": repeat}
                listed.append(Entry(labels, Job(config, genome, n_robots, seed, steps, plan.goal)))
    return listed


def findings(rows: Rows) -> list[Finding]:
    """Whether messages that take time slow the cleaning, and the statements of Fig. 15 at each rate."""
    found = [_slower(rows, rate) for rate in BAUD_RATES[1:]]
    for rate in BAUD_RATES[1:]:
        for finding in hop_count.findings(select(rows, baud_rate=rate)):
            claim = f"{finding.claim}, where messages are sent at {rate:g} bit/s"
            found.append(finding._replace(claim=claim, source="not in the paper", paper="not studied"))
    return found


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw the measures of Fig. 15 by baud rate, with and without hop counts."""
    labels = {
        (rate, flag): f"{f'{rate:g} bit/s' if rate else 'no time'}\n{'with' if flag else 'without'}"
        for rate in BAUD_RATES
        for flag in (True, False)
    }
    setting = Quantity("messages, hop counts", lambda row: (row["baud_rate"], row["use_hop_count"]))
    return [draw_bars(rows, setting, labels, out / "message_time")]


def _slower(rows: Rows, rate: float) -> Finding:
    """Whether swarms with hop counts take longer than where messages take no time."""
    claim = Claim(_SLOWER.format(f"{rate:g}"), "not in the paper", "not studied", PREDICTED)
    groups = [select(rows, baud_rate=of, use_hop_count=True) for of in (rate, 0.0)]
    here, instant = (values(group, TIME) for group in groups)
    if not len(here) or not len(instant):
        return claim.not_run()
    counts = [f"{finished(group)} of {len(group)}" for group in groups]
    ours = (
        f"median {quartiles(here, TIME.unit)}, {quartiles(instant, TIME.unit)} where messages take no time; "
        f"{counts[0]} and {counts[1]} runs reached {rows[0]['goal']} balls"
    )
    comparison = compare(here, instant)
    result = f"{in_words(comparison, TIME.unit)}; {rule_of(is_larger=True)}"
    return claim.found(ours, result, verdict_of(comparison, is_larger=True))


EXPERIMENT = Experiment(
    name="message-time",
    title="hop counts on and off where messages take time, 4 baud rates, 12 runs each",
    source="section 4.1, Fig. 15",
    entries=entries,
    findings=findings,
    draw=draw,
)
