"""Boards to calibrate a lens with: what is printed on them, and where their corners are in an image.

A chessboard is found whole or not at all; a ChArUco board (a chessboard with a marker in each white square) is found in part too, so it may
reach over the edge of the image, which is where a lens has to be measured.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pieper.atomic_file import write_bytes
from pieper.errors import VisionError, unknown_name
from pieper.perception.opencv import opencv

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from pieper.perception.frame import Image
    from pieper.spatial._checks import FloatArray

_BITS = (4, 5, 6, 7)
_COUNTS = (50, 100, 250, 1000)
_SMALLEST = 6
"""Corners of a ChArUco board that make a view: fewer say too little of its pose."""
_SMOOTHING, _SADDLE_TURNS = 1.0, 6
_WINDOW = (2, 6)  # half side, px
_FORMS = "charuco:COLUMNSxROWS:SQUARE:MARKER in squares and metres, or chessboard:COLUMNSxROWS:SQUARE in inner corners and metres"


@dataclass(frozen=True)
class Board:
    """A flat board of squares; x goes right and y down from the corner of the top left square.

    Attributes
    ----------
    kind : "charuco" or "chessboard"
    columns, rows : int
        Squares of a ChArUco board; inner corners of a chessboard, one less than its squares, as is the custom.
    square : float
        Side of a square [m].
    marker : float
        Side of a marker [m]; 0 for a chessboard.
    dictionary : str
        Of the markers, as in ``4x4_50``; empty for a chessboard.
    legacy : bool
        Whether the ChArUco board was drawn by OpenCV before 4.6: with even rows these begin with a white square.

    Examples
    --------
    >>> board = Board.parse("charuco:7x5:0.03:0.022")
    >>> board.corners[:2]
    array([[0.03, 0.03],
           [0.06, 0.03]])
    """

    kind: Literal["charuco", "chessboard"]
    columns: int
    rows: int
    square: float
    marker: float = 0.0
    dictionary: str = ""
    legacy: bool = False

    def __post_init__(self) -> None:
        least = 3 if self.kind == "charuco" else 2
        if min(self.columns, self.rows) < least or max(self.columns, self.rows) > 100:
            raise VisionError(f"a {self.kind} needs {least} to 100 columns and rows, got {self.columns} x {self.rows}")
        if not 0 < self.square < 10:
            raise VisionError(f"the side of a square is in metres, between 0 and 10, got {self.square:g}")
        if self.kind == "chessboard":
            if self.columns == self.rows == 2:
                raise VisionError(
                    "a chessboard needs more than 2 x 2 inner corners, which do not tell how it is turned; take 3 x 2 or more, or a ChArUco board"
                )
            return
        if not 0 < self.marker < self.square:
            raise VisionError(
                f"a marker has to be smaller than its square of {self.square:g} m, got {self.marker:g} m; metres, not millimetres"
            )
        if self.dictionary not in _dictionaries():
            raise unknown_name("dictionary", self.dictionary, _dictionaries())
        needed, there = self.columns * self.rows // 2, int(self.dictionary.split("_")[1])
        if needed > there:
            raise VisionError(
                f"{self.columns} x {self.rows} squares need {needed} markers, and {self.dictionary} has {there}"
            )

    @classmethod
    def parse(cls, text: str) -> Board:
        """Read a board from words such as ``charuco:7x5:0.03:0.022``, ``charuco:7x5:0.03:0.022:5x5_100`` or ``chessboard:9x6:0.025``.

        Raises
        ------
        VisionError
            The words say no board.
        """
        kind, *words = (word.strip().lower() for word in text.split(":"))
        legacy = words[-1:] == ["legacy"]
        words = words[:-1] if legacy else words
        try:
            columns, rows = (int(word) for word in words[0].split("x"))
            lengths = [float(word) for word in words[1:3]]
        except (ValueError, IndexError):
            raise VisionError(f"the board {text!r} is not understood; write {_FORMS}") from None
        if kind == "chessboard" and len(words) == 2 and not legacy:
            return cls("chessboard", columns, rows, lengths[0])
        if kind == "charuco" and len(words) in (3, 4):
            name = words[3] if len(words) == 4 else _dictionary_for(columns * rows // 2)
            return cls("charuco", columns, rows, lengths[0], lengths[1], name, legacy)
        raise VisionError(f"the board {text!r} is not understood; write {_FORMS}")

    def __str__(self) -> str:
        words = [self.kind, f"{self.columns}x{self.rows}", f"{self.square:g}"]
        if self.kind == "charuco":
            words += [f"{self.marker:g}", self.dictionary] + ["legacy"] * self.legacy
        return ":".join(words)

    @property
    def squares(self) -> tuple[int, int]:
        """Columns and rows of squares."""
        return (self.columns, self.rows) if self.kind == "charuco" else (self.columns + 1, self.rows + 1)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m], without margin."""
        return self.squares[0] * self.square, self.squares[1] * self.square

    @property
    def module(self) -> float:
        """Side of the smallest square that has to be told apart: of a marker's modules, or of the board [m]."""
        return self.square if self.kind == "chessboard" else self.marker / (int(self.dictionary[0]) + 2)

    @cached_property
    def corners(self) -> FloatArray:
        """Inner corners, ``(n, 2)``, row by row [m]."""
        columns, rows = self.squares
        y, x = np.mgrid[1:rows, 1:columns]
        return np.stack([x, y], axis=-1).reshape(-1, 2) * self.square

    def is_white(self, p_board: FloatArray) -> NDArray[np.bool_]:
        """Return what is printed at points ``(..., 2)`` [m]; paper is white all around."""
        p = np.asarray(p_board, dtype=np.float64)
        cell = np.floor(p / self.square).astype(np.int64)
        columns, rows = self.squares
        on = ((cell >= 0) & (cell < (columns, rows))).all(axis=-1)
        first_white = self.legacy and rows % 2 == 0
        white: NDArray[np.bool_] = ~on | ((cell.sum(axis=-1) + first_white) % 2 == 1)
        if self.kind == "charuco":
            margin = (self.square - self.marker) / 2
            bits, ids = self._markers
            side = bits.shape[1]
            module = np.floor((p - cell * self.square - margin) * (side / self.marker)).astype(np.int64)
            cell = np.clip(cell, 0, (columns - 1, rows - 1))
            marker = ids[cell[..., 1], cell[..., 0]]
            printed = on & (marker >= 0) & ((module >= 0) & (module < side)).all(axis=-1)
            module = np.clip(module, 0, side - 1)
            white = np.where(printed, bits[marker, module[..., 1], module[..., 0]], white)
        return white

    @property
    def _edges(self) -> FloatArray:
        """Where, along either axis, something may change [m]."""
        starts = np.arange(max(self.squares) + 1) * self.square
        if self.kind == "chessboard":
            return np.asarray(starts, dtype=np.float64)
        side = self._markers[0].shape[1]
        within = (self.square - self.marker) / 2 + np.arange(side + 1) * (self.marker / side)
        return np.asarray(
            np.unique(np.concatenate([starts, (starts[:-1, None] + within).reshape(-1)])), dtype=np.float64
        )

    @cached_property
    def _markers(self) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Modules of each marker, white is true, and the number of the marker in each square, -1 for none."""
        cv2 = opencv("a ChArUco board")
        board = self._opencv_board(cv2)
        dictionary = board.getDictionary()
        side = dictionary.markerSize + 2
        ids = np.full(self.squares[::-1], -1, dtype=np.int64)
        for number, outline in zip(np.ravel(board.getIds()), board.getObjPoints(), strict=True):
            x, y = np.floor(np.asarray(outline)[:, :2].mean(axis=0) / self.square).astype(int)
            ids[y, x] = number
        bits = [cv2.aruco.generateImageMarker(dictionary, i, side) > 127 for i in range(int(ids.max()) + 1)]
        return np.array(bits, dtype=np.bool_), ids

    def _opencv_board(self, cv2: Any) -> Any:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary.upper()}"))
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, dictionary)
        if self.legacy:
            board.setLegacyPattern(True)
        return board

    @cached_property
    def _detector(self) -> Any:
        cv2 = opencv("a ChArUco board")
        return cv2.aruco.CharucoDetector(self._opencv_board(cv2))

    def find(self, image: Image | NDArray[np.uint8]) -> tuple[NDArray[np.int64], FloatArray] | None:
        """Find the board.

        Parameters
        ----------
        image : (height, width, 3) or (height, width) uint8 array

        Returns
        -------
        (n,) int array and (n, 2) array, or None
            Rows of `corners` and their pixels; None if the board is not there. A chessboard may be turned by half a turn, which its picture
            does not tell.
        """
        cv2 = opencv("finding a board")
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
        if self.kind == "chessboard":
            return self._find_chessboard(cv2, gray)
        corners, ids, *_ = self._detector.detectBoard(gray)
        if ids is None or len(ids) < _SMALLEST:
            return None
        rows, uv = np.ravel(ids).astype(np.int64), np.asarray(corners, dtype=np.float64).reshape(-1, 2)
        xy = self.corners[rows]
        if min(np.ptp(xy[:, 0]), np.ptp(xy[:, 1])) < self.square / 2:  # all on one line
            return None
        return rows, self._refine(cv2, gray, uv)

    def _find_chessboard(self, cv2: Any, gray: NDArray[np.uint8]) -> tuple[NDArray[np.int64], FloatArray] | None:
        found, corners = cv2.findChessboardCornersSB(
            gray, (self.columns, self.rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        )
        if not found:
            flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
            found, corners = cv2.findChessboardCorners(gray, (self.columns, self.rows), flags=flags)
        if not found:
            return None
        uv = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
        return np.arange(len(uv)), self._refine(cv2, gray, uv)

    def _refine(self, cv2: Any, gray: NDArray[np.uint8], uv: FloatArray) -> FloatArray:
        """Saddles in windows that hold nothing but the corner: of a ChArUco board, not the corners of markers nearby."""
        clear = 0.4 if self.kind == "chessboard" else 0.75 * (1 - self.marker / self.square) / 2
        half = np.clip((_spacing(uv) * clear).astype(np.int64), *_WINDOW)
        return _saddles(cv2, gray, uv, half)

    def draw(self, dpi: int = 300) -> NDArray[np.uint8]:
        """Draw the board to scale on white paper with a margin of one square, and say below what it is.

        Returns
        -------
        (height, width) uint8 array

        Raises
        ------
        VisionError
            The dots per inch are not from 20 to 2400, or make too large a picture.
        """
        if not 20 <= dpi <= 2400:
            raise VisionError(f"dots per inch must be 20 to 2400, got {dpi}")
        cv2 = opencv("drawing a board")
        pixel = 0.0254 / dpi
        width, height = (round((n + 2) * self.square / pixel) for n in self.squares)
        if width * height > 400e6:
            raise VisionError(f"a board of {width} x {height} pixels is too large to draw; ask for fewer dots per inch")
        edges = self._edges
        middles = (np.concatenate([[-1.0], edges]) + np.concatenate([edges, [edges[-1] + 1.0]])) / 2
        tiles = np.where(self.is_white(np.stack(np.meshgrid(middles, middles), axis=-1)), 255, 0).astype(np.uint8)
        columns, rows = (np.searchsorted(edges, (np.arange(n) + 0.5) * pixel - self.square) for n in (width, height))
        page = np.ascontiguousarray(tiles[np.ix_(rows, columns)])
        words = f"{self}   print at 100 %: one square is {self.square * 1e3:g} mm, measure it"
        scale = min(width * 0.8 / (len(words) * 18), self.square / pixel * 0.3 / 22)
        at = (round(self.square / pixel), height - round(0.3 * self.square / pixel))
        cv2.putText(page, words, at, cv2.FONT_HERSHEY_SIMPLEX, scale, 0, max(1, round(scale * 1.5)), cv2.LINE_AA)
        return page

    def save_drawing(self, path: Path, dpi: int = 300) -> None:
        """Write `draw` as a PNG file that carries its scale, whole or not at all.

        Raises
        ------
        VisionError
            As from `draw`.
        """
        done, raw = opencv("drawing a board").imencode(".png", self.draw(dpi))
        if not done:
            raise VisionError(f"{path}: the picture could not be encoded")
        write_bytes(path, _with_scale(raw.tobytes(), dpi))


def _with_scale(png: bytes, dpi: int) -> bytes:
    """The file with a ``pHYs`` chunk after its header (PNG specification, 11.3.5.3): dots per metre."""
    dots = round(dpi / 0.0254)
    chunk = b"pHYs" + struct.pack(">IIB", dots, dots, 1)
    after = 8 + 25  # signature, and the header with its length, name and check sum
    return png[:after] + struct.pack(">I", 9) + chunk + struct.pack(">I", zlib.crc32(chunk)) + png[after:]


def _saddles(cv2: Any, gray: NDArray[np.uint8], uv: FloatArray, half: NDArray[np.int64]) -> FloatArray:
    """Corners to a fraction of a pixel: where the quadratic surface that fits the smoothed image around a corner has its saddle.

    On exact renderings 0.01 to 0.04 px RMS, a half to a tenth of what gradients at right angles (Foerstner; OpenCV's ``cornerSubPix``) leave,
    and edges of markers nearby do not pull. `half` is the half side of each window [px].
    """
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), _SMOOTHING)
    out = uv.copy()
    for n in np.unique(half):
        y, x = (part.reshape(-1).astype(np.float64) for part in np.mgrid[-n : n + 1, -n : n + 1])
        weight = np.exp(-(x * x + y * y) / (2 * (n / 1.5) ** 2))
        A = np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], axis=1)
        fit = np.linalg.solve((A * weight[:, None]).T @ A, (A * weight[:, None]).T)
        some = np.flatnonzero(half == n)
        at, good = uv[some].copy(), np.ones(len(some), dtype=bool)
        side = (int(2 * n + 1), int(2 * n + 1))
        for _ in range(_SADDLE_TURNS):
            patches = [cv2.getRectSubPix(smooth, side, (float(u), float(v))).reshape(-1) for u, v in at]
            a, b, c, d, e, _ = (np.array(patches) @ fit.T).T
            det = 4 * a * c - b * b
            good &= det < 0
            det = np.where(det < 0, det, -1.0)
            at += np.clip(np.stack([b * e - 2 * c * d, b * d - 2 * a * e], axis=1) / det[:, None], -1, 1)
        good &= np.hypot(*(at - uv[some]).T) <= n
        out[some[good]] = at[good]
    return out


def _spacing(uv: FloatArray) -> FloatArray:
    """Pixels from each corner to the nearest other."""
    apart = np.hypot(*(uv[:, None] - uv).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    return np.asarray(apart.min(axis=1))


def _dictionaries() -> list[str]:
    return [f"{bits}x{bits}_{count}" for bits in _BITS for count in _COUNTS]


def _dictionary_for(markers: int) -> str:
    return next((f"4x4_{count}" for count in _COUNTS if count >= markers), f"4x4_{_COUNTS[-1]}")
