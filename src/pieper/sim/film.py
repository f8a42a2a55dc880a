"""Films of a `Picture` whose arms move: MP4 with H.264, which browsers and slides play, or GIF."""

from __future__ import annotations

import contextlib
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.atomic_file import check_place, replacing
from pieper.errors import ArrayError, MissingExtraError, PieperError
from pieper.sim.offscreen import import_pillow

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Generator, Iterator

    from numpy.typing import NDArray

    from pieper.sim.picture import Image, Picture

FORMATS = (".mp4", ".gif")

MOST_FRAMES = 100_000
"""Longer films are refused: an hour at 25 frames per second takes hours to draw."""

_CODEC = "libx264"
_GIF_TICK = 0.01  # [s] the unit of time in GIF files
_GIF_FASTEST = 50.0  # frames per second; browsers slow down what is faster


def frame_times(duration: float, *, fps: float, speed: float = 1.0, hold: float = 0.0) -> NDArray[np.float64]:
    """(k,) the times [s] of a motion that the frames of a film show: every ``speed / fps``, and the end.

    The film takes ``k / fps`` seconds, at most one frame more than ``duration / speed + hold``; during `hold` the end is shown.

    Raises
    ------
    ArrayError
        A rate, a speed or a time that is not positive and finite, or more pictures than a film may have.

    Examples
    --------
    >>> frame_times(1.0, fps=4)
    array([0.  , 0.25, 0.5 , 0.75, 1.  ])
    """
    for name, value in {"fps": fps, "speed": speed}.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ArrayError(f"{name} must be a positive number, got {value}")
    if not (np.isfinite(hold) and hold >= 0.0):
        raise ArrayError(f"hold must be a time of 0 s or more, got {hold}")
    last = np.ceil(duration / speed * fps - 1e-9)
    count = last + 1 + np.round(hold * fps)
    if count > MOST_FRAMES:
        raise ArrayError(
            f"a film may have {MOST_FRAMES} frames, but {duration:.6g} s at {fps:g} frames per second would be {count:.0f}; "
            "lower fps, or raise speed"
        )
    times: NDArray[np.float64] = np.minimum(np.arange(int(count)) * (speed / fps), duration)
    times[int(last) :] = duration  # to the last bit
    return times


