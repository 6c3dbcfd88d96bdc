"""A scenario means the same to each entry, no part of it can be swapped, and files state it."""

import json
import math
import subprocess
import sys
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.robots import two_kinds

from iswarm_mj import (
    PRESETS,
    Run,
    Scenario,
    SearchPlan,
    Teams,
    World,
    evolve,
    make_env,
    play,
    rollout,
)
from iswarm_mj.commands.main import parse
from iswarm_mj.config.swarm import INTERPRETATIONS, ArenaConfig, EnergyConfig, SwarmConfig
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.envs import PolicyStrategy, parallel_env, single_env, vector_env
from iswarm_mj.output.results import about
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.simulation.scenario_flags import is_same
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.library import STRATEGIES, find
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.tasks.foraging import Forager, Foraging
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import read_table

ARENA = ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0)
CONFIG = SwarmConfig(ARENA)
HERE = PlanarSettings(threads=1)
N = 12
PAPERS = Scenario(CONFIG, robots=N, seed=3, engine=HERE)
"""A scenario of the paper's strategy and task."""
TYPE1 = PRESETS["type1"]
TYPE2 = PRESETS["type2"]


def turn_and_walk(weights, obs):
    """Return the same action for all robots, the weights of a policy."""
    return jnp.broadcast_to(weights, (len(obs), 2))


def first_step(run):
    """Return poses (N, 3) of world 0 after a step."""
    return run.advance().poses[0, 0]


