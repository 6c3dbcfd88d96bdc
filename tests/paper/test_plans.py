"""The runs of which experiments are made: those of the results, and how they differ."""

from dataclasses import replace
from pathlib import Path

import pytest

from iswarm_mj.config.swarm import DriveConfig, SwarmConfig
from iswarm_mj.paper.analysis.varied_values import refused_rates
from iswarm_mj.paper.studies.experiment import Plan
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.tables import read_table

RESULTS = Path(__file__).parents[2] / "results/default"
PLAN = Plan()


def entries_of(name):
    """Return the runs of an experiment with their labels."""
    return EXPERIMENTS[name].entries(PLAN)


def robot_steps(entries):
    """Return how many steps of a robot some runs have at most."""
    return sum(entry.job.steps * entry.job.n_robots for entry in entries)


def changed_settings(config):
    """Return the settings that differ from the default, by their names with their groups."""
    changed = {}
    for group, settings in vars(config).items():
        default = vars(getattr(SwarmConfig(), group))
        for name, value in vars(settings).items():
            if value != default[name]:
                changed[f"{group}.{name}"] = value
    return changed


TO_REPEAT = {
    "infer": "its table has the same swarms of Fig. 17, and no aperture of the photodiodes",
}
"""Reasons why the runs of published tables are others than today's, by experiment."""


def published(name):
    """Return the parameter of an experiment, which must differ from its table if it says so."""
    if name not in TO_REPEAT:
        return name
    return pytest.param(name, marks=pytest.mark.xfail(reason=TO_REPEAT[name], strict=True))


@pytest.mark.parametrize("name", [published(name) for name in EXPERIMENTS])
def test_runs_are_those_of_the_results(name):
    """They have the labels, seeds, sizes and limits of the published tables."""
    rows, _ = read_table(RESULTS / name / EXPERIMENTS[name].table)
    entries = entries_of(name)
    assert len(entries) == len(rows) == len({entry.job for entry in entries})
    for (labels, job), row in zip(entries, rows, strict=True):
        assert row.items() >= labels.items()
        assert row["seed"] == job.seed
        assert row["n_robots"] == job.n_robots
        assert row["failed_fraction"] == job.failed_fraction
        assert row["max_steps"] == job.steps
        assert row["goal"] == (job.stop_at or 72)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_a_quick_version_is_much_shorter(name):
    quick = EXPERIMENTS[name].entries(replace(PLAN, quick=True))
    assert robot_steps(quick) < 0.3 * robot_steps(entries_of(name))


def test_the_densities_are_those_of_fig_17():
    """Section 4.6.2: 120 to 960 robots, shares of all 2401 cells."""
    sizes = {entry.labels["density"]: entry.job.n_robots for entry in entries_of("density")}
    assert (sizes[0.05], sizes[0.4]) == (120, 960)
    assert sizes == {density: round(2401 * density) for density in sizes}

    of_infer = {}
    for labels, job in EXPERIMENTS["infer"].entries(replace(PLAN, quick=True)):
        if labels["study"] == "density":
            of_infer[labels["density"]] = job.n_robots
    assert of_infer == sizes


def test_hop_counts_differ_in_nothing_else():
    jobs = [entry.job for entry in entries_of("hop-count")]
    assert [job.genome.use_hop_count for job in jobs] == [True] * 12 + [False] * 12
    assert {replace(job.genome, use_hop_count=True) for job in jobs} == {PRESETS["type1"]}


def test_another_seed_gives_other_runs():
    seeds = {entry.job.seed for entry in entries_of("hop-count")}
    other_entries = EXPERIMENTS["hop-count"].entries(Plan(seed=1))
    assert seeds.isdisjoint(entry.job.seed for entry in other_entries)


def test_sensitivity_varies_one_value_at_a_time():
    for entry in entries_of("sensitivity"):
        choice = entry.labels["choice"]
        changed = {name: str(v) for name, v in changed_settings(entry.job.config).items()}
        assert changed == ({} if choice == "default" else {choice: entry.labels["value"]})


def test_messages_differ_in_their_time_and_hop_counts_alone():
    entries = entries_of("message-time")
    assert len(entries) == 5 * 2 * 12 == len({entry.job.seed for entry in entries})
    for entry in entries:
        setting = entry.labels["setting"]
        rate = setting.split()[0]
        changed = changed_settings(entry.job.config)
        assert changed.pop("optics.baud_rate", 0.0) == (0.0 if rate == "no" else float(rate))
        photodiodes = {"optics.photodiodes_while_emitting": "all"} if "all" in setting else {}
        assert changed == photodiodes
        assert entry.job.genome.use_hop_count == entry.labels["use_hop_count"]


def test_pairs_of_grasps_differ_only_in_how_they_are_decided():
    """Attempts are resolved or quasi-static."""
    entries = entries_of("resolved-grasps")
    assert len(entries) == 2 * 3 * 3 * 2 * 24
    quasi_static_jobs = {}
    for entry in entries:
        gripper = entry.job.config.gripper
        for name in ("resolution", "grasp_voltage", "relative_humidity"):
            assert getattr(gripper, name) == entry.labels[name]
        quasi_static = replace(gripper, resolution="quasi-static")
        job = replace(entry.job, config=replace(entry.job.config, gripper=quasi_static))
        quasi_static_jobs.setdefault(job.seed, []).append(job)
    for first, second in quasi_static_jobs.values():
        assert first == second


def test_time_steps_are_those_that_the_drive_allows():
    entries = entries_of("time-step")
    assert len(entries) == 2 * 4 * 24
    assert {entry.labels["rate"] for entry in entries} == {10, 20, 50, 100}
    for entry in entries:
        drive = entry.job.config.drive
        assert drive.turn_substeps + drive.walk_substeps == entry.labels["rate"]
        assert replace(drive, turn_substeps=4, walk_substeps=6) == DriveConfig()


def test_the_drive_refuses_few_steps_of_long_movements():
    assert refused_rates(DriveConfig()).keys() == {2, 5}
    assert refused_rates(DriveConfig(step_length=0.08, max_turn=30)) == {}
