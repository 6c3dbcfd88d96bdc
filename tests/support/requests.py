"""Raw requests to a page, which stand for browsers, websites and other users of the machine."""

import socket
from urllib.parse import urlsplit

import viser

SECONDS = 60
"""Time after which a request has failed [s]."""
PROTOCOL = f"viser-v{viser.__version__}"
"""Subprotocol of viser's websocket."""
HANDSHAKE = {
    "Host": "HOST",
    "Origin": "http://HOST",
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Protocol": PROTOCOL,
}
"""Headers with which a browser opens a websocket; HOST is replaced by that of the page."""
PLAIN = {"Upgrade": None, "Origin": None}
"""Headers that a browser leaves out when it loads the page itself."""


def connect_to(url):
    """Return a connection to the server of an address."""
    split = urlsplit(url)
    return socket.create_connection((split.hostname, split.port), SECONDS)


def header_lines(headers):
    """Return the lines of headers, without those whose value is None."""
    return [f"{name}: {value}" for name, value in headers.items() if value is not None]


def status(url, path="PATH", further_line="", **headers):
    """Return the status of the response to a request that opens a websocket.

    Args:
        url: address of the page.
        path: path of the request, in which PATH is replaced by that of the page.
        further_line: another header.
        headers: values of headers other than those of `HANDSHAKE`, with underscores in their names;
            None for one that is left out.
    """
    split = urlsplit(url)
    changed = {name.replace("_", "-"): value for name, value in headers.items()}
    lines = [f"GET {path} HTTP/1.1", *header_lines(HANDSHAKE | changed)]
    if further_line:
        lines.append(further_line)
    request = "\r\n".join(lines) + "\r\n\r\n"
    request = request.replace("HOST", split.netloc).replace("PATH", split.path)
    with connect_to(url) as connection:
        connection.sendall(request.encode("latin-1"))
        return int(connection.recv(100).split()[1])


def head(url, path="PATH"):
    """Return the status line and the headers of the response to a request for a page."""
    split = urlsplit(url)
    path = path.replace("PATH", split.path)
    with connect_to(url) as connection:
        connection.sendall(f"GET {path} HTTP/1.1\r\nHost: {split.netloc}\r\n\r\n".encode())
        return connection.recv(4000).partition(b"\r\n\r\n")[0].decode("latin-1")
