"""Who may speak to the viewer: a browser on this machine that was given the token, and only from the viewer's own page.

Any page that is open in a browser can send requests to a server on the same machine. So every request is looked at, before
anything is answered:

- ``Host`` has to name this machine, or a name that somebody else points at it would do (DNS rebinding);
- ``Origin``, which a browser puts on every websocket, has to be the viewer's own page;
- the address has to carry the token, or the request the cookie that the first such address is answered with.

A websocket needs both its origin and the cookie.
"""

from __future__ import annotations

import hmac
import re
import secrets
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from collections.abc import Sequence

_THIS_MACHINE = re.compile(r"(?:127\.0\.0\.1|localhost)(?::[0-9]{1,5})?", re.ASCII | re.IGNORECASE)

_COOKIE_AGE = 7 * 24 * 3600  # [s]; viewers on ever new ports must not fill the browser with cookies

SAFE_HEADERS = {
    # Nothing from elsewhere, and in no frame of another page.
    "Content-Security-Policy": "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self' ws://127.0.0.1:* ws://localhost:* data: blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Referrer-Policy": "no-referrer",  # the address has the token in it
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
"""Sent with every page."""


class Headers(Protocol):
    """The headers of a request, each of which may be there several times."""

    def get_all(self, key: str) -> Sequence[str]:
        """Every value of a header."""
        ...


@dataclass(frozen=True)
class Verdict:
    """What becomes of a request.

    Attributes
    ----------
    refusal : str or None
        Why it is refused, a sentence; None when it may pass.
    cookie : str or None
        The ``Set-Cookie`` header that the answer has to carry.
    """

    refusal: str | None = None
    cookie: str | None = None


class Guard:
    """Decides about every request to one viewer.

    Parameters
    ----------
    token : str, optional
        What the address must carry; a new one, of 256 bits, when not given.
    cookie_name : str, optional

    Attributes
    ----------
    token : str
    cookie_name : str
        Of its own for each port, since a browser sends the cookies of one host to all its ports.
    """

    def __init__(self, token: str | None = None, *, cookie_name: str = "pieper") -> None:
        self.token = token or secrets.token_urlsafe(32)
        self.cookie_name = cookie_name
        self._cookie = secrets.token_urlsafe(32)

    def judge(self, target: str, headers: Headers) -> Verdict:
        """What becomes of a request.

        Parameters
        ----------
        target : str
            Path and query of the request.
        headers : Headers

        Examples
        --------
        >>> from types import SimpleNamespace
        >>> guard = Guard("open-sesame")
        >>> mine = SimpleNamespace(get_all=lambda key: ["127.0.0.1:8080"] if key == "Host" else [])
        >>> guard.judge("/?token=open-sesame", mine).refusal is None
        True
        >>> guard.judge("/", mine).refusal
        'the address needs the token that the viewer printed when it started'
        """
        host = _single(headers, "Host")
        if host is None or not _THIS_MACHINE.fullmatch(host):
            return Verdict("this viewer answers to 127.0.0.1 and localhost alone")
        is_websocket = bool(headers.get_all("Upgrade"))
        origins = headers.get_all("Origin")
        if (is_websocket or origins) and (len(origins) != 1 or origins[0].lower() != f"http://{host}".lower()):
            return Verdict("this viewer answers to its own page alone")
        if self._has_cookie(headers):
            return Verdict()
        if is_websocket:
            return Verdict("open the address that the viewer printed when it started; reload it if you have")
        if not self._has_token(target):
            return Verdict("the address needs the token that the viewer printed when it started")
        return Verdict(
            cookie=f"{self.cookie_name}={self._cookie}; Path=/; Max-Age={_COOKIE_AGE}; HttpOnly; SameSite=Strict"
        )

    def _has_cookie(self, headers: Headers) -> bool:
        found = False
        for line in headers.get_all("Cookie"):
            for part in line.split(";"):
                name, _, value = part.strip().partition("=")
                found |= name == self.cookie_name and _same(value, self._cookie)
        return found

    def _has_token(self, target: str) -> bool:
        try:
            given = parse_qs(urlsplit(target).query, max_num_fields=32).get("token", [])
        except ValueError:
            return False
        return len(given) == 1 and _same(given[0], self.token)


def _single(headers: Headers, key: str) -> str | None:
    values = headers.get_all(key)
    return values[0] if len(values) == 1 else None


def _same(given: str, secret: str) -> bool:
    """Compare in a time that tells nothing about the secret."""
    return hmac.compare_digest(given.encode("utf-8", "surrogatepass"), secret.encode())
