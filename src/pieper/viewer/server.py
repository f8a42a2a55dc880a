"""viser on this machine alone, behind a guard.

viser by itself listens on every interface, answers any page, takes the next port when one is taken, and lets every visitor ask
for a public tunnel. Here it is given a socket on 127.0.0.1 that is open already, and a `pieper.viewer.guard.Guard` that sees every
request first. For that it is held by its insides, which are those of one version; `InsidesError` tells when they have changed.
"""

from __future__ import annotations

import errno
import http
import math
import socket
from contextlib import contextmanager
from importlib.util import find_spec
from types import FunctionType, SimpleNamespace
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from pieper.errors import ArrayError, MissingExtraError, PieperError
from pieper.viewer.guard import SAFE_HEADERS, Guard

if find_spec("viser") is None:
    raise MissingExtraError("viser", "viewer", "the viewer in the browser")

import rich
import viser
import viser._viser
import viser.infra
import viser.infra._infra
import websockets
import websockets.asyncio.server
import websockets.datastructures
import websockets.exceptions
from viser import _messages
from websockets.http11 import Response

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable, Iterator

VISER = "1.1.1"
"""The version of viser whose insides are known here."""

USUAL_PORT = 8080

_SHARING = (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect)


class InsidesError(PieperError):
    """viser is not made as it was: the guard cannot stand in front of it, and nothing is started."""


class PortError(PieperError):
    """A port that cannot be listened on."""


class Server(viser.ViserServer):
    """A viser server that this machine alone can reach, with the token.

    Parameters
    ----------
    port : int, optional
        The port to listen on, or 0 for any free one. When not given it is 8080, or any free one where that is taken.
    label : str, optional
        Written above the panel.
    token : str, optional
        What the address must carry; a new one, of 256 bits, when not given.

    Attributes
    ----------
    guard : Guard
    port : int
        The port that it became.
    url : str
        The address to open, token and all.
    is_running : bool
        False once it has been stopped; what is written into a page then goes nowhere.
    may_control : callable
        Asked with the id of a client before anything that the client did is taken up: true if it may. By itself everybody may. What a
        client has of its own (``client.gui``) is not asked about.

    Raises
    ------
    PortError
        `port` is taken, or may not be used.
    InsidesError
        Another viser than the one this was written for.
    """

    guard: Guard
    port: int
    url: str
    may_control: Callable[[int], bool]
    is_running: bool = True

    def __init__(self, port: int | None = None, *, label: str | None = None, token: str | None = None) -> None:
        listening = _listen(port)
        self.port = listening.getsockname()[1]
        self.may_control = lambda client_id: True
        self.guard = Guard(token, cookie_name=f"pieper-{self.port}")
        self.url = f"http://127.0.0.1:{self.port}/?token={quote(self.guard.token)}"
        try:
            with _quiet():
                # the same constructor, which finds our websocket server where it looks for viser's
                made: list[_GuardedSockets] = []

                def websocket_server(*arguments: Any, **options: Any) -> _GuardedSockets:
                    made.append(_GuardedSockets(listening, self.guard, *arguments, **options))
                    return made[-1]

                infra = _with(viser.infra, WebsockServer=websocket_server)
                _seeing(viser.ViserServer.__init__, infra=infra)(
                    self, host="127.0.0.1", port=self.port, label=label, verbose=False
                )
            if not made or not made[0].is_guarded:
                raise _changed("its server was not started through the guard")
            made[0].admits = self._admits
        except BaseException:
            listening.close()
            raise
        self.gui.configure_theme(show_share_button=False, show_logo=False)

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refused: a tunnel would open the viewer to everybody."""
        raise PieperError("the viewer is not shared through a tunnel; it is reached from this machine alone")

    def _admits(self, client_id: int, message: Any) -> bool:
        """Whether a message from a browser is taken up; where it is not, that browser is shown again what holds."""
        admitted = self.may_control(client_id) and _is_sane(message)
        if not admitted:
            for undoing in self._as_it_is(message):
                self._websock_server._client_state_from_id[client_id].message_buffer.push(undoing)
        return admitted

    def _as_it_is(self, message: Any) -> list[Any]:
        """Messages that show what a browser has changed by itself as it is here."""
        if isinstance(message, _messages.GuiUpdateMessage):
            handle = self.gui._gui_input_handle_from_uuid.get(message.uuid)
            if handle is not None and "value" in message.updates:
                return [_messages.GuiUpdateMessage(message.uuid, {"value": handle.value})]
        if isinstance(message, _messages.TransformControlsUpdateMessage):
            node = self.scene._handle_from_node_name.get(message.name)
            if node is not None:
                w, x, y, z = (float(part) for part in node.wxyz)
                a, b, c = (float(part) for part in node.position)
                return [
                    _messages.SetOrientationMessage(message.name, (w, x, y, z)),
                    _messages.SetPositionMessage(message.name, (a, b, c)),
                ]
        return []

    def stop(self) -> None:
        """End the server; browsers that look at it are told."""
        self.is_running = False
        with _quiet():
            super().stop()


class _GuardedSockets(viser.infra.WebsockServer):
    """The websocket server of viser, on a socket that is given, behind a guard, and deaf to wishes for a tunnel."""

    def __init__(self, listening: socket.socket, guard: Guard, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._listening = listening
        self._guard = guard
        self._failure: BaseException | None = None
        self.is_guarded = False
        self.admits: Callable[[int, Any], bool] = lambda client_id, message: False

    async def _handle_incoming_message(self, client_id: Any, message: Any) -> None:
        if self.admits(client_id, message):
            await super()._handle_incoming_message(client_id, message)

    def register_handler(self, message_cls: Any, callback: Any) -> None:
        if message_cls not in _SHARING:
            super().register_handler(message_cls, callback)

    def start(self) -> None:
        super().start()
        if self._failure is not None:
            raise _changed(f"its server did not start ({self._failure!r})") from self._failure

    def _background_worker(self, ready_sem: threading.Semaphore) -> None:
        server = SimpleNamespace(serve=self._serve)
        seen = _with(websockets, asyncio=SimpleNamespace(server=server))
        try:
            _seeing(viser.infra.WebsockServer._background_worker, websockets=seen)(self, ready_sem)
        except BaseException as failure:  # noqa: BLE001  whoever waits for the start must not wait for ever
            self._failure = failure
            ready_sem.release()

    def _serve(
        self, handler: Any, host: str, port: int, *, process_request: Callable[..., Response | None], **options: Any
    ) -> Any:
        guard = self._guard

        def guarded(connection: Any, request: Any) -> Response | None:
            verdict = guard.judge(request.path, request.headers)
            if verdict.refusal is not None:
                return _refused(verdict.refusal)
            response = process_request(connection, request)
            if response is not None:
                for name, value in SAFE_HEADERS.items():
                    response.headers[name] = value
                if verdict.cookie is not None:
                    response.headers["Set-Cookie"] = verdict.cookie
            return response

        self.is_guarded = True
        return websockets.asyncio.server.serve(
            handler, sock=self._listening, process_request=guarded, server_header=None, **options
        )


def _is_sane(message: Any) -> bool:
    """Whether every number in a message is finite; a browser can send NaN, or nothing where a number should be."""
    if isinstance(message, _messages.GuiUpdateMessage):
        return _is_finite(list(message.updates.values()))
    if isinstance(message, _messages.TransformControlsUpdateMessage):
        numbers = [*message.position, *message.wxyz]
        return _is_finite(numbers) and any(message.wxyz)
    return True


def _is_finite(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(_is_finite(item) for item in value)
    return value is not None and not (isinstance(value, float) and not math.isfinite(value))


def _refused(reason: str) -> Response:
    body = f"403 Forbidden: {reason}\n".encode()
    headers = websockets.datastructures.Headers(
        {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body)), "Connection": "close"}
        | SAFE_HEADERS
    )
    return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, body)


# --------------------------------------------------------------------------------------------------------------------
# the socket


def _listen(port: Any) -> socket.socket:
    """A socket on 127.0.0.1, listening."""
    if port is None:
        try:
            return _listen(USUAL_PORT)
        except PortError:
            return _listen(0)
    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port <= 65535:
        raise ArrayError(f"port must be a whole number from 0 to 65535, got {port!r}")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows, where reuse means sharing
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(("127.0.0.1", port))
        listening.listen(128)
        listening.setblocking(False)
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRINUSE:
            raise PortError(f"port {port} is taken; leave it out, or give another one (0 for any free one)") from error
        raise PortError(f"port {port} cannot be listened on: {error.strerror}") from error
    return listening


# --------------------------------------------------------------------------------------------------------------------
# how viser is held


def _seeing(function: Any, **names: Any) -> Callable[..., Any]:
    """The same function, for which some names of its module mean something else. The module is left alone."""
    code = function.__code__
    missing = [name for name in names if not _looks_for(code, name)]
    if missing or code.co_freevars:
        raise _changed(f"{function.__qualname__} does not look for {', '.join(missing or names)} where it did")
    changed = FunctionType(code, {**function.__globals__, **names}, function.__name__, function.__defaults__)
    changed.__kwdefaults__ = function.__kwdefaults__
    return changed


def _looks_for(code: Any, name: str) -> bool:
    """Whether this code, or a function within it, looks for a global of that name."""
    inner = [constant for constant in code.co_consts if hasattr(constant, "co_names")]
    return name in code.co_names or any(_looks_for(one, name) for one in inner)


class _With:
    """A module with some names replaced."""

    def __init__(self, module: Any, names: dict[str, Any]) -> None:
        self._module = module
        self.__dict__.update(names)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


def _with(module: Any, **names: Any) -> _With:
    return _With(module, names)


def _changed(what: str) -> InsidesError:
    return InsidesError(
        f"viser {viser.__version__} is not made as viser {VISER}, for which the guard was written: {what}; "
        f"install the one that pieper asks for: pip install 'viser=={VISER}'"
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """Without viser's banner, which is printed whether wanted or not."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
