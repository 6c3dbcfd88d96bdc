"""A strategy and a task that share names of fields: plain names are refused, full names work.

`Seek` and `Zone` both have a `reach` and a switch `fast`. Metrics and memories show which value
each of them has.
"""

import json
import re
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import jax
import numpy as np
import pyarrow.csv
import pytest
from support.cli import code_of, refused, result
from support.mjx import ran

import iswarm_mj
from iswarm_mj import PlanarSettings, Run, Scenario, World, make_env
from iswarm_mj.commands.main import parse
from iswarm_mj.config.setting_names import canonical_name, setting_names
from iswarm_mj.config.swarm import ArenaConfig, StrategyConfig, SwarmConfig
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.strategy.library import STRATEGIES, find
from iswarm_mj.utils.errors import UserError

FILE = '''
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np

from iswarm_mj import Cleaning, Command, Quantity, Strategy, Within


@dataclass(frozen=True)
class Seek(Strategy):
    reach: Annotated[float, Within(0, 10, "mm")] = 0.5
    """Distance of a step [mm]."""
    fast: bool = False
    turn: float = 0.25
    """Turn of a step [rad]."""
    recorded = {"reach": "mm"}

    def init(self, n_robots, key):
        return {"reach": jnp.zeros(n_robots)}

    def picks(self, memory):
        return memory["reach"] < 0

    def act(self, memory, observation, key):
        reach = jnp.full_like(memory["reach"], self.reach) * (2 if self.fast else 1)
        return {"reach": reach}, Command(jnp.full_like(reach, self.turn), 0.1 * reach)


class ZoneState(NamedTuple):
    balls: Any
    reach: Any
    offset: Any


@dataclass(frozen=True)
class Zone(Cleaning):
    reach: Annotated[float, Within(0, 100, "mm")] = 20.0
    """Radius of a zone [mm]."""
    fast: bool = False
    bonus: float = 1.0

    measured: ClassVar = {
        **Cleaning.measured,
        "zone": Quantity("radius of the zone", "mm"),
        "offset": Quantity("offset of the dust areas", "rd"),
    }

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, balls = super().lay_out(config, n_robots, rng, shared, cell)
        return poses, ZoneState(balls, np.float32(0), np.float32(0))

    def advance(self, state, inputs, key):
        balls, sensed = super().advance(state.balls, inputs, key)
        reach = jnp.float32(self.reach) * (3 if self.fast else 1)
        return ZoneState(balls, reach, inputs.arena.dust_area_offset), sensed

    def balls(self, state):
        return state.balls

    def progress(self, state):
        return super().progress(state.balls)

    def reward(self, before, after, inputs):
        return super().reward(before.balls, after.balls, inputs) + self.bonus

    def metrics(self, state):
        metrics = super().metrics(state.balls)
        return {**metrics, "zone": state.reach, "offset": state.offset}

    def areas(self, config, state):
        return super().areas(config, state.balls)


@dataclass(frozen=True)
class Accurate(Zone):
    accuracy: float = 3.0
    """As a setting of the planar engine."""


@dataclass(frozen=True)
class Seeded(Seek):
    seed: int = 5
'''
CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=6, dust_area_size=4.0, dust_area_offset=6.0))
ARENA = (
    "--arena.size=24",
    "--arena.n-dust=6",
    "--arena.dust-area-size=4",
    "--arena.dust-area-offset=6",
)
N = 6
FEW = (*ARENA, f"--robots={N}", "--steps=3", "--engine=planar", "--threads=1")
BOTH = {"strategy": "Seek", "task": "Zone"}
OWN = ("--strategy=own.py:Seek", "--task=own.py:Zone")
PLAIN = "{} is a setting of the strategy Seek and the task Zone; write {} or {}"
OF_FLAGS = PLAIN.format("--reach", "--strategy.reach", "--task.reach")
OF_NAMES = PLAIN.format("reach", "strategy.reach", "task.reach")


@pytest.fixture(autouse=True)
def own(here):
    """The file, in the working directory."""
    (here / "own.py").write_text(FILE)


@cache
def own_class(name):
    """Return a class of a file that all tests share, as they share its compiled programs."""
    path = Path(mkdtemp()) / "own.py"
    path.write_text(FILE)
    return find(STRATEGIES, f"{path}:{name}")


def seek(**values):
    """Return the strategy."""
    return own_class("Seek")(**values)


def zone(**values):
    """Return the task."""
    return own_class("Zone")(**values)


def scenario(**values):
    """Return a scenario of both, whose shared fields differ from each other and the defaults."""
    fields = {
        "strategy": seek(reach=2.0, fast=True),
        "task": zone(reach=50.0, bonus=2.5),
        "robots": N,
        "engine": PlanarSettings(threads=1),
        "strategy_name": "own.py:Seek",
        "task_name": "own.py:Zone",
    }
    return Scenario(CONFIG, **(fields | values))


