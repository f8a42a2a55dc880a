"""Draw a scene, and say where everything in it was.

Outlines are projected through the camera point by point, lens and perspective included, and cover pixels by exact area
(`coverage`), so a picture without noise differs from an ideal camera's by the rounding to 8 bits alone. Motion blur is the mean of
pictures at even steps over the exposure. Light multiplies the colours before noise is added.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.perception.coverage import Patch, coverage
from pieper.perception.frame import Frame, Image
from pieper.perception.opencv import opencv
from pieper.perception.scene import COLORS, Ball, Bgr, Robot, circle
from pieper.perception.truth import TrueMarker, TrueObject, Truth
from pieper.spatial.angle import wrap

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from pieper.perception.scene import Bar, Pose, Scene
    from pieper.spatial._checks import FloatArray

_CORNERS = 48
_STEPS = 8  # pictures in a blurred one
_LINE_STEP = 0.02  # m; a straight line on the field is bent by the lens
_DIM, _LIT = 0.72, 1.25  # the side of a robot and the edge of its top, against its paint


class _Shape(NamedTuple):
    """A flat patch of paint: outline and height in the field, owner for what hides what."""

    outline: FloatArray  # (n, 2) [m]
    height: FloatArray  # (n,) [m]
    paint: Bgr
    opacity: float
    owner: int  # index of the thing; -1 for a bar
    marker: int  # index of the marker; -1 for a body


class Renderer:
    """Draws the frames of a scene, in any order.

    Parameters
    ----------
    scene : Scene
        What to draw.

    Examples
    --------
    >>> from pieper.perception.scene_presets import preset
    >>> frame, truth = Renderer(preset("clean"))[0]
    >>> frame.size, len(truth.objects)
    ((640, 480), 11)
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._background = _field(scene)
        self._lamps = _lamps(scene)

    def __len__(self) -> int:
        return len(self.scene)

    def __iter__(self) -> Iterator[tuple[Frame, Truth]]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: int) -> tuple[Frame, Truth]:
        if not 0 <= index < len(self):
            raise IndexError(f"scene {self.scene.name!r} has frames 0 to {len(self) - 1}, got {index}")
        time = index / self.scene.fps
        picture = self._blurred(time)
        image = self._spoiled(picture, index)
        return Frame(image, index, time), self.truth(index)

    def truth(self, index: int) -> Truth:
        """Return where everything is in a frame, without drawing it."""
        time = index / self.scene.fps
        shapes = _shapes(self.scene, time)
        patches = self._cover(shapes)
        seen = _visible(shapes, patches, self.scene.view.to_image)
        objects = tuple(self._true(k, thing, time, seen) for k, thing in enumerate(self.scene.things))
        return Truth(index, time, objects)

    def _true(self, k: int, thing: Robot | Ball, time: float, seen: dict[tuple[int, int], float]) -> TrueObject:
        pose = thing.motion(time)
        if isinstance(thing, Ball):
            centres, heights, colors = np.array([[pose.x, pose.y]]), thing.radius, [thing.color]
            weights = np.ones(1)
        else:
            markers = thing.model.markers
            centres = _placed(np.array([[m.x, m.y] for m in markers]), pose)
            heights, colors = thing.model.height, [m.color for m in markers]
            weights = np.array([m.area for m in markers])
        images = self.scene.view.to_image(centres, height=heights)
        shares = [seen.get((k, j), 0.0) for j in range(len(colors))]
        robot = isinstance(thing, Robot)
        return TrueObject(
            name=thing.name,
            kind=thing.kind,
            position=np.array([pose.x, pose.y]),
            heading=float(wrap(pose.heading)) if robot else None,
            velocity=np.array([pose.vx, pose.vy]),
            turn_rate=pose.turn_rate if robot else None,
            visible=float(np.average(shares, weights=weights)),
            markers=tuple(TrueMarker(c, image, share) for c, image, share in zip(colors, images, shares, strict=True)),
        )

    def _cover(self, shapes: list[_Shape]) -> list[Patch]:
        view, size = self.scene.view, self.scene.view.camera.size
        if not shapes:
            return []
        points = view.to_image(
            np.concatenate([s.outline for s in shapes]), height=np.concatenate([s.height for s in shapes])
        )
        ends = np.cumsum([len(s.outline) for s in shapes])[:-1]
        return coverage(np.split(points, ends), size)

    def _blurred(self, time: float) -> NDArray[np.float32]:
        exposure = self.scene.effects.exposure
        if exposure == 0:
            return self._sharp(time)
        offsets = ((np.arange(_STEPS) + 0.5) / _STEPS - 0.5) * exposure
        total = self._sharp(time + offsets[0])
        for offset in offsets[1:]:
            total += self._sharp(time + offset)
        return total / np.float32(_STEPS)

    def _sharp(self, time: float) -> NDArray[np.float32]:
        shapes = _shapes(self.scene, time)
        picture = self._background.copy()
        for shape, (left, top, share) in zip(shapes, self._cover(shapes), strict=True):
            if share.size:
                below = picture[top : top + share.shape[0], left : left + share.shape[1]]
                below += (share * np.float32(shape.opacity))[..., None] * (np.array(shape.paint, np.float32) - below)
        return picture

    def _spoiled(self, picture: NDArray[np.float32], index: int) -> Image:
        scene, effects = self.scene, self.scene.effects
        done = scene.progress(index)
        light = effects.light[0] + (effects.light[1] - effects.light[0]) * done
        cast = effects.cast[0] + (effects.cast[1] - effects.cast[0]) * done
        if self._lamps is not None:
            picture *= self._lamps[..., None]
        if light != 1 or cast != 0:
            picture *= np.array([1 - cast, 1, 1 + cast], np.float32) * np.float32(light)
        if effects.noise:
            random = np.random.default_rng((scene.seed, index))
            picture += random.standard_normal(picture.shape, dtype=np.float32) * np.float32(effects.noise)
        image: Image = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
        if effects.quality:
            cv2 = opencv("compression")
            _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, effects.quality])
            image = cv2.imdecode(data, cv2.IMREAD_COLOR)
        return image


