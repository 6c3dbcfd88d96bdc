"""The page from Python and in notebooks."""

from typing import Any

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.robot_file import as_robot_file
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.player.page import PORT, Page
from iswarm_mj.player.scenario import Scenario
from iswarm_mj.player.session import Session
from iswarm_mj.strategy.genome import TYPE1, Genome
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.robot import RobotFile


def play(
    config: SwarmConfig | None = None,
    *,
    strategy: Any = None,
    task: Any = None,
    robots: int | None = None,
    seed: int = 0,
    engine: EngineSettings | None = None,
    robot_file: RobotFile = None,
    port: int = PORT,
) -> Page:
    """Show a swarm in the browser while it runs, and change it there; see docs/play.md.

    In a notebook the returned object shows the page; a script calls its `wait`.

    Args:
        config: of the run.
        strategy: a genome, or see `strategy.protocol.Strategy`; by default the paper's of type 1.
        task: see `tasks.protocol.Task`; cleaning by default.
        robots: their number; by default that of the genome.
        seed: of all random numbers.
        engine: `MujocoSettings()` by default.
        robot_file: MJCF file of the robots, or of each kind (`RobotFile`), by default `models/robot.xml`.
        port: where the page is, on this machine alone; the first one from there on that is free.

    Raises:
        UserError: settings that do not fit each other.
    """
    is_genome = strategy is None or isinstance(strategy, Genome)
    scenario = Scenario(
        config or SwarmConfig(),
        strategy if isinstance(strategy, Genome) else TYPE1,
        None if is_genome else strategy,
        CLEANING if task is None else task,
        robots,
        seed,
        engine or MujocoSettings(),
        as_robot_file(robot_file),
    )
    return Page(Session(scenario), port)
