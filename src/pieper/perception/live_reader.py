"""Frames of a camera or of a stream of the network, of which the newest counts."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol, cast

from pieper.errors import VisionError
from pieper.perception.frame import Frame
from pieper.perception.opencv import opencv
from pieper.perception.reader import Kind, Note, SourceInfo, VideoReader, as_image

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_PATIENCE_MS = 5000  # for a stream to answer; also the longest that a stop waits for it


class Capture(Protocol):
    """What a camera has to offer; OpenCV's ``VideoCapture`` does."""

    def isOpened(self) -> bool:
        """Whether it can be read."""
        ...

    def read(self) -> tuple[bool, Any]:
        """Wait for an image; False when there is none."""
        ...

    def release(self) -> None:
        """Let go of it."""
        ...


class LiveReader:
    """A camera or a stream, opened again when it is unplugged.

    Parameters
    ----------
    name : str
        For messages.
    connect : callable
        Opens it, and gives a `Capture`.
    kind : "camera" or "stream"
    patience : float
        Give up after so long without an image [s].
    first_wait, longest_wait : float
        Pause before the first attempt to open it again, doubled with each one up to the longest [s].
    """

    def __init__(
        self,
        name: str,
        connect: Callable[[], Capture],
        *,
        kind: Kind = "camera",
        fps: float | None = None,
        patience: float = 60.0,
        first_wait: float = 0.25,
        longest_wait: float = 8.0,
    ) -> None:
        self._connect = connect
        self._capture = connect()
        if not self._capture.isOpened():
            self._capture.release()
            doubt = (
                "does it answer, and is the address right?"
                if kind == "stream"
                else "is it plugged in, free, and readable by this user?"
            )
            raise VisionError(f"{name} cannot be opened; {doubt}")
        self._patience, self._waits = patience, (first_wait, longest_wait)
        self.info = SourceInfo(name=name, kind=kind, fps=fps, live=True)

    def read(self, stopped: Callable[[], bool], start: int = 0) -> Iterator[Frame | Note]:
        """Give images with the time at which each came, in seconds since the epoch, on a clock that never goes back."""
        epoch = time.time() - time.monotonic()
        index, last, wait, lost = 0, time.monotonic(), self._waits[0], False
        said = ""
        while not stopped():
            good, picture = self._capture.read() if self._capture.isOpened() else (False, None)
            now = time.monotonic()
            if good:
                if lost:
                    yield Note(f"{self.info.name} is back after {now - last:.1f} s")
                last, wait, lost = now, self._waits[0], False
                image, note = as_image(picture, f"frame {index} of {self.info.name}")
                if note != said:
                    said = note
                    yield Note(f"{self.info.name} is {note}" if note else f"{self.info.name} is in colour again")
                if index >= start:
                    yield Frame(image, index, epoch + now)
                index += 1
                continue
            if not lost:
                lost = True
                yield Note(f"{self.info.name} gives no images; trying to open it again")
            if now - last > self._patience:
                raise VisionError(f"{self.info.name} gave no image for {now - last:.0f} s; given up")
            self._capture.release()
            _pause(wait, stopped)
            wait = min(2 * wait, self._waits[1])
            if not stopped():
                self._capture = self._connect()

    def close(self) -> None:
        """Let go of the camera."""
        self._capture.release()


def camera_reader(which: int | str, *, fps: float | None = None, **options: Any) -> LiveReader:
    """Open a camera of this computer, by its number or as ``/dev/video0``."""
    cv2 = opencv("a camera")
    number = which if isinstance(which, int) else int(which.removeprefix("/dev/video"))

    def connect() -> Capture:
        capture = cv2.VideoCapture(number)
        with suppress(cv2.error):
            capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
            if fps:
                capture.set(cv2.CAP_PROP_FPS, fps)
        return cast("Capture", capture)

    return LiveReader(f"camera {number}", connect, kind="camera", fps=fps, **options)


def stream_reader(url: str, **options: Any) -> LiveReader | VideoReader:
    """Open an address, such as ``rtsp://...`` or ``http://...``; what has an end is a video. Passwords are kept out of messages."""
    cv2 = opencv("a stream")
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _PATIENCE_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _PATIENCE_MS]
    name = re.sub(r"//[^/@]*@", "//...@", url)
    first = [cv2.VideoCapture(url, cv2.CAP_FFMPEG, limits)]
    if first[0].isOpened() and first[0].get(cv2.CAP_PROP_FRAME_COUNT) > 0:
        return VideoReader.of(first[0], name)

    def connect() -> Capture:
        return cast("Capture", first.pop() if first else cv2.VideoCapture(url, cv2.CAP_FFMPEG, limits))

    return LiveReader(name, connect, kind="stream", **options)


def _pause(seconds: float, stopped: Callable[[], bool]) -> None:
    end = time.monotonic() + seconds
    while not stopped() and (left := end - time.monotonic()) > 0:
        time.sleep(min(left, 0.05))