class TestEntries:
    """Each takes the scenario alone."""

    @pytest.mark.slow
    def test_a_run_the_page_and_an_environment_begin_alike(self):
        policy = PolicyStrategy(turn_and_walk, jnp.array([0.3, 0.8]))
        scenario = replace(PAPERS, strategy=policy)
        run = Run(scenario)
        start = run.start.poses[0, 0]
        poses = first_step(run)
        assert np.abs(poses - start).max() > 0.01

        three = Run(replace(scenario, worlds=3), record_worlds=(1, 0, 2))
        np.testing.assert_array_equal(three.advance().poses[0, 1], poses)

        session = Session(PageScenario.of(scenario))
        session.advance()
        np.testing.assert_array_equal(session.snapshots[-1].record.poses[0, 0], poses)

        counted = rollout(replace(scenario, worlds=2, steps=1), poses_of=(0,))
        np.testing.assert_array_equal(counted.poses[0], np.float32([start, poses]))

        env = make_env(scenario, n_starts=1)
        state = env.reset(jax.random.split(jax.random.key(0), 1))
        np.testing.assert_allclose(env.poses(state)[0], start, atol=1e-5)
        state = env.step(state, np.full((1, N, 2), [0.3, 0.8], np.float32))
        np.testing.assert_allclose(env.poses(state)[0], poses, atol=1e-5)

    @pytest.mark.slow
    def test_64_worlds_and_adapters_begin_as_the_run(self):
        scenario = replace(PAPERS, steps=1)
        start = Run(scenario).start.poses[0, 0]
        many = rollout(replace(scenario, worlds=64), poses_of=(0, 63))
        np.testing.assert_array_equal(many.poses[0, 0], np.float32(start))
        assert np.abs(many.poses[1, 0] - start).max() > 1

        for make in (single_env, vector_env, parallel_env):
            env = make(scenario, n_starts=1)
            env.reset(seed=0)
            worlds = getattr(env, "_vector_env", env)
            poses = worlds.env.poses(worlds.current_state("poses"))
            np.testing.assert_allclose(poses[0], start, atol=1e-5)

    @pytest.mark.slow
    @pytest.mark.usefixtures("few_pixels")
    def test_the_first_generation_of_a_search_is_runs_of_the_scenario(self, tmp_path, capsys):
        scenario = replace(PAPERS, robots=None, steps=5)
        evolve(scenario, tmp_path, SearchPlan(generations=1, population=3), workers=1)
        for row in read_table(tmp_path / "evolution.parquet")[0]:
            genome = Genome(*(row[field.name] for field in fields(Genome)))
            run = Run(replace(scenario, strategy=genome, robots=row["n_robots"], seed=row["seed"]))
            while not run.is_over:
                run.advance()
            measures = run.measures(0)
            assert (row["picked"], row["collisions"]) == (measures.picked, measures.collisions)

    def test_a_search_names_the_fields_that_it_does_not_use(self, tmp_path):
        says = "it does not use robots and goal of its scenario: leave them out"
        with pytest.raises(UserError, match=says):
            evolve(replace(PAPERS, goal=3), tmp_path)

    def test_a_run_is_that_of_the_command(self, tmp_path):
        scenario = replace(PAPERS, strategy=TYPE2, steps=3, worlds=2)
        file = tmp_path / "scenario.toml"
        file.write_text(scenario.to_toml())
        command = parse(["run", "--config", str(file)])

        run = Run(scenario)
        run_of_command = Run(command.scenario())
        for _ in range(3):
            expected = run.advance().poses
            np.testing.assert_array_equal(run_of_command.advance().poses, expected)
        assert about(run_of_command) == about(run)

    def test_worlds_of_keys_are_those_keys(self):
        keys = jax.random.split(jax.random.key(1), 2)
        scenario = replace(PAPERS, worlds=keys, steps=3)
        of_both_keys = rollout(scenario, poses_of=(0, 1))
        second_twice = [World(TYPE1, N, key=keys[1])] * 2
        of_second_key = rollout(replace(scenario, worlds=second_twice), poses_of=(0, 1))
        np.testing.assert_array_equal(of_second_key.poses, of_both_keys.poses[[1, 1]])
        assert np.abs(of_both_keys.poses[0, 0] - of_both_keys.poses[1, 0]).max() > 1

    def test_worlds_of_a_scenario_differ(self):
        noisy = replace(CONFIG, optics=replace(CONFIG.optics, error_in_communication=0.5))
        worlds = [World(TYPE2, 5, seed=8), World(TYPE1, N, config=noisy, failed_fraction=0.5)]
        run = Run(replace(PAPERS, robots=None, worlds=worlds), record_worlds=(0, 1))
        assert (run.settings.n_robots, run.settings.n_worlds) == (N, 2)
        assert run.start.swarm.is_alive.sum(axis=-1).tolist() == [[5, N // 2]]

    def test_the_number_of_robots_follows_from_the_genome_or_the_kinds(self, tmp_path):
        sparse = Scenario(CONFIG, strategy=replace(TYPE2, density_of_robots=0.1))
        assert sparse.n_robots < Scenario(CONFIG, strategy=TYPE2).n_robots
        of_kinds = Scenario(CONFIG, robot_file=two_kinds(tmp_path, 6))
        assert of_kinds.n_robots == Run(of_kinds).settings.n_robots


class TestMistakes:
    def test_the_order_of_arguments_does_not_matter(self):
        arguments = {"strategy": TYPE2, "seed": 3, "engine": HERE, "config": CONFIG, "steps": 9}
        assert Scenario(**arguments) == Scenario(**dict(reversed(arguments.items())))

    def test_a_genome_is_no_configuration(self):
        with pytest.raises(UserError, match="config must be a SwarmConfig"):
            Scenario(TYPE2, strategy=CONFIG)

    @pytest.mark.parametrize("call", [Run, rollout, make_env, play])
    def test_a_configuration_is_no_scenario(self, call):
        with pytest.raises(UserError, match="scenario must be a Scenario"):
            call(CONFIG)

    @pytest.mark.parametrize("make", [make_env, parallel_env, single_env, vector_env])
    def test_fields_beside_a_scenario_are_refused(self, make):
        with pytest.raises(UserError, match="`seed` is given beside a scenario"):
            make(PAPERS, seed=0)

    @pytest.mark.parametrize("worlds", [0, [], [TYPE2]], ids=["none", "an empty list", "genomes"])
    def test_worlds_are_a_number_or_worlds_or_keys(self, worlds):
        says = "worlds must be a number above 0, a World for each, or a random key for each"
        with pytest.raises(UserError, match=says):
            Scenario(CONFIG, worlds=worlds)

    @pytest.mark.parametrize(
        ("fields", "says"),
        [
            (
                {"worlds": [World(PRESETS["evolved"], N)], "strategy": TYPE2},
                "worlds have their own",
            ),
            ({"steps": 0}, "steps must be"),
            ({"goal": 0}, "goal must be"),
            ({"robots": 0}, "robots must be"),
            ({"engine": "planar"}, "engine must be"),
            ({"strategy_name": math.inf}, "strategy_name must be a text \\(got inf\\)"),
            ({"task_name": 3}, "task_name must be a text \\(got 3\\)"),
            ({"task": Foraging}, "task is the class Foraging itself; give an object of it"),
            ({"strategy": Forager}, "strategy is the class Forager itself; give an object of it"),
        ],
    )
    def test_impossible_fields_are_refused(self, fields, says):
        with pytest.raises(UserError, match=says):
            Scenario(CONFIG, **fields)

    KEYS = jax.random.split(jax.random.key(1), 2)

    @pytest.mark.parametrize(
        ("call", "fields", "says"),
        [
            (play, {"worlds": [World(TYPE2, N)]}, "shows one world"),
            (play, {"worlds": KEYS}, "shows one world"),
            (play, {"goal": 3}, "without goal"),
            (make_env, {"worlds": [World(TYPE2, N)]}, "a number of worlds"),
            (make_env, {"worlds": KEYS}, "a number of worlds"),
            (partial(vector_env, num_envs=2), {"worlds": 3}, "the scenario has 3 worlds"),
        ],
    )
    def test_each_entry_names_the_fields_that_it_cannot_take(self, call, fields, says):
        with pytest.raises(UserError, match=says):
            call(replace(PAPERS, **fields))


OWN = "from iswarm_mj.tasks.aggregation import Beeclust\n\n\nclass Walk(Beeclust):\n    pass\n"
"""File of a user's strategy."""
BARE = replace(ARENA, n_dust=72)
"""An arena with the default of a setting that has no effect in a task without dust."""
SPOTS = Aggregation(spot_radius=4.0, spot_offset=7.0)
BOXES = replace(ARENA, obstacles=((5.0, 5.0, 1.0, 2.0, 30.0), (-6.0, 6.0, 1.0, 1.0, 0.0)))
ODD = {
    "defaults": Scenario(),
    "a genome of its own": replace(
        PAPERS, strategy=replace(TYPE1, use_hop_count=False, p_vector_forget=0.125)
    ),
    "steps, goal and worlds": replace(PAPERS, steps=17, goal=5, worlds=3),
    "a task with fields": replace(
        PAPERS, config=SwarmConfig(BARE), strategy=Beeclust(longest_wait=20.0), task=SPOTS
    ),
    "another task": replace(PAPERS, strategy=Forager(), task=Foraging()),
    "obstacles": replace(PAPERS, config=SwarmConfig(BOXES)),
    "an outline": replace(PAPERS, config=SwarmConfig(replace(ARENA, outline=((24.0, 20.0),)))),
    "a reading and energy": replace(
        PAPERS, config=replace(INTERPRETATIONS["selected"], energy=EnergyConfig("capacitor"))
    ),
    "teams": replace(
        PAPERS,
        strategy=Teams(
            {"type1": (0.5, TYPE1), "type2": (0.5, replace(TYPE2, fraction_scouts=0.5))}
        ),
    ),
    "MuJoCo": replace(PAPERS, engine=MujocoSettings(threads=1), robots=None),
}
"""Scenarios by what is odd about them."""


def read_back(scenario, file):
    """Write a scenario to a file, and return what is read from it."""
    file.write_text(scenario.to_toml())
    return Scenario.from_toml(file)


class TestFiles:
    @pytest.mark.parametrize("scenario", ODD.values(), ids=ODD)
    def test_a_toml_file_states_it_to_python_and_to_the_command(self, scenario, tmp_path):
        again = read_back(scenario, tmp_path / "scenario.toml")
        assert again.values() == scenario.values()
        assert replace(again, engine=scenario.engine) == scenario
        assert again.engine.identity == scenario.engine.identity

        command = parse(["run", "--config", str(tmp_path / "scenario.toml")])
        assert command.config == scenario.config
        assert command.task == scenario.task
        assert command.rules == scenario.strategy
        assert command.number_of_robots() == scenario.n_robots
        assert command.engine_settings.identity == scenario.engine.identity
        for name in ("seed", "worlds", "steps"):
            assert getattr(command, name) == getattr(scenario, name), name
        assert command.stop_at == scenario.goal

    @pytest.mark.parametrize("scenario", ODD.values(), ids=ODD)
    def test_a_result_states_it(self, scenario, tmp_path):
        run = Run(replace(scenario, engine=HERE) if scenario == Scenario() else scenario)
        again = Run(Scenario.from_result(about(run)))
        assert about(again) == about(run)
        np.testing.assert_array_equal(again.start.poses, run.start.poses)
        (tmp_path / "result.json").write_text(json.dumps(about(run)))
        assert Scenario.from_result(tmp_path / "result.json") == Scenario.from_result(about(run))

    def test_kinds_of_robots(self, tmp_path):
        scenario = replace(PAPERS, robots=None, robot_file=two_kinds(tmp_path, 6))
        again = read_back(scenario, tmp_path / "scenario.toml")
        assert again.robot_file == scenario.robot_file
        assert again.n_robots == scenario.n_robots
        assert Scenario.from_result(about(Run(scenario))).robot_file == scenario.robot_file

    def test_classes_of_files(self, tmp_path):
        (tmp_path / "own.py").write_text(OWN)
        walk = find(STRATEGIES, f"{tmp_path}/own.py:Walk")
        scenario = replace(PAPERS, strategy=walk(longest_wait=7.0), task=SPOTS, robots=4)
        again = read_back(scenario, tmp_path / "scenario.toml")
        assert again.values() == scenario.values()
        assert again.strategy.longest_wait == 7.0
        assert replace(again, engine=scenario.engine) == scenario

        result = about(Run(scenario))
        says = r"strategy Walk, which no package offers; give its class.*strategy=Walk"
        with pytest.raises(UserError, match=says):
            Scenario.from_result(result)
        assert Scenario.from_result(result, strategy=walk).strategy == scenario.strategy

    def test_engines_of_files_and_of_gpus(self, tmp_path):
        engine = find_engine(f"{Path(__file__).parents[1]}/data/teleport.py:TeleportSettings")
        again = read_back(replace(PAPERS, engine=engine(30.0)), tmp_path / "scenario.toml")
        assert type(again.engine).__name__ == "TeleportSettings"
        assert again.engine.identity == engine(30.0).identity
        result = about(Run(replace(PAPERS, engine=engine(30.0))))
        assert Scenario.from_result(result, engine=engine).engine == engine(30.0)

        on_mjx = replace(PAPERS, engine=MjxSettings())
        assert read_back(on_mjx, tmp_path / "scenario.toml").engine.name == "mjx"

    def test_dead_robots_of_a_result(self):
        worlds = [World(TYPE2, N, seed=3, index=index, failed_fraction=0.5) for index in range(2)]
        scenario = replace(PAPERS, strategy=TYPE2, worlds=worlds, steps=3)
        run = Run(scenario, record_worlds=(0, 1))
        again = Run(Scenario.from_result(about(run)), record_worlds=(0, 1))
        np.testing.assert_array_equal(again.start.swarm.is_alive, run.start.swarm.is_alive)
        np.testing.assert_array_equal(again.start.poses, run.start.poses)

    def test_the_flags_of_a_command_may_stand_in_a_file(self, tmp_path):
        file = tmp_path / "run.toml"
        file.write_text('reading = "selected"\nuse-hop-count = false\n[arena]\nn-dust = 24\n')
        scenario = Scenario.from_toml(file)
        assert scenario.config == replace(INTERPRETATIONS["selected"], arena=ArenaConfig(n_dust=24))
        assert scenario.strategy == replace(TYPE1, use_hop_count=False)

    @pytest.mark.parametrize(
        ("text", "says"),
        [("out = 'here'", "names out, which is no part"), ("seed = ", "is no TOML")],
    )
    def test_files_that_state_no_scenario_are_refused(self, tmp_path, text, says):
        file = tmp_path / "run.toml"
        file.write_text(text)
        with pytest.raises(UserError, match=says):
            Scenario.from_toml(file)

    def test_a_misspelt_method_is_named_with_the_one_that_is_meant(self, tmp_path):
        methods = "".join(f"    def {name}(self): pass\n" for name in ("init", "act", "pick"))
        (tmp_path / "walk.py").write_text(
            f"from iswarm_mj import Strategy\nclass Walk(Strategy):\n{methods}"
        )
        file = tmp_path / "run.toml"
        file.write_text(f'strategy = "{(tmp_path / "walk.py").as_posix()}:Walk"')
        with pytest.raises(UserError, match="has no method picks; rename pick, which it has"):
            Scenario.from_toml(file)

    def test_no_file_can_state_classes_of_a_notebook_and_worlds_that_differ(self):
        of_notebook = type("Own", (Beeclust,), {"__module__": "nowhere"})
        with pytest.raises(UserError, match="no command can name Own"):
            replace(PAPERS, strategy=of_notebook(), task=SPOTS).to_toml()
        with pytest.raises(UserError, match="no flag can state worlds that differ"):
            replace(PAPERS, worlds=[World(TYPE2, N)]).to_toml()

    def test_large_arrays_are_to_be_given_beside_a_result(self):
        @dataclass(frozen=True)
        class Large(Beeclust):
            weights: object = None

        large = Large(weights=np.zeros(100, np.float32))
        result = about(Run(replace(PAPERS, strategy=large, task=SPOTS)))
        with pytest.raises(UserError, match="does not state weights of Large completely"):
            Scenario.from_result(result, strategy=Large)
        assert is_same(Scenario.from_result(result, strategy=large).strategy, large)

    def test_other_contents_are_no_results(self):
        for content in ({}, {"config": {}}, {**about(Run(PAPERS)), "settings": {}}):
            with pytest.raises(UserError, match="give the result"):
                Scenario.from_result(content)


SCRIPT = """
from iswarm_mj import Aggregation, Scenario
from iswarm_mj.tasks.aggregation import Beeclust


class Walk(Beeclust):
    pass


print("runs")
scenario = Scenario.from_toml("own.toml")
assert type(scenario.strategy) is Walk and scenario.strategy.longest_wait == 7.0
"""


def test_a_script_reads_a_file_that_names_its_own_classes(tmp_path):
    """The script is not executed again."""
    settings = 'strategy = "own.py:Walk"\ntask = "aggregation"\nlongest_wait = 7.0\n'
    (tmp_path / "own.py").write_text(SCRIPT)
    (tmp_path / "own.toml").write_text(settings)
    process = subprocess.run(
        [sys.executable, "own.py"], cwd=tmp_path, capture_output=True, text=True
    )
    assert (process.returncode, process.stdout) == (0, "runs\n"), process.stderr
