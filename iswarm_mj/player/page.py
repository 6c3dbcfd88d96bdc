"""The page: a server on this machine alone, threads that simulate the swarm and the bench, and one that draws."""

import io
import math
import threading
import time
from contextlib import redirect_stdout
from functools import partial
from typing import Any

import numpy as np

from iswarm_mj.output import shapes
from iswarm_mj.player import view as look
from iswarm_mj.player.guard import Guard
from iswarm_mj.player.panel import GRIPPER, THEME, Panel
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.view import SwarmView
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.constraints import check, check_kind, is_whole
from iswarm_mj.utils.errors import UserError

PORT = 8080
"""Where the page is; the first port from there on that is free."""
_NARROW = """<style>@media (max-width: 36em) {
#root { height: 45% !important; }
#root .mantine-Paper-root[style*="fixed"] { width: 100% !important; max-height: 55% !important; }
#root [style*="20em"] { width: 100% !important; }
}</style>"""
"""In a narrow window the panel lies beneath the arena, and not on it."""
MOST_MESSAGES = 3
"""Errors that are shown at a time at most, the latest ones."""
LAST_PORT = 64_535
"""Last port to begin with: viser tries 1000, and would wait without end beyond 65535."""
FRAME_S, PANEL_S = 1 / 25, 0.3
"""Between two drawings of the swarm, and of the panel [s]."""
CLOSE_S = 2.0
"""How long `Page.close` waits for the end of a control step [s]."""


def open_server(port: int = PORT) -> Any:
    """Return a viser server that listens to this machine alone, for those who know its `url`.

    Args:
        port: the first one that is tried; the server takes the next free one.

    Raises:
        UserError: the port is out of range, or viser has a version that cannot be guarded.
    """
    is_port = is_whole(port) and 1024 <= port <= LAST_PORT
    check("port", port, f"a whole number from 1024 to {LAST_PORT}", is_port)
    import viser

    class Server(viser.ViserServer):
        url: str

        def request_share_url(self, verbose: bool = True) -> str | None:
            """Refuse, as viser would offer the page to the internet."""
            return None

    guard = Guard()
    with guard.start(), redirect_stdout(io.StringIO()):  # it prints its address in a frame
        server = Server(host=guard.host, port=port, label="iswarm play", verbose=False)
    try:
        guard.check(server)
    except BaseException:
        close_server(server)
        raise
    server.url = f"http://{guard.host}:{server.get_port()}/{guard.secret}/"
    return server


def close_server(server: Any) -> None:
    """End a server."""
    with redirect_stdout(io.StringIO()):  # it prints that it stopped
        server.stop()


