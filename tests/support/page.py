"""A page without a window: what a browser would send, and what it would show.

Tests look at private parts of pages and of viser in this module alone.
"""

import asyncio
import time
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
from viser._messages import GuiUpdateMessage

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player.bench import CALIBRATIONS
from iswarm_mj.player.page import Page
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.simulation.scenario import Scenario

CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))
"""Configuration of the swarms that pages show: a small arena with few balls."""
SCENARIO = Scenario(CONFIG, robots=20, engine=PlanarSettings(), seed=3)
"""Scenario of most pages."""
SECONDS = 240
"""Time after which a test that waits has failed, unless the session goes on [s]."""
BROWSER = 0
"""Number of the browser."""


def wait(holds, seconds=SECONDS):
    """Wait until a function returns something true; fail after some seconds."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


def wait_for(session, holds):
    """Wait until a function returns something true, while the session works on what was posted."""
    progress = None
    end = 0.0
    while not holds():
        latest = (session.version, session.step, len(session.inbox))
        if latest != progress:
            progress = latest
            end = time.monotonic() + SECONDS
        assert time.monotonic() < end, f"the session stands still at {progress}"
        time.sleep(0.05)


@contextmanager
def opened(scenario=SCENARIO, *, port, calibrations=CALIBRATIONS, **settings):
    """Open the page of a scenario, and close it after the block.

    Args:
        scenario: scenario of the page.
        port: first port that is tried.
        calibrations: settings of the bench that can be chosen, by their names.
        settings: further arguments of its `Session`, such as the directory `out` of recordings.
    """
    page = Page(Session(PageScenario.of(scenario), **settings), port, calibrations)
    try:
        yield page
    finally:
        page.close()


def node_of(server, name):
    """Return a node of the scene of a server of viser by its path, such as `/swarm/balls`."""
    return server.scene._handle_from_node_name[name]


# What the page does by itself.


def session_thread(page):
    """Return the thread that works on the session of a page."""
    return page._threads[0]


def stop_threads(page):
    """End the threads of a page, so that a test does their work."""
    page._stop.set()
    for thread in page._threads:
        thread.join()


def is_ended(page):
    """Return whether the page has ended by itself."""
    return page._stop.is_set()


def assert_serves(page):
    """Assert that no exception has ended the page, nor one of its threads."""
    assert_no_error(page)
    assert all(thread.is_alive() for thread in page._threads)


def assert_no_error(page):
    """Assert that no exception has ended the page."""
    assert page._error is None


def draw(page, elapsed=0.04):
    """Draw the swarm and the panel.

    Args:
        page: page whose threads have ended.
        elapsed: time since the last drawing [s].
    """
    page._panel_at = -np.inf
    page._draw(0.0, elapsed)


def work(page):
    """Do what was posted to the session of a page whose threads have ended, and draw it."""
    page.session.work()
    draw(page)


def selected_robot(page):
    """Return the robot that has a ring; None if there is none."""
    return page._panel.view.selected


def select(page, robot):
    """Put the ring around a robot."""
    page._panel.view.selected = robot


def bench(page):
    """Return the gripper's bench."""
    return page._panel.bench


def inputs(page):
    """Return the inputs of a page."""
    return page._panel._inputs


# What browsers do, in whatever way they are connected.


def clients(page):
    """Return the browsers that are connected."""
    return list(page._server.get_clients().values())


def disconnect_all(page):
    """End the connections of all browsers, which connect again."""
    page._server._websock_server.disconnect_all_clients()


def is_held_back(page):
    """Return whether messages of the page wait, so that browsers do not see it change."""
    return page._server._websock_server.get_message_buffer().atomic_counter > 0


def send_ray(page, origin, direction):
    """Click on the arena with a ray, as a browser sends it [mm]."""
    page._clicked(SimpleNamespace(ray_origin=origin, ray_direction=direction))


def send_drag(page, robot, camera, pointer, phase="end"):
    """Drag a robot, as a browser sends it.

    Args:
        page: page that is shown.
        robot: number of the robot.
        camera: place of the camera [mm].
        pointer: place of the pointer, on any plane between camera and floor [mm].
        phase: "start", "update" or "end".
    """
    client = SimpleNamespace(camera=SimpleNamespace(position=camera))
    page._dragged(
        SimpleNamespace(
            client=client,
            client_id=BROWSER,
            phase=phase,
            instance_index=robot,
            end_position=pointer,
        )
    )