def parts(strategy="Seek", task="Zone"):
    """Return classes of the file by the parts that they are."""
    return {
        "strategy": own_class(strategy),
        "task": own_class(task),
        "engine": PlanarSettings(),
    }


class TestNames:
    def test_a_shared_field_has_its_part_in_its_name(self):
        names = [*setting_names(parts())]
        assert names[:6] == [
            *("strategy.reach", "strategy.fast", "turn"),
            *("task.reach", "task.fast", "bonus"),
        ]
        assert "accuracy" in names

    def test_the_full_name_is_that_of_any_field(self):
        for name, expected in [
            ("task.bonus", "bonus"),
            ("bonus", "bonus"),
            ("engine.accuracy", "accuracy"),
            ("task.reach", "task.reach"),
            ("arena.size", "arena.size"),
            ("task.size", "task.size"),
            ("strategy.update_order", "strategy.update_order"),
            ("seed", "seed"),
        ]:
            assert canonical_name(name, parts()) == expected

    def test_a_task_and_an_engine_share_names_too(self):
        names = setting_names(parts(task="Accurate"))
        assert {"task.accuracy", "engine.accuracy"} <= names.keys() and "accuracy" not in names

    def test_a_field_that_is_a_setting_of_the_scenario_has_its_full_name(self):
        names = setting_names(parts(strategy="Seeded"))
        assert "strategy.seed" in names and "seed" not in names

    def test_no_field_has_the_name_of_a_setting_of_the_configuration(self, here):
        text = FILE.replace("fast: bool", "update_order: bool").replace("self.fast", "False")
        (here / "own.py").write_text(text)
        strategies = {word: find(STRATEGIES, f"own.py:{name}") for word, name in BOTH.items()}
        sentence = (
            "Seek has a field update_order, as another part of the scenario, "
            "but strategy.update_order is a setting of the configuration; rename the field"
        )
        with pytest.raises(UserError, match=f"^{re.escape(sentence)}$"):
            setting_names(strategies)


