"""Shape, type and finiteness of what a caller passes in, checked once at the public functions."""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pieper.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

FloatArray = NDArray[np.float64]

# A product of a thousand rotations stays below 1e-12, a matrix typed with ten digits below 1e-9;
# a matrix typed with six digits, or one kept in single precision, does not and has to be repaired on purpose.
ROTATION_TOLERANCE = 1e-9


def stack(value: ArrayLike, tail: tuple[int | str, ...], name: str) -> FloatArray:
    """`value` as a finite float64 array of shape ``(..., *tail)``; a letter in `tail` stands for any length above 0.

    >>> stack([[1, 2, 3]], (3,), "p").shape
    (1, 3)
    >>> stack([1, 2], (3,), "p")
    Traceback (most recent call last):
        ...
    pieper.errors.ArrayError: p must have shape (..., 3), got (2,)
    """
    array = _numbers(value, name)
    fits = array.ndim >= len(tail) and all(
        got > 0 if isinstance(want, str) else got == want
        for want, got in zip(tail, array.shape[array.ndim - len(tail) :], strict=True)
    )
    if not fits:
        wanted = ", ".join(["...", *map(str, tail)])
        raise ArrayError(f"{name} must have shape ({wanted}), got {array.shape}")
    finite = np.isfinite(array)
    if not finite.all():
        where = tuple(int(i) for i in np.argwhere(~finite)[0])
        place = f" at index {where}" if where else ""
        raise ArrayError(f"{name} must be finite, got {array[where]}{place}")
    return array


def _numbers(value: ArrayLike, name: str) -> FloatArray:
    """`value` as float64, refused when it is text, complex, ragged or no number at all."""
    try:
        raw: NDArray[Any] = np.asarray(value)
        if raw.dtype.kind not in "biufO":
            raise TypeError(f"its elements are of type {raw.dtype}")
        return np.asarray(raw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as cause:
        said = f"{name} must be an array of real numbers"
        if isinstance(value, (list, tuple)):
            said += ", and its rows of equal lengths" if "inhomogeneous" in str(cause) else f": {cause}"
        elif isinstance(value, (str, bytes, np.ndarray)):
            said += f": {cause}"
        else:  # an object of another package
            said += f", got {type(value).__name__}; give its numbers as an array"
        raise ArrayError(said) from cause


def together(**leading: tuple[int, ...]) -> tuple[int, ...]:
    """The common shape of the leading axes of arguments, or an error that names them.

    >>> together(T=(5, 1), p=(3,))
    (5, 3)
    >>> together(T=(2,), p=(3,))
    Traceback (most recent call last):
        ...
    pieper.errors.ArrayError: the leading axes of T and p must broadcast, got shapes (2,) and (3,)
    """
    try:
        return np.broadcast_shapes(*leading.values())
    except ValueError:
        names, shapes = ([*map(str, part)] for part in (leading.keys(), leading.values()))
        raise ArrayError(f"the leading axes of {_listed(names)} must broadcast, got shapes {_listed(shapes)}") from None


def whole_number(value: object, name: str) -> int:
    """`value` as an int, refused unless it is a whole number of at least 1."""
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = 0
    if number < 1:
        raise ArrayError(f"{name} must be a whole number of at least 1, got {value!r}")
    return number


def _listed(words: list[str]) -> str:
    return f"{', '.join(words[:-1])} and {words[-1]}"


def rotations(value: ArrayLike, name: str) -> FloatArray:
    """`value` as ``(..., 3, 3)`` rotation matrices; the error tells the measured deviation."""
    R = stack(value, (3, 3), name)
    _require_rotations(R, name, "rotation.nearest")
    return R


def poses(value: ArrayLike, name: str) -> FloatArray:
    """`value` as ``(..., 4, 4)`` poses; the error tells the measured deviation."""
    T = stack(value, (4, 4), name)
    last_row = T[..., 3, :].reshape(-1, 4)
    wrong = (np.abs(last_row - (0.0, 0.0, 0.0, 1.0)) > ROTATION_TOLERANCE).any(axis=-1)
    if wrong.any():
        raise ArrayError(f"{name} must have the last row 0 0 0 1, got {last_row[wrong][0].tolist()}")
    _require_rotations(T[..., :3, :3], f"the rotation block of {name}", "pose.nearest")
    return T


def _require_rotations(R: FloatArray, name: str, repair: str) -> None:
    if R.size == 0:
        return
    with np.errstate(over="ignore", invalid="ignore"):
        orthogonality: FloatArray = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(-2, -1))
        determinant = np.linalg.det(R)
    wrong = ~(orthogonality <= ROTATION_TOLERANCE) | ~(determinant > 0.0)
    if wrong.any():
        first = tuple(int(i) for i in np.argwhere(wrong)[0])
        place = f" at index {first}" if first else ""
        if orthogonality[first] <= ROTATION_TOLERANCE:
            raise ArrayError(
                f"{name} must be a rotation: it mirrors{place} (its determinant is -1); its axes make a left-handed frame, turn one of them round"
            )
        raise ArrayError(
            f"{name} must be a rotation: R R^T deviates from the identity by {orthogonality[first]:.3g}{place} "
            f"(allowed {ROTATION_TOLERANCE:g}) and its determinant is {determinant[first]:.3g}; "
            f"if the deviation is rounding, repair it with {repair}"
        )
