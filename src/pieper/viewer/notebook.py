"""An arm that shows itself in a notebook: a small picture, and its joints with their limits.

The picture is SVG text, made here from the solids of `pieper.model.shape` by an orthographic projection: no screen, no browser and no
other package is needed. ``import pieper`` within IPython registers it; elsewhere `html` and `svg` give the text.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pieper.kinematics.fk import fk_frames
from pieper.kinematics.joints import as_joints
from pieper.kinematics.reach import reach
from pieper.model.description import Box, Capsule, Cylinder, Sphere
from pieper.model.shape import Drum, Taper, as_mesh, from_chain
from pieper.viewer.stance import stance

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.model.shape import Part, Solid
    from pieper.spatial._checks import FloatArray

_AZIMUTH, _ELEVATION = np.radians(-55.0), np.radians(18.0)  # of the eye
_LIGHT = np.array([-0.45, 0.62, 0.64])  # to the left, above, and behind the one who looks
_COLORS = {
    "base": "#59626f",
    "link": "#c3cad4",
    "housing": "#3f7fb5",
    "flange": "#59626f",
    "mark": "#d55e00",
    "tool": "#8b949e",
}
_EDGE = "#2b313a"
_TRIAD = ("#d55e00", "#009e73", "#0072b2")
_GRID = 72  # pixels per side by which it is decided what hides what
_AROUND = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
_BANDS = 7  # shades of a round surface
_MARGIN = 0.06  # around the arm, as a fraction of the picture


def svg(arm: Arm, q: ArrayLike | None = None, *, width: int = 240) -> str:
    """A picture of an arm as SVG text.

    Parameters
    ----------
    arm : Arm
    q : (n,) array, optional
        Joint values [rad or m]. Default: `pieper.viewer.stance.stance`.
    width : int
        Width and greatest height [px].

    Returns
    -------
    str
        One ``<svg>`` element without scripts, styles, ids or links.

    Raises
    ------
    ArrayError
        `q` has a wrong shape or is not finite.

    Examples
    --------
    >>> import pieper
    >>> svg(pieper.load("ur5e"))[:4]
    '<svg'
    """
    chain = arm.chain
    values = stance(chain) if q is None else as_joints(chain, q)
    links = fk_frames(chain, values, frames=range(len(chain.screws) + 1))
    view = _view()
    solids = [_seen(part, view @ links[part.link] @ part.T_link_part) for part in from_chain(chain).parts]
    outline = np.vstack([solid.outline for solid in solids])
    triad = _triad(view @ fk_frames(chain, values, frames=[chain.tip])[0], float(np.ptp(outline, axis=0).max()))
    everything = np.vstack([outline, *(line for line, _ in triad)])
    low, size = everything.min(axis=0), np.ptp(everything, axis=0)
    scale = (1.0 - 2.0 * _MARGIN) * width / max(float(size.max()), 1e-9)
    frame = _Paper(scale, low[0] - _MARGIN * width / scale, low[1] + size[1] + _MARGIN * width / scale)
    box_width, box_height = (scale * size + 2.0 * _MARGIN * width).round()
    told = f"{arm.name} at q = ({', '.join(f'{value:.2f}' for value in values + 0.0)})"
    size_text = f'width="{box_width:.0f}" height="{box_height:.0f}" viewBox="0 0 {box_width:.0f} {box_height:.0f}"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size_text} role="img" stroke-linejoin="round">',
        f"<title>{escape(told)}</title>",
    ]
    for i in _back_to_front(solids):
        lines += _drawn(solids[i], frame)
    for line, color in triad:
        lines.append(
            f'<path d="{frame.path(line)}" stroke="{color}" stroke-width="2" stroke-linecap="round" fill="none"/>'
        )
    return "\n".join([*lines, "</svg>"])


def html(arm: Arm) -> str:
    """What a notebook shows of an arm: its picture, its name and reach, and a table of its joints and their limits.

    Returns
    -------
    str
        HTML without scripts; text takes the colour of the page.
    """
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:1.5em;align-items:center">'
        f"<div>{svg(arm)}</div>"
        f"<div><div><b>{escape(arm.name)}</b></div>"
        f'<div style="opacity:.75;margin-bottom:.5em">{escape(_summary(arm))}</div>{_table(arm)}</div></div>'
    )


def _summary(arm: Arm) -> str:
    far = reach(arm.chain).from_base if arm.dof else float(np.linalg.norm(arm.chain.home[:3, 3]))
    reached = f"reach {far:.3f} m from the base" if np.isfinite(far) else "no end of reach"
    return f"{arm.dof} joint{'' if arm.dof == 1 else 's'}, {arm.base} \N{RIGHTWARDS ARROW} {arm.tip}, {reached}"


def _table(arm: Arm) -> str:
    chain = arm.chain
    slides = [not chain.is_revolute[axes].all() for axes in (chain.coupling != 0.0).T]
    cell = 'style="padding:.1em .5em;text-align:right"'
    name = 'style="padding:.1em .5em;text-align:left"'
    headings = "".join(f"<th {cell}>{word}</th>" for word in ("lower", "upper", "lower", "upper", "speed"))
    rows = [f"<tr><th {name}>joint</th>{headings}</tr>"]
    for joint, slide, (lower, upper), speed in zip(
        arm.joint_names, slides, arm.limits, chain.max_velocity, strict=True
    ):
        unit = "m" if slide else "rad"
        turned = ["", ""] if slide else [_number(np.degrees(value), 1, "\N{DEGREE SIGN}") for value in (lower, upper)]
        cells = [_number(lower, 3, f" {unit}"), _number(upper, 3, f" {unit}"), *turned, _number(speed, 2, f" {unit}/s")]
        rows.append(
            f"<tr><td {name}>{escape(joint)}</td>" + "".join(f"<td {cell}>{text}</td>" for text in cells) + "</tr>"
        )
    return f'<table style="border-collapse:collapse;font-size:90%;color:inherit">{"".join(rows)}</table>'


def _number(value: float, digits: int, unit: str) -> str:
    return f"{value + 0.0:.{digits}f}{unit}".replace("-", "\N{MINUS SIGN}") if np.isfinite(value) else "\N{EN DASH}"


# --- the projection: x to the right, y up, z towards the one who looks


class _Paper(NamedTuple):
    """Where a point of the view is in the picture [px]."""

    scale: float
    left: float
    top: float

    def path(self, points: FloatArray, *, closed: bool = False) -> str:
        at = np.column_stack([points[:, 0] - self.left, self.top - points[:, 1]]) * self.scale
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in at) + ("Z" if closed else "")


class _Seen(NamedTuple):
    """A solid as it is seen: its pose in the view, its outline (k, 2), and the planes of its faces (f, 4), n . x = d."""

    role: str
    solid: Solid
    T: FloatArray
    outline: FloatArray
    planes: FloatArray


def _view() -> FloatArray:
    c, s = np.cos(_AZIMUTH), np.sin(_AZIMUTH)
    towards = np.array([np.cos(_ELEVATION) * c, np.cos(_ELEVATION) * s, np.sin(_ELEVATION)])
    right = np.array([-s, c, 0.0])
    T = np.eye(4)
    T[:3, :3] = [right, np.cross(towards, right), towards]
    return T


def _seen(part: Part, T: FloatArray) -> _Seen:
    mesh = as_mesh(part.solid, sections=16)
    vertices = mesh.vertices @ T[:3, :3].T + T[:3, 3]
    a, b, c = (vertices[mesh.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal, a = normal[length[:, 0] > 0.0] / length[length[:, 0] > 0.0], a[length[:, 0] > 0.0]
    planes = np.column_stack([normal, (normal * a).sum(axis=1)])
    return _Seen(part.role, part.solid, T, _hull(vertices[:, :2]), planes)


def _triad(T_view_tip: FloatArray, size: float) -> list[tuple[FloatArray, str]]:
    """The axes of the tip as lines (2, 2) with their colours, the farthest first."""
    origin = T_view_tip[:2, 3]
    lines = [(np.array([origin, origin + 0.13 * size * T_view_tip[:2, k]]), _TRIAD[k]) for k in range(3)]
    return [lines[k] for k in np.argsort(T_view_tip[2, :3])]


# --- what hides what


def _back_to_front(solids: Sequence[_Seen]) -> list[int]:
    """The order in which to draw: of two solids the one that is in front in more places comes later."""
    corners = np.vstack([solid.outline for solid in solids])
    low, high = corners.min(axis=0), corners.max(axis=0)
    x, y = (axis.ravel() for axis in np.meshgrid(*(np.linspace(low[k], high[k], _GRID) for k in range(2))))
    depths = np.array([_depth(solid, x, y) for solid in solids])
    there = np.isfinite(depths)
    in_front = np.array(
        [((depth > depths) & there).sum(axis=1) for depth in depths]
    )  # [i, j]: places where i is in front of j
    surplus = np.maximum(in_front - in_front.T, 0)
    area = np.maximum(there.sum(axis=1), 1)
    left, order = list(range(len(solids))), []
    while left:
        lost = (
            surplus[np.ix_(left, left)].sum(axis=1) / area[left]
        )  # above zero for all where three hide each other in turn
        order.append(min(zip(lost, (solids[i].T[2, 3] for i in left), left, strict=True))[2])
        left.remove(order[-1])
    return order


def _depth(solid: _Seen, x: FloatArray, y: FloatArray) -> FloatArray:
    """How near the surface of a convex solid is at points of the picture; -inf beside it."""
    n, d = solid.planes[:, :3], solid.planes[:, 3]
    facing = np.where(n[:, 2] > 1e-6, 1, np.where(n[:, 2] < -1e-6, -1, 0))
    z = [
        (d[facing == side, None] - n[facing == side, :2] @ np.vstack([x, y])) / n[facing == side, 2:3]
        for side in (1, -1)
    ]
    front, back = z[0].min(axis=0, initial=np.inf), z[1].max(axis=0, initial=-np.inf)
    level = n[facing == 0, :2] @ np.vstack([x, y]) <= d[facing == 0, None] + 1e-9
    return np.where((front >= back) & level.all(axis=0), front, -np.inf)


# --- light and shade


def _drawn(solid: _Seen, paper: _Paper) -> Iterator[str]:
    """The paths of a solid: its outline in its darkest shade, then brighter and brighter parts."""
    color = _COLORS[solid.role]
    yield f'<path d="{paper.path(solid.outline, closed=True)}" fill="{_shade(color, 0.0)}" stroke="{_EDGE}" stroke-width=".9"/>'
    if isinstance(solid.solid, Box):
        patches = _box(solid)
    elif isinstance(solid.solid, (Drum, Cylinder)):
        patches = _cylinder(solid.solid, solid.T)
    else:
        patches = _round(solid.solid, solid.T)
    for points, light in patches:
        yield f'<path d="{paper.path(points, closed=True)}" fill="{_shade(color, light)}"/>'


def _shade(color: str, light: float) -> str:
    """A colour in the shade (0) or in the light (1)."""
    rgb = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)], dtype=np.float64)
    darkened = rgb * (0.58 + 0.5 * light)
    lit = darkened + (255.0 - darkened) * 0.28 * max(0.0, light - 0.55)
    return "#" + "".join(f"{int(value):02x}" for value in np.clip(lit, 0.0, 255.0))


def _brightness(normal: FloatArray) -> FloatArray:
    light = _LIGHT / np.linalg.norm(_LIGHT)
    return np.asarray(np.clip(0.18 + 0.82 * (normal @ light), 0.0, 1.0))


def _box(solid: _Seen) -> Iterator[tuple[FloatArray, float]]:
    assert isinstance(solid.solid, Box)
    half = 0.5 * solid.solid.size
    for axis in range(3):
        for side in (-1.0, 1.0):
            normal = side * solid.T[:3, axis]
            if normal[2] > 0.0:
                corners = np.zeros((4, 3))
                corners[:, axis] = side * half[axis]
                corners[:, (axis + 1) % 3] = np.array([-1, 1, 1, -1]) * half[(axis + 1) % 3]
                corners[:, (axis + 2) % 3] = np.array([-1, -1, 1, 1]) * half[(axis + 2) % 3]
                yield (corners @ solid.T[:3, :3].T + solid.T[:3, 3])[:, :2], float(_brightness(normal))


def _cylinder(solid: Drum | Cylinder, T: FloatArray) -> Iterator[tuple[FloatArray, float]]:
    """The side of a cylinder in bands from shade to light, and the end that is seen."""
    u, v, axis = T[:3, :3].T
    rim = solid.rim if isinstance(solid, Drum) else 0.0
    ends = [T[:3, 3] + side * (0.5 * solid.length - rim) * axis for side in (-1.0, 1.0)]
    across = np.cos(_AROUND)[:, None] * u + np.sin(_AROUND)[:, None] * v
    bright = np.where(across[:, 2] > 0.0, _brightness(across), -1.0)
    for band in range(1, _BANDS):
        level = band / _BANDS
        lit = across[bright >= level]
        if len(lit):
            yield _hull(np.vstack([end + solid.radius * lit for end in ends])[:, :2]), level
    facing = 1.0 if axis[2] > 0.0 else -1.0
    if abs(axis[2]) > 0.03:
        middle = T[:3, 3] + facing * 0.5 * solid.length * axis
        face = middle + (solid.radius - rim) * across
        yield face[:, :2], float(_brightness(facing * axis))


def _round(solid: Solid, T: FloatArray) -> Iterator[tuple[FloatArray, float]]:
    """A sphere, or what two spheres span, in discs that shrink towards the light."""
    if isinstance(solid, Sphere):
        balls = [(T[:2, 3], solid.radius)]
    elif isinstance(solid, (Taper, Capsule)):
        radii = (solid.radius, solid.end_radius) if isinstance(solid, Taper) else (solid.radius, solid.radius)
        balls = [
            (T[:2, 3] + side * 0.5 * solid.length * T[:2, 2], r) for side, r in zip((-1.0, 1.0), radii, strict=True)
        ]
    else:
        return
    light = _LIGHT / np.linalg.norm(_LIGHT)
    circle = np.column_stack([np.cos(_AROUND), np.sin(_AROUND)])
    for band in range(1, _BANDS):
        level = band / _BANDS
        slope = (level - 0.18) / 0.82  # n . light along the edge of the band
        shrink = np.sqrt(max(0.0, 1.0 - max(slope, 0.0) ** 2)) * (1.0 - 0.1 * level)
        shift = light[:2] * (1.0 - shrink) / max(float(np.hypot(*light[:2])), 1e-9)
        yield _hull(np.vstack([centre + r * (shift + shrink * circle) for centre, r in balls])), level


def _hull(points: FloatArray) -> FloatArray:
    """The convex hull of points in the plane, counter-clockwise (Andrew's monotone chain)."""
    ordered = np.unique(points.round(9), axis=0)
    if len(ordered) < 3:
        return ordered
    halves: list[list[FloatArray]] = []
    for sequence in (ordered, ordered[::-1]):
        half: list[FloatArray] = []
        for point in sequence:
            while len(half) > 1 and _turn(half[-2], half[-1], point) <= 0.0:
                half.pop()
            half.append(point)
        halves.append(half[:-1])
    return np.array(halves[0] + halves[1])


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
