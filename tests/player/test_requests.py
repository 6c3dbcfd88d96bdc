"""Only whoever has the whole address of a page reaches it: no website, and no other user.

test_browser.py has the same in Chromium.
"""

import logging
import os
import re
import shutil
import socket
import subprocess
import sys
import webbrowser
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest
from support.requests import HANDSHAKE, PLAIN, SECONDS, connect_to, head, header_lines, status

from iswarm_mj.commands.play import Play, redirect_file
from iswarm_mj.player.page import close_server, open_server

NOBODY = 65534
"""User and group without rights."""

of_websocket_and_page = pytest.mark.parametrize("headers", [{}, PLAIN], ids=["websocket", "page"])
"""Requests that open the websocket, and those that load the page."""


# The address.


def test_the_page_and_its_websocket_open_at_the_whole_address(server):
    assert status(server.url) == 101
    assert status(server.url, Upgrade=None) == 200
    assert status(server.url, **PLAIN) == 200


def test_the_port_may_be_forwarded_from_another_machine(server):
    forwarded = {"Host": "localhost:9999", "Origin": "http://localhost:9999"}
    assert status(server.url, **forwarded) == 101


def test_the_page_may_be_loaded_again(server):
    """The client has put the address of its websocket into that of the page."""
    split = urlsplit(server.url)
    websocket = f"ws%3A%2F%2F{split.netloc}{split.path.removesuffix('/')}"
    encoded = websocket.replace("/", "%2F").replace(":", "%3A")
    assert status(server.url, path=f"PATH?websocket={encoded}", **PLAIN) == 200


@of_websocket_and_page
def test_secrets_are_long_and_differ(server, second_server, headers):
    secret = urlsplit(server.url).path
    second_secret = urlsplit(second_server.url).path
    assert secret != second_secret
    assert min(len(secret), len(second_secret)) > 40
    assert status(server.url, second_secret, **headers) == 403


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
"""Paths that are not the secret one, from which they are made."""


@of_websocket_and_page
@pytest.mark.parametrize("wrong", WRONG_PATHS)
def test_without_the_secret_nothing_is_served(server, wrong, headers):
    path = WRONG_PATHS[wrong](urlsplit(server.url).path)
    assert status(server.url, path, **headers) == 403


@pytest.mark.parametrize("path", ["PATH", "/"])
def test_addresses_are_not_passed_on_and_not_kept(server, path):
    response = head(server.url, path)
    lines = response.splitlines()
    assert "Referrer-Policy: no-referrer" in lines
    assert "Cache-Control: no-store" in lines
    assert "X-Content-Type-Options: nosniff" in lines
    assert urlsplit(server.url).path.strip("/") not in response


# Websites.


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one such address")
def test_pages_have_origins_of_their_own(server):
    """Nothing that browsers keep of an ended page, or of who took its port, meets the next one."""
    ended = open_server(server.get_port())
    close_server(ended)
    hosts = {urlsplit(url).hostname for url in (server.url, ended.url)}
    assert len(hosts) == 2
    assert all(host.startswith("127.") for host in hosts)
    host = urlsplit(ended.url).hostname
    assert status(server.url, Host=f"{host}:{server.get_port()}") == 403


@of_websocket_and_page
@pytest.mark.parametrize(
    "host",
    [
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
    ],
)
def test_a_website_whose_name_leads_to_this_machine_is_refused(server, host, headers):
    as_the_website = {"Host": host, "Origin": f"http://{host}"} | headers
    assert status(server.url, **as_the_website) == 403


@pytest.mark.parametrize("upgrade", ["websocket", None], ids=["websocket", "page"])
@pytest.mark.parametrize(
    "origin",
    [
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
    ],
)
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
def test_a_header_that_occurs_twice_is_refused(server, line):
    assert status(server.url, further_line=line) == 403


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
    assert status(server.url, path=f"PATH?{query}", **PLAIN) == 403


def test_the_client_may_connect_to_the_page_alone(server):
    (policy,) = re.findall("Content-Security-Policy: (.*)\r\n", head(server.url) + "\r\n")
    host = urlsplit(server.url).netloc
    assert f"connect-src 'self' ws://{host} data: blob:" in policy
    assert "evil" not in policy


# Users of the same machine.


def test_requests_of_strangers_leave_nothing_on_the_terminal(server, caplog, monkeypatch):
    # viser adds filters of its own when a page is served for the first time.
    for name in ("websockets.server", "iswarm_mj.player.guard"):
        log = logging.getLogger(name)
        functions = [each for each in log.filters if not isinstance(each, logging.Filter)]
        monkeypatch.setattr(log, "filters", functions)

    for request in (
        b"POST / HTTP/1.1\r\n\r\n",
        b"\x16\x03\x01\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost\r\n\r\n",
        b"",
    ):
        with connect_to(server.url) as connection:
            connection.sendall(request)
            connection.shutdown(socket.SHUT_WR)
            assert b"200" not in connection.recv(1000)
    assert not caplog.records


def as_nobody(command):
    """Run a command of bash as a user without rights."""
    return subprocess.run(
        ["bash", "-c", command],
        user=NOBODY,
        group=NOBODY,
        extra_groups=[],
        cwd="/",
        capture_output=True,
        text=True,
        check=False,
        timeout=SECONDS,
    )


@pytest.mark.skipif(
    os.name == "nt" or os.geteuid() != 0 or not shutil.which("bash"), reason="needs root and bash"
)
def test_another_user_reaches_neither_the_page_nor_the_file_that_leads_there(server):
    """The other user knows the port, and where the file is."""
    split = urlsplit(server.url)
    lines = ["GET / HTTP/1.1", *header_lines(HANDSHAKE), "", ""]
    request = "\\r\\n".join(lines).replace("HOST", split.netloc)
    connection = f"exec 3<>/dev/tcp/{split.hostname}/{split.port}"
    response = as_nobody(f"{connection}; printf '{request}' >&3; head -1 <&3").stdout
    assert response.split()[1] == "403"

    with redirect_file(server.url) as file:
        assert server.url in file.read_text()
        reading = as_nobody(f"cat {file} || ls {file.parent}")
        assert reading.returncode
        assert not reading.stdout
        assert reading.stderr.count("Permission denied") == 2


def test_the_browser_is_given_a_file_and_not_the_address(monkeypatch, capsys):
    """All users can read the command line by which it is started."""
    url = "http://127.0.0.1:8080/secret/"
    opened = []

    def open_browser(address):
        file = Path(url2pathname(urlsplit(address).path))
        assert f"url={url}" in file.read_text()
        assert file.stat().st_mode & 0o777 == 0o600
        assert file.parent.stat().st_mode & 0o777 == 0o700
        opened.append((address, file))

    page = SimpleNamespace(url=url, wait=lambda: None)
    monkeypatch.setattr(webbrowser, "open", open_browser)
    monkeypatch.setattr(Play, "session", lambda _: SimpleNamespace())
    monkeypatch.setattr("iswarm_mj.player.page.Page", lambda *_: page)
    Play().run()
    Play(open=False).run()

    ((address, file),) = opened
    assert "secret" not in address
    assert not file.parent.exists()
    assert capsys.readouterr().out.count(url) == 2