def _placed(points: FloatArray, pose: Pose) -> FloatArray:
    c, s = np.cos(pose.heading), np.sin(pose.heading)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y))


def _shapes(scene: Scene, time: float) -> list[_Shape]:
    """Everything that moves, from what is painted first to what is painted last: the far from the camera before the near."""
    eye = _eye(scene)
    shapes: list[_Shape] = []
    poses = [(thing, k, thing.motion(time)) for k, thing in enumerate(scene.things)]
    for thing, _, pose in poses:
        shapes.append(_soft_shadow(thing, pose))
    poses.sort(key=lambda item: (isinstance(item[0], Robot), -np.hypot(item[2].x - eye[0], item[2].y - eye[1])))
    for thing, k, pose in poses:
        shapes.extend(_ball(thing, k, pose, eye) if isinstance(thing, Ball) else _robot(thing, k, pose, eye))
    return shapes + [_bar(bar, time) for bar in scene.bars if bar.interval[0] <= time <= bar.interval[1]]


def _eye(scene: Scene) -> FloatArray:
    T = scene.view.T_camera_field
    return np.asarray(T[:3, :3].T @ -T[:3, 3])


def _flat(
    outline: FloatArray, height: float, paint: Bgr, opacity: float = 1.0, owner: int = -2, marker: int = -1
) -> _Shape:
    return _Shape(outline, np.full(len(outline), height), paint, opacity, owner, marker)


def _soft_shadow(thing: Robot | Ball, pose: Pose) -> _Shape:
    """What a thing takes from the light around its foot."""
    size = thing.radius if isinstance(thing, Ball) else max(thing.model.radius, thing.model.side * 0.6)
    return _flat(
        circle(size * 1.25, 24) + np.array([pose.x + 0.15 * size, pose.y - 0.2 * size]), 0.0, (20, 30, 18), 0.35
    )


