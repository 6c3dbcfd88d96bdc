"""Who reaches the page, and with which messages.

Raw requests stand for browsers, websites and other users; test_browser.py has the same in Chromium.
"""

import asyncio
import gc
import logging
import math
import os
import re
import shutil
import socket
import subprocess
import sys
import time
import webbrowser
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit
from urllib.request import url2pathname

import msgspec
import pytest
import viser
import websockets.asyncio.server
from viser.infra import _infra
from websockets.asyncio.client import connect as connect_asyncio
from websockets.exceptions import ConnectionClosedError
from websockets.sync.client import connect

from iswarm_mj.commands.play import Play, redirect_file
from iswarm_mj.player.guard import Guard
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.utils.errors import UserError

SECONDS = 60
PORT = 8350
PROTOCOL = f"viser-v{viser.__version__}"
NOBODY = 65534


def wait(holds):
    end = time.monotonic() + SECONDS
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.fixture
def server():
    server = open_server(PORT)
    yield server
    close_server(server)


@pytest.fixture
def controls(server):
    """One control of each kind."""
    gui = server.gui
    return SimpleNamespace(
        choice=gui.add_dropdown("choice", ("red", "green", "blue")),
        slider=gui.add_slider("slider", 0.0, 10.0, 0.5, 2.0),
        number=gui.add_number("number", 3),
        tick=gui.add_checkbox("tick", False),
        upload=gui.add_upload_button("upload"),
    )


def values(controls):
    """Return all that a browser might change, except what is chosen."""
    choice = controls.choice
    numbers = controls.slider.value, controls.number.value, controls.tick.value
    return choice.options, choice.visible, choice.label, controls.upload.value.content, *numbers


def client(url, **settings):
    """Open a websocket as the page's own client does."""
    split = urlsplit(url)
    origin = f"http://{split.netloc}"
    return connect(
        f"ws://{split.netloc}{split.path.removesuffix('/')}",
        origin=origin,
        subprotocols=[PROTOCOL],
        compression=None,
        max_size=None,
        **settings,
    )


def update(handle, **updates):
    """Return the message that changes properties of a control."""
    return {"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": updates}


def send(connection, *messages):
    """Send frames: text or bytes as they are, maps as the client encodes them."""
    for message in messages:
        raw = isinstance(message, bytes | str)
        connection.send(message if raw else msgspec.msgpack.encode(message))


# Requests.

HANDSHAKE = {
    "Host": "HOST",
    "Origin": "http://HOST",
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Protocol": PROTOCOL,
}
"""Headers of a websocket, HOST being that of the page."""


def status(url, path="PATH", more="", **changed):
    """Return the status of the response to the request of a websocket.

    Args:
        url: address of the page.
        path: of the request, where PATH is that of the page.
        more: a further line.
        changed: headers by their names, None for one that is left out.
    """
    split = urlsplit(url)
    headers = HANDSHAKE | {name.replace("_", "-"): value for name, value in changed.items()}
    lines = [
        f"GET {path} HTTP/1.1",
        *(f"{k}: {v}" for k, v in headers.items() if v is not None),
        more,
    ]
    text = "\r\n".join(line for line in lines if line) + "\r\n\r\n"
    text = text.replace("HOST", split.netloc).replace("PATH", split.path)
    with socket.create_connection((split.hostname, split.port), SECONDS) as connection:
        connection.sendall(text.encode("latin-1"))
        return int(connection.recv(100).split()[1])


def test_the_page_and_its_websocket_open_at_the_whole_address(server):
    assert status(server.url) == 101
    assert status(server.url, Upgrade=None, Origin=None) == 200
    assert status(server.url, Upgrade=None) == 200
    forwarded = {"Host": "localhost:9999", "Origin": "http://localhost:9999"}
    assert status(server.url, **forwarded) == 101
    split = urlsplit(server.url)
    own = f"ws%3A%2F%2F{split.netloc}{split.path.removesuffix('/')}".replace("/", "%2F").replace(
        ":", "%3A"
    )
    assert (
        status(server.url, path=f"PATH?websocket={own}", Upgrade=None, Origin=None) == 200
    )  # as after a reload


