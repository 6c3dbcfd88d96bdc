"""The guard gets into the server of a page and into no other, or the page does not open.

test_requests.py has who reaches a page, and test_messages.py which messages pass.
"""

import asyncio
import re
import socket
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest
import viser
import websockets.asyncio.server
from support.requests import SECONDS, status
from viser.infra import _infra
from websockets.asyncio.client import connect

from iswarm_mj.player.guard import Guard
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.utils.errors import UserError

PORT = 8390


def test_a_server_that_cannot_be_guarded_is_stopped(monkeypatch):
    """Another version of viser may start its server by another name of the same function."""
    serve = websockets.asyncio.server.serve

    def serve_by_another_name(*arguments, **settings):
        return serve(*arguments, **settings)

    server = SimpleNamespace(serve=serve_by_another_name)
    of_viser = SimpleNamespace(
        asyncio=SimpleNamespace(server=server),
        exceptions=websockets.exceptions,
        datastructures=websockets.datastructures,
    )
    monkeypatch.setattr(_infra, "websockets", of_viser)
    with pytest.raises(UserError, match=re.escape(viser.__version__)):
        open_server(PORT)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", PORT), SECONDS)


def test_servers_of_others_start_as_ever():
    """Another thread may start a server in the moment in which viser starts its own."""

    async def answer(connection):
        await connection.send(await connection.recv())

    async def talk():
        with Guard().start():
            starting = websockets.asyncio.server.serve(answer, "127.0.0.1", 0)
        async with starting as server:
            port = server.sockets[0].getsockname()[1]
            async with connect(f"ws://127.0.0.1:{port}/") as connection:
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
        secrets = {urlsplit(server.url).path for server in servers}
        assert len(secrets) == 4
        for server in servers:
            statuses = [status(server.url, secret) for secret in secrets]
            assert sorted(statuses) == [101, 403, 403, 403]
    finally:
        for server in servers:
            close_server(server)
