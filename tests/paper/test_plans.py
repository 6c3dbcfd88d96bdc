"""Which runs the experiments are made of."""

from dataclasses import replace
from pathlib import Path

import pytest

from iswarm_mj.config.swarm import DriveConfig, SwarmConfig
from iswarm_mj.paper.analysis.varied_values import refused_rates
from iswarm_mj.paper.studies.experiment import Plan
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.tables import read_table

PLAN = Plan()


def entries(name):
    return EXPERIMENTS[name].entries(PLAN)


def differing(config):
    """What differs from the default, by names of settings."""
    parts = {
        part: (vars(mine), vars(getattr(SwarmConfig(), part)))
        for part, mine in vars(config).items()
    }
    return {
        f"{part}.{k}": v
        for part, (mine, usual) in parts.items()
        for k, v in mine.items()
        if v != usual[k]
    }


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_runs_are_those_of_the_results(name):
    """Labels, seeds, sizes and limits of the published tables; those of a quick version are fewer
    and shorter."""
    rows, _ = read_table(
        Path(__file__).parents[2] / "results/default" / name / EXPERIMENTS[name].table
    )
    found, quick = entries(name), EXPERIMENTS[name].entries(replace(PLAN, quick=True))
    assert len(found) == len(rows) == len({entry.job for entry in found})
    for (labels, job), row in zip(found, rows, strict=True):
        facts = {"seed": job.seed, "n_robots": job.n_robots, "failed_fraction": job.failed_fraction}
        assert (
            row.items()
            >= {**labels, **facts, "max_steps": job.steps, "goal": job.stop_at or 72}.items()
        )
    assert sum(e.job.steps * e.job.n_robots for e in quick) < 0.3 * sum(
        e.job.steps * e.job.n_robots for e in found
    )


def test_hop_counts_differ_in_nothing_else():
    jobs = [entry.job for entry in entries("hop-count")]
    assert [job.genome.use_hop_count for job in jobs] == [True] * 12 + [False] * 12
    assert {replace(job.genome, use_hop_count=True) for job in jobs} == {PRESETS["type1"]}
    assert {job.seed for job in jobs}.isdisjoint(
        e.job.seed for e in EXPERIMENTS["hop-count"].entries(Plan(seed=1))
    )


def test_sensitivity_varies_one_value_at_a_time():
    for entry in entries("sensitivity"):
        choice, value = entry.labels["choice"], entry.labels["value"]
        found = {name: str(mine) for name, mine in differing(entry.job.config).items()}
        assert found == ({} if choice == "default" else {choice: value})


def test_messages_differ_in_their_time_and_hop_counts_alone():
    found = entries("message-time")
    assert len(found) == 5 * 2 * 12 == len({entry.job.seed for entry in found})
    for job, setting, flag in (
        (e.job, e.labels["setting"], e.labels["use_hop_count"]) for e in found
    ):
        rate, own = setting.split()[0], differing(job.config)
        assert own.pop("optics.baud_rate", 0.0) == (0.0 if rate == "no" else float(rate))
        assert own == ({"optics.photodiodes_while_emitting": "all"} if "all" in setting else {})
        assert job.genome.use_hop_count == flag


def test_pairs_of_grasps_differ_in_what_decides_alone():
    found, pairs = entries("resolved-grasps"), {}
    assert len(found) == 2 * 3 * 3 * 2 * 24
    for entry in found:
        gripper = entry.job.config.gripper
        assert all(
            getattr(gripper, k) == entry.labels[k]
            for k in ("resolution", "grasp_voltage", "relative_humidity")
        )
        usual = replace(entry.job.config, gripper=replace(gripper, resolution="quasi-static"))
        pairs.setdefault(entry.job.seed, []).append(replace(entry.job, config=usual))
    assert all(len(both) == 2 and both[0] == both[1] for both in pairs.values())


def test_time_steps_are_those_that_the_drive_allows():
    found = entries("time-step")
    assert {e.labels["rate"] for e in found} == {10, 20, 50, 100} and len(found) == 2 * 4 * 24
    for entry in found:
        drive = entry.job.config.drive
        assert drive.turn_substeps + drive.walk_substeps == entry.labels["rate"]
        assert replace(drive, turn_substeps=4, walk_substeps=6) == DriveConfig()
    assert (
        refused_rates(DriveConfig()).keys() == {2, 5}
        and refused_rates(DriveConfig(step_length=0.08, max_turn=30)) == {}
    )