@pytest.mark.parametrize(
    "query",
    [
        "playbackPath=http://evil.example/x.viser",
        "websocket=ws://evil.example:1",
        "websocket=ws://HOST/",
        "websocket=ws://HOSTPATH&playbackPath=x",
        "websocket=ws://HOSTPATH&websocket=ws://evil.example",
        "theme=dark",
        "&",
    ],
)
def test_parameters_by_which_a_website_could_lead_the_client_elsewhere_are_refused(server, query):
    assert status(server.url, path=f"PATH?{query}", Upgrade=None, Origin=None) == 403


def test_the_client_may_connect_to_the_page_alone(server):
    split = urlsplit(server.url)
    with socket.create_connection((split.hostname, split.port), SECONDS) as connection:
        connection.sendall(f"GET {split.path} HTTP/1.1\r\nHost: {split.netloc}\r\n\r\n".encode())
        head = connection.recv(4000).decode("latin-1")
    policy = re.search("Content-Security-Policy: (.*)\r\n", head)[1]
    assert f"connect-src 'self' ws://{split.netloc} data: blob:" in policy and "evil" not in policy


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one such address")
def test_pages_have_origins_of_their_own(server):
    """So that nothing that a browser keeps of an ended page, or of who took its port, meets the
    next one."""
    other = open_server(PORT)
    close_server(other)
    hosts = {urlsplit(one.url).hostname for one in (server, other)}
    assert len(hosts) == 2 and all(host.startswith("127.") for host in hosts)
    assert status(server.url, Host=f"{urlsplit(other.url).hostname}:{PORT}") == 403


@pytest.mark.parametrize("upgrade", ["websocket", None], ids=["websocket", "page"])
def test_secrets_are_long_and_differ(server, upgrade):
    other = open_server(PORT)
    try:
        assert server.url != other.url
        for one in (server, other):
            assert len(urlsplit(one.url).path) > 40
        foreign = urlsplit(other.url).path
        origin = HANDSHAKE["Origin"] if upgrade else None
        assert status(server.url, foreign, Upgrade=upgrade, Origin=origin) == 403
    finally:
        close_server(other)


WRONG_PATHS = {
    "none": lambda path: "/",
    "empty": lambda path: "//",
    "another": lambda path: "/" + "A" * 43 + "/",
    "a part": lambda path: path[:-2],
    "more": lambda path: path[:-1] + "A/",
    "a folder": lambda path: path + "x",
    "the client's file": lambda path: path + "index.html",
    "another case": lambda path: path.swapcase(),
    "percents": lambda path: f"/%{ord(path[1]):02x}{path[2:]}",
    "two slashes": lambda path: f"/{path}",
    "a dot": lambda path: f"/.{path}",
    "a way up": lambda path: f"{path}..{path}",
    "a backslash": lambda path: "\\" + path[1:],
    "in the query": lambda path: f"/?{path}",
    "an absolute form": lambda path: f"http://HOST{path}",
    "no ASCII": lambda path: path[:-1] + "\xff",
}


@pytest.mark.parametrize("upgrade", ["websocket", None], ids=["websocket", "page"])
@pytest.mark.parametrize("wrong", WRONG_PATHS)
def test_without_the_secret_nothing_is_served(server, wrong, upgrade):
    path = WRONG_PATHS[wrong](urlsplit(server.url).path)
    origin = HANDSHAKE["Origin"] if upgrade else None
    assert status(server.url, path, Upgrade=upgrade, Origin=origin) == 403


HOSTS = [
    None,
    "",
    "evil.example",
    "evil.example:8350",
    "127.0.0.1.evil.example",
    "localhost.evil.example",
    "evil.example#127.0.0.1",
    "user@127.0.0.1",
    "127.0.0.1:80:80",
    "127.0.0.1:",
    "127.1",
    "2130706433",
    "0.0.0.0",
    "LOCALHOST",
    "[::1]",
    "127.0.0.1, evil.example",
    "127.0.0.\xb2",
]


@pytest.mark.parametrize("upgrade", ["websocket", None], ids=["websocket", "page"])
@pytest.mark.parametrize("host", HOSTS)
def test_a_website_whose_name_leads_to_this_machine_is_refused(server, host, upgrade):
    origin = f"http://{host}" if upgrade else None
    assert status(server.url, Host=host, Upgrade=upgrade, Origin=origin) == 403