def _robot(robot: Robot, k: int, pose: Pose, eye: FloatArray) -> Iterator[_Shape]:
    model = robot.model
    foot = _placed(model.outline(_CORNERS), pose)
    # The silhouette of a prism, seen from a point: the shadow of its top on the floor and its foot, joined.
    top_on_floor = eye[:2] + (foot - eye[:2]) * eye[2] / (eye[2] - model.height)
    yield _flat(_hull(np.concatenate([foot, top_on_floor])), 0.0, _shade(model.paint, _DIM), owner=k)
    yield _flat(foot, model.height, _shade(model.paint, _LIT), owner=k)
    inner = _placed(model.outline(_CORNERS) * 0.96, pose)
    yield _flat(inner, model.height, model.paint, owner=k)
    for j, marker in enumerate(model.markers):
        outline = _placed(marker.outline(_CORNERS), pose)
        yield _flat(outline, model.height, COLORS[marker.color], owner=k, marker=j)


def _ball(ball: Ball, k: int, pose: Pose, eye: FloatArray) -> Iterator[_Shape]:
    """The silhouette of a sphere: the circle in which a cone from the eye touches it."""
    centre = np.array([pose.x, pose.y, ball.radius])
    sight = centre - eye
    d = float(np.linalg.norm(sight))
    n = sight / d
    across = np.cross(n, [1.0, 0.0, 0.0] if abs(n[0]) < 0.9 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    rim = circle(ball.radius * np.sqrt(1 - (ball.radius / d) ** 2), _CORNERS)
    points = centre - n * ball.radius**2 / d + rim[:, :1] * across + rim[:, 1:] * np.cross(n, across)
    yield _Shape(points[:, :2], points[:, 2], COLORS[ball.color], 1.0, k, 0)


def _bar(bar: Bar, time: float) -> _Shape:
    return _flat(_dense(_placed(bar.outline(), bar.motion(time))), bar.height, bar.paint, owner=-1)


def _shade(paint: Bgr, factor: float) -> Bgr:
    return (paint[0] * factor, paint[1] * factor, paint[2] * factor)


def _hull(points: FloatArray) -> FloatArray:
    from scipy.spatial import ConvexHull

    return np.asarray(points[ConvexHull(points).vertices])


def _dense(corners: FloatArray) -> FloatArray:
    """The same polygon with corners along its sides, for a lens that bends them."""
    pieces = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(2, int(np.hypot(*(b - a)) / _LINE_STEP))
        pieces.append(a + (b - a) * (np.arange(count) / count)[:, None])
    return np.concatenate(pieces)


def _visible(shapes: list[_Shape], patches: list[Patch], to_image: Any) -> dict[tuple[int, int], float]:
    """Share of each marker that is in the image and not below something painted later."""
    shares = {}
    for n, (shape, (left, top, share)) in enumerate(zip(shapes, patches, strict=True)):
        if shape.marker < 0 or shape.owner < 0:
            continue
        whole = _area(to_image(shape.outline, height=shape.height))
        if not share.size or not whole > 0:
            shares[shape.owner, shape.marker] = 0.0
            continue
        clear = share.copy()
        rows, columns = share.shape
        for other, (x, y, cover) in zip(shapes[n + 1 :], patches[n + 1 :], strict=True):
            if other.owner == shape.owner:
                continue
            x0, x1 = max(x, left), min(x + cover.shape[1], left + columns)
            y0, y1 = max(y, top), min(y + cover.shape[0], top + rows)
            if x0 < x1 and y0 < y1:
                clear[y0 - top : y1 - top, x0 - left : x1 - left] *= 1 - cover[y0 - y : y1 - y, x0 - x : x1 - x]
        shares[shape.owner, shape.marker] = min(round(float(clear.sum(dtype=np.float64)) / whole, 6), 1.0)
    return shares


def _area(polygon: FloatArray) -> float:
    x, y = polygon.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def _field(scene: Scene) -> NDArray[np.float32]:
    """The carpet and its lines, lit evenly."""
    pitch, view = scene.pitch, scene.view
    width, height = view.camera.size
    random = np.random.default_rng((scene.seed, 1_000_003))
    floor = np.empty((height, width, 3), np.float32)
    floor[:] = (74, 76, 78)
    half = np.array([pitch.length / 2, pitch.width / 2])
    polygons = [_dense(_rectangle(half + pitch.margin))]
    polygons += [_dense(_rectangle(half + pitch.line / 2)), _dense(_rectangle(half - pitch.line / 2))]
    centre = circle(1.0, 144)
    polygons += [centre * (pitch.circle + pitch.line / 2), centre * (pitch.circle - pitch.line / 2)]
    across = _rectangle(np.array([pitch.line / 2, half[1]]))
    polygons.append(_dense(across))
    for side in (-1, 1):
        at = np.array([side * (half[0] - pitch.box[0] / 2), 0.0])
        size = np.array(pitch.box) / 2
        polygons += [_dense(_rectangle(size + pitch.line / 2) + at), _dense(_rectangle(size - pitch.line / 2) + at)]
        goal = np.array([side * (half[0] + pitch.goal[0] / 2), 0.0])
        polygons.append(_dense(_rectangle(np.array(pitch.goal) / 2) + goal))
    covers = [np.zeros((height, width), np.float32) for _ in polygons]
    for whole, (left, top, share) in zip(
        covers, coverage([view.to_image(p) for p in polygons], (width, height)), strict=True
    ):
        whole[top : top + share.shape[0], left : left + share.shape[1]] = share
    carpet, outer, inner, ring, hole, middle = covers[:6]
    white = np.clip(outer - inner, 0, 1)
    white = np.maximum(white, np.clip(ring - hole, 0, 1))
    white = np.maximum(white, middle * inner)
    for k in (6, 9):
        white = np.maximum(white, np.clip(covers[k] - covers[k + 1], 0, 1) * outer)
    floor += carpet[..., None] * (np.array(pitch.carpet, np.float32) - floor)
    for k in (8, 11):
        floor += covers[k][..., None] * (np.array([52, 50, 48], np.float32) - floor)
    floor += white[..., None] * (np.array([228, 232, 230], np.float32) - floor)
    return np.asarray(floor * _nap(random, (height, width))[..., None])


def _nap(random: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Light and dark of a carpet: coarse patches and fine grain."""
    total = np.ones(shape, np.float32)
    for cell, strength in ((96, 0.05), (12, 0.02), (1, 0.02)):
        rows, columns = shape[0] // cell + 2, shape[1] // cell + 2
        coarse = random.standard_normal((rows, columns), dtype=np.float32) * np.float32(strength)
        y, x = np.arange(shape[0]) / cell, np.arange(shape[1]) / cell
        i, j = y.astype(int), x.astype(int)
        fy, fx = (y - i)[:, None].astype(np.float32), (x - j)[None].astype(np.float32)
        upper = coarse[i][:, j] * (1 - fx) + coarse[i][:, j + 1] * fx
        lower = coarse[i + 1][:, j] * (1 - fx) + coarse[i + 1][:, j + 1] * fx
        total += upper * (1 - fy) + lower * fy
    return np.maximum(total, 0)


def _rectangle(half: FloatArray) -> FloatArray:
    return np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half


def _lamps(scene: Scene) -> NDArray[np.float32] | None:
    """Light over the image: a gradient from left to right, and a shadow with a soft edge across the right third."""
    effects = scene.effects
    if effects.gradient == 0 and effects.shadow == 0:
        return None
    width, height = scene.view.camera.size
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    light = 1 + effects.gradient / 2 * x
    edge = 1 / (1 + np.exp(-(x + 0.4 * y - 0.25) / 0.03))
    return np.asarray(light * (1 - effects.shadow * edge), dtype=np.float32)
