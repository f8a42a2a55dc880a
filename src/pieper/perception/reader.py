"""Where frames come from: a video file, a folder of images, a camera or stream, a pipe, or anything that can be iterated.

A reader gives frames one after another in the thread that asks; `pieper.perception.source` puts a thread and a queue around it.
Between frames it may say something, as a `Note`. It never seeks: to come to a frame, the frames before it are decoded, since
``CAP_PROP_POS_FRAMES`` lands beside the frame with many codecs.
"""

from __future__ import annotations

import os
import re
import select
import sys
import time
from collections.abc import Sized
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, Protocol, cast

import numpy as np

from pieper.errors import VisionError
from pieper.perception.frame import Frame, Image
from pieper.perception.opencv import decode_image, opencv, read_image_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

Kind = Literal["video", "images", "camera", "stream", "pipe", "frames"]

FPS = 30.0
"""Of images and pipes that bring no times of their own."""

IMAGES = (".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp")
_PATIENCE_MS = 5000  # for a stream to answer; also the longest that a stop waits for it
_CHUNK = 1 << 16
_LARGEST_JPEG = 1 << 26  # bytes, of a picture in a pipe
_LARGEST = 1 << 15  # pixels along a side, of what a pipe may announce


class Note(str):
    """Something that a reader has to say between two frames."""

    __slots__ = ()


@dataclass(frozen=True)
class SourceInfo:
    """What a source says of itself before it is read.

    Attributes
    ----------
    name : str
        For messages.
    kind : "video", "images", "camera", "stream", "pipe" or "frames"
    size : (int, int) or None
        Width and height [px]; None where the first frame will tell.
    fps : float or None
        Frames per second, on average; None where unknown.
    frames : int or None
        How many there are. Of a video, what its header claims: a damaged file holds fewer, and some formats only estimate it.
    codec : str
        Four letters, where known.
    live : bool
        Whether frames are lost when nobody takes them in time.
    """

    name: str
    kind: Kind
    size: tuple[int, int] | None = None
    fps: float | None = None
    frames: int | None = None
    codec: str = ""
    live: bool = False


class Reader(Protocol):
    """Gives frames, one after another."""

    info: SourceInfo

    def read(self, stopped: Callable[[], bool], start: int = 0) -> Iterator[Frame | Note]:
        """Give the frames from number `start` on, until there are no more or `stopped()` is true."""
        ...

    def close(self) -> None:
        """Let go of what was opened."""
        ...


def invalid_number(number: object, name: str, count: int) -> VisionError:
    """Build the error for a frame number that is not there.

    >>> print(invalid_number(7, "a.mp4", 5))
    Error: Not valid frame number: 7; a.mp4 has 5 frames, 0 to 4
    """
    return VisionError(f"Error: Not valid frame number: {number}; {name} has {count} frames, 0 to {count - 1}")


def as_image(picture: Any, name: str) -> tuple[Image, str]:
    """Return a picture as blue, green, red of 8 bits, and what had to be done for it: nothing, or a sentence.

    Grey becomes three equal channels, transparency is left out, and of 16 bits the upper eight stay.

    Raises
    ------
    VisionError
        It is not a picture, is empty, or has numbers of another type.

    Examples
    --------
    >>> image, note = as_image(np.full((2, 2), 0x1234, np.uint16), "frame 0")
    >>> image[0, 0], note
    (array([18, 18, 18], dtype=uint8), 'grey, taken as three equal channels; 16 bits, of which the upper 8 are kept')
    """
    raw = np.asarray(picture)
    if raw.ndim not in (2, 3) or 0 in raw.shape or (raw.ndim == 3 and raw.shape[2] not in (1, 3, 4)):
        raise VisionError(f"{name} must have shape (height, width, 3), got {raw.shape}")
    if raw.dtype not in (np.uint8, np.uint16):
        raise VisionError(
            f"{name} must be of 8 bits (uint8), got {raw.dtype}; scale it to 0 to 255 and convert it before"
        )
    done = []
    if raw.ndim == 2 or raw.shape[2] == 1:
        done.append("grey, taken as three equal channels")
        raw = np.repeat(raw.reshape(*raw.shape[:2], 1), 3, axis=2)
    elif raw.shape[2] == 4:
        done.append("transparency left out")
        raw = raw[..., :3]
    if raw.dtype == np.uint16:
        done.append("16 bits, of which the upper 8 are kept")
        raw = (raw >> 8).astype(np.uint8)
    return np.ascontiguousarray(raw), "; ".join(done)


