"""viser behind the guard, asked over real sockets; and what the guard leans on in viser."""

from __future__ import annotations

import socket
import urllib.error
import urllib.request

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the viewer's extra is not installed")

import websockets.exceptions  # noqa: E402
import websockets.sync.client  # noqa: E402

from pieper.errors import ArrayError, PieperError  # noqa: E402
from pieper.viewer import server as module  # noqa: E402
from pieper.viewer.server import VISER, InsidesError, PortError, Server  # noqa: E402

PROTOCOL = f"viser-v{viser.__version__}"


@pytest.fixture(scope="module")
def server():
    running = Server(port=0)
    yield running
    running.stop()


def get(url, **headers):
    request = urllib.request.Request(url, headers={name.replace("_", "-"): value for name, value in headers.items()})
    try:
        with urllib.request.urlopen(request, timeout=10) as response:
            return response.status, response.headers, response.read()
    except urllib.error.HTTPError as refused:
        with refused:
            return refused.code, refused.headers, refused.read()


def cookie_of(server):
    return get(server.url)[1]["Set-Cookie"].partition(";")[0]


def websocket(server, **headers):
    """The first message that the websocket sends, or the status that it was refused with."""
    page = f"http://127.0.0.1:{server.port}"
    given = {"Origin": page, "Cookie": cookie_of(server)} | headers
    origin = given.pop("Origin")
    try:
        with websockets.sync.client.connect(
            f"ws://127.0.0.1:{server.port}",
            origin=origin,
            subprotocols=[PROTOCOL],
            additional_headers={name: value for name, value in given.items() if value},
            open_timeout=10,
            proxy=None,
            max_size=None,
        ) as connection:
            return len(connection.recv(timeout=10))
    except websockets.exceptions.InvalidStatus as refused:
        return refused.response.status_code


def test_the_own_page_is_answered(server):
    status, headers, body = get(server.url)
    assert status == 200
    assert b"<html" in body[:500]
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]


def test_the_own_websocket_is_answered(server):
    assert websocket(server) > 16


def test_the_page_is_refused_without_the_token(server):
    page = server.url.partition("?")[0]
    assert get(page)[0] == 403
    assert get(page + "?token=wrong")[0] == 403
    assert b"needs the token" in get(page)[2]
    assert get(page + "index.html")[0] == 403


def test_the_page_is_refused_to_a_foreign_host(server):
    assert get(server.url, Host="evil.example")[0] == 403
    assert get(server.url, Host=f"evil.example:{server.port}", Cookie=cookie_of(server))[0] == 403


def test_the_page_is_refused_to_a_foreign_origin(server):
    assert get(server.url, Origin="http://evil.example", Cookie=cookie_of(server))[0] == 403


def test_the_websocket_is_refused_to_a_foreign_origin(server):
    assert websocket(server, Origin="http://evil.example") == 403
    assert websocket(server, Origin=None) == 403
    assert websocket(server, Origin="null") == 403


def test_the_websocket_is_refused_to_a_foreign_host(server):
    assert websocket(server, Host="evil.example") == 403


def test_the_websocket_is_refused_without_the_cookie(server):
    assert websocket(server, Cookie=None) == 403
    assert websocket(server, Cookie=f"pieper-{server.port}=wrong") == 403


def test_a_websocket_by_any_spelling_is_a_websocket(server):
    assert get(server.url, Upgrade="WebSocket", Connection="Upgrade")[0] == 403


def test_it_listens_on_this_machine_alone(server):
    address = server._websock_server._listening.getsockname()
    assert address == ("127.0.0.1", server.port)
    assert server.get_port() == server.port
    assert server.url.startswith(f"http://127.0.0.1:{server.port}/?token=")


def test_no_tunnel_is_opened_by_anybody(server, monkeypatch):
    opened = []
    monkeypatch.setattr(viser._viser, "ViserTunnel", lambda *arguments: opened.append(arguments))
    with pytest.raises(PieperError, match="not shared through a tunnel"):
        server.request_share_url()
    from viser import _messages

    assert _messages.ShareUrlRequest not in server._websock_server._incoming_handlers
    assert _messages.ShareUrlDisconnect not in server._websock_server._incoming_handlers
    assert opened == []


def test_a_taken_port_is_said_and_not_replaced(server):
    with pytest.raises(PortError, match=rf"port {server.port} is taken; leave it out, or give another one"):
        Server(port=server.port)


def test_without_a_wish_a_taken_port_is_replaced(server, monkeypatch):
    monkeypatch.setattr(module, "USUAL_PORT", server.port)
    other = Server()
    try:
        assert other.port != server.port
        assert get(other.url)[0] == 200
        assert get(other.url.replace(other.guard.token, server.guard.token))[0] == 403
    finally:
        other.stop()


@pytest.mark.parametrize("port", [-1, 65536, 80.0, "8080", True])
def test_a_port_is_a_whole_number(port):
    with pytest.raises(ArrayError, match="port must be a whole number from 0 to 65535"):
        Server(port=port)


def test_a_stopped_server_leaves_its_port():
    running = Server(port=0)
    running.stop()
    with socket.socket() as free:
        free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        free.bind(("127.0.0.1", running.port))


def test_nothing_of_viser_is_printed(capfd):
    Server(port=0).stop()
    assert capfd.readouterr() == ("", "")


def test_other_servers_of_viser_are_left_alone(server):
    """The guard changes no module: a server that somebody else starts is viser's own."""
    from viser.infra import WebsockServer

    assert viser._viser.infra.WebsockServer is WebsockServer
    assert "_seeing" not in WebsockServer._background_worker.__qualname__
    assert viser.infra._infra.websockets is websockets


class TestWhatIsLeanedOn:
    """Each of these fails with a sentence when a new viser is made in another way."""

    def test_the_version(self):
        assert viser.__version__ == VISER, (
            f"viser {viser.__version__} is installed; look at every test of this class, then set VISER in server.py and the extra"
        )

    def test_the_constructor_looks_for_its_websocket_server_in_infra(self, monkeypatch):
        monkeypatch.setattr(viser.ViserServer, "__init__", lambda self, **options: None)
        with pytest.raises(
            InsidesError, match=r"ViserServer|<lambda>.* does not look for infra where it did; install the one"
        ):
            Server(port=0)

    def test_a_server_that_never_asks_the_guard_is_not_started(self, monkeypatch):
        monkeypatch.setattr(
            module._GuardedSockets, "is_guarded", property(lambda self: False, lambda self, value: None), raising=False
        )
        with pytest.raises(InsidesError, match="was not started through the guard"):
            Server(port=0)

    def test_a_failure_while_starting_is_told_and_nobody_waits(self, monkeypatch):
        def broken(self, *arguments, **options):
            raise TypeError("serve() got an unexpected argument")

        monkeypatch.setattr(module._GuardedSockets, "_serve", broken)
        with pytest.raises(InsidesError, match=r"did not start.*unexpected argument.*pip install 'viser=="):
            Server(port=0)


def test_names_of_arrays_of_the_scene_are_those_that_are_set(server):
    """What the arm sets on its ghosts exists in this viser; a misspelt name would be taken without a word."""
    ghosts = server.scene.add_batched_meshes_simple(
        "/probe", np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.uint32), np.empty((0, 4)), np.empty((0, 3))
    )
    for name in ("batched_positions", "batched_wxyzs", "batched_colors"):
        assert name in ghosts._prop_hints
    ghosts.remove()
