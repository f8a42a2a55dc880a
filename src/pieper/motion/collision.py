"""Whether an arm touches itself or what stands around it, how far away it is, and from what.

Every moving solid is enclosed in a capsule, every obstacle in boxes or capsules. Distances of these, for whole batches of states at once,
bound the true ones from below; for capsules against boxes, balls and capsules they are the true ones. Where a bound does not decide, Coal
measures the solids themselves. Coal also tells the nearest pair, points and contacts.
"""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import ArrayError, WorldError, unknown_name
from pieper.kinematics.joints import as_joints
from pieper.model.chain import Chain
from pieper.model.description import Box, Capsule, Cylinder, Mesh, Sphere
from pieper.motion.arm_solids import enclosing_capsule, solids_of_chain, solids_of_description
from pieper.motion.clearance import segment_to_box, segment_to_segment
from pieper.motion.coal_solids import Measure, as_coal, vertices_of
from pieper.motion.world import Item, World

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from pieper.model.description import Geometry
    from pieper.motion.arm_solids import ArmLike
    from pieper.spatial._checks import FloatArray

DEFAULT_MARGIN = 0.01
"""Metres that are kept between solids unless told otherwise."""

SAMPLES = 1000
"""States by which it is found which links always touch, and which never come near each other."""

_MEASURED = 200  # of the samples, for pairs whose capsules nearly always touch
_ALWAYS = 0.95  # fraction of the samples in which a pair touches that is built to touch
_COARSE = 0.25  # the same for links two apart whose solids are made from the chain, see `SelfPairs`
_NEVER = 0.1  # a pair that stays farther apart than this fraction of the arm's reach in every sample is not looked at
_BLOCK = 2048  # states that are looked at together, to stay in the cache


class Nearest(NamedTuple):
    """The nearest pair of an arm at some joint values.

    Attributes
    ----------
    distance : float
        Metres; below 0 by the depth where they overlap, infinite where there is no pair.
    first, second : str
        A link, tool or grasped object, and what it is near to.
    p_first, p_second : (3,) arrays
        The nearest points of the two in the base frame [m].
    """

    distance: float
    first: str
    second: str
    p_first: FloatArray
    p_second: FloatArray

    def __str__(self) -> str:
        if self.distance <= 0.0:
            return f"{self.first} is {-1e3 * self.distance:.1f} mm inside {self.second}"
        return f"{self.first} is {1e3 * self.distance:.1f} mm from {self.second}"


@dataclass(frozen=True)
class SelfPairs:
    """Which pairs of links are looked at, and why the others are not. Names as collisions are told.

    Attributes
    ----------
    checked : tuple of (str, str)
    adjacent : tuple of (str, str)
        Joined by one joint, or the tool and what carries it.
    always : tuple of (str, str)
        Touching, which is nearer than the margin or `DEFAULT_MARGIN`, in 95 % of `SAMPLES` states, drawn evenly within the limits. For solids made from the chain, whose radii are a guess, it is
        25 % for links two joints apart, such as the two ends of a wrist.
    never : tuple of (str, str)
        Farther apart than a tenth of the reach in each of these states.
    allowed : tuple of (str, str)
        As the caller asked for.
    """

    checked: tuple[tuple[str, str], ...]
    adjacent: tuple[tuple[str, str], ...]
    always: tuple[tuple[str, str], ...]
    never: tuple[tuple[str, str], ...]
    allowed: tuple[tuple[str, str], ...]


class _Moving(NamedTuple):
    """A solid that moves with a link, and its capsule in the frame of the link."""

    body: int
    name: str
    solid: Geometry
    T: FloatArray
    a: FloatArray
    b: FloatArray
    radius: float
    exact: bool


