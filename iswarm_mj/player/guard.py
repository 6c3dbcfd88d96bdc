"""The wall around a page: who knows its address may connect, and only expected messages pass.

viser lets anyone connect who reaches its port: every website in the user's browser, and every
other user of the machine. It offers no way to refuse them, so the guard sets parameters of the
websockets server that viser starts.
"""

import asyncio
import hmac
import http.client
import logging
import re
import secrets
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from functools import partial
from http import HTTPStatus
from numbers import Number
from typing import Annotated, Any, Literal
from urllib.parse import parse_qsl

import msgspec
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from iswarm_mj.utils.errors import UserError

MAX_SIZE = 2**16
"""Largest message of a browser [bytes]; those of the stock client have at most 223."""
PACE_S = 0.002
"""Pause after each message of a browser [s]: viser queues messages without a limit, and the stock
client sends fewer than 70 a second."""
CLOSE_S = 1.0
"""Time that a browser has to confirm the end of its connection when the page closes [s]."""
HEADERS = {
    "Referrer-Policy": "no-referrer",  # the address is the secret
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
}
"""Headers of all responses."""

_HOST = re.compile(r"(?P<name>[a-z0-9.]+)(:[0-9]{1,5})?")
"""Form of the header Host; any port, as it may be forwarded from another machine."""
_FORWARDED = ("127.0.0.1", "localhost")
"""Names by which a forwarded port is reached."""
OPEN_S = 3.0
"""Longest time of a handshake [s]: a stranger may begin many, and each takes a file descriptor."""
_START = threading.Lock()
"""Lock of `Guard.start`, which replaces a function for all threads."""
_LOG = logging.getLogger(__name__)
# Strangers could fill the terminal with these, by many requests that they do not finish.
_LOG.addFilter(lambda record: record.getMessage() != "opening handshake failed")
logging.getLogger("asyncio").addFilter(
    lambda record: not record.getMessage().startswith("socket.accept() out of system resource")
)


# What the stock client of viser 1.1 sends on this page: changes of controls, the camera, and clicks
# and drags on the arena. The names are viser's. Other messages do not pass, such as uploads,
# requests for a public address, and changes of other properties of a control than its value.

_Coordinate = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
_Vector = tuple[_Coordinate, _Coordinate, _Coordinate]
_Pixels = Annotated[int, msgspec.Meta(ge=1, le=100_000)]
_Integer = Annotated[int, msgspec.Meta(ge=-(2**53), le=2**53)]
_Real = Annotated[float, msgspec.Meta(ge=-(2.0**53), le=2.0**53)]
"""Numbers up to where JavaScript has all whole ones; NaN fails the comparison, too."""
_Text = Annotated[str, msgspec.Meta(max_length=4096)]
"""A text as long as the path of a file may be."""
_Name = Annotated[str, msgspec.Meta(max_length=100)]


class _Strict(msgspec.Struct, forbid_unknown_fields=True):
    """A map that has these keys and no others."""


class _Updates(_Strict):
    """The new value, and no other property."""

    value: bool | _Integer | _Real | _Text


class GuiUpdateMessage(_Strict, tag_field="type", tag=True):
    """A control has a new value."""

    uuid: _Name
    updates: _Updates


class ViewerCameraMessage(_Strict, tag_field="type", tag=True):
    """The camera moved."""

    wxyz: tuple[_Coordinate, _Coordinate, _Coordinate, _Coordinate]
    position: _Vector
    fov: _Coordinate
    near: _Coordinate
    far: _Coordinate
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Vector
    up_direction: _Vector


class ScenePointerMessage(_Strict, tag_field="type", tag=True):
    """Somebody clicked on the arena."""

    event_type: Literal["click"]
    ray_origin: _Vector
    ray_direction: _Vector
    screen_pos: tuple[tuple[_Coordinate, _Coordinate]]
    modifier: _Name | None


class SceneNodeDragMessage(_Strict, tag_field="type", tag=True):
    """Somebody drags a robot."""

    phase: Literal["start", "update", "end"]
    name: _Name
    instance_index: Annotated[int, msgspec.Meta(ge=0, le=2**31)] | None
    start_position: _Vector
    start_screen_pos: tuple[_Coordinate, _Coordinate]
    end_position: _Vector
    end_screen_pos: tuple[_Coordinate, _Coordinate]
    button: Literal["left", "middle", "right"]
    modifier: _Name | None
    owner: _Name