FOREIGN_ORIGINS = [
    "https://evil.example",
    "http://evil.example",
    "null",
    "",
    "https://HOST",
    "http://HOST.evil.example",
    "http://127.0.0.1",
    "http://127.0.0.1:1",
    "http://HOST/",
    "http://HOST http://evil.example",
    "file://",
]


@pytest.mark.parametrize("upgrade", ["websocket", None], ids=["websocket", "page"])
@pytest.mark.parametrize("origin", FOREIGN_ORIGINS)
def test_another_website_is_refused_even_with_the_address(server, origin, upgrade):
    assert status(server.url, Origin=origin, Upgrade=upgrade) == 403


def test_a_websocket_that_no_browser_opens_is_refused(server):
    assert status(server.url, Origin=None) == 403


@pytest.mark.parametrize("upgrade", ["WebSocket", "h2c", "", "websocket, h2c"])
def test_other_upgrades_are_refused(server, upgrade):
    assert status(server.url, Upgrade=upgrade) == 403


@pytest.mark.parametrize(
    "line",
    [
        "Host: HOST",
        "host: evil.example",
        "Origin: http://HOST",
        "ORIGIN: https://evil.example",
        "Upgrade: websocket",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
    ],
)
def test_headers_that_occur_twice_are_refused(server, line):
    assert status(server.url, more=line) == 403


@pytest.mark.parametrize("path", ["PATH", "/"])
def test_addresses_are_not_passed_on_and_not_kept(server, path):
    split = urlsplit(server.url)
    with socket.create_connection((split.hostname, split.port), SECONDS) as connection:
        wanted = path.replace("PATH", split.path)
        connection.sendall(f"GET {wanted} HTTP/1.1\r\nHost: {split.netloc}\r\n\r\n".encode())
        head = connection.recv(4000).partition(b"\r\n\r\n")[0].decode()
    for line in (
        "Referrer-Policy: no-referrer",
        "Cache-Control: no-store",
        "X-Content-Type-Options: nosniff",
    ):
        assert line in head.splitlines()
    assert split.path.strip("/") not in head


def test_requests_of_strangers_leave_nothing_on_the_terminal(server, caplog, monkeypatch):
    # Without the filters that viser adds when a page is served for the first time.
    for name in ("websockets.server", "iswarm_mj.player.guard"):
        log = logging.getLogger(name)
        own = [one for one in log.filters if not isinstance(one, logging.Filter)]
        monkeypatch.setattr(log, "filters", own)

    split = urlsplit(server.url)
    for text in (
        b"POST / HTTP/1.1\r\n\r\n",
        b"\x16\x03\x01\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost\r\n\r\n",
        b"",
    ):
        with socket.create_connection((split.hostname, split.port), SECONDS) as connection:
            connection.sendall(text)
            connection.shutdown(socket.SHUT_WR)
            assert b"200" not in connection.recv(1000)
    assert not caplog.records


@pytest.mark.skipif(
    os.name == "nt" or os.geteuid() != 0 or not shutil.which("bash"), reason="needs root and bash"
)
def test_another_user_reaches_neither_the_page_nor_the_file_that_leads_there(server):
    """Another user knows the port, and where the file is."""

    def as_nobody(command):
        own = {"user": NOBODY, "group": NOBODY, "extra_groups": [], "cwd": "/", "timeout": SECONDS}
        return subprocess.run(
            ["bash", "-c", command], capture_output=True, text=True, check=False, **own
        )

    host, port = urlsplit(server.url).hostname, server.get_port()
    request = "".join(f"{k}: {v}\\r\\n" for k, v in HANDSHAKE.items()).replace(
        "HOST", f"{host}:{port}"
    )
    talk = f"exec 3<>/dev/tcp/{host}/{port}; printf 'GET / HTTP/1.1\\r\\n{request}\\r\\n' >&3; head -1 <&3"
    assert as_nobody(talk).stdout.split()[1] == "403"

    with redirect_file(server.url) as file:
        assert server.url in file.read_text()
        read = as_nobody(f"cat {file} || ls {file.parent}")
        assert read.returncode and not read.stdout
        assert read.stderr.count("Permission denied") == 2


