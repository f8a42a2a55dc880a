"""An annotated video, which becomes a file when it is closed, by Ctrl-C too."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pieper.atomic_file import replacing
from pieper.errors import VisionError
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Sequence

    from pieper.perception.frame import Image

VIDEOS = (".mp4", ".avi")


def video_path(path: str | os.PathLike[str]) -> Path:
    """Return the path, if a video can have that name."""
    return with_suffix(path, VIDEOS, "an annotated video")


def with_suffix(path: str | os.PathLike[str], suffixes: Sequence[str], what: str) -> Path:
    """A path to be written, refused before any work where its suffix or its folder cannot be.

    Parameters
    ----------
    path : path
    suffixes : sequence of str
        Those that it may have, with their dots, in small letters.
    what : str
        What it is, for the message.

    Returns
    -------
    Path

    Raises
    ------
    VisionError
        Another suffix.
    OSError
        No such folder, or a folder of that name.
    """
    file = Path(path)
    if file.suffix.lower() not in suffixes:
        raise VisionError(f"{what} must end in {', '.join(suffixes)}, got {str(file)!r}")
    if file.is_dir():
        raise IsADirectoryError(21, "is a folder, not a file", str(file))
    if not file.parent.is_dir():
        raise FileNotFoundError(2, "no such folder", str(file.parent))
    return file


class VideoFile:
    """An annotated video; MPEG-4 in ``.mp4``, Motion JPEG in ``.avi``. It becomes a file when it is closed.

    Parameters
    ----------
    path : path
        Ends in ``.mp4`` or ``.avi``.
    fps : float
        Frames per second; one rate for the whole video.

    Attributes
    ----------
    path : Path
    frames : int
        Written so far.
    """

    def __init__(self, path: str | os.PathLike[str], *, fps: float) -> None:
        opencv("writing a video")
        self.path, self._fps = video_path(path), fps
        self._stack = ExitStack()
        self._unfinished = self.path
        self._writer: Any = None
        self.frames = 0

    def write(self, image: Image) -> None:
        """Add a frame; the first one sets the size.

        Raises
        ------
        VisionError
            OpenCV cannot write such a video here.
        """
        cv2 = opencv("writing a video")
        if self._writer is None:
            self._unfinished = self._stack.enter_context(replacing(self.path))
            with naming(self.path):
                self._unfinished.touch()  # tells why, if it cannot
            code = cv2.VideoWriter_fourcc(*("mp4v" if self.path.suffix.lower() == ".mp4" else "MJPG"))
            size = (image.shape[1], image.shape[0])
            self._writer = cv2.VideoWriter(str(self._unfinished), cv2.CAP_FFMPEG, code, self._fps, size)
            if not self._writer.isOpened():
                self._writer = None
                with self._stack:
                    raise VisionError(
                        f"{self.path}: OpenCV cannot write a video of {size[0]} x {size[1]} pixels at {self._fps:g} frames per second"
                    )
        self._writer.write(image)
        self.frames += 1

    def close(self) -> None:
        """Finish the file; without frames there is none.

        Raises
        ------
        VisionError
            Frames are missing in it, most likely because the disk is full: OpenCV does not tell when it cannot write.
        """
        if self._writer is None:
            return
        with self._stack:
            self._writer.release()
            self._writer = None
            held = _frames_in(self._unfinished)
            if held < self.frames:
                raise VisionError(
                    f"{self.path} cannot be written: {held} of {self.frames} frames are in the file; is the disk full?"
                )


def _frames_in(video: Path) -> int:
    """How many frames a video says that it holds; 0 if it cannot be read."""
    cv2 = opencv("writing a video")
    capture = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG)
    try:
        return int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
    finally:
        capture.release()


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """An error of the system names the file that is wanted, not one beside it, or none."""
    try:
        yield
    except OSError as error:
        error.filename = str(path)
        raise
