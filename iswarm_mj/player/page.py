"""The page: a server on this machine alone, threads that simulate the swarm and the bench, and one that draws."""

import io
import math
import threading
import time
from contextlib import redirect_stdout
from typing import Any

import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.robot_file import as_robot_file
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.output import shapes
from iswarm_mj.player import view as look
from iswarm_mj.player.panel import GRIPPER, THEME, Panel
from iswarm_mj.player.scenario import Scenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.view import SwarmView
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.robot import RobotFile

HOST, PORT = "127.0.0.1", 8080
"""Where the page is; the first port from there on that is free."""
_NARROW = """<style>@media (max-width: 36em) {
#root { height: 45% !important; }
#root .mantine-Paper-root[style*="fixed"] { width: 100% !important; max-height: 55% !important; }
#root [style*="20em"] { width: 100% !important; }
}</style>"""
"""In a narrow window the panel lies beneath the arena, and not on it."""
FRAME_S, PANEL_S = 1 / 25, 0.3
"""Between two drawings of the swarm, and of the panel [s]."""


def open_server(port: int = PORT) -> Any:
    """Return a viser server that listens to this machine alone, and that nobody can ask to be reached from outside."""
    import viser

    class Server(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> str | None:
            """Refuse, as viser would offer the page to the internet."""
            return None

    with redirect_stdout(io.StringIO()):  # it prints its address in a frame
        return Server(host=HOST, port=port, label="iswarm play", verbose=False)


def close_server(server: Any) -> None:
    """End a server."""
    with redirect_stdout(io.StringIO()):  # it prints that it stopped
        server.stop()


class Page:
    """A session in the browser; a notebook shows it, a script calls `wait`, and `close` ends it.

    Attributes:
        session: that is shown.
        url: of the page.
    """

    def __init__(self, session: Session, port: int = PORT):
        """Open the page."""
        self.session, self._server = session, open_server(port)
        self.url = f"http://{HOST}:{self._server.get_port()}"
        session.shown = 0.0
        server = self._server
        server.gui.configure_theme(**THEME)
        server.gui.add_html(_NARROW)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(380)
        look.light(server.scene)
        look.aim(server.initial_camera, session.scene)
        self._panel = Panel(server, session)
        self._panel.looks.on_update(lambda _: self._turn_to(self._panel.looks.value))
        self._panel.rebuild()
        self._version, self._time, self._panel_at = session.version, time.monotonic(), -math.inf
        server.scene.on_click()(self._clicked)
        server.on_client_connect(self._connected)
        self._error: BaseException | None = None
        self._stop = threading.Event()
        works = session.work, self._panel.bench.work, self._tick
        self._threads = [threading.Thread(target=self._loop, args=(work,), daemon=True) for work in works]
        for thread in self._threads:
            thread.start()

    def _loop(self, work: Any) -> None:
        try:
            while not self._stop.is_set():
                if not work():
                    time.sleep(0.005)
        except BaseException as error:
            self._error = error
            self._stop.set()

    def wait(self) -> None:
        """Serve until an exception, such as that of Ctrl-C, then close; raise what ended the simulation."""
        try:
            while not self._stop.wait(0.2):
                pass
        finally:
            self.close()
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """End the session, complete its recording, and close the page."""
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self.session.stop_recording()
        close_server(self._server)

    def _repr_html_(self) -> str:
        """The page within a notebook on this machine."""
        return f'<iframe src="{self.url}" width="100%" height="640" style="border:none"></iframe>'

    def _tick(self) -> bool:
        """Draw what is due; return whether the next drawing is due, too."""
        now = time.monotonic()
        if now - self._time >= FRAME_S:
            elapsed, self._time = now - self._time, now
            with self.session.lock:
                self._draw(now, elapsed)
        return False

    def _draw(self, now: float, elapsed: float) -> None:
        session = self.session
        if session.version != self._version:
            self._version = session.version
            before, view = self._panel.view, SwarmView(self._server.scene, session.scene)
            view.by, view.shows, view.root.visible = before.by, before.shows, not self._panel.bench.root.visible
            self._panel.view = view
            session.shown = 0.0
            self._panel.rebuild()
        past = list(session.snapshots)
        latest = past[-1].step
        speed = min(self._panel.speed, session.rate) if session.is_playing else self._panel.speed
        session.shown = min(latest, max(session.shown + elapsed * speed, latest - 3))
        past = [one for one in past if one.step < session.shown + 1]
        share = session.shown - past[-1].step + 1
        with self._server.atomic():
            self._panel.view.show([one.frames for one in past], share, past[-1].energy)
        while not session.messages.empty():
            text = session.messages.get()
            for client in self._server.get_clients().values():
                client.add_notification("Not possible", text, color="red", auto_close_seconds=10)
            self._panel.synchronise()
        if self._panel.bench.root.visible:
            self._panel.bench.show()
        if now - self._panel_at > PANEL_S:
            self._panel_at = now
            self._panel.update()

    def _turn_to(self, shown: str) -> None:
        """Show the swarm or the bench, and let all browsers look at it."""
        is_bench = shown == GRIPPER
        self._panel.bench.turn(is_bench)
        self._panel.view.root.visible = not is_bench
        look.aim(self._server.initial_camera, self.session.scene, is_low=is_bench)
        for client in self._server.get_clients().values():
            self._aim(client)

    def _connected(self, client: Any) -> None:
        """Let a browser look at all of the arena, again when its window changes its shape."""
        aspect = 0.0

        @client.camera.on_update
        def _(camera: Any) -> None:
            nonlocal aspect
            if camera.aspect != aspect:
                aspect = camera.aspect
                self._aim(client)

    def _aim(self, client: Any) -> None:
        """Let a browser look at what is shown, all of it."""
        look.aim(client.camera, self.session.scene, client.camera.aspect, self._panel.bench.root.visible)

    def _clicked(self, event: Any) -> None:
        """Find the place on the robots' tops that was clicked on."""
        origin, way = np.array(event.ray_origin), np.array(event.ray_direction)
        scene = self.session.scene
        length, height = scene.length * shapes.MILLIMETRES, scene.height * shapes.MILLIMETRES
        if way[2] < 0 and self._panel.view.root.visible:
            x, y, _ = origin + (height / 2 - origin[2]) / way[2] * way
            self._panel.clicked(float(x), float(y), 0.8 * length)


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
        strategy: a genome, or see `strategy.base.Strategy`; by default the paper's of type 1.
        task: see `tasks.base.Task`; cleaning by default.
        robots: their number; by default that of the genome.
        seed: of all random numbers.
        engine: `MujocoSettings()` by default.
        robot_file: MJCF file of the robots, or of each kind (`RobotFile`), by default `models/robot.xml`.
        port: where the page is, on this machine alone; the first one from there on that is free.

    Raises:
        UserError: settings that do not fit each other.
    """
    scenario = Scenario(
        config or SwarmConfig(),
        strategy=TYPE1 if strategy is None else strategy,
        task=CLEANING if task is None else task,
        robots=robots,
        seed=seed,
        engine=engine or MujocoSettings(),
        robot_file=as_robot_file(robot_file),
    )
    return Page(Session(scenario), port)
