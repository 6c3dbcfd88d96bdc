"""Drives a page as a browser does, without one: messages arrive in viser's event loop."""

import asyncio
import time
from types import SimpleNamespace

from viser._messages import GuiUpdateMessage

SECONDS = 240
"""After which a test that waits has failed, unless the session goes on."""
BROWSER = 0
"""Number of the browser."""


def wait(holds):
    """Wait until something holds."""
    end = time.monotonic() + SECONDS
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


def wait_for(session, holds):
    """Wait until something holds, for as long as the session works on what was posted."""
    progress, end = None, 0.0
    while not holds():
        latest = (session.version, session.step, len(session.inbox))
        if latest != progress:
            progress, end = latest, time.monotonic() + SECONDS
        assert time.monotonic() < end, f"the session stands still at {progress}"
        time.sleep(0.05)


class Browser:
    """A browser that shows a page.

    Attributes:
        notifications: texts that were shown.
        files: contents of files that were offered.
    """

    def __init__(self, page):
        self.page = page
        self.notifications = []
        self.files = []
        self.camera = SimpleNamespace(aspect=1.5, fov=1.0, position=(0, 0, 1), look_at=(0, 0, 0))
        page._server._connected_clients[BROWSER] = self

    def close(self):
        self.page._server._connected_clients.pop(BROWSER)

    def add_notification(self, title, body, **_):
        self.notifications.append(body)

    def send_file_download(self, name, content):
        self.files.append(content)

    @property
    def inputs(self):
        """Controls of the page by the identifiers of the inputs."""
        return self.page._panel._inputs.controls()

    def find(self, label):
        """Return the identifier of an input; of several the last one."""
        return [uuid for uuid, control in self.inputs.items() if control.label == label][-1]

    def handle(self, uuid):
        return self.page._server.gui._gui_input_handle_from_uuid[uuid]

    def value(self, label):
        """Return the value that an input shows."""
        return self.handle(self.find(label)).value

    def send(self, uuid, updates):
        """Send a message; an exception of the handler is one of this call."""
        gui = self.page._server.gui
        arrived = gui._websock_interface._handle_incoming_message(
            BROWSER, GuiUpdateMessage(uuid, updates)
        )
        return asyncio.run_coroutine_threadsafe(arrived, gui._event_loop).result(SECONDS)

    def set(self, label, value):
        """Give an input a value, or click on a button."""
        self.send(self.find(label), {"value": value})
