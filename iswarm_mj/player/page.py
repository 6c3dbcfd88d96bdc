"""The page: a server on this machine alone, and threads that simulate and draw."""

import io
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.output import shapes
from iswarm_mj.player.bench import CALIBRATIONS, calibrations_of
from iswarm_mj.player.bench_settings import BenchSettings
from iswarm_mj.player.guard import Guard
from iswarm_mj.player.number_boxes import let_number_boxes_wait
from iswarm_mj.player.panel import GRIPPER, THEME, Panel
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.view import SwarmView, aim, light
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.constraints import check, check_kind, is_whole
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.extras import naming_extras

PORT = 8080
"""First port that is tried."""
_NARROW = """<style>@media (max-width: 36em) {
#root { height: 45% !important; }
#root .mantine-Paper-root[style*="fixed"] { width: 100% !important; max-height: 55% !important; }
#root [style*="20em"] { width: 100% !important; }
}</style>"""
"""Style by which the panel lies beneath the arena, and not on it, in a narrow window."""
MOST_MESSAGES = 3
"""Largest number of errors that are shown at a time, the latest ones."""
LAST_PORT = 64_535
"""Last port to begin with: viser tries 1000, and would wait without end beyond 65535."""
FRAME_S = 1 / 25
"""Time between two drawings of the swarm [s]."""
PANEL_S = 0.3
"""Time between two drawings of the panel [s]."""
IDLE_S = 0.005
"""Pause of a thread that has nothing to do [s]."""
CLOSE_S = 2.0
"""Time that `Page.close` waits for the end of a control step [s]."""
_MOST_STEPS_BEHIND = 3
"""Largest number of control steps between what is drawn and the latest one."""
_RADIUS_OF_CLICK = 0.8
"""Largest distance between a click and the robot that is meant, in lengths of a robot."""


class _Followed(NamedTuple):
    """Robot that all cameras follow, and where it was."""

    robot: int
    place: np.ndarray
    """x, y [mm]."""