class TestCommands:
    """Flags, files of `--config`, and sweeps."""

    def test_full_names_are_flags(self):
        command = parse(
            [
                *("run", *OWN, *FEW, "--strategy.reach=2", "--task.reach", "50"),
                *("--strategy.fast", "--turn=1", "--task.bonus=3", "--engine.accuracy=0.02"),
            ]
        )
        assert (
            command.strategy_plugin.reach,
            command.strategy_plugin.fast,
            command.strategy_plugin.turn,
        ) == (2.0, True, 1.0)
        task = command.task_plugin
        assert (task.reach, task.fast, task.bonus) == (50.0, False, 3.0)
        assert command.engine_plugin.accuracy == 0.02
        command = parse(["run", *OWN, *FEW, "--task.fast", "--strategy.no-fast"])
        assert command.task_plugin.fast and not command.strategy_plugin.fast

    def test_a_plain_name_is_that_of_the_only_one(self):
        assert parse(["clean", OWN[0], "--reach=3"]).strategy_plugin.reach == 3.0
        assert parse(["run", OWN[1], "--reach=30"]).task_plugin.reach == 30.0

    @pytest.mark.parametrize(
        ("flags", "sentence"),
        [
            (["--reach=3"], OF_FLAGS),
            (["--reach", "3", "--task.reach=4"], OF_FLAGS),
            (["--no-fast"], PLAIN.format("--fast", "--strategy.fast", "--task.fast")),
            (
                ["--task.reach=200"],
                "--task.reach must be between 0 and 100 mm (got 200.0)",
            ),
            (["--bonus=3", "--task.bonus=4"], "--bonus is given twice"),
            (["--changes", "1:reach=3"], OF_NAMES),
        ],
    )
    def test_mistakes(self, capfd, here, flags, sentence):
        command = "play" if flags[0] == "--changes" else "run"
        few = FEW if command == "run" else [flag for flag in FEW if "steps" not in flag]
        error = refused(capfd, here, command, *OWN, *few, *flags)
        assert error.startswith(f"iswarm: {sentence}")

    def test_a_flag_that_is_taken_is_refused_as_before(self, capfd, here):
        error = refused(capfd, here, "run", "--strategy=own.py:Seeded", *FEW)
        assert "Seeded has a field seed, but --seed is already a flag of iswarm run" in error

    def test_help_has_the_full_names(self, capfd):
        assert code_of("run", *OWN, "--help") == 0
        text = capfd.readouterr().out
        assert "--strategy.reach" in text and "--task.no-fast" in text and "--bonus" in text
        assert " --reach" not in text

    def test_a_run_and_the_run_that_repeats_its_result(self, here):
        values = ("--strategy.reach=2", "--task.reach=50", "--task.fast")
        assert code_of("run", *OWN, *FEW, *values) == 0
        first = result("runs/task")
        assert first["metrics"]["zone"] == 150.0
        assert first["strategy"]["reach"] == 2.0 and first["task"]["reach"] == 50.0
        robots = iswarm_mj.load("runs/task").robots
        np.testing.assert_allclose(robots["reach"].to_numpy()[-N:], 2e-3)

        again = ["--config=runs/task/result.json", "--out=runs/again", "--threads=1"]
        assert code_of("run", *OWN, *again) == 0
        second = result("runs/again")
        for name in ("strategy", "task", "metrics", "config", "settings"):
            assert second[name] == first[name]

    def test_files_have_full_names(self, here):
        (here / "own.toml").write_text(
            'strategy = "own.py:Seek"\ntask = "own.py:Zone"\nbonus = 4.0\n'
            '"strategy.reach" = 2.0\n"task.reach" = 50.0\n"task.fast" = true\n'
        )
        command = parse(["run", "--config=own.toml", *FEW, "--task.reach=60"])
        assert (command.strategy_plugin.reach, command.task_plugin.reach) == (2.0, 60.0)
        assert command.task_plugin.fast and command.task_plugin.bonus == 4.0

    def test_a_table_of_the_task_goes_with_its_flag(self, here):
        (here / "own.toml").write_text("[task]\nreach = 50.0\nbonus = 4.0\n")
        command = parse(["run", *OWN, "--config=own.toml", *FEW])
        assert (command.task_plugin.reach, command.task_plugin.bonus) == (50.0, 4.0)

    @pytest.mark.parametrize(
        ("lines", "sentence"),
        [
            ("reach = 2.0", "--config own.toml: " + OF_NAMES),
            ('bonus = 2.0\n"task.bonus" = 3.0', "--config own.toml names bonus twice, also as"),
            (
                "task.reach = 2.0",
                "--config own.toml is no TOML (Cannot overwrite a value "
                '(at line 3, column 17)); put a key with a dot in quotes, as "task.range" = 5',
            ),
        ],
    )
    def test_mistakes_in_files(self, capfd, here, lines, sentence):
        head = 'strategy = "own.py:Seek"\ntask = "own.py:Zone"\n'
        (here / "own.toml").write_text(f"{head}{lines}\n")
        error = refused(capfd, here, "run", "--config=own.toml", *FEW)
        assert error.startswith(f"iswarm: {sentence}"), error
        with pytest.raises(UserError, match=re.escape(sentence.removeprefix("--config "))):
            Scenario.from_toml("own.toml")

    @pytest.mark.slow
    def test_a_sweep_varies_a_full_name(self, capfd, here):
        sweep = ("sweep", "run", *OWN, *FEW, "--over")
        error = refused(capfd, here, *sweep, "reach=10,20")
        assert error.startswith(f"iswarm: {OF_FLAGS}")
        assert code_of(*sweep, "task.reach=10,20", "strategy.fast=True,False") == 0
        rows = pyarrow.csv.read_csv("runs/sweep/sweep.csv").to_pylist()
        assert [row["task.reach"] for row in rows] == [10, 10, 20, 20]
        assert [row["strategy.fast"] for row in rows] == [True, False, True, False]
        assert [row["zone"] for row in rows] == [10.0, 10.0, 20.0, 20.0]


