"""Frames from a pipe: raw pixels, MJPEG or Y4M."""

from __future__ import annotations

import os
import re
import select
import sys
from typing import TYPE_CHECKING, BinaryIO, cast

import numpy as np

from pieper.errors import VisionError
from pieper.perception.frame import Frame, Image
from pieper.perception.opencv import decode_image, opencv
from pieper.perception.reader import FPS, Note, SourceInfo, invalid_number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_CHUNK = 1 << 16
_LARGEST_JPEG = 1 << 26  # bytes, of a picture in a pipe
_LARGEST = 1 << 15  # pixels along a side, of what a pipe may announce


class PipeReader:
    """Frames from a pipe: Y4M and MJPEG are recognised; anything else is raw blue, green, red of a given size.

    A pipe waits, so nothing is dropped. Times are counted at the rate given, or at that of the Y4M header.
    """

    def __init__(
        self,
        stream: BinaryIO | None = None,
        *,
        size: tuple[int, int] | None = None,
        fps: float | None = None,
        name: str = "stdin",
    ) -> None:
        self._stream = sys.stdin.buffer if stream is None else stream
        self._size, self._fps = size, fps
        self.info = SourceInfo(name=name, kind="pipe", size=size, fps=fps)
        if size is not None and not all(1 <= n <= _LARGEST for n in size):
            raise VisionError(f"size must be a positive width and height, got {size[0]} x {size[1]}")

    def read(self, stopped: Callable[[], bool], start: int = 0) -> Iterator[Frame | Note]:
        """Give the frames of the pipe."""
        pipe = _Pipe(self._stream, stopped)
        fps = self._fps or FPS
        if self._size is not None:
            images = self._raw(pipe, self._size)
        elif pipe.peek(9) == b"YUV4MPEG2":
            images, rate = self._y4m(pipe)
            fps = self._fps or rate or FPS
        elif pipe.peek(2) == b"\xff\xd8":
            images = self._mjpeg(pipe)
        elif not pipe.peek(1):
            images = iter(())
        else:
            raise VisionError(
                f"{self.info.name} holds neither Y4M nor MJPEG; for raw BGR frames say --size WIDTHxHEIGHT"
            )
        index = 0
        for image in images:
            if isinstance(image, Note):
                yield image
                continue
            if index >= start:
                yield Frame(image, index, index / fps)
            index += 1
        if not stopped():
            if index == 0:
                raise VisionError(f"{self.info.name} holds no frames")
            if start >= index:
                raise invalid_number(start, self.info.name, index)

    def _raw(self, pipe: _Pipe, size: tuple[int, int]) -> Iterator[Image | Note]:
        width, height = size
        while block := pipe.take(3 * width * height):
            if len(block) < 3 * width * height:
                if not pipe.stopped():
                    yield Note(
                        f"{self.info.name} ended within a frame; the {len(block)} bytes of it are left out "
                        f"(is the size {width} x {height} right?)"
                    )
                return
            yield np.frombuffer(block, np.uint8).reshape(height, width, 3)

    def _y4m(self, pipe: _Pipe) -> tuple[Iterator[Image | Note], float | None]:
        words = pipe.line().decode("ascii", "replace").split()[1:]
        tags = {word[0]: word[1:] for word in words}
        try:
            width, height = int(tags["W"]), int(tags["H"])
            above, below = (int(n) for n in tags.get("F", "0:1").split(":"))
        except (KeyError, ValueError) as cause:
            raise VisionError(f"{self.info.name}: the Y4M header is malformed: {' '.join(words)[:80]!r}") from cause
        form = tags.get("C", "420jpeg")
        planes = {"420": 0.25, "422": 0.5, "444": 1.0, "mono": 0.0}
        kind = next((k for k in planes if form.startswith(k)), "")
        deep = re.search(r"p1\d|1[0-6]$", form)
        if not kind or deep or not (1 <= width <= _LARGEST and 1 <= height <= _LARGEST):
            raise VisionError(
                f"{self.info.name}: Y4M of {width} x {height}, {form}, is not supported; it must be 8 bits of 420, 422, 444 or mono"
            )
        return self._y4m_frames(pipe, width, height, kind), above / below if above > 0 and below > 0 else None

    def _y4m_frames(self, pipe: _Pipe, width: int, height: int, kind: str) -> Iterator[Image | Note]:
        cv2 = opencv("Y4M")
        across = {"420": (width + 1) // 2, "422": (width + 1) // 2, "444": width, "mono": 0}[kind]
        down = {"420": (height + 1) // 2, "422": height, "444": height, "mono": 0}[kind]
        bright, tint = width * height, across * down
        while header := pipe.line():
            block = pipe.take(bright + 2 * tint)
            if not header.startswith(b"FRAME") or len(block) < bright + 2 * tint:
                if not pipe.stopped():
                    yield Note(f"{self.info.name} ended within a frame, which is left out")
                return
            y = np.frombuffer(block, np.uint8, bright).reshape(height, width)
            if not tint:
                yield np.repeat(y[..., None], 3, axis=2)
                continue
            uv = np.frombuffer(block, np.uint8, 2 * tint, bright).reshape(2, down, across)
            wide = [cv2.resize(plane, (width, height), interpolation=cv2.INTER_LINEAR) for plane in uv]
            yield cast("Image", cv2.cvtColor(np.dstack([y, wide[1], wide[0]]), cv2.COLOR_YCrCb2BGR))

    def _mjpeg(self, pipe: _Pipe) -> Iterator[Image | Note]:
        while jpeg := pipe.until(b"\xff\xd9", _LARGEST_JPEG):
            picture = decode_image(np.frombuffer(jpeg, np.uint8))
            if picture is None:
                if not pipe.stopped():
                    yield Note(f"{self.info.name}: a JPEG of {len(jpeg)} bytes cannot be decoded and is left out")
                continue
            yield cast("Image", picture)

    def close(self) -> None:
        """The pipe is not ours to close."""


class _Pipe:
    """Bytes of a stream, in pieces, without being stuck in it when it is time to stop."""

    def __init__(self, stream: BinaryIO, stopped: Callable[[], bool]) -> None:
        self._stream, self.stopped = stream, stopped
        self._held = bytearray()
        try:
            self._number: int | None = stream.fileno() if sys.platform != "win32" else None
        except OSError:
            self._number = None

    def _more(self) -> bool:
        while self._number is not None and not select.select([self._number], [], [], 0.1)[0]:
            if self.stopped():
                return False
        if self.stopped():
            return False
        piece = self._stream.read(_CHUNK) if self._number is None else os.read(self._number, _CHUNK)
        self._held += piece
        return bool(piece)

    def peek(self, count: int) -> bytes:
        while len(self._held) < count and self._more():
            pass
        return bytes(self._held[:count])

    def take(self, count: int) -> bytes:
        while len(self._held) < count and self._more():
            pass
        piece = bytes(self._held[:count])
        del self._held[:count]
        return piece

    def line(self) -> bytes:
        """Up to and with the end of the line; headers are short, so a long one is none."""
        while b"\n" not in self._held and len(self._held) < 4096 and self._more():
            pass
        return self.take(self._held.find(b"\n") + 1 or len(self._held))

    def until(self, mark: bytes, most: int) -> bytes:
        """Up to and with a mark; all that is left where it does not come, or not within so many bytes."""
        begin = 0
        while (at := self._held.find(mark, begin)) < 0:
            if len(self._held) > most:
                return self.take(most)
            begin = max(len(self._held) - len(mark) + 1, 0)
            if not self._more():
                return self.take(len(self._held))
        return self.take(at + len(mark))
