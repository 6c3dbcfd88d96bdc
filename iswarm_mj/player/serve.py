"""The page from the command line, from Python and in notebooks."""

import webbrowser
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.player.changes import Change
from iswarm_mj.player.page import PORT, Page
from iswarm_mj.player.scenario import Scenario
from iswarm_mj.player.session import Session
from iswarm_mj.strategy.genome import TYPE1, Genome
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.progress import waiting


def serve(scenario: Scenario, changes: Sequence[Change], out: Path, port: int, is_opened: bool) -> None:
    """Show a scenario until an exception, such as that of Ctrl-C.

    Args:
        scenario: of the run.
        changes: to be made in it.
        out: directory for recordings.
        port: where the page is; the first one from there on that is free.
        is_opened: open the page in the browser, where there is one.

    Raises:
        UserError: settings that do not fit each other.
    """
    with waiting("placing the robots"):
        session = Session(scenario, changes, out)
    page = Page(session, port)
    session.is_playing = True
    try:
        print(f"{page.url} shows the swarm, on this machine alone; Ctrl-C ends it.", flush=True)
        if is_opened:
            webbrowser.open(page.url)
        page.wait()
    finally:
        page.close()


class Played:
    """A page that a notebook or a script opened.

    Attributes:
        session: the run, and what can be done with it.
        url: of the page.
    """

    def __init__(self, page: Page):
        self._page, self.session, self.url = page, page.session, page.url

    def wait(self) -> None:
        """Serve until Ctrl-C."""
        try:
            self._page.wait()
        finally:
            self.close()

    def close(self) -> None:
        """End the run and close the page."""
        self._page.close()

    def _repr_html_(self) -> str:
        """The page within a notebook on this machine."""
        return f'<iframe src="{escape(self.url)}" width="100%" height="640" style="border:none"></iframe>'


def play(
    config: SwarmConfig | None = None,
    *,
    strategy: Any = None,
    task: Any = None,
    robots: int | None = None,
    seed: int = 0,
    engine: EngineSettings | None = None,
    robot_file: Path | str | None = None,
    port: int = PORT,
) -> Played:
    """Show a swarm in the browser while it runs, and change it there; see docs/play.md.

    In a notebook the returned object shows the page; a script calls its `wait`.

    Args:
        config: of the run.
        strategy: a genome, or see `strategy.protocol.Strategy`; by default the paper's of type 1.
        task: see `tasks.protocol.Task`; cleaning by default.
        robots: their number; by default that of the genome.
        seed: of all random numbers.
        engine: `MujocoSettings()` by default.
        robot_file: MJCF file of the robots, by default `models/robot.xml`.
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
        None if robot_file is None else Path(robot_file),
    )
    return Played(Page(Session(scenario), port))
