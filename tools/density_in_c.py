"""The sparser swarms of Fig. 17 by MuJoCo in C: `python tools/density_in_c.py`, a few minutes on two cores.

What they come to is compared with what the planar engine gives for the same swarms, on the page of the comparison. The
denser ones, whose robots press upon each other, would take hours.
"""

from dataclasses import replace
from pathlib import Path

from iswarm_mj.experiments.report.results import collect
from iswarm_mj.experiments.report.statements import topics_of, write_findings
from iswarm_mj.experiments.runner.experiment import Entry, Plan, run_experiment
from iswarm_mj.experiments.studies.density import EXPERIMENT

LARGEST = 0.2
OUT = Path("runs/density-in-c")
KEPT = Path("results-mujoco/density")


def sparse(plan: Plan) -> list[Entry]:
    """Runs of the densities up to `LARGEST`."""
    return [entry for entry in EXPERIMENT.entries(plan) if entry.labels["density"] <= LARGEST]


if __name__ == "__main__":
    run_experiment(replace(EXPERIMENT, entries=sparse), Plan(), OUT)
    KEPT.mkdir(parents=True, exist_ok=True)
    (KEPT / EXPERIMENT.table).write_bytes((OUT / EXPERIMENT.table).read_bytes())
    write_findings(topics_of(collect([KEPT.parent])))
