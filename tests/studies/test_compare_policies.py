"""The table of learned and other strategies, with runs that are pretended."""

import sys

import compare_policies
import numpy as np
import pytest
from support.robots import robot_file

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.intervals import interval

OUTCOMES = [
    Measures(5, 5, 30, 9.0, 120),
    Measures(1, 2, 10, 9.0, None),
    Measures(4, 4, 80, 9.0, None),
    Measures(5, 5, 20, 9.0, 60),
    Measures(5, 5, 11, 9.0, 200),
]
"""Outcomes of the worlds of each run, of which three are clean."""


@pytest.fixture
def runs(monkeypatch):
    """Return the runs that are begun, which are pretended."""
    runs = []

    class PretendedRun:
        faults = ()

        def __init__(self, scenario, **options):
            self.scenario = scenario
            self.options = options
            self._steps_left = 3
            runs.append(self)

        @property
        def is_over(self):
            return self._steps_left == 0

        def advance(self):
            self._steps_left -= 1

        def measures(self, world):
            assert self.is_over
            return OUTCOMES[world]

    monkeypatch.setattr(compare_policies, "Run", PretendedRun)
    return runs


@pytest.fixture
def table(runs, monkeypatch, capsys):
    """Return a function that runs the tool, and returns the rows of its table."""

    def table(*flags):
        monkeypatch.setattr(sys, "argv", ["compare_policies.py", *flags])
        compare_policies.main()
        _, _, *rows = capsys.readouterr().out.splitlines()
        return rows

    return table


def test_a_row_by_hand(table):
    """Worlds that are not clean count as 300 steps, whose median is 200."""
    rows = table("--worlds", "5", "--steps", "300", "--only", "type1", "neural")
    mean, low, high = interval(np.array([5, 1, 4, 5, 5.0]), np.mean)
    assert mean == 4.0
    cells = (
        "3 of 5",
        "200.0 (60.0 to 300.0)",
        "20.0 (10.0 to 80.0)",
        f"{mean:.1f} ({low:.1f} to {high:.1f})",
    )
    expected = " | ".join(cells)
    assert rows == [f"| type1 | {expected} |", f"| neural | {expected} |"]


def test_a_row_with_faults_says_so(table, monkeypatch):
    monkeypatch.setattr(compare_policies.Run, "faults", [1])
    (row,) = table("--worlds", "5", "--only", "type2")
    assert row.endswith(" faults!")


class TestConditions:
    def test_flags_reach_the_runs(self, table, runs, tmp_path):
        path = robot_file(tmp_path, "five")
        flags = (
            "--worlds 4 --steps 70 --robots 9 --size 30 --dust 9 4 20 --failed 0.25 "
            "--noise 2 --turn-error 5 --threads 2 --only type1"
        )
        table(*flags.split(), "--robot", str(path))
        (run,) = runs
        assert run.options == {"record_worlds": ()}

        scenario = run.scenario
        assert scenario.strategy == PRESETS["type1"]
        assert scenario.task == CLEANING
        assert scenario.engine == PlanarSettings(2)
        assert scenario.robot_file == path
        assert scenario.steps == 70
        assert scenario.config.drive.error_turn == 5
        arena = scenario.config.arena
        assert (arena.size, arena.n_dust) == (30, 20)
        assert (arena.dust_area_offset, arena.dust_area_size) == (9, 4)
        for name in ("error_distance_measure", "error_in_communication", "p_communication_break"):
            optics = scenario.config.optics
            assert getattr(optics, name) == 2 * getattr(SwarmConfig().optics, name)

        assert len(scenario.worlds) == 4
        for world in scenario.worlds:
            assert (world.n_robots, world.failed_fraction) == (9, 0.25)
            assert world.seed == compare_policies.FRESH > 2**31

    def test_they_are_the_default_ones_without_flags(self, table, runs):
        table("--worlds", "4", "--only", "type1")
        (run,) = runs
        assert run.scenario.config == SwarmConfig()
