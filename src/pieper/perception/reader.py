"""Where frames come from: a video file, a folder of images, a camera or stream, a pipe, or anything that can be iterated.

A reader gives frames one after another in the thread that asks; `pieper.perception.source` puts a thread and a queue around it.
Between frames it may say something, as a `Note`. It never seeks: to come to a frame, the frames before it are decoded, since
``CAP_PROP_POS_FRAMES`` lands beside the frame with many codecs.
"""

from __future__ import annotations

import re
from collections.abc import Sized
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

import numpy as np

from pieper.errors import VisionError
from pieper.perception.frame import Frame, Image
from pieper.perception.opencv import has_transparency, opencv, read_image_file

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Iterator

Kind = Literal["video", "images", "camera", "stream", "pipe", "frames"]
FPS = 30.0
"""Of images and pipes that bring no times of their own."""
IMAGES = (".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp")

_NO_ALPHA = "transparency left out"


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
        done.append(_NO_ALPHA)
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
        image, note = as_image(picture, f"frame {index}, {path.name},")
        if has_transparency(str(path)) and _NO_ALPHA not in note:
            note = "; ".join(filter(None, (_NO_ALPHA, note)))
        return image, note

    def close(self) -> None:
        """Nothing is open."""


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