class VideoReader:
    """A video file, through OpenCV's FFmpeg.

    Times are those of the container, from 0 at its first frame, so a variable frame rate keeps its times. A time that is not after
    the one before is replaced by the next one at the mean rate, and that is said. Where the size changes within the file, FFmpeg
    scales to the first size.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        cv2 = opencv("reading a video")
        _must_exist(Path(path))
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            raise VisionError(
                f"{path} cannot be read as a video: it is damaged or cut off, or its codec is not known to FFmpeg"
            )
        self._take(capture, str(path), Path(path).name)

    @classmethod
    def of(cls, capture: Any, name: str) -> VideoReader:
        """Read a video that OpenCV has opened already."""
        made = cls.__new__(cls)
        made._take(capture, name, name)
        return made

    def _take(self, capture: Any, path: str, name: str) -> None:
        cv2 = opencv("reading a video")
        self._capture, self._path = capture, path
        fps, count = self._capture.get(cv2.CAP_PROP_FPS), self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        size = (int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        self.info = SourceInfo(
            name=name,
            kind="video",
            size=size if min(size) > 0 else None,
            fps=float(fps) if 0 < fps < 1e5 else None,
            frames=int(count) if 0 < count < 1e9 else None,
            codec=_four_letters(self._capture.get(cv2.CAP_PROP_FOURCC)),
        )

    def read(self, stopped: Callable[[], bool], start: int = 0) -> Iterator[Frame | Note]:
        """Decode from the first frame on, and give those from `start`."""
        cv2 = opencv("reading a video")
        clock = _Clock(self.info.name, 1.0 / (self.info.fps or FPS))
        index = 0
        while not stopped() and self._capture.grab():
            moment, said = clock.at(index, float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0)
            if index >= start:
                if said:
                    yield Note(said)
                good, image = self._capture.retrieve()
                if good:
                    yield Frame(cast("Image", image), index, moment)
                else:
                    yield Note(f"{self.info.name}: frame {index} cannot be decoded and is left out")
            index += 1
        if stopped():
            return
        if index == 0:
            raise VisionError(f"{self._path} holds no frames that can be decoded")
        if start >= index:
            raise invalid_number(start, self.info.name, index)
        claimed = self.info.frames or 0
        if index < claimed - 1 and clock.last + 2 * clock.step < claimed * clock.step:
            yield Note(
                f"{self.info.name} is cut off or damaged: it claims {claimed} frames, and ended after {index}; "
                "what was read is kept"
            )
        if clock.corrected > 1:
            yield Note(f"{self.info.name}: {clock.corrected} time stamps in all did not go forward")

    def close(self) -> None:
        """Close the file."""
        self._capture.release()


class FolderReader:
    """The images of a folder, in natural order: ``frame2.png`` comes before ``frame10.png``."""

    def __init__(self, path: str | os.PathLike[str], *, fps: float | None = None) -> None:
        opencv("reading images")
        folder = Path(path)
        _must_exist(folder)
        self.files = sorted((p for p in folder.iterdir() if p.suffix.lower() in IMAGES), key=_natural)
        if not self.files:
            raise VisionError(f"{folder} holds no images; they end in {', '.join(IMAGES)}")
        self.info = SourceInfo(name=folder.name, kind="images", fps=fps or FPS, frames=len(self.files))

    def read(self, stopped: Callable[[], bool], start: int = 0) -> Iterator[Frame | Note]:
        """Give the images; one that cannot be read is left out, and that is said."""
        if start >= len(self.files):
            raise invalid_number(start, self.info.name, len(self.files))
        said: set[str] = set()
        readable = 0
        for index in range(start, len(self.files)):
            if stopped():
                return
            try:
                image, note = self.image(index)
            except VisionError as error:
                yield Note(f"{error}; it is left out")
                continue
            if note and note not in said:
                said.add(note)
                yield Note(f"{self.info.name}: {self.files[index].name} is {note}")
            readable += 1
            yield Frame(image, index, index / (self.info.fps or FPS))
        if not readable:
            raise VisionError(f"{self.info.name} holds no image that can be read")

    def image(self, index: int) -> tuple[Image, str]:
        """Return one image, and what was done to it."""
        path = self.files[index]
        picture = read_image_file(str(path))
        if picture is None:
            raise VisionError(f"frame {index}, {path.name}, cannot be read as an image")
        return as_image(picture, f"frame {index}, {path.name},")

    def close(self) -> None:
        """Nothing is open."""


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


class FramesReader:
    """Images, `Frame` objects, or pairs of image and time, from a list, a generator or anything else to iterate."""

    def __init__(self, frames: Iterable[Any], *, fps: float | None = None, name: str = "frames") -> None:
        self._frames, self._fps = frames, fps or FPS
        count = len(frames) if isinstance(frames, Sized) else None
        self.info = SourceInfo(name=name, kind="frames", fps=fps, frames=count)

    def read(self, stopped: Callable[[], bool], start: int = 0) -> Iterator[Frame | Note]:
        """Give the frames; times that are missing are counted at the rate, times that go back are put right."""
        clock = _Clock(self.info.name, 1.0 / self._fps)
        said: set[str] = set()
        count = 0
        for number, item in enumerate(self._frames):
            if stopped():
                return
            index, moment, picture = number, number / self._fps, item
            if isinstance(item, Frame):
                index, moment, picture = item.index, item.time, item.image
            elif isinstance(item, tuple) and len(item) == 2:
                picture, moment = item[0], float(item[1])
            image, note = as_image(picture, f"frame {index} of {self.info.name}")
            moment, late = clock.at(index, moment)
            for words in (f"{self.info.name}: frame {index} is {note}" if note else "", late):
                if words and note not in said:
                    yield Note(words)
            if note:
                said.add(note)
            count = number + 1
            if index >= start:
                yield Frame(image, index, moment)
        if count == 0:
            raise VisionError(f"{self.info.name} holds no frames")

    def close(self) -> None:
        """Nothing is open."""


class _Clock:
    """Times that go forward."""

    def __init__(self, name: str, step: float) -> None:
        self._name, self.step = name, step
        self.last = -np.inf
        self.corrected = 0
        self._jumped = False
        self._offset = 0.0

    def at(self, index: int, moment: float) -> tuple[float, str]:
        """Return the time of a frame, and what is odd about it, said once."""
        said = ""
        if np.isfinite(moment):
            moment += self._offset
        if not moment > self.last:  # also where it is no number
            right = self.last + self.step if np.isfinite(self.last) else 0.0
            self.corrected += 1
            if self.corrected == 1:
                said = (
                    f"{self._name}: the time stamp of frame {index} does not go forward "
                    f"({moment:.3f} s after {self.last:.3f} s); from there on they follow the mean rate"
                )
            if np.isfinite(moment) and self.last - moment > self.step:
                self._offset += right - moment  # joined recordings: what follows goes on from here
            moment = right
        elif moment - self.last > max(1.0, 10 * self.step) and np.isfinite(self.last) and not self._jumped:
            self._jumped = True
            said = f"{self._name}: the time stamps jump by {moment - self.last:.3f} s at frame {index}; they are kept"
        self.last = moment
        return moment, said


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


def _pause(seconds: float, stopped: Callable[[], bool]) -> None:
    end = time.monotonic() + seconds
    while not stopped() and (left := end - time.monotonic()) > 0:
        time.sleep(min(left, 0.05))


def _must_exist(path: Path) -> None:
    if not path.exists():
        raise VisionError(f"{path}: no such file or folder")


def _natural(path: Path) -> list[tuple[int, int, str]]:
    parts = re.split(r"(\d+)", path.name.lower())
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


def _four_letters(code: float) -> str:
    number = int(code) & 0xFFFFFFFF
    letters = "".join(chr(number >> shift & 0xFF) for shift in (0, 8, 16, 24))
    return letters.strip("\0 ") if letters.isprintable() else ""
