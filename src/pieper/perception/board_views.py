"""Views of a board: found in images and videos, sharp ones that differ."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import VisionError
from pieper.perception.image_file import PICTURES, read_image
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from pieper.perception.board import Board
    from pieper.perception.frame import Image
    from pieper.spatial._checks import FloatArray

LEAST_VIEWS = 4
"""Three determine a lens; the fourth can contradict."""
_MOST_LOOKED_AT = 400  # frames of a video
_MOST_VIEWS = 40
_SHARP = 0.6  # of the sharpest quarter: less is blurred
_NEAR = 0.04  # poses nearer than this, in the shares of the image in which they are compared, say the same


@dataclass(frozen=True, eq=False)
class BoardView:
    """A board in one image: its name, corners by row of `Board.corners`, their pixels, and how sharp its edges are."""

    name: str
    ids: NDArray[np.int64]
    uv: FloatArray
    sharpness: float = 1.0


@dataclass(frozen=True, eq=False)
class BoardViews:
    """What `find_views` found: the views, the size of the images [px], how many images were looked at, and what was left out, in words."""

    views: tuple[BoardView, ...]
    size: tuple[int, int]
    looked_at: int
    left_out: tuple[str, ...] = ()


def find_views(
    sources: Sequence[str | Path],
    board: Board,
    *,
    most: int = _MOST_VIEWS,
    progress: Callable[[int, int], None] | None = None,
) -> BoardViews:
    """Find a board in images, folders of images and videos.

    Of a video, 400 frames at most are looked at, evenly; those that are not sharp (less than 0.6 of the sharpest quarter) are left out, and of
    the rest those whose poses differ most are taken. Of images, all are taken, unless there are more than `most`.

    Parameters
    ----------
    sources : list of str or Path
    board : Board
    most : int
        Views that are kept.
    progress : callable, optional
        Told how many images of how many have been looked at.

    Returns
    -------
    BoardViews
        The corners of the board in each image that is taken.

    Raises
    ------
    VisionError
        A file cannot be read, sizes differ, or the board is in fewer than four images.
    """
    found: list[BoardView] = []
    first: tuple[str, tuple[int, int]] | None = None
    looked_at, from_video = 0, False
    for name, image, total, video in _images(sources):
        looked_at += 1
        size = (image.shape[1], image.shape[0])
        first = first or (name, size)
        if size != first[1]:
            raise VisionError(
                f"{name} is {size[0]} x {size[1]} pixels and {first[0]} is {first[1][0]} x {first[1][1]}; one lens at one resolution "
                "has one size, so calibrate them apart"
            )
        corners = board.find(image)
        if corners is not None:
            found.append(BoardView(name, *corners, sharpness=_sharpness(image, corners[1])))
        from_video |= video
        if progress is not None:
            progress(looked_at, max(total, looked_at))
    if first is None:
        raise VisionError("there is no image to look at; give images, folders of images, or a video")
    if len(found) < LEAST_VIEWS:
        raise VisionError(_too_few(board, len(found), looked_at))
    chosen, left_out = _chosen(found, board, first[1], most, spread=from_video or len(found) > most)
    if len(chosen) < LEAST_VIEWS:
        raise VisionError(
            f"{_too_few(board, len(found), looked_at)}; of these only {len(chosen)} are sharp and differ in pose"
        )
    return BoardViews(tuple(chosen), first[1], looked_at, tuple(left_out))


def _too_few(board: Board, found: int, looked_at: int) -> str:
    hint = "a chessboard counts inner corners" if board.kind == "chessboard" else "a ChArUco board counts squares"
    words = f"the board {board} was found in {found} of {looked_at} images, and {LEAST_VIEWS} are needed, better 15"
    return (
        f"{words}; is it the board that was printed ({hint}), whole, sharp and lit?" if found < LEAST_VIEWS else words
    )


def _sharpness(image: Image, uv: FloatArray) -> float:
    """How steep the edges of the board are: the steepest hundredth of the gradients over the contrast [1/px]."""
    cv2 = opencv("a calibration")
    low = np.maximum(np.floor(uv.min(axis=0)).astype(int), 0)
    high = np.ceil(uv.max(axis=0)).astype(int) + 1
    patch = image[low[1] : high[1], low[0] : high[0]]
    gray = (cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY) if patch.ndim == 3 else patch).astype(np.float32)
    if min(gray.shape) < 8:
        return 0.0
    steep = np.hypot(cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1)) / 8
    dark, light = np.quantile(gray, [0.05, 0.95])
    return float(np.quantile(steep, 0.99) / max(light - dark, 1.0))


def _chosen(
    found: list[BoardView], board: Board, size: tuple[int, int], most: int, *, spread: bool
) -> tuple[list[BoardView], list[str]]:
    """Those that are sharp, and of these the ones that differ most."""
    if not spread:
        return found, []
    sharp = np.array([view.sharpness for view in found])
    limit = _SHARP * float(np.quantile(sharp, 0.75))
    kept = [view for view in found if view.sharpness >= limit]
    left_out = [f"{len(found) - len(kept)} views: not sharp"] if len(kept) < len(found) else []
    where = np.array([_descriptor(view, board, size) for view in kept])
    order = [int(np.argmax([len(view.ids) for view in kept]))]
    apart = np.linalg.norm(where - where[order[0]], axis=1)
    while len(order) < min(most, len(kept)) and apart.max() > _NEAR:
        order.append(int(apart.argmax()))
        apart = np.minimum(apart, np.linalg.norm(where - where[order[-1]], axis=1))
    if len(order) < len(kept):
        left_out.append(f"{len(kept) - len(order)} views: nearly the pose of others")
    return [kept[i] for i in sorted(order)], left_out


def _descriptor(view: BoardView, board: Board, size: tuple[int, int]) -> FloatArray:
    """Where the board's four outer corners would be, in shares of the image."""
    cv2 = opencv("a calibration")
    H, _ = cv2.findHomography(board.corners[view.ids], view.uv)
    if H is None:
        return np.asarray(np.tile(view.uv.mean(axis=0) / size, 4))
    width, height = board.size
    outer = np.array([[[0, 0]], [[width, 0]], [[width, height]], [[0, height]]], dtype=np.float64)
    return np.asarray(np.clip(cv2.perspectiveTransform(outer, H).reshape(4, 2) / size, -2, 3).reshape(-1) / 2)


