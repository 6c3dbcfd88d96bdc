"""Defaults of flags: `--config`, a TOML file of flags or the result.json of an earlier run, and
`--reading`."""

import json
from importlib.metadata import EntryPoint

import pytest

from iswarm_mj.commands.main import main, parse
from iswarm_mj.config.swarm import INTERPRETATIONS
from iswarm_mj.strategy import library

RUN = """
steps = 8
robots = 12
record = false
use-hop-count = false
record_worlds = [0, 1]
worlds = 2
reading = "initial"

[arena]
size = 15
dump-size = 3
dust-area-size = 3
dust-area-offset = 5
n_dust = 24

[optics]
line-of-sight = false
"""
TASK = {
    "class": "Aggregation",
    "spot_radius": 8.0,
    "spot_offset": 14.0,
    "dim": 0.25,
    "error_light": 0.05,
}
STRATEGY = {
    "class": "Beeclust",
    "longest_wait": 200.0,
    "half_light": 0.5,
    "meeting": 1.4,
    "leaving": 4.0,
}


@pytest.fixture(autouse=True)
def run_toml(here):
    (here / "run.toml").write_text(RUN)


class TestToml:
    def test_keys_are_flags(self):
        command = parse(["clean", "--config", "run.toml"])
        assert (command.steps, command.robots, command.record) == (8, 12, False)
        assert command.record_worlds == (0, 1)
        assert command.strategy_plugin.use_hop_count is False

        arena = command.arena
        assert (arena.size, arena.dump_size, arena.n_dust) == (15.0, 3.0, 24)
        assert command.optics.line_of_sight is False
        assert command.strategy == INTERPRETATIONS["initial"].strategy

    @pytest.mark.parametrize("is_file_first", [False, True])
    def test_flags_override_the_file(self, is_file_first):
        flags = ["--steps", "9", "--record", "--arena.size=20", "--record-worlds", "1"]
        file = ["--config=run.toml"]
        command = parse(["clean", *(file + flags if is_file_first else flags + file)])
        assert (command.steps, command.record) == (9, True)
        assert (command.arena.size, command.arena.n_dust) == (20.0, 24)
        assert command.record_worlds == (1,)

    def test_lists_are_whole_values(self, here):
        """Empty ones too; and words that follow are not part of them."""
        (here / "gaps.toml").write_text("no_contact_gap = []")
        assert parse(["grasp", "--config", "gaps.toml"]).no_contact_gap == ()

        (here / "trails.toml").write_text('draw = ["trails"]')
        command = parse(["replay", "--config", "trails.toml", "runs/other"])
        assert command.draw == ("trails",)
        assert str(command.directory) == "runs/other"

    def test_rows_are_the_numbers_of_a_flag(self, here):
        text = "[arena]\nobstacles = [[8, 8, 2, 0.5, 30], [0, 9, 1, 1, 0]]"
        (here / "boxes.toml").write_text(text)
        config = parse(["clean", "--config", "boxes.toml"]).config
        assert config.arena.obstacles == ((8.0, 8.0, 2.0, 0.5, 30.0), (0.0, 9.0, 1.0, 1.0, 0.0))

    def test_a_strategy_in_a_file(self, here):
        (here / "own.py").write_text("from iswarm_mj.strategy.genome import TYPE2")
        (here / "own.toml").write_text(
            'strategy = "own.py:TYPE2"\nfraction-scouts = 0.5\n"strategy.random-turn" = 10'
        )
        command = parse(["clean", "--config", "own.toml"])
        assert (
            command.strategy_plugin.fraction_scouts,
            command.strategy_plugin.density_of_robots,
        ) == (0.5, 0.132)
        assert command.strategy.random_turn == 10.0

    def test_a_flag_replaces_what_it_excludes(self, here):
        """A number of robots replaces the file's density, and the other way round."""
        (here / "density.toml").write_text("density = 0.1\n")
        command = parse(["clean", "--config", "density.toml", "--robots", "5"])
        assert (command.robots, command.density) == (5, None)

        (here / "robots.toml").write_text("robots = 9\n")
        command = parse(["clean", "--config", "robots.toml", "--density", "0.2"])
        assert (command.robots, command.density) == (None, 0.2)