class TestScenario:
    """Python has fields in place of names."""

    def test_three_worlds_that_differ(self):
        offsets = [6.0, 5.0, 5.5]
        arenas = [replace(CONFIG.arena, dust_area_offset=offset) for offset in offsets]
        worlds = [
            World(TYPE1, n_robots, index=k, config=replace(CONFIG, arena=arena))
            for k, (n_robots, arena) in enumerate(zip((6, 5, 4), arenas, strict=True))
        ]
        run = Run(scenario(worlds=worlds, steps=3), record_worlds=(0, 1, 2))
        record = ran(run)
        metrics = run.metrics()
        assert metrics["zone"].tolist() == [50.0] * 3 and metrics["offset"].tolist() == offsets
        assert (np.asarray(record.swarm.memory["reach"])[-1, :, :4] == 4.0).all()

    def test_an_environment(self):
        env = make_env(scenario(worlds=2), n_starts=1)
        state = env.reset(jax.random.split(jax.random.key(0), 2))
        for _ in range(2):
            state = env.step(state, np.zeros((2, N, env.action_size), np.float32))
        assert state.metrics["zone"].tolist() == [50.0, 50.0]
        np.testing.assert_allclose(state.reward, 2.5)

    def test_toml_states_both_and_reads_them(self, here):
        written = scenario()
        (here / "own.toml").write_text(written.to_toml())
        keys = tomllib.loads(written.to_toml())
        assert keys["strategy.reach"] == 2.0 and keys["task.reach"] == 50.0
        assert keys["bonus"] == 2.5 and "turn" not in keys  # which is the class's default

        read_again = Scenario.from_toml("own.toml")
        assert (read_again.strategy.reach, read_again.strategy.fast) == (2.0, True)
        assert (read_again.task.reach, read_again.task.fast, read_again.task.bonus) == (
            50.0,
            False,
            2.5,
        )
        assert read_again.to_toml() == written.to_toml()
        command = parse(["run", "--config=own.toml"])
        assert (command.strategy_plugin.reach, command.task_plugin.reach) == (2.0, 50.0)

    def test_a_result_states_both(self):
        about = Run(scenario(steps=1)).rules
        assert about["strategy"]["reach"] == 2.0 and about["task"]["reach"] == 50.0
        json.dumps(about)

    def test_settings_of_the_configuration_stand_beside_the_name_of_a_strategy(self, here):
        config = replace(CONFIG, strategy=StrategyConfig(update_order="sequential"))
        file = here / "own.toml"
        file.write_text(replace(scenario(), config=config).to_toml())
        assert Scenario.from_toml(file).config == config
        command = parse(["run", "--config=own.toml"])
        assert command.config.strategy.update_order == "sequential"

    def test_no_flag_states_a_field_that_is_a_flag_of_the_run(self):
        seeded = own_class("Seeded")
        stated = scenario(strategy=seeded(seed=7), strategy_name="own.py:Seeded", seed=3)
        with pytest.raises(
            UserError, match="no flag can state seed of Seeded, as `seed` is a flag"
        ):
            stated.to_toml()


class TestPage:
    """The page is its session, without a browser."""

    def test_each_has_a_control_that_changes_it_alone(self):
        session = Session(PageScenario.of(scenario()))
        names = [control.name for control in session.controls()]
        assert len({*names}) == len(names) and "reach" not in names
        assert {"strategy.reach", "task.reach", "turn", "bonus"} <= {*names}
        label_of = {control.name: control.label for control in session.controls()}
        assert label_of["strategy.reach"] == "strategy reach [mm]"
        assert label_of["task.reach"] == "task reach [mm]"
        assert label_of["bonus"] == "bonus"
        assert label_of["optics.communication_radius"].startswith("communication radius")

        session.advance()
        session.set("task.reach", 70.0)
        session.set("strategy.reach", 3.0)
        session.set("strategy.turn", 0.5)
        session.advance()
        assert session.lines["zone"][-1] == 70.0
        memory = session.snapshots[-1].record.swarm.memory["reach"]
        assert (np.asarray(memory) == 6.0).all()
        assert (session.now.strategy.turn, session.wanted.task.reach) == (0.5, 70.0)
        assert [change.name for change in session.changes] == [
            *("task.reach", "strategy.reach", "turn"),
        ]
        with pytest.raises(UserError, match=f"^{re.escape(OF_NAMES)}$"):
            session.set("reach", 3.0)

    def test_what_it_copies_repeats_the_run(self, here):
        session = Session(PageScenario.of(scenario()))
        session.advance()
        session.set("task.reach", 70.0)
        session.advance()
        (here / "play.toml").write_text(session.toml())
        again = parse(["play", "--config=play.toml", "--threads=1"]).session()
        for _ in range(2):
            again.advance()
        assert again.lines["zone"][-1] == 70.0 and again.now.strategy.reach == 2.0
        assert "--changes 1:task.reach=70.0" in session.command()

    def test_a_rule_keeps_its_value_while_another_task_waits(self):
        """The strategy's reach is `strategy.reach` beside Zone, and `reach` beside cleaning."""
        session = Session(PageScenario.of(scenario()))
        session.advance()
        session.want("task", "aggregation")
        session.want("spot_offset", 5.0)
        session.want("spot_radius", 4.0)
        session.set("strategy.reach", 3.0)
        assert session.wanted.strategy.reach == 3.0
        names = [control.name for control in session.controls()]
        assert "strategy.reach" in names and "reach" not in names
        session.reset()
        assert session.now.strategy.reach == 3.0
        assert "reach" in [control.name for control in session.controls()]

    def test_the_seed_is_that_of_the_world(self):
        seeded = own_class("Seeded")
        page = PageScenario.of(scenario(strategy=seeded(seed=7), seed=3))
        assert (page.get("seed"), page.get("strategy.seed")) == (3, 7)
        assert page.set("seed", 4).strategy.seed == 7