def click_with(page, effect, x, y):
    """Click on a place of the arena [mm] after choosing what a click can do."""
    page._panel.click = effect
    page._panel.clicked(x, y, 1.0)


def drawn_lines(page):
    """Return the names of the lines and arrows that are drawn."""
    return page._panel.view.shows


def drawn_place(page, robot):
    """Return where a robot is drawn [mm]."""
    return page._panel.view.place_of(robot)


class Browser:
    """A browser that shows a page, without a window.

    Attributes:
        page: page that is shown.
        notifications: texts that were shown.
        files: contents of files that were offered.
    """

    def __init__(self, page):
        self.page = page
        self.notifications = []
        self.files = []
        self.camera = SimpleNamespace(aspect=1.5, fov=1.0, position=(0, 0, 1), look_at=(0, 0, 0))
        self.open()

    def open(self):
        """Connect to the page."""
        self.page._server._connected_clients[BROWSER] = self

    def close(self):
        """Leave the page."""
        self.page._server._connected_clients.pop(BROWSER)

    # What viser calls.

    def add_notification(self, title, body, **_):
        """Show a text."""
        self.notifications.append(body)

    def send_file_download(self, name, content, save_immediately):
        """Save a file."""
        assert save_immediately  # otherwise it takes a second click
        self.files.append(content)

    # What the page shows.

    @property
    def _gui(self):
        """Elements of the page, of viser."""
        return self.page._server.gui

    @property
    def _elements(self):
        """All that the panel has, of viser."""
        containers = list(self._gui._container_handle_from_uuid.values())
        return [element for each in containers for element in list(each._children.values())]

    @property
    def text(self):
        """All texts of the panel, one after the other, in Markdown or HTML."""
        texts = [getattr(element, "content", "") for element in self._elements]
        return "\n".join(texts)

    def plot(self, title):
        """Return the arrays that a plot shows."""
        (plot,) = [element for element in self._elements if getattr(element, "title", "") == title]
        return plot.data

    @property
    def inputs(self):
        """Controls of the page by the identifiers of their inputs."""
        return inputs(self.page).controls()

    @property
    def shown_inputs(self):
        """Identifiers of the inputs that browsers show."""
        return set(self._gui._gui_input_handle_from_uuid)

    def find(self, name):
        """Return the identifier of an input by the name or label of its control; the last one."""
        return [
            uuid for uuid, control in self.inputs.items() if name in (control.name, control.label)
        ][-1]

    def handle(self, uuid):
        """Return the input of viser that has an identifier."""
        return self._gui._gui_input_handle_from_uuid[uuid]

    def properties(self, uuid):
        """Return a copy of all that viser knows of an input, by the names of attributes."""
        return dict(vars(self.handle(uuid)._impl))

    def value(self, name):
        """Return the value that an input shows."""
        return self.handle(self.find(name)).value

    def note(self, name):
        """Return the HTML of the sentence beneath an input; empty where there is none."""
        note = inputs(self.page)._notes.get(self.find(name))
        return "" if note is None else note.content

    def node(self, name):
        """Return a node of the scene by its path."""
        return node_of(self.page._server, name)

    # What a user does.

    def send(self, uuid, updates):
        """Send a message that changes properties of an input.

        An exception of the page's handler is one of this call.
        """
        connection = self._gui._websock_interface
        message = GuiUpdateMessage(uuid, updates)
        arrived = connection._handle_incoming_message(BROWSER, message)
        return asyncio.run_coroutine_threadsafe(arrived, self._gui._event_loop).result(SECONDS)

    def set(self, name, value):
        """Give an input a value."""
        self.send(self.find(name), {"value": value})

    def press(self, name):
        """Click on a button."""
        self.set(name, True)

    def click(self, x, y):
        """Click on a place of the arena [mm], from above."""
        send_ray(self.page, origin=(x, y, 90.0), direction=(0.0, 0.0, -1.0))