class TestResult:
    def test_it_repeats_its_run(self, here):
        """Every measure is the same, and so are all settings."""
        flags = ["--record", "--out=first", "--engine=planar", "--impl=numba"]
        main(["clean", "--config", "run.toml", "--seed", "7", *flags])
        main(["clean", "--config", "first/result.json", "--out", "second", "--no-record"])

        first = json.loads((here / "first/result.json").read_text())
        second = json.loads((here / "second/result.json").read_text())
        assert first["picked"]
        assert first["genome"]["use_hop_count"] is False
        assert first["seed"] == 7
        differing = {key for key in first if first[key] != second[key]}
        assert differing <= {"wall_s", "seconds"}

    @pytest.fixture
    def own_tasks_are_installed(self, monkeypatch):
        """Let a task and a strategy of this package be found, also where it is not installed."""
        points = [
            EntryPoint("aggregation", "iswarm_mj.tasks.aggregation:Aggregation", "iswarm_mj.tasks"),
            EntryPoint("beeclust", "iswarm_mj.tasks.aggregation:Beeclust", "iswarm_mj.strategies"),
        ]

        def points_of_group(group):
            return [point for point in points if point.group == group]

        monkeypatch.setattr(library, "entry_points", points_of_group)

    @pytest.mark.usefixtures("own_tasks_are_installed")
    @pytest.mark.parametrize(
        "rules", [{"genome": {"fraction_scouts": 0.5}}, {"strategy": STRATEGY}]
    )
    def test_other_rules_replace_its_own(self, here, rules):
        """With its task, they are those of a candidate that is compared with the run."""
        content = {"settings": {"n_robots": 9}, "config": {}, "task": TASK, **rules}
        (here / "result.json").write_text(json.dumps(content))
        bees = parse(["run", "--config", "result.json", "--strategy", "beeclust"])
        scouts = parse(["run", "--config", "result.json", "--genome", "type2"])
        assert type(bees.strategy_plugin).__name__ == "Beeclust" and bees.robots == 9
        assert scouts.strategy_plugin.fraction_scouts == 0.27 and not scouts.controller

    def test_it_names_its_task_and_its_strategy(self, here):
        result = {"settings": {"seed": 3}, "config": {}, "strategy": STRATEGY, "task": TASK}
        (here / "bees.json").write_text(json.dumps(result))
        command = parse(["run", "--config", "bees.json", "--dim", "0.3"])
        assert (command.task_name, command.controller) == ("aggregation", ("beeclust",))
        assert (command.task.spot_radius, command.task.dim) == (8.0, 0.3)
        assert command.strategy_plugin.longest_wait == 200.0
        assert command.seed == 3

    def test_a_flag_replaces_its_engine(self, here):
        """The file has the settings of the engine, too."""
        result = {"settings": {}, "config": {}, "engine": "mjx", "impl": "jax"}
        (here / "mjx.json").write_text(json.dumps(result))
        command = parse(["clean", "--config", "mjx.json", "--engine", "mujoco"])
        assert command.engine == "mujoco"


class TestReading:
    @pytest.mark.parametrize("command", [["clean"], ["experiment", "hop-count"]])
    @pytest.mark.parametrize("reading", INTERPRETATIONS)
    def test_it_is_the_default_of_the_flags(self, command, reading):
        assert parse([*command, "--reading", reading]).config == INTERPRETATIONS[reading]

    @pytest.mark.parametrize("is_reading_first", [False, True])
    def test_flags_override_it(self, is_reading_first):
        """Also those whose value is the default of the other reading."""
        reading = ["--reading", "initial"]
        flags = ["--strategy.avoidance-sides", "front", "--strategy.random-turn=90"]
        arguments = reading + flags if is_reading_first else flags + reading
        strategy = parse(["clean", *arguments]).config.strategy

        initial = vars(INTERPRETATIONS["initial"].strategy)
        assert vars(strategy) == initial | {"avoidance_sides": "front", "random_turn": 90.0}