_MESSAGES = (GuiUpdateMessage, ViewerCameraMessage, ScenePointerMessage, SceneNodeDragMessage)
"""Kinds of messages that pass."""
_DECODER = msgspec.msgpack.Decoder(
    GuiUpdateMessage | ViewerCameraMessage | ScenePointerMessage | SceneNodeDragMessage
)


class Guard:
    """Refuses requests without the secret or from other websites, and drops unexpected messages.

    Attributes:
        secret: path of the page's address; a new one for each page.
        host: address of this machine at which the page is; a new one for each page where possible.
        n_dropped: messages that did not pass.
    """

    def __init__(self) -> None:
        """Choose a secret and an address."""
        self.secret = secrets.token_urlsafe(32)
        self.host = _new_address()
        self.n_dropped = 0
        self._n_connections = 0
        self._controls: dict[str, Any] = {}

    @contextmanager
    def start(self) -> Iterator[None]:
        """Guard the server that viser starts within the block."""

        def guarded(handler: Any, *args: Any, **settings: Any) -> Any:
            """Start a server; its parameters are those of `websockets.asyncio.server.serve`."""
            module = getattr(handler, "__module__", None) or ""
            if module.partition(".")[0] != "viser":  # another thread starts a server in this moment
                return serve(handler, *args, **settings)

            settings["process_request"] = partial(self._process, settings.get("process_request"))
            settings["create_connection"] = partial(_Connection, self)
            settings["max_size"] = MAX_SIZE
            settings["close_timeout"] = CLOSE_S
            settings["open_timeout"] = OPEN_S
            settings["logger"] = _LOG
            return serve(handler, *args, **settings)

        with _START:
            serve = websockets.asyncio.server.serve
            websockets.asyncio.server.serve = guarded  # pyright: ignore[reportAttributeAccessIssue]
            try:
                yield
            finally:
                websockets.asyncio.server.serve = serve

    def check(self, server: Any) -> None:
        """Make sure that a server is guarded, and learn its controls.

        Raises:
            UserError: it is not, as this version of viser starts it in another way.
        """
        import viser

        connection = http.client.HTTPConnection(self.host, server.get_port(), timeout=10)
        connection.request("GET", "/")
        status = connection.getresponse().status
        connection.close()

        # Only this attribute of viser finds a control by the name that messages give it.
        controls = getattr(server.gui, "_gui_input_handle_from_uuid", None)
        is_guarded = status == HTTPStatus.FORBIDDEN and self._n_connections > 0
        if not is_guarded or controls is None or not _knows_messages():
            version = viser.__version__
            raise UserError(
                f"viser {version} cannot close the page to others; viser 1.1 can: "
                "`pip install 'viser>=1.1,<1.2'`"
            )
        self._controls = controls

    def connected(self) -> None:
        """Count a connection."""
        self._n_connections += 1

    def screened(self, raw: bytes | str) -> bytes | None:
        """Return what viser may read of a message; None for one that does not pass."""
        try:
            message = _DECODER.decode(raw) if isinstance(raw, bytes) else None
        except (msgspec.MsgspecError, ValueError, RecursionError):
            message = None
        if message is None or not self._fits(message) or not self._looks(message):
            self._drop()
            return None

        # Encoded again, as viser might read the same bytes in another way.
        return msgspec.msgpack.encode(message)

    def _fits(self, message: Any) -> bool:
        """Return whether a new value is of its control's kind.

        viser would convert "nan" to a number, and fail at other texts.
        """
        if not isinstance(message, GuiUpdateMessage):
            return True
        control = self._controls.get(message.uuid)
        return control is None or _kind(control.value) is _kind(message.updates.value)

    @staticmethod
    def _looks(message: Any) -> bool:
        """Return whether a camera looks somewhere; viser computes angles of its directions."""
        if not isinstance(message, ViewerCameraMessage):
            return True
        return any(message.up_direction) and message.look_at != message.position

    def _drop(self) -> None:
        """Count a message that did not pass, and report the first one."""
        self.n_dropped += 1
        if self.n_dropped == 1:
            text = "iswarm: the page ignores messages that its own client does not send."
            print(text, file=sys.stderr, flush=True)

    def _process(
        self,
        serve_page: Any,
        connection: ServerConnection,
        request: Request,
    ) -> Response | None:
        """Answer a request, or let a websocket open.

        Args:
            serve_page: viser's function of connection and request; returns None for websockets.
            connection: on which the request came.
            request: request of anyone.
        """
        refusal = self._refusal(request)
        if refusal:
            response = connection.respond(HTTPStatus.FORBIDDEN, f"{refusal}\n")
        else:
            response = serve_page(connection, Request("/", request.headers))
        if response is not None:
            response.headers.update(HEADERS)
            if not refusal:
                # What the client loads by itself, whatever parameters it is given.
                sources = f"connect-src 'self' ws://{request.headers['Host']} data: blob:"
                policy = f"{sources}; object-src 'none'; base-uri 'none'; form-action 'none'"
                response.headers["Content-Security-Policy"] = policy
        return response

    def _refusal(self, request: Request) -> str | None:
        """Return why a request is refused; None if it is not."""
        headers = request.headers
        names = [name.lower() for name, _ in headers.raw_items()]
        if len(set(names)) < len(names):
            return "A header occurs twice."

        # Other names are refused, as a website can let its own name lead to this machine.
        host = headers.get("Host", "")
        match = _HOST.fullmatch(host)
        if match is None or match["name"] not in (self.host, *_FORWARDED):
            return f"This page is at {self.host} only."

        # Browsers state the website by which a websocket is opened.
        upgrade = headers.get("Upgrade")
        origin = headers.get("Origin")
        if upgrade not in (None, "websocket"):
            return "Only websockets can be opened here."
        if origin != f"http://{host}" and (upgrade or origin is not None):
            return "Another website cannot use this page."

        # The whole path is compared, without a guess what other forms of it might mean.
        path, _, query = request.path.partition("?")
        path_bytes = path.removesuffix("/").encode(errors="replace")
        if not hmac.compare_digest(path_bytes, f"/{self.secret}".encode()):
            return "Open the whole address that `iswarm play` printed, or `Page.url` in Python."

        # viser's client loads what parameters name, which a website might choose. It adds the
        # address of its own websocket itself.
        parameters = parse_qsl(query, keep_blank_values=True)
        own_websocket = ("websocket", f"ws://{host}/{self.secret}")
        if query and parameters != [own_websocket]:
            return "Open the address without what stands behind the question mark."
        return None


