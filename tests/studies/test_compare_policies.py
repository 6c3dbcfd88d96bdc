"""The table of learned and other strategies, with runs that are pretended."""

import sys

import compare_policies
import numpy as np
import pytest
from support.robots import robot_file

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.paper.analysis.statistics import interval
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.measures import Measures

FOUND = [
    Measures(5, 5, 30, 9.0, 120),
    Measures(1, 2, 10, 9.0, None),
    Measures(4, 4, 80, 9.0, None),
    Measures(5, 5, 20, 9.0, 60),
    Measures(5, 5, 11, 9.0, 200),
]


@pytest.fixture
def told(monkeypatch, capsys):
    """Returns what was given to each run, and the rows."""

    def call(*flags, faults=()):
        given = []

        class Pretended:
            def __init__(self, *args, **options):
                given.append((args, options))
                self.faults, self.left = faults, 3

            @property
            def is_over(self):
                return self.left == 0

            def advance(self):
                self.left -= 1

            def measures(self, world):
                assert self.is_over
                return FOUND[world]

        monkeypatch.setattr(compare_policies, "Run", Pretended)
        monkeypatch.setattr(sys, "argv", ["compare_policies.py", *flags])
        compare_policies.main()
        return given, capsys.readouterr().out.splitlines()[2:]

    return call


def test_a_row_by_hand(told):
    """Of 5 worlds 3 are clean; the others count as 300 steps, whose median is 200."""
    _, rows = told("--worlds", "5", "--steps", "300", "--only", "type1", "neural")
    mean = interval(np.array([5, 1, 4, 5, 5.0]), np.mean)
    delivered = "{:.1f} ({:.1f} to {:.1f})".format(*mean)
    row = f"3 of 5 | 200.0 (60.0 to 300.0) | 20.0 (10.0 to 80.0) | {delivered} |"
    assert rows == [f"| type1 | {row}", f"| neural | {row}"] and delivered.startswith("4.0 (")
    assert told("--worlds", "5", "--only", "type2", faults=[1])[1][0].endswith(" faults!")


def test_conditions_reach_the_runs(told, tmp_path):
    path = robot_file(tmp_path, "five")
    flags = (
        "--worlds 4 --steps 70 --robots 9 --size 30 --dust 9 4 20 --failed 0.25 "
        "--noise 2 --turn-error 5 --threads 2"
    )
    given, _ = told(*flags.split(), "--robot", str(path), "--only", "type1")
    ((scenario,), options), *_ = given
    assert options == {"record_worlds": ()}
    assert scenario.strategy == PRESETS["type1"] and scenario.engine == PlanarSettings(2)
    config = scenario.config
    arena = config.arena
    assert (arena.size, arena.dust_area_offset, arena.dust_area_size, arena.n_dust) == (
        30,
        9,
        4,
        20,
    )
    for name in ("error_distance_measure", "error_in_communication", "p_communication_break"):
        assert getattr(config.optics, name) == 2 * getattr(SwarmConfig().optics, name)
    assert config.drive.error_turn == 5 and scenario.robot_file == path
    assert (scenario.steps, scenario.task) == (70, CLEANING)
    assert len(scenario.worlds) == 4
    for world in scenario.worlds:
        assert (world.n_robots, world.failed_fraction) == (9, 0.25)
        assert world.seed == compare_policies.FRESH > 2**31
    (default_scenario,), _ = told("--worlds", "4", "--only", "type1")[0][0]
    assert default_scenario.config == SwarmConfig()
