"""A page in the browser on which one steps through a video and drags a box for each colour; it takes the place of a desktop window.

It serves this machine alone, and only its own page: any other page that is open in a browser can send requests here too. So a request
has to name this machine as its host, come from the page itself where it says whence it comes, and carry the token that is in the address.
"""

from __future__ import annotations

import base64
import hmac
import json
import re
import secrets
import threading
from collections import OrderedDict
from contextlib import suppress
from dataclasses import asdict
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from pieper.errors import PieperError, VisionError
from pieper.perception.color_learning import classified, learn
from pieper.perception.color_regions import Region
from pieper.perception.drawn_color import DRAWN, as_hex
from pieper.perception.opencv import opencv
from pieper.perception.source import probe, read_frame

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

    from pieper.perception.frame import Image

LARGEST_BODY = 1 << 18
"""Bytes of a request."""

MOST_REGIONS = 1000
"""Boxes in a request."""

_HOST = re.compile(r"(?:127\.0\.0\.1|localhost):([0-9]{1,5})", re.ASCII | re.IGNORECASE)
_PATIENCE = 10.0  # [s] that a request may take to come in
_KEPT = 24  # frames
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Referrer-Policy": "no-referrer",  # the address has the token in it
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class ColorPage:
    """The page and its server, which runs until `close`.

    Parameters
    ----------
    video : str or Path
        A video file, or a folder of images.
    names : sequence of str
        Colours that are there from the start.
    regions : sequence of Region
        Boxes that are there from the start.
    port : int
        0 for any that is free.

    Attributes
    ----------
    url : str
        The address to open, with its token.
    """

    def __init__(
        self, video: str | Path, *, names: Sequence[str] = (), regions: Sequence[Region] = (), port: int = 0
    ) -> None:
        self._frames = _Frames(Path(video))
        self._names = list(dict.fromkeys([*names, *(region.color for region in regions)]))
        self._regions = list(regions)
        self._token = secrets.token_urlsafe(32)
        self._picked: list[Region] | None = None
        self._ended = threading.Event()
        self._learning, self._taking = threading.Lock(), threading.Lock()
        page = self

        class Handler(_Handler):
            pass

        Handler.page = page
        self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        self.url = f"http://127.0.0.1:{self.port}/?token={self._token}"
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), name="pieper-colors", daemon=True
        )
        self._thread.start()

    def wait(self, timeout: float | None = None) -> list[Region]:
        """Return the boxes when somebody presses Done.

        Raises
        ------
        PieperError
            Nobody did, within the time given [s].
        """
        if not self._ended.wait(timeout) or self._picked is None:
            raise PieperError("no boxes were picked: the page was closed, or Done was not pressed in time")
        return self._picked

    def close(self) -> None:
        """Stop serving."""
        self._ended.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(5.0)
        self._frames.close()

    def __enter__(self) -> ColorPage:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def refusal(self, headers: Any, token: str | None, *, writes: bool) -> str | None:
        """Why a request is refused; None when it is not."""
        hosts, origins = headers.get_all("Host") or [], headers.get_all("Origin") or []
        host = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
        if host is None or int(host[1]) != self.port:
            return "this page answers to 127.0.0.1 and localhost alone"
        if (writes or origins) and [origin.lower() for origin in origins] != [f"http://{hosts[0]}".lower()]:
            return "this page answers to itself alone"
        if token is None or not hmac.compare_digest(token.encode("utf-8", "surrogatepass"), self._token.encode()):
            return "the address needs the token that was printed with it"
        return None

    def state(self) -> dict[str, Any]:
        """What the page begins with."""
        draw = {name: as_hex(bgr) for name, bgr in DRAWN.items()}
        regions = [asdict(region) for region in self._regions]
        return {"names": self._names, "regions": regions, "frames": self._frames.count, "draw": draw}

    def frame(self, number: int) -> bytes:
        """Return a frame as JPEG."""
        return _encoded(".jpg", self._frames[number])

    def preview(self, number: int, regions: Sequence[Region]) -> dict[str, Any]:
        """Return a frame with what the boxes teach, as the address of a picture, and the remarks."""
        with self._learning:
            learned = learn(self._frames.__getitem__, regions)
        both = classified(self._frames[number], learned.model)
        raw = _encoded(".png", both[:, both.shape[1] // 2 :])
        return {"image": "data:image/png;base64," + base64.b64encode(raw).decode(), "remarks": list(learned.remarks)}

    def finish(self, regions: list[Region]) -> None:
        """Take the boxes and let `wait` return; refuses boxes that are not in their frames."""
        if not regions:
            raise VisionError("there are no boxes yet; drag one on a marker")
        for region in regions:
            region.cut(self._frames[region.frame])
        with self._taking:
            if self._ended.is_set():
                raise VisionError("boxes were taken already, perhaps from another window; this one can be closed")
            self._picked = regions
            self._ended.set()


class _Frames:
    """Frames by number, read on from the last one where that is possible."""

    def __init__(self, path: Path) -> None:
        info = probe(path)
        self._path, self._folder = path, path.is_dir()
        self.count = max(int(info.frames or 1), 1)
        self._kept: OrderedDict[int, Image] = OrderedDict()
        self._lock = threading.Lock()
        self._video: Any = None
        self._next = 0

    def __getitem__(self, number: int) -> Image:
        with self._lock:
            if not 0 <= number < self.count:
                raise VisionError(f"not valid frame number: {number}; there are frames 0 to {self.count - 1}")
            if number not in self._kept:
                self._kept[number] = read_frame(self._path, number).image if self._folder else self._read(number)
                while len(self._kept) > _KEPT:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(number)
            return self._kept[number]

    def _read(self, number: int) -> Image:
        cv2 = opencv("a video")
        if self._video is None or number < self._next:
            self.close()
            self._video, self._next = cv2.VideoCapture(str(self._path)), 0
        while self._next < number and self._video.grab():
            self._next += 1
        good, image = self._video.read()
        if self._next != number or not good:
            raise VisionError(f"frame {number} of {self._path.name} cannot be read")
        self._next += 1
        kept: Image = image
        return kept

    def close(self) -> None:
        if self._video is not None:
            self._video.release()
            self._video = None


class _Handler(BaseHTTPRequestHandler):
    page: ColorPage
    timeout = _PATIENCE
    server_version, sys_version = "pieper", ""

    def do_GET(self) -> None:
        """The page itself with the token in its address; all else with the token in a header."""
        try:
            where = urlsplit(self.path)
            query = parse_qs(where.query, max_num_fields=8)
        except ValueError:
            where, query = urlsplit(""), {}
        token = query.get("token", [None])[0] if where.path == "/" else self.headers.get("X-Pieper-Token")
        if self._refused(token, writes=False):
            return
        if where.path == "/":
            text = files("pieper.perception").joinpath("color_page.html").read_bytes()
            self._send(200, "text/html; charset=utf-8", text)
        elif where.path == "/state":
            self._answer(self.page.state)
        elif where.path == "/frame":
            number = query.get("n", [""])[0]
            self._answer(lambda: self.page.frame(_frame_number(number)))
        else:
            self._complain(404, "there is no such page")

    def do_POST(self) -> None:
        """Boxes, to be tried or taken."""
        if self._refused(self.headers.get("X-Pieper-Token"), writes=True):
            return
        body = self._body()
        if body is None:
            return
        if self.path == "/preview":
            self._answer(lambda: self.page.preview(_frame_number(body.get("frame")), _regions(body)))
        elif self.path == "/done":
            self._answer(lambda: self.page.finish(_regions(body)))
        else:
            self._complain(404, "there is no such page")

    def _refused(self, token: str | None, *, writes: bool) -> bool:
        reason = self.page.refusal(self.headers, token, writes=writes)
        if reason is not None:
            self._complain(403, reason)
        return reason is not None

    def _body(self) -> dict[str, Any] | None:
        length = self.headers.get("Content-Length", "")
        if not length.isascii() or not length.isdigit() or self.headers.get("Transfer-Encoding"):
            self._complain(411, "a request must say how long it is")
            return None
        if len(length) > 9 or int(length) > LARGEST_BODY:
            self._complain(413, f"a request may have {LARGEST_BODY} bytes")
            return None
        try:
            body = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError):
            body = None
        if not isinstance(body, dict):
            self._complain(400, "a request must be an object in JSON")
            return None
        return body

    def _answer(self, make: Any) -> None:
        try:
            made = make()
        except (PieperError, OSError) as error:
            self._complain(400, str(error))
            return
        if isinstance(made, bytes):
            self._send(200, "image/jpeg", made)
        else:
            self._send(200, "application/json", json.dumps(made).encode())

    def _complain(self, code: int, reason: str) -> None:
        self._send(code, "text/plain; charset=utf-8", reason.encode())

    def _send(self, code: int, kind: str, body: bytes) -> None:
        with suppress(ConnectionError):  # a page that was closed, or stepped on, does not wait for its answer
            self._write(code, kind, body)

    def _write(self, code: int, kind: str, body: bytes) -> None:
        self.send_response(code)
        for key, value in {**_HEADERS, "Content-Type": kind, "Content-Length": str(len(body))}.items():
            self.send_header(key, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  the name is the base's
        """Say nothing: the addresses hold the token."""


def _frame_number(value: Any) -> int:
    try:
        return int(value)
    except (TypeError, ValueError, OverflowError):
        raise VisionError(f"not valid frame number: {str(value)[:20]!r}") from None


def _regions(body: dict[str, Any]) -> list[Region]:
    rows = body.get("regions")
    if not isinstance(rows, list) or len(rows) > MOST_REGIONS:
        got = f"{len(rows)} of them" if isinstance(rows, list) else type(rows).__name__
        raise VisionError(f"regions must be a list of at most {MOST_REGIONS} boxes, got {got}")
    found = []
    for row in rows:
        numbers = [row.get(key) for key in ("frame", "x", "y", "width", "height")] if isinstance(row, dict) else []
        whole = [n for n in numbers if type(n) is int and abs(n) < 1 << 31]
        if len(whole) != 5:
            raise VisionError(f"a region must have whole numbers frame, x, y, width and height, got {str(row)[:80]}")
        color = row.get("color")
        if not isinstance(color, str) or not 0 < len(color.strip()) <= 40 or not color.isprintable():
            raise VisionError(f"a region must have a colour of 1 to 40 letters, got {str(color)[:60]!r}")
        found.append(Region(color.strip(), *whole))
    return found


def _encoded(kind: str, image: Image) -> bytes:
    good, raw = opencv("a page of colours").imencode(kind, image)
    if not good:
        raise VisionError(f"a frame of shape {image.shape} could not be encoded as {kind}, and cannot be shown")
    return bytes(raw.tobytes())
