"""Voxels over a box, in chunks."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pieper.errors import ArrayError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike

    from pieper.spatial._checks import FloatArray

CHUNK = 12
"""Voxels along each side of a chunk unless told otherwise."""

_FLAT = 1e-9  # [m] a box this thin is a plane, and gets one layer of voxels exactly on it
_MOST = 2**31  # voxels along one side
_DECIMALS = 12  # of centres: 0 is 0
_AXES = "xyz"


@dataclass(frozen=True)
class Grid:
    """Voxels, each of which stands for its centre.

    Attributes
    ----------
    origin : tuple of 3 float
        Centre of the first voxel in the base frame [m].
    voxel : float
        Length of the sides of a voxel [m].
    shape : tuple of 3 int
        Voxels along x, y and z.
    chunk : int
        Voxels along each side of a chunk; chunks at the far sides may be smaller.

    Examples
    --------
    >>> grid = Grid((-0.1, 0.0, 0.0), 0.05, (5, 3, 1), chunk=2)
    >>> grid.voxels, grid.chunks, grid.chunk_shape
    (15, 6, (3, 2, 1))
    >>> grid.slices(1)
    (slice(0, 2, None), slice(2, 3, None), slice(0, 1, None))
    >>> grid.centres(1).round(3).tolist()
    [[-0.1, 0.1, 0.0], [-0.05, 0.1, 0.0]]
    """

    origin: tuple[float, float, float]
    voxel: float
    shape: tuple[int, int, int]
    chunk: int = CHUNK

    @property
    def voxels(self) -> int:
        """Number of voxels."""
        return math.prod(self.shape)

    @property
    def volume(self) -> float:
        """Of one voxel [m^3]."""
        return self.voxel**3

    @property
    def chunk_shape(self) -> tuple[int, int, int]:
        """Chunks along x, y and z."""
        a, b, c = (-(-n // self.chunk) for n in self.shape)
        return a, b, c

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return math.prod(self.chunk_shape)

    @property
    def lower(self) -> FloatArray:
        """(3,) corner of the box [m]."""
        return np.asarray(np.array(self.origin) - 0.5 * self.voxel)

    @property
    def upper(self) -> FloatArray:
        """(3,) the opposite corner [m]."""
        return np.asarray(np.array(self.origin) + (np.array(self.shape) - 0.5) * self.voxel)

    def axis(self, which: str) -> FloatArray:
        """(n,) centres along x, y or z [m]."""
        i = axis_number(which)
        return np.asarray((self.origin[i] + np.arange(self.shape[i]) * self.voxel).round(_DECIMALS)) + 0.0

    def slices(self, chunk: int) -> tuple[slice, slice, slice]:
        """Where the voxels of a chunk are in arrays over the grid."""
        place = np.unravel_index(chunk, self.chunk_shape)
        a, b, c = (
            slice(int(i) * self.chunk, min((int(i) + 1) * self.chunk, n))
            for i, n in zip(place, self.shape, strict=True)
        )
        return a, b, c

    def chunk_voxels(self, chunk: int) -> tuple[int, int, int]:
        """Voxels of a chunk along x, y and z."""
        a, b, c = (part.stop - part.start for part in self.slices(chunk))
        return a, b, c

    def centres(self, chunk: int) -> FloatArray:
        """(k, 3) centres of the voxels of a chunk [m], z running fastest."""
        axes = [self.axis(name)[part] for name, part in zip(_AXES, self.slices(chunk), strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def layer(self, which: str, value: float) -> int:
        """Number of the layer of voxels that holds a coordinate [m]."""
        i = axis_number(which)
        layer = math.floor((value - float(self.lower[i])) / self.voxel)
        if not 0 <= layer < self.shape[i]:
            raise ArrayError(
                f"no layer at {which} = {value:g} m: the map goes from {which} = {self.lower[i]:.3f} to {self.upper[i]:.3f} m"
            )
        return layer

    def pieces(self, *, most: int = 2_000_000) -> Iterator[tuple[slice, slice, slice]]:
        """The whole grid in pieces of whole chunks that fit into memory, of no more than `most` voxels where a chunk is smaller.

        >>> list(Grid((0.0, 0.0, 0.0), 0.1, (3, 4, 5), chunk=2).pieces(most=24))[1]
        (slice(0, 2, None), slice(2, 4, None), slice(0, 5, None))
        """
        sides = [self.chunk] * 3
        for i in (2, 1):
            others = math.prod(sides) // self.chunk
            sides[i] = max(self.chunk, most // others // self.chunk * self.chunk)
            sides[i] = min(sides[i], -(-self.shape[i] // self.chunk) * self.chunk)
        spans = [
            [slice(start, min(start + side, n)) for start in range(0, n, side)]
            for side, n in zip(sides, self.shape, strict=True)
        ]
        yield from itertools.product(*spans)


def axis_number(which: str) -> int:
    """0, 1 or 2 for x, y or z."""
    if which not in tuple(_AXES):
        raise ArrayError(f"an axis is x, y or z, got {which!r}")
    return _AXES.index(which)


def positive(value: object, name: str) -> float:
    """A length [m], if it is one; raises ArrayError else."""
    if (
        isinstance(value, (int, float, np.integer, np.floating))
        and not isinstance(value, bool)
        and 0.0 < value < np.inf
    ):
        return float(value)
    raise ArrayError(f"{name} must be a positive length [m], got {value!r}")


def whole(value: object, name: str, *, least: int = 1) -> int:
    """A whole number, if it is one; raises ArrayError else."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool) and value >= least:
        return int(value)
    raise ArrayError(f"{name} must be a whole number of at least {least}, got {value!r}")


