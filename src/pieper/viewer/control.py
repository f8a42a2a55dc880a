"""One controller at a time: whoever came first moves the arm, the others look on until they take over."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from viser import ClientHandle

    from pieper.viewer.server import Server

LOOKING_ON = "**You are looking on.** Another window controls the arm."
NOBODY = "**Nobody controls the arm.**"
IN_CONTROL = "You control the arm; {others} looking on."
TAKE_OVER = "Take control"

_RELOAD = 2.0  # [s]


class Control:
    """Who may move the arm.

    The first client that comes when nobody controls does from then on. When it leaves, the arm is stopped, and nobody controls until
    somebody takes over or a new client comes. A page that is loaded anew may come back before it is known to have gone: it keeps control.

    Parameters
    ----------
    server : Server
    on_lost : callable, optional
        Called when the one in control has left or has been replaced.

    Attributes
    ----------
    holder : int or None
        Id of the client in control.
    """

    def __init__(self, server: Server, *, on_lost: Callable[[], None] | None = None) -> None:
        self.holder: int | None = None
        self._server = server
        self._on_lost = on_lost
        self._lock = threading.RLock()
        self._notes: dict[int, tuple[Any, Any]] = {}
        self._came_at: dict[int, float] = {}
        server.may_control = self.allows
        server.on_client_connect(self._came)
        server.on_client_disconnect(self._went)

    def allows(self, client_id: int) -> bool:
        """Whether a client may move the arm."""
        return self.holder == client_id

    def take(self, client_id: int) -> None:
        """Hand control to a client; whoever had it looks on."""
        with self._lock:
            if client_id not in self._notes or self.holder == client_id:
                return
            lost = self.holder is not None
            self.holder = client_id
            self._tell()
        if lost and self._on_lost is not None:
            self._on_lost()

    def _came(self, client: ClientHandle) -> None:
        with self._lock:
            note = client.gui.add_markdown("", order=-2.0, visible=False)
            button = client.gui.add_button(TAKE_OVER, order=-1.0, visible=False, color="orange")
            button.on_click(lambda _: self.take(client.client_id))
            self._notes[client.client_id] = (note, button)
            self._came_at[client.client_id] = time.monotonic()
            if self.holder is None:
                self.holder = client.client_id
            self._tell()

    def _went(self, client: ClientHandle) -> None:
        with self._lock:
            self._notes.pop(client.client_id, None)
            self._came_at.pop(client.client_id, None)
            lost = self.holder == client.client_id
            if lost:
                newest = max(self._came_at, key=lambda other: self._came_at[other], default=None)
                reloaded = newest is not None and time.monotonic() - self._came_at[newest] < _RELOAD
                self.holder = newest if reloaded else None
            self._tell()
        if lost and self._on_lost is not None:
            self._on_lost()

    def _tell(self) -> None:
        """Write to every client how it stands."""
        here = (
            self._server.get_clients().keys() & self._notes.keys()
        )  # without those that have gone and are yet to be told of
        others = len(here) - 1
        for client_id in here:
            note, button = self._notes[client_id]
            in_control = client_id == self.holder
            if in_control:
                note.content = IN_CONTROL.format(others=f"{others} other window{'s are' if others > 1 else ' is'}")
            else:
                note.content = NOBODY if self.holder is None else LOOKING_ON
            note.visible = others > 0 or not in_control
            button.visible = not in_control