def _images(sources: Sequence[str | Path]) -> Iterator[tuple[str, Image, int, bool]]:
    """Name, image, how many there will be, and whether it is of a video."""
    cv2 = opencv("reading images")
    files: list[Path] = []
    for source in map(Path, sources):
        if source.is_dir():
            inside = sorted(p for p in source.iterdir() if p.suffix.lower() in PICTURES)
            if not inside:
                raise VisionError(f"{source}: the folder has no images ({', '.join(PICTURES)})")
            files += inside
        elif not source.exists():
            raise FileNotFoundError(2, "no such file or folder", str(source))
        else:
            files.append(source)
    for file in files:
        if file.suffix.lower() in PICTURES:
            yield file.name, read_image(file), len(files), False
            continue
        video = cv2.VideoCapture(str(file))
        try:
            if not video.isOpened():
                raise VisionError(f"{file}: is no image and no video that OpenCV can read")
            count = max(int(video.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
            every = max(1, -(-count // _MOST_LOOKED_AT))
            index = 0
            while video.grab():
                if index % every == 0:
                    done, frame = video.retrieve()
                    if done:
                        yield f"{file.name}#{index}", frame, max(1, -(-count // every)), True
                index += 1
            if index == 0:
                raise VisionError(f"{file}: the video has no frame that can be read")
        finally:
            video.release()