class CollisionModel:
    """An arm with its tool among obstacles.

    Parameters
    ----------
    arm : Arm or Chain
        Its solids are those of the description, or made from the chain; see `pieper.motion.arm_solids`.
    world : World, optional
        In the base frame of the arm. The base itself is not checked against it, since it does not move.
    tool : Item or sequence of Item, optional
        Solids fixed to the tip, placed in its frame.
    attached : sequence of Item
        Objects that are grasped, placed in the frame of the tip. They may touch the tool and the link of the tip.
    margin : float
        Distance that counts as free [m].
    allowed : sequence of (str, str)
        Pairs of links or items that may touch.

    Raises
    ------
    WorldError
        A margin that is negative or more than a tenth of the reach, or a name that is there twice.
    UnknownNameError
        A name in `allowed` that nothing has.
    MissingExtraError
        Coal is not installed.

    Examples
    --------
    >>> import pieper
    >>> from pieper.motion.world import Item, World
    >>> T = np.eye(4)
    >>> T[:3, 3] = [0.6, 0.0, 0.4]
    >>> model = CollisionModel(pieper.load("ur5e"), World([Item("box", Box([0.2, 0.2, 0.8]), T)]))
    >>> model.is_free([0.0, -1.2, 1.2, 0.0, 0.0, 0.0]), model.is_free([3.0, -1.2, 1.2, 0.0, 0.0, 0.0])
    (False, True)
    >>> nearest = model.distance([0.0, -1.2, 1.2, 0.0, 0.0, 0.0])
    >>> nearest.second, nearest.distance < 0.0
    ('box', True)
    """

    def __init__(
        self,
        arm: ArmLike | Chain,
        world: World | None = None,
        *,
        tool: Item | Iterable[Item] = (),
        attached: Iterable[Item] = (),
        margin: float = DEFAULT_MARGIN,
        allowed: Iterable[tuple[str, str]] = (),
    ) -> None:
        self.arm = arm
        self.chain = arm if isinstance(arm, Chain) else arm.chain
        self.world = World() if world is None else world
        self.tool = (tool,) if isinstance(tool, Item) else tuple(tool)
        self.attached = tuple(attached)
        self.allowed = tuple((str(a), str(b)) for a, b in allowed)
        self.margin = float(margin)
        if not 0.0 <= self.margin < np.inf:
            raise WorldError(f"margin must be a finite distance of at least 0 [m], got {margin!r}")
        self._measure = Measure()
        self._place_moving()
        if self.margin > _NEVER * self.reach_bound > 0.0:
            raise WorldError(
                f"margin must be at most {_NEVER:g} of the reach of the arm, {_NEVER * self.reach_bound:.3g} m for {self.chain.name!r}, "
                f"since links farther apart than that are not looked at; got {self.margin:g} m"
            )
        self._place_world()
        self._choose_world_pairs()
        self._self_first = self._self_second = np.zeros(0, dtype=np.int64)
        self.self_pairs = self._choose_self_pairs([each.name for each in self._moving_solids])

    # --- what there is

    def _place_moving(self) -> None:
        description = None if isinstance(self.arm, Chain) else self.arm.description
        described = None if description is None else solids_of_description(self.chain, description)
        self._from_chain = described is None
        solids = solids_of_chain(self.chain) if described is None else described
        last = len(self.chain.screws)
        flange = self.chain.frame(last).home
        T_last_tip = np.linalg.inv(flange) @ self.chain.home
        solids = tuple(sorted(solids, key=lambda each: each.link))
        moving = [self._moving(each.link, each.name, each.solid, each.T_link_solid) for each in solids]
        self._links = len({each.name for each in moving})
        carried = (*self.tool, *self.attached)
        names = [*dict.fromkeys(each.name for each in moving), *(item.name for item in carried)]
        self._moving_names = tuple(names)
        moving += [self._moving(last, item.name, item.solid, T_last_tip @ item.pose) for item in carried]
        self._moving_solids = moving
        self._body = np.array([each.body for each in moving], dtype=np.int64)
        self._ends = np.array([[each.a, each.b] for each in moving]).reshape(-1, 2, 3)
        ones = np.ones((len(moving), 1, 2))
        self._ends_of_columns = np.concatenate([self._ends.transpose(0, 2, 1), ones], axis=1)  # (p, 4, 2)
        self._radius = np.array([each.radius for each in moving])
        self._exact = np.array([each.exact for each in moving], dtype=bool)
        self._is_box = np.array([isinstance(each.solid, Box) for each in moving], dtype=bool)
        self._is_cylinder = np.array([isinstance(each.solid, Cylinder) for each in moving], dtype=bool)
        self._cylinder_half = np.array(
            [0.5 * each.solid.length if isinstance(each.solid, Cylinder) else 0.0 for each in moving]
        )
        self._some_boxes = bool(self._is_box.any())
        self._solid_T = np.array([each.T for each in moving]).reshape(-1, 4, 4)
        self._box_half = np.array(
            [0.5 * each.solid.size if isinstance(each.solid, Box) else np.zeros(3) for each in moving]
        ).reshape(-1, 3)
        self._reach = 0.5 * np.linalg.norm(self._ends[:, 1] - self._ends[:, 0], axis=1) + self._radius
        self._bodies = list(range(last + 1))
        self._homes = np.array([self.chain.frame(k).home for k in self._bodies]).reshape(-1, 4, 4)
        self._coal = [as_coal(each.solid, hull=True, name=each.name) for each in moving]
        self._T_solid = [each.T for each in moving]

    @staticmethod
    def _moving(body: int, name: str, solid: Geometry, T: FloatArray) -> _Moving:
        vertices = vertices_of(solid, name) if isinstance(solid, Mesh) else None
        a, b, radius, exact = enclosing_capsule(solid, vertices)
        return _Moving(body, name, solid, T, T[:3, :3] @ a + T[:3, 3], T[:3, :3] @ b + T[:3, 3], radius, exact)

    def _place_world(self) -> None:
        """Every obstacle as one or two boxes swept by balls, which hold it."""
        names = [*self._moving_names, *self.world.names]
        twice = next((name for name, count in Counter(names).items() if count > 1), None)
        if twice is not None:
            raise WorldError(f"{twice!r} is the name of two of the links, tools and items; rename one")
        self.names = tuple(names)
        known = {*names, *(frame.name for frame in self.chain.frames)}
        for name in (name for pair in self.allowed for name in pair):
            if name not in known:
                raise unknown_name("name", name, names, f"the collision model of {self.chain.name!r}")
        rows: list[tuple[int, FloatArray, FloatArray, float, bool]] = []
        for number, item in enumerate(self.world):
            rows += [(number, *row) for row in _enclosures(item)]
        self._row_item = np.array([row[0] for row in rows], dtype=np.int64)
        T = np.array([row[1] for row in rows]).reshape(-1, 4, 4)
        self._row_R, self._row_p = T[:, :3, :3], T[:, :3, 3]
        self._row_half = np.array([row[2] for row in rows]).reshape(-1, 3)
        self._row_sweep = np.array([row[3] for row in rows])
        self._row_exact = np.array([row[4] for row in rows], dtype=bool)
        self._row_axes = [np.ascontiguousarray(self._row_R[:, :, axis].T) for axis in range(3)]  # (3, rows) each
        self._row_shift = np.einsum("ki,kij->kj", self._row_p, self._row_R)
        self._coal_world = [as_coal(item.solid, hull=False, name=item.name) for item in self.world]
        self._T_world = [self._measure.placed(item.pose) for item in self.world]

    # --- which pairs

    def _may_touch(self, first: str, second: str) -> bool:
        for a, b in self.allowed:
            if {a, b} == {first, second}:
                return True
        touches = {item.name: item.may_touch for item in (*self.tool, *self.attached, *self.world)}
        return second in touches.get(first, ()) or first in touches.get(second, ())

    def _choose_world_pairs(self) -> None:
        names = [each.name for each in self._moving_solids]
        pairs = [
            (p, k)
            for p, name in enumerate(names)
            if self._body[p] > 0
            for k, item in enumerate(self.world)
            if not self._may_touch(name, item.name)
        ]
        self._wanted = np.zeros((len(names), len(self.world)), dtype=bool)
        for p, k in pairs:
            self._wanted[p, k] = True
        self._row_wanted = self._wanted[:, self._row_item] if len(self._row_item) else np.zeros((len(names), 0), bool)
        self._row_thick = self._radius[:, None] + self._row_sweep
        self._row_beyond = np.where(self._row_wanted, self._reach[:, None] + self._row_sweep, -np.inf)
        starts = np.flatnonzero(np.diff(self._body, prepend=-1))
        self._runs = starts, self._body[starts]

    def _choose_self_pairs(self, names: list[str]) -> SelfPairs:
        bodies: dict[str, int] = {}
        for name, body in zip(names, self._body, strict=True):
            bodies.setdefault(name, int(body))
        groups = list(bodies)
        carried = {item.name for item in (*self.tool, *self.attached)}
        kinds: dict[str, list[tuple[str, str]]] = {"adjacent": [], "allowed": [], "sampled": []}
        for i, first in enumerate(groups):
            for second in groups[i + 1 :]:
                near = abs(bodies[first] - bodies[second]) <= 1 and not (
                    bodies[first] != bodies[second] and (first in carried or second in carried)
                )
                kind = "adjacent" if near else "allowed" if self._may_touch(first, second) else "sampled"
                kinds[kind].append((first, second))
        members = {name: [p for p, other in enumerate(names) if other == name] for name in groups}
        sampled = kinds["sampled"]
        every = [(p, o) for a, b in sampled for p in members[a] for o in members[b]]
        found: dict[str, list[tuple[str, str]]] = {"checked": [], "always": [], "never": []}
        if every:
            self._self_first, self._self_second = np.array(every, dtype=np.int64).T
            q = self._samples()
            blocks = (self._self_gaps(*self._segments(block), np.inf) for block in np.array_split(q, 4))
            distances = np.concatenate(list(blocks))
            at = 0
            for a, b in sampled:
                count = len(members[a]) * len(members[b])
                here = slice(at, at + count)
                at += count
                question = (abs(bodies[a] - bodies[b]), bool({a, b} & carried))
                verdict = self._verdict(distances[:, here].min(axis=1), *question)
                if verdict == "always":  # of the capsules; of the solids?
                    verdict = self._verdict(self._measured_gaps(q, distances, here).min(axis=1), *question)
                found[verdict].append((a, b))
            kept = [(p, o) for a, b in found["checked"] for p in members[a] for o in members[b]]
            kept.sort(key=lambda pair: sorted((int(self._body[pair[0]]), int(self._body[pair[1]]))))
            self._self_first, self._self_second = np.array(kept, dtype=np.int64).reshape(-1, 2).T
        ends = np.sort(
            self._body[np.stack([self._self_first, self._self_second])], axis=0
        )  # links of either, low and high
        starts = np.flatnonzero(np.diff(ends, axis=1, prepend=-1).any(axis=0))
        self._groups = ends[:, starts].T
        self._self_starts = starts
        self._self_column = len(self._bodies) + np.repeat(np.arange(len(starts)), np.diff(starts, append=ends.shape[1]))
        return SelfPairs(
            tuple(found["checked"]),
            tuple(kinds["adjacent"]),
            tuple(found["always"]),
            tuple(found["never"]),
            tuple(kinds["allowed"]),
        )

    def _samples(self) -> FloatArray:
        """States drawn evenly within the limits, (SAMPLES, n); always the same."""
        lower, upper = finite_limits(self.chain)
        return lower + (upper - lower) * np.random.default_rng(0).random((SAMPLES, self.chain.dof))

    def _measured_gaps(self, q: FloatArray, gaps: FloatArray, pairs: slice) -> FloatArray:
        """The same for some pairs of solids, in which capsules that only hold a solid have been replaced by what Coal measures."""
        gaps = gaps[:_MEASURED, pairs].copy()
        for column, pair in enumerate(range(*pairs.indices(len(self._self_first)))):
            p, o = int(self._self_first[pair]), int(self._self_second[pair])
            if self._exact[p] and self._exact[o]:
                continue
            placed: dict[tuple[int, int], Any] = {}
            for k in np.flatnonzero(gaps[:, column] < self._touching):
                Tp, To = self._placed(q, int(k), p, placed), self._placed(q, int(k), o, placed)
                gaps[k, column] = self._measure.distance(self._coal[p], Tp, self._coal[o], To)
        return gaps

    @property
    def _touching(self) -> float:
        """Nearer than this counts as touching when pairs are chosen [m], so that the choice is the same for all small margins."""
        return max(self.margin, min(DEFAULT_MARGIN, _NEVER * self.reach_bound))

    def _verdict(self, gaps: FloatArray, apart: int, carried: bool) -> str:
        touching = float((gaps < self._touching).mean())
        if touching >= _ALWAYS or (self._from_chain and not carried and apart == 2 and touching >= _COARSE):
            return "always"
        return "never" if gaps.min() > _NEVER * self.reach_bound else "checked"

    @cached_property
    def reach_bound(self) -> float:
        """No point of the moving arm is farther than this from an axis that turns it [m]."""
        finite = self.lever[np.isfinite(self.lever)]
        return float(finite.max(initial=float(self._reach.max(initial=0.0))))

    # --- how far points move

    @cached_property
    def lever(self) -> FloatArray:
        """(m, m + 1) array: how far a point of link j can move at most when axis i moves by one unit [m/rad or 1].

        Between the points c_k chosen on the axes lengths do not change, but for the travel of axes that slide, so that the distance of
        a point x of link j from axis i is at most ``|c_i c_(i+1)| + ... + |c_(j-1) x|`` plus travels.
        """
        chain, m = self.chain, len(self.chain.screws)
        turns = chain.is_revolute
        points = np.zeros((m, 3))
        for i, screw in enumerate(chain.screws):
            v, w = screw[:3], screw[3:]
            hint = chain.frame(i + 1).home[:3, 3]
            on = np.cross(w, v)
            points[i] = on + w * float(w @ (hint - on)) if turns[i] else hint
        lower, upper = chain.limits.T
        most = np.maximum(np.abs(lower), np.abs(upper))
        used = np.where(chain.coupling != 0.0, most, 0.0)
        travel = np.where(turns, 0.0, (np.abs(chain.coupling) * used).sum(axis=1))
        lever = np.zeros((m, m + 1))
        homes = self._homes
        for j in range(1, m + 1):
            mine = np.flatnonzero(self._body == j)
            ends = self._ends[mine] @ homes[j, :3, :3].T + homes[j, :3, 3]
            for i in range(j):
                if not turns[i]:
                    lever[i, j] = 1.0
                    continue
                if not len(mine):
                    continue
                way = sum(float(np.linalg.norm(points[k + 1] - points[k])) for k in range(i, j - 1))
                far = np.linalg.norm(ends - points[j - 1], axis=2).max(axis=1) + self._radius[mine]
                lever[i, j] = way + float(travel[i + 1 : j].sum()) + float(far.max())
        return lever

    def displacement(self, dq: ArrayLike) -> FloatArray:
        """How far any point of each link moves at most while the joints move straight by `dq`: (..., n) -> (..., m + 1) [m]."""
        return np.abs(np.asarray(dq) @ self.chain.coupling.T) @ self.lever

    @cached_property
    def _column_lever(self) -> FloatArray:
        """(m, columns) as `lever`, for links against the world and then for pairs of links against each other."""
        axes = np.arange(len(self.chain.screws))[:, None]
        low, high = self._groups.T
        return np.hstack([self.lever, np.where(axes >= low, self.lever[:, high], 0.0)])

    def approach(self, dq: ArrayLike) -> FloatArray:
        """How much nearer the pairs behind each column of `bounds` can come while the joints move straight by `dq`, (..., columns) [m].

        A link and the world: as far as a point of the link moves. Two links: as far as a point of one moves as seen from the other, for
        which the joints below both do not count.
        """
        return np.abs(np.asarray(dq) @ self.chain.coupling.T) @ self._column_lever

    # --- bounds for many states

    def _segments(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ends (k, p, 3) of all capsules in the base frame, and the poses (k, p, 3, 4) of their links."""
        Ts = self.chain.native.link_poses(np.ascontiguousarray(q), self._bodies, self._homes)[:, self._body, :3]
        ends = Ts @ self._ends_of_columns  # (k, p, 3, 2)
        return ends[..., 0], ends[..., 1], Ts

    def _self_gaps(self, a: FloatArray, b: FloatArray, Ts: FloatArray, enough: FloatArray | float) -> FloatArray:
        """Lower bounds (k, pairs) on the distances of pairs of the arm; sharp below `enough`, (k, pairs) or one number [m]."""
        first, second = self._self_first, self._self_second
        middle = 0.5 * (a + b)
        apart = middle[:, first] - middle[:, second]
        apart *= apart
        gaps = np.sqrt(apart[..., 0] + apart[..., 1] + apart[..., 2]) - (self._reach[first] + self._reach[second])
        k, pair = np.nonzero(gaps < enough)
        if len(k):
            p, o = first[pair], second[pair]
            gaps[k, pair] = segment_to_segment(a[k, p], b[k, p], a[k, o], b[k, o]) - (self._radius[p] + self._radius[o])
            if self._some_boxes:
                self._sharpen_by_boxes(a, b, Ts, gaps, enough)
            for cylinder, other in ((first, second), (second, first)):
                self._sharpen_by_ends(a, b, Ts, gaps, enough, cylinder, other)
        return np.asarray(gaps)

    def _sharpen_by_ends(
        self,
        a: FloatArray,
        b: FloatArray,
        Ts: FloatArray,
        gaps: FloatArray,
        enough: FloatArray | float,
        cylinder: NDArray[np.int64],
        other: NDArray[np.int64],
    ) -> None:
        """Where one of a pair is a cylinder, what lies beyond its flat ends is as far away as it is beyond them."""
        k, pair = np.nonzero((gaps < enough) & self._is_cylinder[cylinder])
        if not len(k):
            return
        p, o = cylinder[pair], other[pair]
        axis = (Ts[k, p, :, :3] @ self._solid_T[p, :3, 2:3])[..., 0]
        center = 0.5 * (a[k, p] + b[k, p])
        along = np.stack([((x[k, o] - center) * axis).sum(axis=1) for x in (a, b)])
        beyond = np.where(along[0] * along[1] > 0.0, np.abs(along).min(axis=0), 0.0)
        gaps[k, pair] = np.maximum(gaps[k, pair], beyond - self._cylinder_half[p] - self._radius[o])

    def _sharpen_by_boxes(
        self, a: FloatArray, b: FloatArray, Ts: FloatArray, gaps: FloatArray, enough: FloatArray | float
    ) -> None:
        """Where one of a pair is a box, measure from the box instead of from the capsule that holds it."""
        box = np.where(self._is_box[self._self_second], self._self_second, self._self_first)
        other = self._self_first + self._self_second - box
        k, pair = np.nonzero((gaps < enough) & self._is_box[box])
        if not len(k):
            return
        p, o = box[pair], other[pair]
        T = Ts[k, p]
        R = T[:, :, :3] @ self._solid_T[p, :3, :3]
        center = (T[:, :, :3] @ self._solid_T[p, :3, 3:])[..., 0] + T[:, :, 3]
        start = ((a[k, o] - center)[:, None] @ R)[:, 0]
        end = ((b[k, o] - center)[:, None] @ R)[:, 0]
        gaps[k, pair] = np.maximum(gaps[k, pair], segment_to_box(start, end, self._box_half[p]) - self._radius[o])

    def _world_gaps(self, a: FloatArray, b: FloatArray, enough: FloatArray | float) -> FloatArray:
        """Lower bounds (k, p, rows) on the distances from the rows of the world; infinite for pairs that are not looked at."""
        shape = (*a.shape[:2], len(self._row_item))
        middle = 0.5 * (a + b)
        squared = np.zeros(shape)
        for axis in range(3):
            local = (middle.reshape(-1, 3) @ self._row_axes[axis]).reshape(shape)
            local -= self._row_shift[:, axis]
            np.abs(local, out=local)
            local -= self._row_half[:, axis]
            np.maximum(local, 0.0, out=local)
            local *= local
            squared += local
        gaps = np.sqrt(squared, out=squared)
        gaps -= self._row_beyond
        k, p, row = np.nonzero(gaps < (enough if np.ndim(enough) == 0 else np.asarray(enough)[..., None]))
        if len(k):
            R, center = self._row_R[row], self._row_p[row]
            start = ((a[k, p] - center)[:, None] @ R)[:, 0]
            end = ((b[k, p] - center)[:, None] @ R)[:, 0]
            gaps[k, p, row] = segment_to_box(start, end, self._row_half[row]) - self._row_thick[p, row]
        return gaps

    def bounds(self, q: FloatArray, enough: FloatArray | float) -> FloatArray:
        """Lower bounds on clearances in states (k, n): (k, columns) [m].

        Parameters
        ----------
        q : (k, n) array
        enough : float or (columns,) array
            Distances of so much and more need not be told sharply [m].

        Returns
        -------
        (k, columns) array
            Of every link from the world, (m + 1) columns, and then of every two links that are looked at from each other. What is below the margin
            is the distance itself, or below 0.
        """
        a, b, Ts = self._segments(q)
        links = len(self._bodies)
        wanted = np.broadcast_to(enough, links + len(self._groups))
        clear = np.full((len(q), len(wanted)), np.inf)
        if len(self._row_item):
            gaps = self._world_gaps(a, b, wanted[self._body])
            near = gaps < self.margin
            if near.any():
                self._settle_world(q, gaps, near)
            starts, bodies = self._runs
            clear[:, bodies] = np.minimum.reduceat(gaps.min(axis=2), starts, axis=1)
        if len(self._groups):
            gaps = self._self_gaps(a, b, Ts, wanted[self._self_column])
            near = gaps < self.margin
            if near.any():
                self._settle_self(q, gaps, near)
            clear[:, links:] = np.minimum.reduceat(gaps, self._self_starts, axis=1)
        return clear

    def _settle_world(self, q: FloatArray, gaps: FloatArray, near: NDArray[np.bool_]) -> None:
        """Replace bounds that do not decide by what Coal measures."""
        open_ones = near & ~(self._exact[:, None] & self._row_exact)
        decided = (near & ~open_ones).any(axis=(1, 2))
        found: dict[tuple[int, int, int], float] = {}
        placed: dict[tuple[int, int], Any] = {}
        for k, p, row in np.argwhere(open_ones & ~decided[:, None, None]):
            item = int(self._row_item[row])
            key = (int(k), int(p), item)
            if key not in found:
                others = gaps[k, p, self._row_item == item]
                if others.max() >= self.margin:  # another box around the same obstacle is clear
                    found[key] = float(others.max())
                else:
                    T = self._placed(q, int(k), int(p), placed)
                    found[key] = self._measure.distance(self._coal[p], T, self._coal_world[item], self._T_world[item])
            gaps[k, p, row] = found[key]

    def _settle_self(self, q: FloatArray, gaps: FloatArray, near: NDArray[np.bool_]) -> None:
        first, second = self._self_first, self._self_second
        exact = (self._exact[first] & (self._exact[second] | self._is_box[second])) | (
            self._is_box[first] & self._exact[second]
        )
        decided = (near & exact).any(axis=1)
        placed: dict[tuple[int, int], Any] = {}
        for k, pair in np.argwhere(near & ~exact & ~decided[:, None]):
            p, o = int(self._self_first[pair]), int(self._self_second[pair])
            Tp, To = self._placed(q, int(k), p, placed), self._placed(q, int(k), o, placed)
            gaps[k, pair] = self._measure.distance(self._coal[p], Tp, self._coal[o], To)

    def _placed(self, q: FloatArray, k: int, p: int, kept: dict[tuple[int, int], Any]) -> Any:
        if (k, p) not in kept:
            if (k, -1) not in kept:
                kept[k, -1] = self.chain.native.link_poses(q[k], self._bodies, self._homes)
            kept[k, p] = self._measure.placed(kept[k, -1][self._body[p]] @ self._T_solid[p])
        return kept[k, p]

    # --- answers

    def is_free(self, q: ArrayLike) -> Any:
        """Whether every pair is at least the margin apart: (..., n) -> (...); one state gives a bool.

        Parameters
        ----------
        q : (..., n) array_like
            Joint values [rad or m]. Limits are not looked at.

        Returns
        -------
        bool or (...) array of bool
            True where nothing touches, nor comes nearer than the margin.

        Raises
        ------
        ArrayError
            A wrong shape, or a number that is not finite.
        """
        values = as_joints(self.chain, q)
        flat = values.reshape(-1, self.chain.dof)
        free = np.empty(len(flat), dtype=bool)
        for start in range(0, len(flat), _BLOCK):
            block = flat[start : start + _BLOCK]
            free[start : start + _BLOCK] = (self.bounds(block, self.margin) >= self.margin).all(axis=1)
        return bool(free[0]) if values.ndim == 1 else free.reshape(values.shape[:-1])

    def distance(self, q: ArrayLike) -> Nearest:
        """The nearest pair at joint values (n,), by Coal.

        Returns
        -------
        Nearest
            Named, with distance and points. Where several overlap, the deepest.
        """
        values = self._one(q)
        best = Nearest(np.inf, "", "", np.full(3, np.nan), np.full(3, np.nan))
        for bound, p, other in self._candidates(values):
            if bound > best.distance and bound > 0.0:
                break
            gap, names = self._exactly(values, p, other)
            if gap.distance < best.distance:
                best = Nearest(gap.distance, *names, gap.p_first, gap.p_second)
        return best

    def distances(self, q: ArrayLike) -> FloatArray:
        """Distance [m] of the nearest pair for many states: (..., n) -> (...)."""
        values = as_joints(self.chain, q)
        flat = values.reshape(-1, self.chain.dof)
        return np.array([self.distance(row).distance for row in flat]).reshape(values.shape[:-1])

    def contacts(self, q: ArrayLike) -> tuple[Nearest, ...]:
        """Every pair of solids that is nearer than the margin at joint values (n,), the deepest first."""
        values = self._one(q)
        found = []
        for bound, p, other in self._candidates(values):
            if bound >= self.margin:
                break
            gap, names = self._exactly(values, p, other)
            if gap.distance < self.margin:
                found.append(Nearest(gap.distance, *names, gap.p_first, gap.p_second))
        return tuple(sorted(found, key=lambda pair: pair.distance))

    def _one(self, q: ArrayLike) -> FloatArray:
        values = as_joints(self.chain, q)
        if values.ndim != 1:
            raise ArrayError(f"q must have shape ({self.chain.dof},), got {values.shape}; use `distances` or `is_free`")
        return values

    def _candidates(self, q: FloatArray) -> list[tuple[float, int, tuple[str, int]]]:
        """Every pair with a lower bound on its distance [m], the least first."""
        a, b, Ts = self._segments(q[None])
        found: list[tuple[float, int, tuple[str, int]]] = []
        if len(self._row_item):
            gaps = self._world_gaps(a, b, np.inf)[0]
            for p, k in np.argwhere(self._wanted):
                found.append((float(gaps[p, self._row_item == k].max()), int(p), ("world", int(k))))
        if len(self._self_first):
            gaps = self._self_gaps(a, b, Ts, np.inf)[0]
            found += [
                (float(gap), int(p), ("self", int(o)))
                for gap, p, o in zip(gaps, self._self_first, self._self_second, strict=True)
            ]
        return sorted(found, key=lambda each: each[0])

    def _exactly(self, q: FloatArray, p: int, other: tuple[str, int]) -> tuple[Any, tuple[str, str]]:
        placed: dict[tuple[int, int], Any] = {}
        T = self._placed(q[None], 0, p, placed)
        kind, k = other
        name = self._moving_solids[p].name
        if kind == "world":
            return (
                self._measure.gap(self._coal[p], T, self._coal_world[k], self._T_world[k]),
                (name, self.world.items[k].name),
            )
        T_other = self._placed(q[None], 0, k, placed)
        return self._measure.gap(self._coal[p], T, self._coal[k], T_other), (name, self._moving_solids[k].name)

    # --- a changed model

    def with_margin(self, margin: float) -> CollisionModel:
        """The same with another margin [m]; with a smaller one the pairs of links are those of this model."""
        if not 0.0 <= margin <= self.margin:
            return self._changed(margin=margin)
        other = copy.copy(self)
        other.margin = float(margin)
        return other

    def with_world(self, world: World) -> CollisionModel:
        """The same in another world; quick, since the pairs of links are those of this one."""
        other = copy.copy(self)
        other.world = world
        known = {*(frame.name for frame in self.chain.frames), *self._moving_names, *world.names}
        other.allowed = tuple(pair for pair in self.allowed if known.issuperset(pair))  # what is gone needs no leave
        other._place_world()
        other._choose_world_pairs()
        return other

    def grasp(self, name: str, q: ArrayLike) -> CollisionModel:
        """The model once the item of that name is held by the tip, where it is now, at joint values (n,).

        Raises
        ------
        UnknownNameError
            The world has no item of that name.
        """
        from dataclasses import replace

        item = self.world[name]
        T_tip_item = np.linalg.inv(self.chain.native.fk(self._one(q))) @ item.pose
        return self._changed(world=self.world.without(name), attached=(*self.attached, replace(item, T=T_tip_item)))

    def release(self, name: str, q: ArrayLike) -> CollisionModel:
        """The model once the object of that name is left where it is at joint values (n,)."""
        from dataclasses import replace

        held = {item.name: item for item in self.attached}
        if name not in held:
            raise unknown_name("item", name, held, "the grasp")
        T = self.chain.native.fk(self._one(q)) @ held[name].pose
        return self._changed(
            world=self.world.with_items([replace(held[name], T=T)]),
            attached=tuple(item for item in self.attached if item.name != name),
        )

    def _changed(self, **changes: Any) -> CollisionModel:
        kept: dict[str, Any] = {
            "world": self.world, "tool": self.tool, "attached": self.attached, "margin": self.margin, "allowed": self.allowed,
        }  # fmt: skip
        kept |= changes
        items = (*kept["world"], *kept["tool"], *kept["attached"])
        known = {*(frame.name for frame in self.chain.frames), *self.names[: self._links], *(i.name for i in items)}
        kept["allowed"] = [pair for pair in self.allowed if known.issuperset(pair)]  # what is gone needs no leave
        return CollisionModel(self.arm, **kept)

    def solids(self, q: ArrayLike) -> list[tuple[str, Geometry, FloatArray]]:
        """Name, solid and pose (4, 4) in the base frame of everything that moves, at joint values (n,); to draw or to check."""
        Ts = self.chain.native.link_poses(self._one(q), self._bodies, self._homes)
        return [(each.name, each.solid, Ts[each.body] @ each.T) for each in self._moving_solids]


def finite_limits(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Lower and upper limits (n,); -pi and pi for a joint that turns without end, -1 and 1 m for one that slides so."""
    turns = ((chain.coupling != 0.0) & chain.is_revolute[:, None]).any(axis=0)
    end = np.where(turns, np.pi, 1.0)
    lower, upper = chain.limits.T
    return np.where(np.isfinite(lower), lower, -end), np.where(np.isfinite(upper), upper, end)


def _enclosures(item: Item) -> Sequence[tuple[FloatArray, FloatArray, float, bool]]:
    """Boxes swept by balls that hold an obstacle: pose (4, 4), half the edges (3,) and radius [m], and whether it is the obstacle itself."""
    solid, T = item.solid, item.pose
    if isinstance(solid, Box):
        return [(T, 0.5 * solid.size, 0.0, True)]
    if isinstance(solid, Sphere):
        return [(T, np.zeros(3), solid.radius, True)]
    if isinstance(solid, Capsule):
        return [(T, np.array([0.0, 0.0, 0.5 * solid.length]), solid.radius, True)]
    if isinstance(solid, Cylinder):
        half = 0.5 * solid.length
        return [
            (T, np.array([solid.radius, solid.radius, half]), 0.0, False),
            (T, np.array([0.0, 0.0, half]), solid.radius, False),
        ]
    vertices = vertices_of(solid, item.name)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = np.eye(4)
    middle[:3, 3] = 0.5 * (low + high)
    return [(T @ middle, 0.5 * (high - low), 0.0, False)]
