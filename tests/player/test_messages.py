"""Only messages that the page's own client sends pass the guard; others change and end nothing."""

import gc
import math
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pytest
from support.page import wait
from support.requests import PROTOCOL, SECONDS
from websockets.exceptions import ConnectionClosedError
from websockets.sync.client import connect

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 0.0, 9.0],
    "fov": 1.0,
    "near": 0.01,
    "far": 1000,
    "image_height": 700,
    "image_width": 1000,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 1.0, 0.0],
}
"""A camera that looks down."""
CLICK = {
    "type": "ScenePointerMessage",
    "event_type": "click",
    "ray_origin": [0.0, 0.0, 9.0],
    "ray_direction": [0.0, 0.0, -1.0],
    "screen_pos": [[0.5, 0.5]],
    "modifier": None,
}
"""A click on the middle of the arena."""
DRAG = {
    "type": "SceneNodeDragMessage",
    "phase": "end",
    "name": "/swarm/robots",
    "instance_index": 1,
    "start_position": [0.0, 0.0, 1.0],
    "start_screen_pos": [0.5, 0.5],
    "end_position": [5.0, 0.0, 1.0],
    "end_screen_pos": [0.6, 0.5],
    "button": "left",
    "modifier": None,
    "owner": "",
}
"""The end of a drag of a robot."""
EVIL = ["/tmp/evil.py:Evil"]
"""Choices that would let the page import a file."""


@dataclass
class Controls:
    """One control of each kind."""

    choice: Any
    slider: Any
    number: Any
    tick: Any
    upload: Any

    def values(self):
        """Return all that a browser might change, except what is chosen."""
        choice = self.choice
        numbers = (self.slider.value, self.number.value, self.tick.value)
        return (choice.options, choice.visible, choice.label, self.upload.value.content, *numbers)


@pytest.fixture
def controls(server):
    """The controls of the server."""
    gui = server.gui
    return Controls(
        choice=gui.add_dropdown("choice", ("red", "green", "blue")),
        slider=gui.add_slider("slider", 0.0, 10.0, 0.5, 2.0),
        number=gui.add_number("number", 3),
        tick=gui.add_checkbox("tick", False),
        upload=gui.add_upload_button("upload"),
    )


def client(url):
    """Open a websocket as the page's own client does."""
    split = urlsplit(url)
    return connect(
        f"ws://{split.netloc}{split.path.removesuffix('/')}",
        origin=f"http://{split.netloc}",
        subprotocols=[PROTOCOL],
        compression=None,
        max_size=None,
    )


def uuid_of(control):
    """Return the name that messages give a control."""
    return control._impl.uuid


def update(control, **updates):
    """Return the message that changes properties of a control."""
    return {"type": "GuiUpdateMessage", "uuid": uuid_of(control), "updates": updates}


def encode(message):
    """Return a message as the client encodes it."""
    return msgspec.msgpack.encode(message)


def send(connection, *messages):
    """Send messages, or frames of text and bytes as they are."""
    for message in messages:
        is_frame = isinstance(message, bytes | str)
        connection.send(message if is_frame else encode(message))


def upload(control):
    """Return the messages that upload a file of one byte."""
    start = {
        "type": "FileTransferStartUpload",
        "source_component_uuid": uuid_of(control),
        "transfer_uuid": "a",
        "filename": "a",
        "mime_type": "text/plain",
        "part_count": 1,
        "size_bytes": 1,
    }
    part = {
        "type": "FileTransferPart",
        "source_component_uuid": uuid_of(control),
        "transfer_uuid": "a",
        "part_index": 0,
        "content": b"a",
    }
    return [start, part]


def test_what_the_client_sends_passes(server, controls, capsys):
    clicks = []
    server.scene.on_click()(clicks.append)
    gone = {"type": "GuiUpdateMessage", "uuid": "gone", "updates": {"value": 1}}
    with client(server.url) as browser:
        send(browser, CAMERA)
        wait(lambda: any(each.camera.image_width == 1000 for each in server.get_clients().values()))
        send(browser, CLICK)
        send(browser, update(controls.choice, value="blue"))
        send(browser, update(controls.slider, value=7))
        send(browser, update(controls.number, value=4))
        send(browser, update(controls.tick, value=True))
        send(browser, gone)
        wait(lambda: controls.tick.value and clicks)
    assert clicks[0].ray_direction == (0.0, 0.0, -1.0)
    assert controls.choice.value == "blue"
    assert controls.slider.value == 7.0
    assert controls.number.value == 4
    assert not capsys.readouterr().err


