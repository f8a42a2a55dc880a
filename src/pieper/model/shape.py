"""What an arm looks like when no meshes are at hand: a few round solids for every link, made from the chain alone.

The skeleton of a serial arm is that of Denavit and Hartenberg: a link runs along the common normal of its two axes, and along each axis
there is the offset between the feet of two such normals. Here links become tapered bars, short offsets become drums (the housings of
the joints), long offsets become two bars with a ring where one turns in the other, sliding joints become rails with carriages or rods
in bushings. Radii taper from base to tip and grow with the arm.

Parallel axes have no single common normal. Between parallel axes whose ends are offset sideways the links lie side by side, so that an
arm with a sideways offset (UR, PUMA) can fold; otherwise the frames of the chain say where a link is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from pieper.model._solid_mesh import ROLES, Drum, FloatArray, Part, Solid, Taper, Triangles, as_mesh, merge
from pieper.model.description import Box, Sphere

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pieper.model.chain import Chain


__all__ = ["ROLES", "ArmShape", "Drum", "Part", "Solid", "Taper", "Triangles", "as_mesh", "from_chain", "merge"]

# Sizes as fractions of the length of the arm, which is the length of its skeleton.
_RADIUS_AT_BASE = 0.050
_RADIUS_AT_TIP = 0.024
_LENGTH_OF_A_POINT = 0.3  # [m] for an arm all of whose axes and whose tip meet in one point
# Sizes as multiples of the radius where they are.
_HOUSING = 1.2
_RING = 1.12
_BEYOND = 1.12  # how far a housing reaches beyond the bars that it holds
_LONG = 3.0  # an offset longer than this is a bar, not a housing
_SEAM = 0.42  # where along a long offset the next link begins
_SHARED = 0.1  # sine of the angle below which axes are taken to be parallel
_SIDEWAYS = 0.03  # fraction of the length from which on an offset between parallel axes is meant


@dataclass(frozen=True, eq=False)
class ArmShape:
    """The parts of an arm.

    Attributes
    ----------
    parts : tuple of Part
        From base to tip.
    length : float
        Length of the skeleton, travel of sliding joints included [m]; radii are fractions of it.
    """

    parts: tuple[Part, ...]
    length: float

    def of_link(self, link: int) -> tuple[Part, ...]:
        """The parts that the first `link` axes move together."""
        return tuple(part for part in self.parts if part.link == link)


def from_chain(chain: Chain) -> ArmShape:
    """The shape of an arm from its screws, its home pose and its frames.

    Parameters
    ----------
    chain : Chain

    Returns
    -------
    ArmShape
        At least one part for every link; parts of consecutive links overlap at any joint values within the limits. At joint values
        ``q`` a part is at ``fk_frames(chain, q, frames=range(m + 1))[part.link] @ part.T_link_part``, m being the number of axes.

    Notes
    -----
    A picture of the kinematics, not of the product: an arm that carries its elbow beside its shoulder may be drawn in one plane. Scaling
    an arm scales its shape, except for one without any extent, which is drawn as if it were 0.3 m long.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> shape = from_chain(catalog.describe("mh12").chain())
    >>> round(shape.length, 3)  # 0.45 + 0.155 + 0.614 + 0.2 + 0.64 + 0.1
    2.159
    >>> [part.role for part in shape.of_link(3)]
    ['housing', 'link', 'link']
    """
    skeleton = _Skeleton(chain)
    homes = [chain.frame(link).home for link in range(len(chain.screws) + 1)]
    parts = tuple(
        Part(link, role, solid, _inverse(homes[link]) @ T) for link, role, solid, T in _solids(chain, skeleton)
    )
    return ArmShape(parts, skeleton.length)


# --------------------------------------------------------------------------------------------------------------------
# the skeleton: where the bones of the arm are at the home pose, in the base frame


class _Skeleton:
    """Axes with the two points where the links before and behind are fixed to them.

    Attributes
    ----------
    foot : (3,) point where the arm stands
    axis : (m, 3) directions
    entry, leave : (m, 3) points on the axes where the link before ends and where the link behind begins
    flange, tip : (3,) points
    travel : (m, 2) from where to where a sliding axis goes [m]; zero for turning ones
    length : float
    """

    def __init__(self, chain: Chain) -> None:
        m = len(chain.screws)
        self.turns = chain.is_revolute
        self.axis = np.where(self.turns[:, None], chain.screws[:, 3:], chain.screws[:, :3]).reshape(m, 3)
        self.stand = next(f.home for f in reversed(chain.frames) if f.after == 0)
        self.foot: FloatArray = self.stand[:3, 3]
        self.tip: FloatArray = chain.home[:3, 3]
        hints = np.array([chain.frame(i + 1).home[:3, 3] for i in range(m)]).reshape(m, 3)
        self._point = np.array(
            [self._on_line(chain.screws[i], hints[i]) if self.turns[i] else hints[i] for i in range(m)]
        ).reshape(m, 3)
        for i in map(int, np.flatnonzero(~self.turns)):
            self._point[i] = self._slide_point(i, hints[i])
        rough = float(np.linalg.norm(np.diff([self.foot, *self._point, self.tip], axis=0), axis=1).sum())
        self._rough = rough
        self._thickest = np.inf  # [m] of links side by side

        self.entry, self.leave = self._point.copy(), self._point.copy()
        if m:
            self.entry[0] = self._nearest(0, self.foot)
            for i in range(m - 1):
                if not self._parallel(i, i + 1):
                    self.leave[i], self.entry[i + 1] = self._feet(i, i + 1)
        self.flange = self._find_flange(chain)
        if m:
            self.leave[-1] = self._nearest(m - 1, self.flange)
            for first, last in self._parallel_runs():
                self._lay_side_by_side(first, last, hints)
        self.travel = np.array([self._reach_of(chain, i) for i in range(m)]).reshape(m, 2)
        bones = float(np.linalg.norm(np.diff(self._bones(), axis=0), axis=1).sum())
        self.endless = ~np.isfinite(self.travel)
        slides = float(np.where(self.endless, 0.0, self.travel) @ [-1.0, 1.0] @ np.ones(m)) if m else 0.0
        self.length = bones + slides
        if self.length <= 1e-9 * max(1.0, float(np.abs(self.foot).max())):
            self.length = _LENGTH_OF_A_POINT
        self.travel = np.where(self.endless, np.sign(self.travel) * 0.25 * self.length, self.travel)
        self._at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self._bones(), axis=0), axis=1))])
        self._bone_length = bones

    def _slide_point(self, i: int, hint: FloatArray) -> FloatArray:
        """A point of a sliding axis: screws say nothing of where it is; where its frame says no more either, what follows does."""
        before = self._point[i - 1] if i else self.foot
        if np.linalg.norm(np.cross(self.axis[i], hint - before)) > 1e-6 * max(1.0, float(np.abs(hint).max())):
            return hint
        if i == len(self.axis) - 1:
            return self.tip
        return self._point[i + 1] if self.turns[i + 1] and self._parallel(i, i + 1) else hint

    @staticmethod
    def _on_line(screw: FloatArray, near: FloatArray) -> FloatArray:
        v, w = screw[:3], screw[3:]
        point = np.cross(w, v)
        return np.asarray(point + w * float(w @ (near - point)))

    def _nearest(self, i: int, target: FloatArray) -> FloatArray:
        """The point of axis i nearest to `target`."""
        return np.asarray(self._point[i] + self.axis[i] * float(self.axis[i] @ (target - self._point[i])))

    def _parallel(self, i: int, j: int) -> bool:
        return float(np.linalg.norm(np.cross(self.axis[i], self.axis[j]))) < _SHARED

    def _feet(self, i: int, j: int) -> tuple[FloatArray, FloatArray]:
        """The feet of the common normal of two axes, not farther from the frames on them than the arm is long."""
        a, b, between = self.axis[i], self.axis[j], self._point[j] - self._point[i]
        c = float(a @ b)
        along_i = (float(a @ between) - c * float(b @ between)) / (1.0 - c * c)
        along_j = (c * float(a @ between) - float(b @ between)) / (1.0 - c * c)
        along_i, along_j = (min(max(value, -self._rough), self._rough) for value in (along_i, along_j))
        return self._point[i] + a * along_i, self._point[j] + b * along_j

    def _find_flange(self, chain: Chain) -> FloatArray:
        """Where the last link ends and a tool begins: the frame before the tip, unless it is on the last joint itself."""
        m = len(chain.screws)
        start = self.entry[-1] if m else self.foot
        if m and not self.turns[-1]:
            return self.tip
        flange = self.tip
        for frame in chain.frames:
            point = frame.home[:3, 3]
            if (
                frame.after == m
                and min(np.linalg.norm(point - start), np.linalg.norm(point - self.tip)) > 0.01 * self._rough
            ):
                flange = point
        return flange

    def _parallel_runs(self) -> Iterator[tuple[int, int]]:
        first, m = 0, len(self.axis)
        for i in range(m):
            if i == m - 1 or not self._parallel(i, i + 1):
                if i > first:
                    yield first, i
                first = i + 1

    def _lay_side_by_side(self, first: int, last: int, hints: FloatArray) -> None:
        """Choose where the links between parallel axes are along them."""
        u = self.axis[first]
        low, high = float(u @ self.entry[first]), float(u @ self.leave[last])
        if first > 0 and self.turns[first : last + 1].all():
            sideways = abs(high - low) > _SIDEWAYS * self._rough
            levels = [high if sideways and k % 2 == 0 else low for k in range(last - first)]
            if sideways and last - first > 1:
                self._thickest = min(self._thickest, 0.45 * abs(high - low))
        else:
            levels = []
            for i in range(first, last):
                ahead = np.linalg.norm(hints[i] - self._nearest(i + 1, hints[i])) <= 1e-3 * self._rough
                levels.append(float(u @ (hints[i] if ahead and self.turns[i] else self._point[i + 1])))
        for i, level in zip(range(first, last), levels, strict=True):
            for j, where in ((i, self.leave), (i + 1, self.entry)):
                a, p = self.axis[j], self._point[j]
                where[j] = p + a * (level - float(u @ p)) / float(u @ a)

    @staticmethod
    def _reach_of(chain: Chain, i: int) -> FloatArray:
        if chain.is_revolute[i]:
            return np.zeros(2)
        row = chain.coupling[i]
        ends = np.where(
            row[:, None] != 0.0, row[:, None] * np.nan_to_num(chain.limits, posinf=1e300, neginf=-1e300), 0.0
        )
        lower, upper = float(ends.min(axis=1).sum()), float(ends.max(axis=1).sum())
        return np.array([lower if lower > -1e15 else -np.inf, upper if upper < 1e15 else np.inf])

    def _bones(self) -> FloatArray:
        """Points from foot to tip, (2 m + 3, 3)."""
        pairs = np.stack([self.entry, self.leave], axis=1).reshape(-1, 3)
        return np.vstack([self.foot, pairs, self.flange, self.tip])

    def radius(self, i: int, end: float) -> float:
        """Radius [m] on axis i at its entry (`end` 0), where it is left (1), or between; axis m is flange (0) and tip (1)."""
        here, there = float(self._at[2 * i + 1]), float(self._at[min(2 * i + 2, len(self._at) - 1)])
        done = (here + end * (there - here)) / self._bone_length if self._bone_length > 0.0 else 0.5
        thick = min(_RADIUS_AT_BASE, self._thickest / self.length)
        return self.length * (thick + done * (min(_RADIUS_AT_TIP, 0.7 * thick) - thick))


# --------------------------------------------------------------------------------------------------------------------
# flesh on the bones

_Placed: TypeAlias = tuple[int, str, Solid, FloatArray]


def _solids(chain: Chain, bones: _Skeleton) -> Iterator[_Placed]:
    m = len(bones.axis)
    yield from _base(bones)
    for i in range(m):
        r = bones.radius(i, 0.5)
        start, end = bones.entry[i], bones.leave[i]
        span = float(np.linalg.norm(end - start))
        if i > 0 or bones.turns[i]:  # the link before, from where it left its own axis
            if i:
                yield from _bar(i, "link", bones.leave[i - 1], start, bones.radius(i - 1, 1.0), bones.radius(i, 0.0))
            else:
                yield from _tongue(bones)
        if not bones.turns[i]:
            yield from _slide(bones, i)
        elif i == 0 and span > 0.5 * r:
            seam = start + _SEAM * (end - start)
            yield _drum(0, "base", start, seam, _HOUSING * r)
            yield _drum(1, "housing", seam, end, r * 1.05)
        elif i == m - 1 and span > 0.2 * r:
            yield _drum(m, "link", start, start + (1.0 - 0.2 * r / span) * (end - start), 0.9 * r)
        elif span > _LONG * r:
            seam = start + _SEAM * (end - start)
            yield from _bar(i, "link", start, seam, bones.radius(i, 0.0), r)
            yield from _bar(i + 1, "link", seam, end, r, bones.radius(i, 1.0))
            ring = bones.axis[i] * 0.4 * r
            yield _drum(i + 1, "housing", seam - ring, seam + ring, _RING * bones.radius(i, 0.0))
        else:
            beyond = (
                bones.axis[i]
                * _BEYOND
                * r
                * (1.0 if float(bones.axis[i] @ (end - start)) > -1e-6 * bones.length else -1.0)
            )
            yield _drum(i + 1, "housing", start - beyond, end + beyond, _HOUSING * r)
    yield from _end(chain, bones)


def _base(bones: _Skeleton) -> Iterator[_Placed]:
    """A plate to stand on; for a rail high above the ground, posts under its ends come with the rail."""
    r = bones.radius(0, 0.0)
    if _on_posts(bones):
        return
    up = bones.stand[:3, 2]
    yield _drum(0, "base", bones.foot, bones.foot + up * 0.4 * r, 1.7 * r)
    if len(bones.axis) and not bones.turns[0]:
        yield from _bar(0, "base", bones.foot, bones.entry[0], r, r)


def _tongue(bones: _Skeleton) -> Iterator[_Placed]:
    """From where the arm stands to its first axis: flat on the ground where that axis stands beside it."""
    r, up = bones.radius(0, 0.0), bones.stand[:3, 2]
    if abs(float(up @ (bones.entry[0] - bones.foot))) > r:
        yield from _bar(0, "base", bones.foot, bones.entry[0], r, r)
    else:
        lift = up * 0.4 * r
        yield from _bar(0, "base", bones.foot + lift, bones.entry[0] + lift, 0.4 * r, 0.4 * r)


def _on_posts(bones: _Skeleton) -> bool:
    if not len(bones.axis) or bones.turns[0] or not _is_rail(bones, 0):
        return False
    up = bones.stand[:3, 2]
    level = abs(float(up @ bones.axis[0])) < _SHARED
    return level and float(up @ (bones.leave[0] - bones.foot)) > 4.0 * bones.radius(0, 0.0)


def _is_rail(bones: _Skeleton, i: int) -> bool:
    """Whether the slide is a carriage on a rail, as where an arm is carried, or a rod in a bushing, as where it reaches out."""
    if bones.turns[:i].any():
        return False
    off = [
        float(np.linalg.norm(np.cross(bones.axis[i], bones.leave[j] - bones.leave[i]))) > 1e-3 * bones.length
        or float(np.linalg.norm(np.cross(bones.axis[i], bones.axis[j]))) > _SHARED
        for j in range(i + 1, len(bones.axis))
    ]
    return any(off)


def _slide(bones: _Skeleton, i: int) -> Iterator[_Placed]:
    """A rail on link i with a carriage on link i + 1, or a rod on link i + 1 in a bushing on link i."""
    u, r = bones.axis[i], bones.radius(i, 0.5)
    start, end = bones.entry[i], bones.leave[i]
    lower, upper = (float(value) for value in bones.travel[i])
    if _is_rail(bones, i):
        along = sorted([lower - 1.6 * r, upper + 1.6 * r, float(u @ (start - end)), 0.0])
        low, high = end + u * along[0], end + u * along[-1]
        role = "link" if i else "base"
        yield _beam(i, role, low, high, 1.3 * r)
        yield _block(i + 1, "housing", end, u, np.array([2.0, 2.0, 2.4]) * r)
        if i == 0 and _on_posts(bones):
            up = bones.stand[:3, 2]
            for top in (low, high):
                ground = top - up * float(up @ (top - bones.foot))
                yield _beam(0, "base", ground, top, 1.3 * r)
                yield _drum(0, "base", ground, ground + up * 0.4 * r, 1.7 * r)
        return
    along = sorted([float(u @ (start - end)) - lower, float(u @ (start - end)) - upper, 0.0])
    yield _block(i, "housing", start, u, np.array([2.0, 2.0, 2.4]) * r)
    yield _drum(i + 1, "link", end + u * (along[0] - 0.6 * r), end + u * (along[-1] + 0.6 * r), 0.6 * r)


def _end(chain: Chain, bones: _Skeleton) -> Iterator[_Placed]:
    """From the last axis to the flange, the flange with its mark, and the tool."""
    m = len(bones.axis)
    r = bones.radius(m, 0.0)
    start = bones.leave[-1] if m else bones.foot
    flange, tip, x = bones.flange, bones.tip, chain.home[:3, 0]
    if np.linalg.norm(flange - start) > 1e-6 * bones.length:
        out = flange - start
        yield _drum(m, "link", start, flange - min(0.2, 0.2 * r / float(np.linalg.norm(out))) * out, 0.9 * r)
        yield m, "link", Sphere(0.9 * r), _at(start)
    elif m and np.linalg.norm(start - bones.entry[-1]) > 1e-6 * bones.length:
        out = start - bones.entry[-1]
    else:
        out = bones.axis[-1] if m else chain.home[:3, 2]
    out = out / np.linalg.norm(out)
    yield _drum(m, "flange", flange - 0.45 * r * out, flange, 1.05 * r)
    yield from _bar(m, "mark", flange, flange + 1.7 * r * x, 0.24 * r, 0.12 * r)
    if np.linalg.norm(tip - flange) > 1e-6 * bones.length:
        yield from _bar(m, "tool", flange, tip, 0.4 * r, 0.2 * r)
        yield m, "tool", Sphere(0.3 * r), _at(tip)


def _bar(
    link: int, role: str, start: FloatArray, end: FloatArray, radius: float, end_radius: float
) -> Iterator[_Placed]:
    """A tapered bar between two points; none between equal points."""
    length = float(np.linalg.norm(end - start))
    if length > 1e-9 * max(radius, end_radius):
        yield link, role, Taper(radius, end_radius, length), _between(start, end)


def _drum(link: int, role: str, start: FloatArray, end: FloatArray, radius: float) -> _Placed:
    length = float(np.linalg.norm(end - start))
    return link, role, Drum(radius, length, min(0.22 * radius, 0.45 * length)), _between(start, end)


def _beam(link: int, role: str, start: FloatArray, end: FloatArray, width: float) -> _Placed:
    length = float(np.linalg.norm(end - start))
    return link, role, Box(np.array([width, width, length + width])), _between(start, end)


def _block(link: int, role: str, at: FloatArray, direction: FloatArray, size: FloatArray) -> _Placed:
    return link, role, Box(size), _between(at - 0.5 * direction, at + 0.5 * direction)


def _between(start: FloatArray, end: FloatArray) -> FloatArray:
    """A pose half way from `start` to `end` whose z axis points to `end`; its x axis is as level as can be."""
    z = (end - start) / np.linalg.norm(end - start)
    x = np.cross([0.0, 0.0, 1.0], z) if abs(z[2]) < 0.9 else np.cross([0.0, 1.0, 0.0], z)
    x = x / np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    T[:3, 3] = 0.5 * (start + end)
    return T


def _at(point: FloatArray) -> FloatArray:
    T = np.eye(4)
    T[:3, 3] = point
    return T


def _inverse(T: FloatArray) -> FloatArray:
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse
