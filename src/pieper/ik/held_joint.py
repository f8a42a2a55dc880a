"""Seven joints, one of which is held: which one, and how the other six are solved."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.errors import ArrayError
from pieper.ik import general_6r
from pieper.ik.family import Family, find_family
from pieper.ik.prepared import prepared
from pieper.ik.swivel import Swivel, find_swivel
from pieper.spatial.twist import exp

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray

_JOINTS = 7
_TURN = 2.0 * np.pi
_POINT = 1e-6  # rad or m: a range no longer than this is one value


class RedundantSolutions(NamedTuple):
    """Every solution of every pose for each of m values of the redundancy; k places for each value, empty ones NaN."""

    q: FloatArray
    """(..., m k, n) joint values [rad or m]. Joints that turn are in (-pi, pi], but for the one that is held. Joint limits are not
    looked at."""
    valid: NDArray[np.bool_]
    """(..., m k): True for solutions within the tolerances."""
    position_error: FloatArray
    """(..., m k): measured at the pose that forward kinematics gives for all joints [m]."""
    rotation_error: FloatArray
    """(..., m k): the same for the rotation [rad]."""
    value: FloatArray
    """(..., m k): the value that each place belongs to [rad or m]."""
    doubtful: NDArray[np.bool_]
    """(..., m): True where solutions may be missing for a value, as at poses where they form curves though a joint is held."""


@dataclass(frozen=True, eq=False)
class Redundancy:
    """An arm with seven joints, the joint that is held, and how the other six are solved. Made by `prepare`.

    Attributes
    ----------
    chain : Chain
    joint : int
        The joint whose value is given, counted from 0.
    rest : Chain
        The other six, with that joint at 0.
    family : Family
        Their closed form; `Family.has_closed_form` is False where the general solver does it.
    swivel : Swivel or None
        Shoulder, elbow and wrist, of an arm that has them.
    """

    chain: Chain
    joint: int
    rest: Chain
    family: Family
    swivel: Swivel | None
    _kept: dict[Any, Any] = field(default_factory=dict, repr=False)

    @property
    def joint_name(self) -> str:
        """Name of the joint whose value is given."""
        return self.chain.joint_names[self.joint]

    @property
    def reason(self) -> str:
        """What was found, in words."""
        how = self.family.reason if self.family.has_closed_form else "no closed form: solved by the general solver"
        swivel = "; spherical shoulder and wrist: the swivel angle may be given instead" if self.swivel else ""
        return f"{self.joint_name} is given; of the other six, {how}{swivel}"

    @cached_property
    def without_limits(self) -> Chain:
        """The arm with a whole turn for every joint that turns."""
        limits = np.where(self.chain.is_revolute[:, None], [-np.pi, np.pi], self.chain.limits)
        return replace(self.chain, limits=limits)

    @property
    def places(self) -> int:
        """Places for solutions of one value, k."""
        return 8 if self.family.has_closed_form and self.family.level == "exact" else general_6r.MOST_SOLUTIONS

    def samples(self, count: int, *, limited: bool = True) -> FloatArray:
        """(count,): values in the middle of as many equal parts of the range of the joint, or of one turn if that is less.

        Parameters
        ----------
        count : int
        limited : bool
            False for a whole turn, whatever the limits of the joint.

        Returns
        -------
        (count,) array
            [rad or m].

        Raises
        ------
        ArrayError
            The joint slides without limits.
        """
        lower, upper = self.chain.limits[self.joint]
        if self.chain.is_revolute[self.joint] and (not limited or not upper - lower < _TURN):
            lower, upper = -np.pi, np.pi
        if not np.isfinite(upper - lower):
            raise ArrayError(
                f"{self.joint_name} slides without limits, so that there is no range to sample; give values"
            )
        if upper - lower <= _POINT:  # the joint is held
            return np.array([0.5 * (lower + upper)])
        return np.asarray(lower + (np.arange(count) + 0.5) * ((upper - lower) / count))

    def transports(self, values: FloatArray) -> FloatArray:
        """(..., 4, 4): what a target is multiplied by, from the left for the first joint and from the right for the last."""
        back = exp(-values[..., None] * self.chain.screws[self.joint])
        if self.joint == 0:
            return back
        home = self.chain.home
        return np.asarray(np.linalg.inv(home) @ back @ home)


def prepare(chain: Chain) -> Redundancy:
    """Which joint of an arm with seven is held, and how the others are solved; kept as long as the chain lives.

    An end joint whose rest has a closed form comes first, with plain roots before quartics; then the end for which the general
    solver has least to do.

    Parameters
    ----------
    chain : Chain
        Seven joints.

    Returns
    -------
    Redundancy

    Raises
    ------
    ArrayError
        Another number of joints, mimic joints, or six joints that no complete solver takes.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> print(prepare(catalog.describe("franka_panda").chain()).reason)
    panda_joint7 is given; of the other six, axes 4, 5 and 6 meet (spherical wrist), and axes 1 and 2 meet, read from the tip: up to 8 answers (exact)
    """
    return prepared(chain, "redundancy", None, lambda: _make(chain))


def _make(chain: Chain) -> Redundancy:
    if chain.dof != _JOINTS or chain.is_coupled:
        more = "; lock all but seven first, or use the numeric solver" if chain.dof > _JOINTS else ""
        mimic = " and mimic joints" if chain.is_coupled else ""
        raise ArrayError(f"redundancy is that of seven joints; {chain.name!r} has {chain.dof}{mimic}{more}")
    found = []
    for joint in (_JOINTS - 1, 0):
        rest = chain.lock(**{chain.joint_names[joint]: 0.0})
        family = find_family(rest)
        if family.complete:
            found.append(((0.0, float(family.level != "exact"), float(family.quartic)), joint, rest, family))
        elif rest.is_revolute.all():
            best = min(general_6r.prepare(rest).native.reports, key=lambda r: r.rank if r.rank >= 0 else 99)
            found.append(((1.0, 1.0 - best.found, best.median_work), joint, rest, family))
    if not found:
        raise ArrayError(
            f"no six joints of {chain.name!r} can be solved completely with its first or its last joint held "
            f"({family.reason}); use the numeric solver"
        )
    _, joint, rest, family = min(found, key=lambda entry: entry[0])
    try:
        swivel = find_swivel(chain)
    except ArrayError:
        swivel = None
    return Redundancy(chain, joint, rest, family, swivel)
