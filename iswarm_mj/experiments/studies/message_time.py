"""What it costs that messages take time: hop counts on and off (Fig. 15) where robots stop to emit and disturb each
other, at several baud rates."""

from dataclasses import replace
from pathlib import Path

from iswarm_mj.experiments.analysis.findings import (
    NOT_IN_PAPER,
    PREDICTED,
    Claim,
    Finding,
    Rows,
    in_words,
    number,
    rule_of,
    verdict_of,
)
from iswarm_mj.experiments.analysis.measures import TIME, finished, quartiles, select, values
from iswarm_mj.experiments.analysis.plots import Quantity, draw_bars
from iswarm_mj.experiments.analysis.statistics import compare, holm
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.experiments.runner.variation import Values, varied
from iswarm_mj.experiments.studies import hop_count
from iswarm_mj.tasks.layout import robots_for

REPEATS = 12
SETTINGS: dict[str, Values] = {
    "no time": {"optics.baud_rate": 0.0},
    "30000 bit/s": {"optics.baud_rate": 30000.0},
    "2000 bit/s": {"optics.baud_rate": 2000.0},
    "1000 bit/s": {"optics.baud_rate": 1000.0},
    "30000 bit/s, all photodiodes on": {"optics.baud_rate": 30000.0, "optics.photodiodes_while_emitting": "all"},
}
"""Light of each setting.

The paper tells no rate of its robots. Kilobots, robots of 33 mm, send at 8 MHz / 269 = 29.7 kbit/s (kilolib,
message_send.S). With the default 8 slots, 427 bit/s leave no time to walk; the rates between are choices.
"""
INSTANT, *TIMED = SETTINGS


def entries(plan: Plan) -> list[Entry]:
    """Runs with and without hop counts in all settings."""
    n_robots = robots_for(plan.config.arena, plan.genome.density_of_robots)
    repeats, steps = (3, 300) if plan.quick else (REPEATS, TIME_LIMIT)
    listed = []
    for name, own in SETTINGS.items():
        config = varied(plan.config, own)
        number = int(own["optics.baud_rate"]) + (len(own) - 1)
        for use_hop_count in (True, False):
            genome = replace(plan.genome, use_hop_count=use_hop_count)
            for repeat in range(repeats):
                seed = run_seed(plan.seed, number, int(use_hop_count), repeat)
                labels = {"setting": name, "use_hop_count": use_hop_count, "repeat": repeat}
                listed.append(Entry(labels, Job(config, genome, n_robots, seed, steps, plan.goal)))
    return listed


def findings(rows: Rows) -> list[Finding]:
    """Whether messages that take time slow the cleaning, and the statements of Fig. 15 in each setting."""
    found = _slower(rows)
    for name in TIMED:
        for finding in hop_count.findings(select(rows, setting=name)):
            claim = f"{finding.claim}, with messages at {name}"
            found.append(finding._replace(claim=claim, source=NOT_IN_PAPER, paper="not studied"))
    return found


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw the measures of Fig. 15 by setting, with and without hop counts."""
    labels = {
        (name, flag): name.replace(" bit", "\nbit").replace(", all photodiodes", "\nall")
        + ("\nwith" if flag else "\nwithout")
        for name in SETTINGS
        for flag in (True, False)
    }
    setting = Quantity("messages, hop counts", lambda row: (row["setting"], row["use_hop_count"]))
    return [draw_bars(rows, setting, labels, out / "message_time")]


def _slower(rows: Rows) -> list[Finding]:
    """Whether swarms with hop counts take longer in each setting than where messages take no time."""
    groups = {name: select(rows, setting=name, use_hop_count=True) for name in SETTINGS}
    times = {name: values(group, TIME) for name, group in groups.items()}
    instant = times[INSTANT]
    tested = {name: compare(times[name], instant) for name in TIMED if len(times[name]) and len(instant)}
    adjusted = dict(zip(tested, holm([comparison.p for comparison in tested.values()]), strict=True))
    found = []
    for name in TIMED:
        text = f"Messages at {name} slow a swarm with hop counts down"
        claim = Claim(text, NOT_IN_PAPER, "not studied", PREDICTED)
        if name not in tested:
            found.append(claim.not_run())
            continue
        counts = [f"{finished(groups[of])} of {len(groups[of])}" for of in (name, INSTANT)]
        ours = (
            f"median {quartiles(times[name], TIME.unit)}, {quartiles(instant, TIME.unit)} where messages take no time; "
            f"{counts[0]} and {counts[1]} runs reached {rows[0]['goal']} balls"
        )
        corrected = f"p = {number(adjusted[name], 2)} by Holm for {len(tested)} tests"
        result = f"{in_words(tested[name], TIME.unit)}; {corrected}; {rule_of(is_larger=True)}"
        found.append(claim.found(ours, result, verdict_of(tested[name], is_larger=True)))
    return found


EXPERIMENT = Experiment(
    name="message-time",
    title="hop counts on and off where messages take time, at three baud rates, 12 runs each",
    source="section 4.1, Fig. 15",
    entries=entries,
    findings=findings,
    draw=draw,
)