def open_server(port: int = PORT) -> Any:
    """Return a viser server that listens to this machine alone, for those who know its `url`.

    Args:
        port: first port that is tried; the server takes the next free one.

    Raises:
        UserError: the port is out of range, or viser has a version that cannot be guarded.
    """
    is_port = is_whole(port) and 1024 <= port <= LAST_PORT
    check("port", port, f"a whole number from 1024 to {LAST_PORT}", is_port)
    with naming_extras():
        import viser  # which takes a second

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
        session: session that is shown.
        url: address of the page; whoever knows it can use the page, on this machine alone.
    """

    def __init__(
        self,
        session: Session,
        port: int = PORT,
        calibrations: Mapping[str, BenchSettings] = CALIBRATIONS,
    ):
        """Open the page.

        Args:
            session: session that is shown.
            port: first port that is tried.
            calibrations: settings of the bench that can be chosen, by their names.

        Raises:
            UserError: see `open_server`.
        """
        self.session = session
        self._server = open_server(port)
        self.url = self._server.url
        session.shown = 0.0

        # What browsers show.
        server = self._server
        server.gui.configure_theme(**THEME)
        server.gui.add_html(_NARROW)
        let_number_boxes_wait(server)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(380)
        light(server.scene)
        aim(server.initial_camera, session.scene)
        self._panel = Panel(server, session, calibrations)
        self._panel.rebuild()
        self._version_of_drag: dict[int, int] = {}  # version of the session, by the browser
        self._let_robots_be_dragged()
        server.scene.on_click()(self._clicked)
        server.on_client_connect(self._connected)

        # What was drawn, and when.
        self._drawn_content = self._panel.content.value
        self._drawn_version = session.version
        self._drawn_at = time.monotonic()
        self._panel_at = -math.inf

        self._followed: _Followed | None = None

        # The threads.
        self._error: BaseException | None = None
        self._stop = threading.Event()
        self._threads = []
        for work in (session.work, self._panel.bench.work, self._tick):
            thread = threading.Thread(target=self._loop, args=(work,), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _loop(self, work: Callable[[], bool]) -> None:
        """Work until the page ends; what the work raises is shown, and does not end the page.

        Args:
            work: returns whether there was something to do.
        """
        while not self._stop.is_set():
            try:
                if not work():
                    time.sleep(IDLE_S)
            except (Exception, SystemExit) as error:
                if self.session.faults.is_new(error):
                    self.session.fail(error)
                self._stop.wait(FRAME_S)
            except BaseException as error:
                self._error = error
                self._stop.set()

    def wait(self) -> None:
        """Serve until an exception, such as that of Ctrl-C, then close.

        Raises:
            BaseException: what ended the simulation.
        """
        try:
            while not self._stop.wait(0.2):
                pass
        finally:
            self.close()
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """End the session, complete its recording, and close the page; wait for no compiler."""
        self._stop.set()

        # A thread that compiles or takes a long step goes on. It ends with the process, or after
        # its step.
        end = time.monotonic() + CLOSE_S
        for thread in self._threads:
            thread.join(max(0.0, end - time.monotonic()))

        self._panel.sweeps.close()
        self.session.stop_recording()
        close_server(self._server)

    def _repr_html_(self) -> str:
        """Return HTML that shows the page within a notebook on this machine."""
        style = "border:none"
        return f'<iframe src="{self.url}" width="100%" height="640" style="{style}"></iframe>'

    def _tick(self) -> bool:
        """Draw what is due; return False, as the next drawing is never due at once."""
        now = time.monotonic()
        elapsed = now - self._drawn_at
        if elapsed >= FRAME_S:
            self._drawn_at = now
            with self.session.lock:
                self._draw(now, elapsed)
        return False

    def _draw(self, now: float, elapsed: float) -> None:
        """Draw what is due, each part on its own: where one fails, the others go on.

        Args:
            now: time [s].
            elapsed: time since the last drawing [s].
        """
        parts = [
            self._begin_view,
            self._turn,
            partial(self._draw_swarm, elapsed),
            self._show_messages,
        ]
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
        session = self.session
        before = self._panel.view
        if session.version == self._drawn_version:
            before.follow(session.scene)
            return
        self._drawn_version = session.version
        session.shown = 0.0
        view = SwarmView(self._server.scene, session.scene)
        view.colour_by = before.colour_by
        view.shows = before.shows
        view.root.visible = not self._panel.bench.root.visible
        self._panel.view = view
        self._panel.rebuild()
        self._let_robots_be_dragged()

    def _draw_swarm(self, elapsed: float) -> None:
        """Draw the swarm between two control steps.

        Args:
            elapsed: time since the last drawing [s].
        """
        session = self.session
        snapshots = list(session.snapshots)
        latest = snapshots[-1].step

        # What is shown follows the latest control step at the speed that is wanted and possible.
        speed = self._panel.speed
        if session.is_playing:
            speed = min(speed, session.rate)
        shown = session.shown + elapsed * speed
        session.shown = min(latest, max(shown, latest - _MOST_STEPS_BEHIND))

        # The last of these is the one after the time that is shown.
        past = [snapshot for snapshot in snapshots if snapshot.step < session.shown + 1]
        after = past[-1]
        share = session.shown - after.step + 1
        with self._server.atomic():
            self._panel.view.show([snapshot.frames for snapshot in past], share, after.energy)
            self._follow()

    def _follow(self) -> None:
        """Let all browsers move along with the selected robot, if this is wished."""
        view = self._panel.view
        robot = view.selected if self._panel.follows else None
        before, self._followed = self._followed, None
        if robot is None:
            return
        place = view.place_of(robot)
        self._followed = _Followed(robot, place)
        for client in self._server.get_clients().values():
            # At first the robot comes to the middle, and then each camera moves as it does.
            start = np.array(client.camera.look_at)[:2]
            if before is not None and before.robot == robot:
                start = before.place
            position = np.array(client.camera.position, float)
            position[:2] += place - start
            client.camera.position = tuple(position)

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
        """Show the swarm or the bench, whichever is chosen, and let all browsers look at it."""
        chosen = self._panel.content.value
        if chosen == self._drawn_content:
            return
        self._drawn_content = chosen
        is_bench = chosen == GRIPPER
        self._panel.bench.show_or_hide(is_shown=is_bench)
        self._panel.view.root.visible = not is_bench
        aim(self._server.initial_camera, self.session.scene, is_low=is_bench)
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
        is_bench = self._panel.bench.root.visible
        aim(client.camera, self.session.scene, client.camera.aspect, is_low=is_bench)

    def _let_robots_be_dragged(self) -> None:
        """Move a robot of the present view to where somebody drags its hull or its front."""
        for node in self._panel.view.nodes.values():
            node.on_drag("left")(self._dragged)

    def _dragged(self, event: Any) -> None:
        """Put a robot where a drag ends; the place is the one on the floor behind the pointer.

        A drag that outlives its run or its browser, for which viser ends it, has no effect.
        """
        session = self.session
        if event.phase == "start":
            self._version_of_drag[event.client_id] = session.version
        if event.phase != "end" or event.instance_index is None:
            return
        version = self._version_of_drag.pop(event.client_id, None)
        is_connected = event.client_id in self._server.get_clients()
        if version != session.version or not is_connected:
            return
        camera = np.array(event.client.camera.position, float)
        ray = np.array(event.end_position, float) - camera
        half_height = session.scene.height * shapes.MILLIMETRES / 2
        place = _place_of_ray(camera, ray, half_height)
        if place is None:
            return
        try:
            self._panel.dragged(int(event.instance_index), *place)
        except UserError as error:
            session.messages.put(str(error))

    def _clicked(self, event: Any) -> None:
        """Act on a click on the arena; impossible rays hit nothing."""
        if not self._panel.view.root.visible:
            return
        scene = self.session.scene
        height = scene.height * shapes.MILLIMETRES
        place = _place_of_ray(event.ray_origin, event.ray_direction, height / 2)
        if place is None:
            return
        radius = _RADIUS_OF_CLICK * scene.length * shapes.MILLIMETRES
        try:
            self._panel.clicked(*place, radius)
        except UserError as error:
            self.session.messages.put(str(error))


def _place_of_ray(origin: Any, direction: Any, height: float) -> tuple[float, float] | None:
    """Return the place x, y where a ray from above passes a height; None if it does not.

    Args:
        origin: point of the ray, which a browser has sent.
        direction: direction of the ray, which a browser has sent.
        height: z of the place, in units of the origin.
    """
    try:
        start, ahead = np.array([origin, direction], float)
        _, _, slope = ahead
        start_x, start_y, start_z = start
    except (TypeError, ValueError):
        return None
    if not slope < 0:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        distance = (height - start_z) / slope
        x = start_x + distance * ahead[0]
        y = start_y + distance * ahead[1]
    if not np.isfinite([x, y]).all():
        return None
    return float(x), float(y)


def play(scenario: Scenario, *, port: int = PORT, fits: Sequence[Any] = ()) -> Page:
    """Show a swarm in the browser while it runs, and change it there; see docs/play.md.

    In a notebook the returned object shows the page; a script calls its `wait`.

    Args:
        scenario: what is simulated, in one world.
        port: where the page is, on this machine alone; the first one from there on that is free.
        fits: calibrations that the tab Gripper offers and of which it begins with the first: each
            a `Fit` of `iswarm_mj.fit`, `GraspSettings`, or the path of a fit.toml.

    Raises:
        UserError: settings that do not fit each other, or that the page does not use.
    """
    check_kind("scenario", scenario, Scenario)
    calibrations = calibrations_of(fits)
    return Page(Session(PageScenario.of(scenario)), port, calibrations)
