"""What a map asks of an arm: which voxels, which poses in each, and what counts as reached.

What can be asked depends on the joints. ``kind`` tells which question it is:

=============== ================================== ===============================================================
kind            arms                               asked in each voxel
=============== ================================== ===============================================================
orientations    six joints, seven joints           whole poses, with orientations spread evenly over all that there are
turns           all axes parallel, three turning   whole poses in the plane, turned evenly about the common direction
                (planar, SCARA)
directions      five joints                        the position, and a line fixed to the tool in evenly spread directions
position        two, three or four joints          the position alone
=============== ================================== ===============================================================

Five joints reach no more than a thin part of all orientations, so that a share of these would be 0 everywhere. They can point a line
in any direction, as long as every joint turns it: the line is `LINE`, in tool axes, oblique to any axis that an arm is likely to have.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper._native import kernels
from pieper._version import __version__
from pieper.errors import ArrayError
from pieper.ik import partial, redundancy
from pieper.ik.solve import solver
from pieper.ik.target import ignore_orientation, position_and_axis
from pieper.kinematics.reach import extent
from pieper.model.chain import Chain
from pieper.model.description import Mesh
from pieper.workspace.grid import CHUNK, Grid, axis_number, grid_over, positive, whole
from pieper.workspace.orientations import spread_directions, spread_rotations, spread_turns

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pieper.arm import Arm
    from pieper.model.description import Description, Geometry
    from pieper.motion.world import World
    from pieper.spatial._checks import FloatArray

LINE = (0.36, 0.48, 0.8)
"""The line in tool axes that arms with five joints are asked to point."""

KINDS = ("orientations", "turns", "directions", "position")

_PARALLEL = 1e-9


@dataclass(frozen=True, eq=False)
class Survey:
    """One question. Made by `survey`; it can be pickled, and sent to whoever works on it.

    Attributes
    ----------
    chain : Chain
        The arm, with its tool and its limits.
    grid : Grid
    kind : str
        One of `KINDS`, see the page.
    samples : int
        Poses asked in each voxel: the orientations, turns or directions; 1 for positions.
    seed : int
        Turns all orientations together at random; 0 for the set as it is.
    redundancy : int
        Seven joints: values of the joint that is held for which each pose is solved; 1 for other arms.
    collision : bool
        Whether answers in which the arm touches itself, or what stands around it, count as not reached.
    margin : float
        Distance that is kept then [m].
    description : Description or None
        Where the solids of the arm are from, if collisions count.
    world : World or None
        What stands around the arm, in its base frame.
    measures : bool
        Whether manipulability, singularity and limit margin are looked at, or poses and solutions are counted alone.
    instructions : str
        The vector instructions that every worker is to use: others round otherwise, and a map is to be the same everywhere.
    """

    chain: Chain
    grid: Grid
    kind: str
    samples: int
    seed: int = 0
    redundancy: int = 1
    collision: bool = False
    margin: float = 0.0
    description: Description | None = None
    world: World | None = None
    measures: bool = True
    instructions: str = field(default_factory=kernels.instruction_set)

    @property
    def poses(self) -> int:
        """Number of poses that are solved for."""
        return self.grid.voxels * self.samples

    @property
    def words(self) -> str:
        """What is asked, in words."""
        asked = {
            "orientations": f"{self.samples} orientations",
            "turns": f"{self.samples} turns about the direction of all axes",
            "directions": f"a tool-fixed oblique line in {self.samples} directions (five joints cannot take orientations at will)",
            "position": "the position alone (too few joints for orientations)",
        }[self.kind]
        if self.redundancy > 1:
            asked += f", each for {self.redundancy} values of {redundancy.prepare(self.chain).joint_name}"
        if not self.collision:
            return asked
        around = f" among {len(self.world.items)} obstacles" if self.world is not None else ""
        return f"{asked}, nothing touching{around} (margin {1e3 * self.margin:g} mm)"

    def rotations(self) -> FloatArray:
        """(samples, 3, 3): what is asked of the tip, for whole poses."""
        if self.kind == "turns":
            direction = _common_direction(self.chain)
            assert direction is not None
            return np.asarray(spread_turns(self.samples, direction, seed=self.seed) @ self.chain.home[:3, :3])
        return spread_rotations(self.samples, seed=self.seed)

    def directions(self) -> FloatArray:
        """(samples, 3): where the line is to point, for five joints."""
        return spread_directions(self.samples, seed=self.seed)

    def record(self) -> dict[str, Any]:
        """Everything that the map depends on, as plain values: what a store keeps, and compares before it goes on."""
        chain = self.chain
        return {
            "arm": chain.name,
            "base": chain.base,
            "tip": chain.tip,
            "joint_names": list(chain.joint_names),
            "screws": chain.screws.tolist(),
            "home": chain.home.tolist(),
            "coupling": chain.coupling.tolist(),
            "limits": [[_finite(value) for value in row] for row in chain.limits.tolist()],
            "origin": list(self.grid.origin),
            "voxel": self.grid.voxel,
            "shape": list(self.grid.shape),
            "chunk": self.grid.chunk,
            "kind": self.kind,
            "samples": self.samples,
            "seed": self.seed,
            "redundancy": self.redundancy,
            "collision": self.collision,
            "margin": self.margin,
            "solids": self._solids_digest(),
            "measures": self.measures,
            "instructions": self.instructions,
            "version": __version__,
        }

    def _solids_digest(self) -> str:
        shapes: list[Any] = []
        if self.collision and self.description is not None:
            shapes += [(link.name, [repr(each) for each in link.collisions]) for link in self.description.links]
        if self.collision and self.world is not None:
            shapes += [
                (item.name, _solid_words(item.solid), item.pose.tolist(), item.may_touch) for item in self.world.items
            ]
        if not shapes:
            return ""
        return hashlib.sha256(json.dumps(shapes).encode()).hexdigest()[:16]


def survey(
    arm: Arm | Chain,
    *,
    voxel: float = 0.05,
    orientations: int = 200,
    box: ArrayLike | None = None,
    layer: tuple[str, float] | None = None,
    seed: int = 0,
    redundancy: int = 16,
    collision: bool = False,
    world: World | None = None,
    margin: float = 0.0,
    measures: bool = True,
    chunk: int = CHUNK,
) -> Survey:
    """What to ask of an arm.

    Parameters
    ----------
    arm : Arm or Chain
        With its tool: ``arm.with_tool(T)``.
    voxel : float
        Side of a voxel [m].
    orientations : int
        How many are asked in each voxel; turns or directions for arms that cannot take orientations at will, see the page.
    box : (2, 3) array_like, optional
        Least and greatest x, y and z in the base frame [m]; all that the tip reaches when not given.
    layer : (str, float), optional
        One layer alone, as in ``("y", 0.0)``: a planar slice.
    seed : int
        Turns all orientations together at random, to see how much a figure depends on them; 0 for none.
    redundancy : int
        Seven joints: values of the joint that is held. More of them find more.
    collision : bool
        Count only answers in which the arm does not touch itself (extra ``plan``).
    world : World, optional
        What stands around the arm, in its base frame: count only answers in which it touches neither that nor itself.
    margin : float
        Distance that is kept then [m].
    measures : bool
        False to count poses and solutions alone, which is quicker.
    chunk : int
        Voxels along each side of a chunk, which is the least that is computed, stored and lost.

    Returns
    -------
    Survey
        To be run by `pieper.workspace.run.run`.

    Raises
    ------
    ArrayError
        A number that is not positive, a box that the arm does not reach, an arm with a slide without limits and no box, or
        one that no complete solver takes.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> asked = survey(catalog.describe("ur5e").chain(), voxel=0.1, orientations=50)
    >>> asked.grid.shape, asked.poses, asked.words
    ((21, 21, 20), 441000, '50 orientations')
    """
    chain = arm if isinstance(arm, Chain) else arm.chain
    description = None if isinstance(arm, Chain) else arm.description
    if chain.dof == 0:
        raise ArrayError(f"{chain.name!r} has no joints, and one place")
    turned, values = whole(seed, "seed", least=0), whole(redundancy, "redundancy")
    count = whole(orientations, "orientations")
    if not 0.0 <= margin < np.inf:
        raise ArrayError(f"margin must be a distance of at least 0 [m], got {margin!r}")
    kind = _kind(chain)
    collision = bool(collision) or world is not None
    grid = _grid(chain, voxel, box, layer, chunk)
    return Survey(
        chain=chain,
        grid=grid,
        kind=kind,
        samples=1 if kind == "position" else count,
        seed=turned,
        redundancy=values if chain.dof == _REDUNDANT else 1,
        collision=collision,
        margin=float(margin) if collision else 0.0,
        description=description if collision else None,
        world=world,
        measures=bool(measures),
    )


_REDUNDANT = 7


def _kind(chain: Chain) -> str:
    """Which question the arm can be asked; raises where none has a complete answer."""
    method = solver(chain).method
    direction = _common_direction(chain)
    if direction is not None:
        if int(chain.is_revolute.sum()) == 3 and method == "closed form":
            return "turns"
        if partial.covers(chain, ignore_orientation(np.zeros(3))):
            return "position"
    elif chain.dof in (6, _REDUNDANT) and method != "numeric":
        return "orientations"
    elif chain.dof == 5 and partial.covers(chain, position_and_axis(np.zeros(3), LINE, axis_tip=LINE)):
        return "directions"
    elif chain.dof < 5 and partial.covers(chain, ignore_orientation(np.zeros(3))):
        return "position"
    more = "; lock all but seven first" if chain.dof > _REDUNDANT else ""
    raise ArrayError(
        f"a map needs all solutions, and no complete solver takes {chain.name!r} with {chain.dof} joints{more}: {solver(chain).family.reason}"
    )


def _common_direction(chain: Chain) -> FloatArray | None:
    """(3,) the direction that all axes have, in the base frame; None where they have not."""
    turning = chain.is_revolute
    directions = np.where(turning[:, None], chain.screws[:, 3:], chain.screws[:, :3])
    parallel = np.linalg.norm(np.cross(directions, directions[0]), axis=1).max() < _PARALLEL
    return np.asarray(directions[0]) if parallel and turning.any() else None


def _grid(chain: Chain, voxel: float, box: ArrayLike | None, layer: tuple[str, float] | None, chunk: int) -> Grid:
    reached = extent(chain)
    if box is None:
        if not np.isfinite(reached).all():
            raise ArrayError(f"{chain.name!r} has a joint that slides without limits: give a box to look at")
        corners = reached
    else:
        grid_over(box, voxel, chunk=chunk)  # says what is wrong with it
        corners = np.array(box, dtype=np.float64)
    if layer is not None:
        i = axis_number(layer[0])
        if not np.isfinite(layer[1]):
            raise ArrayError(f"a layer is at a finite coordinate [m], got {layer[1]!r}")
        corners = corners.copy()
        corners[:, i] = layer[1]
    half = 0.5 * positive(voxel, "voxel")
    if ((corners[1] + half < reached[0]) | (corners[0] - half > reached[1])).any():
        spans = ", ".join(f"{name} from {a:.3f} to {b:.3f}" for name, a, b in zip("xyz", *reached, strict=True))
        what = "the layer" if layer is not None and box is None else "the box"
        raise ArrayError(f"{what} is outside the reach of {chain.name!r}, whose tip gets to {spans} m")
    return grid_over(corners, voxel, chunk=chunk)


def _solid_words(solid: Geometry) -> str:
    """A solid as it is compared: of a mesh what is in its file, wherever that lies."""
    if isinstance(solid, Mesh):
        content = Path(solid.path or solid.filename).read_bytes()
        return f"mesh {hashlib.sha256(content).hexdigest()} scaled by {np.asarray(solid.scale).tolist()}"
    sizes = {name: np.asarray(value).tolist() for name, value in vars(solid).items()}
    return f"{type(solid).__name__} {sizes}"


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