HOSTILE = {
    # Frames that are no message.
    "nothing": lambda c: b"",
    "text": lambda c: "text",
    "no msgpack": lambda c: b"\xc1",
    "cut off": lambda c: encode(update(c.slider, value=5.0))[:-1],
    "more than a message": lambda c: encode(update(c.slider, value=5.0)) + b"\x00",
    "no map": lambda c: b"\x01",
    "no type": lambda c: b"\x80",
    "deep": lambda c: b"\x82\xa1v" + b"\x91" * 60_000,
    "no UTF-8": lambda c: b"\x81\xa4type\xa2\xff\xff",
    # Messages that the page does not need.
    "an unknown type": lambda c: {"type": "Nonsense"},
    "a base class": lambda c: {"type": "Message"},
    "a message of the server": lambda c: {"type": "RunJavascriptMessage", "source": "1"},
    "a public address": lambda c: {"type": "ShareUrlRequest"},
    "an upload": lambda c: upload(c.upload),
    "a form": lambda c: {"type": "GuiFormSubmitMessage", "uuid": "a"},
    # Properties of a control other than its value.
    "options": lambda c: update(c.choice, options=EVIL),
    "visible": lambda c: update(c.choice, visible=False),
    "label": lambda c: update(c.choice, label="other"),
    "an attribute of all": lambda c: update(c.choice, __class__="x"),
    "more than a value": lambda c: update(c.choice, value="green", options=EVIL),
    "no value": lambda c: update(c.choice),
    "a further field": lambda c: update(c.slider, value=5.0) | {"excluded_self_client": 1},
    "a list for a name": lambda c: update(c.slider, value=1) | {"uuid": [1]},
    # Values of other kinds.
    "none": lambda c: update(c.slider, value=None),
    "NaN": lambda c: update(c.slider, value=math.nan),
    "infinity": lambda c: update(c.slider, value=math.inf),
    "a huge number": lambda c: update(c.slider, value=1e300),
    "a huge whole number": lambda c: update(c.number, value=2**60),
    "NaN as a text": lambda c: update(c.slider, value="nan"),
    "a text for a number": lambda c: update(c.number, value="many"),
    "a text for a tick": lambda c: update(c.tick, value="yes"),
    "a tick for a number": lambda c: update(c.number, value=True),
    "a list for a number": lambda c: update(c.slider, value=[1.0]),
    "a number for a text": lambda c: update(c.choice, value=5),
    "a long text": lambda c: update(c.choice, value="x" * 5000),
    # Cameras and clicks that no browser has.
    "a camera without height": lambda c: CAMERA | {"image_height": 0},
    "a camera at NaN": lambda c: CAMERA | {"position": [math.nan, 0.0, 0.0]},
    "a short vector": lambda c: CAMERA | {"position": [0.0, 0.0]},
    "a click from infinity": lambda c: CLICK | {"ray_origin": [math.inf, 0.0, 0.0]},
    "a drag to NaN": lambda c: DRAG | {"end_position": [math.nan, 0.0, 0.0]},
    "a drag of robot -1": lambda c: DRAG | {"instance_index": -1},
    "a drag of many": lambda c: DRAG | {"instance_index": [1, 2]},
    "another gesture": lambda c: CLICK | {"event_type": "rect-select"},
}
"""Messages that do not pass, by what they are; functions of the controls."""


def hostile_messages(kind, controls):
    """Return the hostile messages of a kind."""
    messages = HOSTILE[kind](controls)
    return messages if isinstance(messages, list) else [messages]


def test_a_drag_of_a_robot_passes(server):
    drags = []
    node = server.scene.add_batched_meshes_simple(
        "/swarm/robots",
        np.eye(3),
        np.array([[0, 1, 2]]),
        np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)),
        np.zeros((2, 3)),
    )
    node.on_drag("left")(drags.append)
    with client(server.url) as browser:
        send(browser, CAMERA)
        wait(server.get_clients)
        send(browser, DRAG | {"phase": "start"}, DRAG)
        wait(lambda: len(drags) == 2)
    assert [drag.phase for drag in drags] == ["start", "end"]
    assert drags[1].instance_index == 1
    assert drags[1].end_position == (5.0, 0.0, 1.0)


def test_other_messages_change_nothing_and_end_nothing(server, controls, caplog, capsys):
    """Each kind comes from a browser of its own, whose next choice still arrives."""
    shared = []
    clicks = []
    chosen = []
    server.request_share_url = lambda: shared.append(True)
    server.scene.on_click()(clicks.append)
    controls.choice.on_update(lambda _: chosen.append(controls.choice.value))
    before = controls.values()

    for kind in HOSTILE:
        choice = "green" if controls.choice.value == "blue" else "blue"
        chosen.clear()
        with client(server.url) as browser:
            send(browser, CAMERA)
            wait(server.get_clients)
            (viewer,) = server.get_clients().values()
            send(browser, *hostile_messages(kind, controls))
            send(browser, update(controls.choice, value=choice))
            wait(lambda choice=choice: choice in chosen)
            assert math.isfinite(viewer.camera.aspect), kind
            assert tuple(viewer.camera.position) == (0.0, 0.0, 9.0), kind
        wait(lambda: not server.get_clients())
        assert controls.values() == before, kind
        assert chosen == [choice], kind
        assert not shared, kind
        assert not clicks, kind

    gc.collect()  # asyncio reports exceptions of tasks that nobody waits for
    assert not caplog.records
    assert capsys.readouterr().err.count("\n") == 1


def test_huge_messages_end_their_own_connection_alone(server, controls):
    with client(server.url) as good, client(server.url) as browser:
        with pytest.raises(ConnectionClosedError, match="1009"):
            send(browser, update(controls.choice, value="x" * 40_000_000))
            while True:
                browser.recv(SECONDS)
        send(good, update(controls.choice, value="blue"))
        wait(lambda: controls.choice.value == "blue")
    assert controls.choice.options == ("red", "green", "blue")


def test_after_a_thousand_hostile_messages_all_work(server, controls, capsys):
    messages = []
    for kind in HOSTILE:
        messages += hostile_messages(kind, controls)
    with client(server.url) as good, client(server.url) as browser:
        for number in range(1000):
            send(browser, messages[number % len(messages)])

        # Another browser, the same one, and one that comes later.
        send(good, update(controls.slider, value=9.0))
        wait(lambda: controls.slider.value == 9.0)
        send(browser, update(controls.choice, value="blue"))
        wait(lambda: controls.choice.value == "blue")
        with client(server.url) as late:
            send(late, update(controls.slider, value=1.0))
            wait(lambda: controls.slider.value == 1.0)
    assert capsys.readouterr().err.count("\n") == 1