class Page:
    """A session in the browser; a notebook shows it, a script calls `wait`, and `close` ends it.

    Attributes:
        session: that is shown.
        url: address of the page; whoever knows it can use the page, on this machine alone.
    """

    def __init__(self, session: Session, port: int = PORT):
        """Open the page."""
        self.session, self._server = session, open_server(port)
        self.url = self._server.url
        session.shown = 0.0
        server = self._server
        server.gui.configure_theme(**THEME)
        server.gui.add_html(_NARROW)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(380)
        look.light(server.scene)
        look.aim(server.initial_camera, session.scene)
        self._panel = Panel(server, session)
        self._panel.rebuild()
        self._shown = self._panel.looks.value
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
        """Work until the page ends; what the work raises is shown, and does not end the page."""
        while not self._stop.is_set():
            try:
                if not work():
                    time.sleep(0.005)
            except (Exception, SystemExit) as error:
                if self.session.faults.is_new(error):
                    self.session.fail(error)
                self._stop.wait(FRAME_S)
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
        """End the session, complete its recording, and close the page; do not wait for a compiler."""
        self._stop.set()

        # A thread that compiles or takes a long step goes on; it ends with the process, or after its step.
        end = time.monotonic() + CLOSE_S
        for thread in self._threads:
            thread.join(max(0.0, end - time.monotonic()))

        self.session.stop_recording()
        close_server(self._server)

    def _repr_html_(self) -> str:
        """Return HTML that shows the page within a notebook on this machine."""
        style = "border:none"
        return f'<iframe src="{self.url}" width="100%" height="640" style="{style}"></iframe>'

    def _tick(self) -> bool:
        """Draw what is due; return whether the next drawing is due, too."""
        now = time.monotonic()
        if now - self._time >= FRAME_S:
            elapsed, self._time = now - self._time, now
            with self.session.lock:
                self._draw(now, elapsed)
        return False

    def _draw(self, now: float, elapsed: float) -> None:
        """Draw what is due, each part on its own: where one fails, the others go on.

        Args:
            now: time [s].
            elapsed: since the last drawing [s].
        """
        parts = [self._begin_view, self._turn, partial(self._draw_swarm, elapsed), self._show_messages]
        if self._panel.bench.root.visible:
            parts.append(self._panel.bench.show)
        if now - self._panel_at > PANEL_S:
            self._panel_at = now
            parts.append(self._panel.update)
        for part in parts:
            try:
                part()
            except Exception as error:
                # It may fail at each drawing: it is shown once, and does not pause the run.
                if self.session.faults.is_new(error):
                    self.session.messages.put(self.session.faults.report(error))

    def _begin_view(self) -> None:
        """Make a new view after a reset, and let the present one follow changes of settings."""
        session, before = self.session, self._panel.view
        if session.version == self._version:
            before.follow(session.scene)
            return
        self._version = session.version
        session.shown = 0.0
        view = SwarmView(self._server.scene, session.scene)
        view.by = before.by
        view.shows = before.shows
        view.root.visible = not self._panel.bench.root.visible
        self._panel.view = view
        self._panel.rebuild()

    def _draw_swarm(self, elapsed: float) -> None:
        """Draw the swarm between two control steps, some seconds after the last drawing."""
        session = self.session
        past = list(session.snapshots)
        latest = past[-1].step
        speed = self._panel.speed
        if session.is_playing:
            speed = min(speed, session.rate)
        session.shown = min(latest, max(session.shown + elapsed * speed, latest - 3))
        past = [one for one in past if one.step < session.shown + 1]
        share = session.shown - past[-1].step + 1
        with self._server.atomic():
            self._panel.view.show([one.frames for one in past], share, past[-1].energy)

    def _show_messages(self) -> None:
        """Show the latest errors in all browsers, each once, and the settings that they left."""
        texts: dict[str, None] = {}
        while not self.session.messages.empty():
            texts[self.session.messages.get()] = None
        for text in [*texts][-MOST_MESSAGES:]:
            for client in self._server.get_clients().values():
                client.add_notification("Not possible", text, color="red", auto_close_seconds=10)
        if texts:
            self._panel.synchronise()

    def _turn(self) -> None:
        """Show the swarm or the bench, if somebody has chosen the other, and let all browsers look at it."""
        chosen = self._panel.looks.value
        if chosen == self._shown:
            return
        self._shown = chosen
        is_bench = chosen == GRIPPER
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
        """Find the place on the robots' tops that was clicked on; impossible rays hit nothing."""
        try:
            origin, way = np.array([event.ray_origin, event.ray_direction], float)
            _, _, slope = way
            x0, y0, z0 = origin
        except (TypeError, ValueError):
            return
        if not (slope < 0 and self._panel.view.root.visible):
            return
        scene = self.session.scene
        length, height = scene.length * shapes.MILLIMETRES, scene.height * shapes.MILLIMETRES
        with np.errstate(over="ignore", invalid="ignore"):
            distance = (height / 2 - z0) / slope
            x, y = x0 + distance * way[0], y0 + distance * way[1]
        if np.isfinite([x, y]).all():
            try:
                self._panel.clicked(float(x), float(y), 0.8 * length)
            except UserError as error:
                self.session.messages.put(str(error))


def play(scenario: Scenario, *, port: int = PORT) -> Page:
    """Show a swarm in the browser while it runs, and change it there; see docs/play.md.

    In a notebook the returned object shows the page; a script calls its `wait`.

    Args:
        scenario: what is simulated, in one world.
        port: where the page is, on this machine alone; the first one from there on that is free.

    Raises:
        UserError: settings that do not fit each other, or that the page does not use.
    """
    check_kind("scenario", scenario, Scenario)
    return Page(Session(PageScenario.of(scenario)), port)