def save(
    picture: Picture,
    path: str | os.PathLike[str],
    *,
    fps: float | None = None,
    speed: float = 1.0,
    hold: float = 0.0,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write the motions in a picture as a film; the times are those of their trajectories.

    A file of that name is replaced once the film is complete; an interrupted one leaves nothing behind.

    Parameters
    ----------
    picture : Picture
        With at least one arm that moves.
    path : path
        Ends in ``.mp4`` (H.264; the last row and column of an odd size are repeated, which the format needs) or ``.gif``.
    fps : float, optional
        Frames per second; 30, or 20 for GIF, whose frames last whole hundredths of a second.
    speed : float
        2 plays twice as fast as the arm moves.
    hold : float
        How long the end is shown [s].
    progress : callable, optional
        Called with the number of frames done and of all frames, before the first one and after each.

    Returns
    -------
    int
        Number of frames.

    Raises
    ------
    ArrayError
        Another suffix, nothing that moves, or numbers that make no film.
    MissingExtraError, MissingLibraryError
        Something to draw or to write with is not installed; the message says what to install.
    PieperError
        The film cannot be encoded; the message is that of FFmpeg.
    OSError
        The file cannot be written.
    """
    suffix = check_format(path)
    if picture.duration <= 0.0:
        raise ArrayError("a film needs an arm with a trajectory that takes time; for a still picture see Picture.save")
    rate = (20.0 if suffix == ".gif" else 30.0) if fps is None else fps
    times = frame_times(picture.duration, fps=rate, speed=speed, hold=hold)
    if suffix == ".gif":
        _check_gif(rate)
    save_images(picture.images(times), path, count=len(times), fps=rate, size=picture.stage.size, progress=progress)
    return len(times)


def check_format(path: str | os.PathLike[str]) -> str:
    """The suffix of a film, in small letters.

    Raises
    ------
    ArrayError
        It is not one of `FORMATS`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise ArrayError(f"a film must end in {' or '.join(FORMATS)}, got {str(path)!r}")
    return suffix


def check_ready(path: str | os.PathLike[str], fps: float) -> None:
    """See that a film can be written there, before what it shows begins.

    Raises
    ------
    ArrayError, MissingExtraError, OSError
        As from `save`.
    """
    if check_format(path) == ".gif":
        import_pillow()
        _check_gif(fps)
    else:
        _ffmpeg()
    check_place(path)


def _check_gif(fps: float) -> None:
    if fps > _GIF_FASTEST:
        raise ArrayError(f"a GIF film shows at most {_GIF_FASTEST:g} frames per second, got fps = {fps:g}")


def save_images(
    images: Iterator[Image],
    path: str | os.PathLike[str],
    *,
    count: int,
    fps: float,
    size: tuple[int, int],
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write pictures as a film; a file of that name is replaced once the film is complete.

    Parameters
    ----------
    images : iterator of (height, width, 3) arrays
        All of one size.
    count : int
        How many there are, for the progress.
    size : (int, int)
        Width and height [px].
    path, fps, progress
        As for `save`.

    Raises
    ------
    ArrayError, MissingExtraError, PieperError, OSError
        As from `save`.
    """
    suffix = check_format(path)
    with (
        replacing(Path(path)) as unfinished,
        contextlib.closing(_told(images, count, progress)) as told,
    ):
        if suffix == ".gif":
            _write_gif(told, unfinished, fps, count)
        else:
            _write_mp4(told, unfinished, fps, size)


def _told(
    images: Iterator[Image], count: int, progress: Callable[[int, int], None] | None
) -> Generator[Image, None, None]:
    if progress is not None:
        progress(0, count)
    for done, image in enumerate(images, start=1):
        yield image
        if progress is not None:
            progress(done, count)


def _write_mp4(images: Iterator[Image], file: Path, fps: float, size: tuple[int, int]) -> None:
    width, height = (side + side % 2 for side in size)
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", repr(float(fps)), "-i", "pipe:0"]
    film = ["-c:v", _CODEC, "-pix_fmt", "yuv420p", "-crf", "20", "-preset", "medium", "-movflags", "+faststart"]
    command = [_ffmpeg(), "-y", "-nostdin", "-loglevel", "error", *raw, "-an", *film, str(file.absolute())]
    with tempfile.TemporaryFile() as complaints:
        # A session of its own: Ctrl-C is ours to deal with, and ends it below.
        encoder = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=complaints, start_new_session=True
        )
        try:
            with contextlib.suppress(BrokenPipeError):  # it has left, and its exit code says so
                assert encoder.stdin is not None
                with encoder.stdin as frames:
                    for image in images:
                        missing = ((0, height - image.shape[0]), (0, width - image.shape[1]), (0, 0))
                        frames.write(np.pad(image, missing, mode="edge").tobytes())
            code = encoder.wait()
        finally:
            encoder.kill()
            encoder.wait()
        if code != 0:
            complaints.seek(0)
            words = " ".join(complaints.read().decode(errors="replace").split())
            raise PieperError(f"FFmpeg stopped with exit code {code}: {words[:300]}")


def _ffmpeg() -> str:
    try:
        import imageio_ffmpeg
    except ModuleNotFoundError as cause:
        raise MissingExtraError("imageio-ffmpeg", "sim", "writing an MP4 film") from cause
    return str(imageio_ffmpeg.get_ffmpeg_exe())


def _write_gif(images: Iterator[Image], file: Path, fps: float, count: int) -> None:
    pillow = import_pillow()
    ends = np.round(np.arange(count + 1) / fps / _GIF_TICK)
    lasting = [
        int(10 * ticks) for ticks in np.diff(ends)
    ]  # [ms] whole hundredths of a second, whose sum is the time of the film
    first = pillow.fromarray(next(images)).quantize(255)

    def others() -> Iterator[Any]:
        for image in images:
            yield pillow.fromarray(image).quantize(palette=first, dither=pillow.Dither.NONE)  # one palette: no flicker

    with file.open("wb") as binary:
        first.save(binary, format="GIF", save_all=True, append_images=others(), duration=lasting, loop=0)