def test_the_browser_is_given_a_file_and_not_the_address(monkeypatch, capsys):
    """All users can read the command line by which it is started."""
    url = "http://127.0.0.1:8080/secret/"
    opened = {}

    def open_browser(address):
        file = Path(url2pathname(urlsplit(address).path))
        opened[address] = (
            file.read_text(),
            file.stat().st_mode & 0o777,
            file.parent.stat().st_mode & 0o777,
        )

    page = SimpleNamespace(url=url, wait=lambda: None)
    monkeypatch.setattr(webbrowser, "open", open_browser)
    monkeypatch.setattr(Play, "session", lambda _: SimpleNamespace())
    monkeypatch.setattr("iswarm_mj.player.page.Page", lambda *_: page)
    Play().run()
    Play(open=False).run()

    ((address, (text, mode, mode_of_folder)),) = opened.items()
    assert "secret" not in address
    assert f"url={url}" in text
    assert (mode, mode_of_folder) == (0o600, 0o700)
    assert not Path(url2pathname(urlsplit(address).path)).parent.exists()
    assert capsys.readouterr().out.count(url) == 2


# Messages.

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
CLICK = {
    "type": "ScenePointerMessage",
    "event_type": "click",
    "ray_origin": [0.0, 0.0, 9.0],
    "ray_direction": [0.0, 0.0, -1.0],
    "screen_pos": [[0.5, 0.5]],
    "modifier": None,
}


def test_what_the_client_sends_passes(server, controls, capsys):
    clicks = []
    server.scene.on_click()(clicks.append)
    with client(server.url) as browser:
        send(browser, CAMERA)
        wait(lambda: any(one.camera.image_width == 1000 for one in server.get_clients().values()))
        send(browser, CLICK)
        send(browser, update(controls.choice, value="blue"))
        send(browser, update(controls.slider, value=7))
        send(browser, update(controls.number, value=4))
        send(browser, update(controls.tick, value=True))
        send(browser, update(SimpleNamespace(_impl=SimpleNamespace(uuid="gone")), value=1))
        wait(lambda: controls.tick.value and clicks)
    assert clicks[0].ray_direction == (0.0, 0.0, -1.0)
    assert (controls.choice.value, controls.slider.value, controls.number.value) == ("blue", 7.0, 4)
    assert not capsys.readouterr().err


HOSTILE = {
    "nothing": lambda c: b"",
    "text": lambda c: "text",
    "no msgpack": lambda c: b"\xc1",
    "cut off": lambda c: msgspec.msgpack.encode(update(c.slider, value=5.0))[:-1],
    "more than a message": lambda c: msgspec.msgpack.encode(update(c.slider, value=5.0)) + b"\x00",
    "no map": lambda c: b"\x01",
    "no type": lambda c: b"\x80",
    "deep": lambda c: b"\x82\xa1v" + b"\x91" * 60_000,
    "no UTF-8": lambda c: b"\x81\xa4type\xa2\xff\xff",
    "an unknown type": lambda c: {"type": "Nonsense"},
    "a base class": lambda c: {"type": "Message"},
    "a message of the server": lambda c: {"type": "RunJavascriptMessage", "source": "1"},
    "a public address": lambda c: {"type": "ShareUrlRequest"},
    "an upload": lambda c: [
        {
            "type": "FileTransferStartUpload",
            "source_component_uuid": c.upload._impl.uuid,
            "transfer_uuid": "a",
            "filename": "a",
            "mime_type": "text/plain",
            "part_count": 1,
            "size_bytes": 1,
        },
        {
            "type": "FileTransferPart",
            "source_component_uuid": c.upload._impl.uuid,
            "transfer_uuid": "a",
            "part_index": 0,
            "content": b"a",
        },
    ],
    "a form": lambda c: {"type": "GuiFormSubmitMessage", "uuid": "a"},
    "options": lambda c: update(c.choice, options=["/tmp/evil.py:Evil"]),
    "visible": lambda c: update(c.choice, visible=False),
    "label": lambda c: update(c.choice, label="other"),
    "an attribute of all": lambda c: update(c.choice, __class__="x"),
    "more than a value": lambda c: update(c.choice, value="green", options=["/tmp/evil.py:Evil"]),
    "no value": lambda c: update(c.choice),
    "a further field": lambda c: update(c.slider, value=5.0) | {"excluded_self_client": 1},
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
    "a list for a name": lambda c: {
        "type": "GuiUpdateMessage",
        "uuid": [1],
        "updates": {"value": 1},
    },
    "a camera without height": lambda c: CAMERA | {"image_height": 0},
    "a camera at NaN": lambda c: CAMERA | {"position": [math.nan, 0.0, 0.0]},
    "a short vector": lambda c: CAMERA | {"position": [0.0, 0.0]},
    "a click from infinity": lambda c: CLICK | {"ray_origin": [math.inf, 0.0, 0.0]},
    "another gesture": lambda c: CLICK | {"event_type": "rect-select"},
}