def _knows_messages() -> bool:
    """Return whether viser's messages have the fields that pass; others would all be dropped."""
    from viser import _messages

    for kind in _MESSAGES:
        of_viser = getattr(_messages, kind.__name__)
        if {field.name for field in fields(of_viser)} != set(kind.__struct_fields__):
            return False
    return True


class _Connection(ServerConnection):
    """A browser, of which viser receives only what the guard lets pass."""

    def __init__(self, guard: Guard, *args: Any, **settings: Any):
        """Begin with the handshake."""
        super().__init__(*args, **settings)
        self._guard = guard
        guard.connected()

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next message that passes."""
        while True:
            message = self._guard.screened(await super().recv(decode))
            await asyncio.sleep(PACE_S)
            if message is not None:
                return message

    def recv_streaming(self, decode: bool | None = None) -> Any:
        """Refuse, as parts of a message cannot be screened; viser does not ask."""
        raise NotImplementedError


def _new_address() -> str:
    """Return an address of this machine for one page.

    Browsers keep what belongs to an origin, that is address and port, when a page has ended: its
    tab, which connects again, or a service worker, which answers for whatever comes next. Whoever
    takes the port of an ended page could so learn the address of the next one. On Linux all of
    127.0.0.0/8 is this machine, so each page has an origin of its own.
    """
    if sys.platform != "linux":
        return "127.0.0.1"
    return ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])


def _kind(value: Any) -> type:
    """Return bool, Number or the type of something else."""
    if isinstance(value, bool):
        return bool
    return Number if isinstance(value, Number) else type(value)