def grid_over(box: ArrayLike, voxel: float, *, chunk: int = CHUNK) -> Grid:
    """The voxels that a box touches; their centres are whole multiples of the voxel, so that maps of one resolution fit together.

    Parameters
    ----------
    box : (2, 3) array_like
        Least and greatest x, y and z [m]. Where both are the same there is one layer, exactly there.
    voxel : float
        Side of a voxel [m].
    chunk : int
        Voxels along each side of a chunk.

    Returns
    -------
    Grid

    Raises
    ------
    ArrayError
        A voxel or a chunk that is not positive, or a box that is none.

    Examples
    --------
    >>> grid_over([[-0.1, 0.02, 0.4], [0.1, 0.02, 0.52]], 0.05)
    Grid(origin=(-0.1, 0.02, 0.4), voxel=0.05, shape=(5, 1, 3), chunk=12)
    """
    size, side = positive(voxel, "voxel"), whole(chunk, "chunk")
    try:
        corners = np.asarray(box, dtype=np.float64)
    except (TypeError, ValueError):
        corners = np.empty(0)
    if corners.shape != (2, 3) or not np.isfinite(corners).all():
        raise ArrayError(f"box must be finite with shape (2, 3), got {box!r}")
    names = [name for name, low, high in zip(_AXES, *corners, strict=True) if low > high]
    if names:
        raise ArrayError(f"box must go from the lower to the upper corner; along {', '.join(names)} it goes backwards")
    origin, shape = [], []
    for name, low, high in zip(_AXES, *corners.tolist(), strict=True):
        if high - low < _FLAT:
            origin.append(low)
            shape.append(1)
            continue
        first, last = math.floor(low / size + 0.5), math.floor(high / size + 0.5)
        if last - first >= _MOST:
            raise ArrayError(f"{last - first + 1} voxels along {name} are too many; take larger voxels than {size:g} m")
        origin.append(round(first * size, _DECIMALS) + 0.0)
        shape.append(last - first + 1)
    return Grid((origin[0], origin[1], origin[2]), size, (shape[0], shape[1], shape[2]), side)