def messages_of(kind, controls):
    """Return the hostile messages of a kind."""
    messages = HOSTILE[kind](controls)
    return messages if isinstance(messages, list) else [messages]


@pytest.mark.parametrize("kind", HOSTILE)
def test_other_messages_change_nothing_and_end_nothing(server, controls, kind, caplog, capsys):
    before = values(controls)
    shared = []
    server.request_share_url = lambda: shared.append(True)
    seen = []
    server.scene.on_click()(seen.append)
    chosen = []
    controls.choice.on_update(lambda _: chosen.append(controls.choice.value))
    with client(server.url) as browser:
        send(browser, CAMERA)
        wait(server.get_clients)
        (camera,) = (one.camera for one in server.get_clients().values())
        send(browser, *messages_of(kind, controls))
        send(browser, update(controls.choice, value="blue"))
        wait(lambda: "blue" in chosen)
        assert math.isfinite(camera.aspect) and tuple(camera.position) == (0.0, 0.0, 9.0)
    gc.collect()  # asyncio reports exceptions of tasks that nobody waits for
    assert values(controls) == before
    assert chosen == ["blue"]
    assert not shared and not seen and not caplog.records
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
    hostile = [message for kind in HOSTILE for message in messages_of(kind, controls)]
    with client(server.url) as good, client(server.url) as browser:
        for k in range(1000):
            send(browser, hostile[k % len(hostile)])
        send(good, update(controls.slider, value=9.0))
        wait(lambda: controls.slider.value == 9.0)
        send(browser, update(controls.choice, value="blue"))
        wait(lambda: controls.choice.value == "blue")
        with client(server.url) as late:
            send(late, update(controls.slider, value=1.0))
            wait(lambda: controls.slider.value == 1.0)
    assert capsys.readouterr().err.count("\n") == 1


# How the guard gets into viser.


def test_a_server_that_cannot_be_guarded_is_stopped(monkeypatch):
    """Such as one of another version of viser, which calls something else."""
    real = websockets.asyncio.server.serve
    own = SimpleNamespace(server=SimpleNamespace(serve=lambda *given, **more: real(*given, **more)))
    parts = {"exceptions": websockets.exceptions, "datastructures": websockets.datastructures}
    monkeypatch.setattr(_infra, "websockets", SimpleNamespace(asyncio=own, **parts))
    with pytest.raises(UserError, match=re.escape(viser.__version__)):
        open_server(8390)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", 8390), SECONDS)


def test_servers_of_others_start_as_ever():
    """Also those that start at the same time, in another thread."""

    async def handler(connection):
        await connection.send(await connection.recv())

    async def talk():
        with Guard().start():
            starting = websockets.asyncio.server.serve(handler, "127.0.0.1", 0)
        async with starting as server:
            port = server.sockets[0].getsockname()[1]
            async with connect_asyncio(f"ws://127.0.0.1:{port}/") as connection:
                await connection.send("anything")
                return await connection.recv()

    before = websockets.asyncio.server.serve
    assert asyncio.run(talk()) == "anything"
    assert websockets.asyncio.server.serve is before


def test_pages_that_open_at_the_same_time_have_guards_of_their_own():
    before = websockets.asyncio.server.serve
    with ThreadPoolExecutor(4) as pool:
        servers = list(pool.map(open_server, 4 * [PORT]))
    try:
        assert websockets.asyncio.server.serve is before
        secrets = {urlsplit(one.url).path for one in servers}
        assert len(secrets) == 4
        for one in servers:
            opened = [status(one.url, path) for path in secrets]
            assert sorted(opened) == [101, 403, 403, 403]
    finally:
        for one in servers:
            close_server(one)
