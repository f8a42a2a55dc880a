"""Frames of a video, a folder of images, a camera, a stream, a pipe or a list, read ahead in a thread of their own.

A recording waits for whoever reads it: no frame is lost. A camera does not wait: when frames are not taken in time, the oldest is
dropped and counted, so that what comes next is the newest.
"""

from __future__ import annotations

import re
import threading
import warnings
import weakref
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from pieper.errors import PieperWarning, VisionError
from pieper.perception import live_reader, reader
from pieper.perception.frame import Frame
from pieper.perception.pipe_reader import PipeReader
from pieper.perception.reader import Note, Reader, SourceInfo

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator, Sequence
    from types import TracebackType

_URL = re.compile(r"(rtsps?|rtmps?|https?|udp|tcp|srt)://", re.IGNORECASE)
_LONGEST_STOP = 10.0  # s; a stream answers or gives up within 5


class Source:
    """Frames, one after another; made by `open_source`.

    Attributes
    ----------
    info : SourceInfo
        What it says of itself.
    dropped : int
        Frames of a camera or stream that came and were not taken in time.
    taken : int
        Frames given so far.

    Notes
    -----
    What is odd but no reason to stop (a file that ends early, time stamps that go back, a camera that was unplugged) comes as a
    `PieperWarning` in the thread that iterates. What is a reason to stop is raised there, after the frames before it.
    """

    def __init__(
        self, frames: Reader, *, start: int = 0, stop: int | None = None, queue: int = 8, threaded: bool = True
    ) -> None:
        self.info = frames.info
        self.taken = 0
        self._size: tuple[int, int] | None = None
        self._stopping = False
        self._reader, self._start, self._stop = frames, start, stop
        self._ahead = _Ahead(frames, start, stop, queue) if threaded else None
        self._last = weakref.finalize(self, _end, frames, self._ahead)

    @property
    def dropped(self) -> int:
        """Frames of a camera or stream that came and were not taken in time."""
        return self._ahead.dropped if self._ahead is not None else 0

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames that are left."""
        for item in self._ahead if self._ahead is not None else self._here():
            if self._stopping:
                return
            if isinstance(item, Note):
                warnings.warn(str(item), PieperWarning, stacklevel=2)
                continue
            if self._size is None:
                self._size = item.size
            elif item.size != self._size:
                self.close()
                raise VisionError(
                    "frame {} of {} is {} x {}, those before were {} x {}; one size at a time, so read them apart".format(
                        item.index, self.info.name, *item.size, *self._size
                    )
                )
            self.taken += 1
            yield item

    def _here(self) -> Iterator[Frame | Note]:
        for item in self._reader.read(lambda: not self._last.alive, self._start):
            if isinstance(item, Frame) and self._stop is not None and item.index >= self._stop:
                return
            yield item

    def stop(self) -> None:
        """Have the iteration end before the next frame; may be called from anywhere, a signal handler too."""
        self._stopping = True
        if self._ahead is not None:
            self._ahead.leave = True

    def close(self) -> None:
        """Stop the thread and let go of the file or camera; iterating ends."""
        self._last()

    def __enter__(self) -> Source:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Ahead:
    """The thread that reads ahead, and its queue. It does not know the `Source`, so that one that is forgotten can end it."""

    def __init__(self, frames: Reader, start: int, stop: int | None, length: int) -> None:
        self.dropped = 0
        self.leave = False
        self._length, self._live = max(1, length), frames.info.live
        self._items: deque[Frame | Note] = deque()
        self._change = threading.Condition()
        self._stopped = self._done = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, args=(frames, start, stop), name="pieper-frames", daemon=True)
        self._thread.start()

    def _run(self, frames: Reader, start: int, stop: int | None) -> None:
        try:
            for item in frames.read(lambda: self._stopped, start):
                if isinstance(item, Frame) and stop is not None and item.index >= stop:
                    break
                self._put(item)
        except BaseException as error:  # noqa: BLE001  raised where the frames are taken
            self._error = error
        with self._change:
            self._done = True
            self._change.notify_all()

    def _put(self, item: Frame | Note) -> None:
        with self._change:
            if isinstance(item, Frame):
                while self._waiting() >= self._length and not self._stopped:
                    if self._live:
                        self._items.remove(next(i for i in self._items if isinstance(i, Frame)))
                        self.dropped += 1
                    else:
                        self._change.wait()
            self._items.append(item)
            self._change.notify_all()

    def _waiting(self) -> int:
        return sum(isinstance(item, Frame) for item in self._items)

    def __iter__(self) -> Iterator[Frame | Note]:
        while True:
            with self._change:
                while not (self._items or self._done or self._stopped or self.leave):
                    self._change.wait(0.2)  # so that Ctrl-C is heard
                if self._stopped or self.leave:
                    return
                if not self._items:
                    if self._error is not None:
                        error, self._error = self._error, None
                        raise error
                    return
                item = self._items.popleft()
                self._change.notify_all()
            yield item

    def end(self) -> None:
        with self._change:
            self._stopped = True
            self._items.clear()
            self._change.notify_all()
        if self._thread is not threading.current_thread():
            self._thread.join(_LONGEST_STOP)


def _end(frames: Reader, ahead: _Ahead | None) -> None:
    if ahead is not None:
        ahead.end()
    frames.close()


def open_source(
    what: str | int | os.PathLike[str] | BinaryIO | Reader | Iterable[Any],
    *,
    start: int = 0,
    stop: int | None = None,
    size: tuple[int, int] | None = None,
    fps: float | None = None,
    queue: int = 8,
    patience: float = 60.0,
) -> Source:
    """Open something that gives frames.

    Parameters
    ----------
    what : path, int, str, stream, Reader or iterable
        A video file; a folder of images, taken in natural order; a camera, as its number or ``/dev/video0``; an address such as
        ``rtsp://...`` or ``http://...``; ``"-"`` for standard input, or an open binary stream; or anything to iterate: images,
        pairs of image and time [s], or `Frame` objects. Nothing of the network is opened unless an address is given here.
    start, stop : int
        Frames from `start` to before `stop`, counted from 0.
    size : (int, int), optional
        Width and height of raw BGR frames on standard input [px]; Y4M and MJPEG say it themselves.
    fps : float, optional
        Frames per second of what has no times: images (30 by default), raw frames. For a camera, the rate to ask for.
    queue : int
        How many frames may be read ahead.
    patience : float
        How long a camera or stream may be without images before it is given up [s].

    Returns
    -------
    Source
        Iterate over it, and close it, best by ``with``.

    Raises
    ------
    VisionError
        No such file, not a video or of an unknown codec, an empty folder, a camera that does not open. While iterating: no frames, a
        start after the last frame, a size that changes, a camera that stays away.
    MissingExtraError
        OpenCV is not installed, and the source needs it.

    Notes
    -----
    Frames are 8 bits of blue, green, red. Grey images become three equal channels, of 16 bits the upper eight are kept, and a
    warning says so. Videos are brought to 8 bits of colour by FFmpeg itself.

    Examples
    --------
    >>> import numpy as np
    >>> with open_source([np.zeros((4, 6, 3), np.uint8)] * 3, fps=10) as source:
    ...     [(frame.index, frame.time, frame.size) for frame in source]
    [(0, 0.0, (6, 4)), (1, 0.1, (6, 4)), (2, 0.2, (6, 4))]
    """
    if start < 0 or (stop is not None and stop <= start):
        raise VisionError(f"start must be 0 or more and before stop, got start {start}, stop {stop}")
    if fps is not None and not 0 < fps < float("inf"):
        raise VisionError(f"fps must be a positive number, got {fps:g}")
    if not patience >= 0:
        raise VisionError(f"patience must be 0 seconds or more, got {patience:g}")
    frames = _reader(what, size, fps, patience)
    threaded = not isinstance(frames, reader.FramesReader)  # what the caller made is read in the caller's thread
    return Source(frames, start=start, stop=stop, queue=queue, threaded=threaded)


def _reader(what: Any, size: tuple[int, int] | None, fps: float | None, patience: float) -> Reader:
    if isinstance(what, int):
        return live_reader.camera_reader(what, fps=fps, patience=patience)
    if isinstance(what, str) or hasattr(what, "__fspath__"):
        text = str(what)
        if text == "-":
            return PipeReader(size=size, fps=fps)
        if text.isdecimal() and not Path(text).exists():
            return live_reader.camera_reader(int(text), fps=fps, patience=patience)
        if re.fullmatch(r"/dev/video\d+", text):
            return live_reader.camera_reader(text, fps=fps, patience=patience)
        if _URL.match(text):
            return live_reader.stream_reader(text, fps=fps, patience=patience)
        if Path(text).is_dir():
            return reader.FolderReader(text, fps=fps)
        return reader.VideoReader(text)
    if isinstance(what, Source):
        raise VisionError("this source is open already; iterate over it")
    if hasattr(what, "info") and callable(getattr(what, "read", None)):
        return what  # type: ignore[no-any-return]
    if callable(getattr(what, "read", None)):
        return PipeReader(what, size=size, fps=fps, name=str(getattr(what, "name", "stream")))
    try:
        iter(what)
    except TypeError:
        raise VisionError(
            f"a source must be a path, a camera number, an address, a stream or frames, got {type(what).__name__}"
        ) from None
    return reader.FramesReader(what, fps=fps)


def probe(path: str | os.PathLike[str]) -> SourceInfo:
    """Return what a video file or a folder of images says of itself, without decoding it.

    The number of frames of a video is a claim of its header: a damaged file holds fewer, and some formats only estimate it.

    Raises
    ------
    VisionError
        No such file, or not a video.
    """
    frames = reader.FolderReader(path) if Path(path).is_dir() else reader.VideoReader(path)
    try:
        return frames.info
    finally:
        frames.close()


def read_frame(path: str | os.PathLike[str], n: int) -> Frame:
    """Return frame `n` of a video file or a folder of images, exactly: see `read_frames`."""
    return read_frames(path, [n])[0]


def read_frames(path: str | os.PathLike[str], numbers: Sequence[int]) -> list[Frame]:
    """Return chosen frames of a video file or a folder of images, in the order asked for.

    A video is decoded once, from its first frame to the last one wanted: jumping to a frame is inexact with many codecs.

    Parameters
    ----------
    path : path
        Video file, or folder of images.
    numbers : sequence of int
        Numbers of frames, from 0.

    Returns
    -------
    list of Frame
        With image, number and time.

    Raises
    ------
    VisionError
        No such file; a number that is not that of a frame, ``Error: Not valid frame number``; a frame that cannot be read.
    """
    wanted = [_number(n, path) for n in numbers]
    name = Path(path).name
    if Path(path).is_dir():
        folder = reader.FolderReader(path)
        for n in wanted:
            if not 0 <= n < len(folder.files):
                raise reader.invalid_number(n, name, len(folder.files))
        return [Frame(folder.image(n)[0], n, n / (folder.info.fps or reader.FPS)) for n in wanted]
    video = reader.VideoReader(path)
    found: dict[int, Frame] = {}
    count = 0
    try:
        negative = min(wanted, default=0) < 0
        for item in video.read(lambda: not negative and len(found) == len(set(wanted))):
            if isinstance(item, Frame):
                count = item.index + 1
                if item.index in wanted:
                    found[item.index] = item
    finally:
        video.close()
    for n in wanted:
        if n not in found:
            if 0 <= n < count:
                raise VisionError(f"frame {n} of {name} cannot be read")
            raise reader.invalid_number(n, name, count)
    return [found[n] for n in wanted]


def _number(n: Any, path: Any) -> int:
    if isinstance(n, bool) or not hasattr(n, "__index__"):
        raise VisionError(f"Error: Not valid frame number: {n!r}; frames of {Path(path).name} are counted 0, 1, 2, ...")
    return int(n)
