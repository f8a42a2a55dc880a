"""An arm ready to use: a chain with its description, and thin methods that call the rooms below."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError, DescriptionError, UnknownNameError
from pieper.kinematics import fk as _fk
from pieper.kinematics import jacobian as _jacobian
from pieper.kinematics.joints import as_joints
from pieper.model.chain import Chain, FloatArray
from pieper.model.description import Description

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from pieper.ik.curve import SolutionCurve
    from pieper.ik.info import IKInfo
    from pieper.ik.projection import Projections
    from pieper.ik.solutions import IKSolutions
    from pieper.ik.solver import Solver
    from pieper.ik.target import Target
    from pieper.model.dh import DhTable
    from pieper.model.package import PackageFolders


class Arm:
    """A serial arm. Made by `load`, or from a `Chain`.

    Parameters
    ----------
    chain : Chain
        The screws, the home pose and the limits: everything that kinematics needs.
    description : Description, optional
        The tree that the chain was taken from, with link shapes and inertia. None for an arm given by screws or DH rows.
    """

    def __init__(self, chain: Chain, description: Description | None = None) -> None:
        self.chain = chain
        self.description = description

    # --- what it is

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.chain.name

    @property
    def dof(self) -> int:
        """Number of joints n, the length of ``q``."""
        return self.chain.dof

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of ``q``."""
        return self.chain.joint_names

    @property
    def limits(self) -> FloatArray:
        """Lower and upper joint limits, (n, 2) [rad or m]; infinite where a joint has none."""
        return self.chain.limits

    @property
    def base(self) -> str:
        """Name of the base frame."""
        return self.chain.base

    @property
    def tip(self) -> str:
        """Name of the tip frame."""
        return self.chain.tip

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of the frames from base to tip."""
        return tuple(frame.name for frame in self.chain.frames)

    # --- where it is and how it moves

    def fk(
        self, q: ArrayLike, *, up_to: str | int | None = None, out: FloatArray | None = None, threads: int = 1
    ) -> FloatArray:
        """Pose of the tip, or of frame `up_to`, in the base frame: (..., n) -> (..., 4, 4).

        Parameters
        ----------
        q : (..., n) array_like
            Joint values [rad or m], in the order of `joint_names`.
        up_to : str or int, optional
            Another frame than the tip: its name, or how many joints come before it.
        out : (..., 4, 4) array, optional
            Where to write the poses.
        threads : int
            How many to use for large batches.

        Returns
        -------
        (..., 4, 4) array
            ``T_base_tip`` [m, -].

        Raises
        ------
        ArrayError
            A wrong shape, or a number that is not finite.
        UnknownNameError
            No frame `up_to`; the message lists those there are.

        See Also
        --------
        pieper.kinematics.fk.fk : the same for a chain, with the formula.

        Examples
        --------
        >>> load("ur5e").fk([-1.28, 4.41, 1.54, -1.16, -1.56, 0.0])[:3, 3].round(6) + 0.0
        array([ 0.224996, -0.28312 ,  0.589463])
        """
        if up_to is None:
            try:
                return self.chain.native.fk(q, out, threads)  # straight to the kernel: a call costs as much as the pose
            except TypeError:
                pass
        return _fk.fk(self.chain, q, up_to=up_to, out=out, threads=threads)

    def fk_frames(self, q: ArrayLike, *, frames: Sequence[str | int] | None = None) -> FloatArray:
        """Poses of every frame of the chain for joint values (..., n): (..., k, 4, 4). See `pieper.kinematics.fk.fk_frames`."""
        return _fk.fk_frames(self.chain, q, frames=frames)

    def jacobian(self, q: ArrayLike, *, out: FloatArray | None = None, threads: int = 1) -> FloatArray:
        """Geometric Jacobian in base axes for joint values (..., n): (..., 6, n), linear part first.

        Its rows are metres, then radians, per radian or metre of a joint. See `pieper.kinematics.jacobian.jacobian`.
        """
        try:
            return self.chain.native.jacobian(q, out, threads)
        except TypeError:
            return _jacobian.jacobian(self.chain, q, out=out, threads=threads)

    def jacobian_space(self, q: ArrayLike, *, out: FloatArray | None = None, threads: int = 1) -> FloatArray:
        """Space Jacobian, (..., n) -> (..., 6, n): twists in the base frame. See `pieper.kinematics.jacobian.jacobian_space`."""
        return _jacobian.jacobian_space(self.chain, q, out=out, threads=threads)

    def jacobian_body(self, q: ArrayLike, *, out: FloatArray | None = None, threads: int = 1) -> FloatArray:
        """Body Jacobian, (..., n) -> (..., 6, n): twists in the tip frame. See `pieper.kinematics.jacobian.jacobian_body`."""
        return _jacobian.jacobian_body(self.chain, q, out=out, threads=threads)

    def jacobian_rate(self, q: ArrayLike, dq: ArrayLike) -> FloatArray:
        """Time derivative of the geometric Jacobian at `q` (..., n) with velocities `dq` (..., n): (..., 6, n). See `pieper.kinematics.jacobian.jacobian_rate`."""
        return _jacobian.jacobian_rate(self.chain, q, dq)

    def hessian(self, q: ArrayLike) -> FloatArray:
        """Derivative of the geometric Jacobian by each joint, (..., n) -> (..., n, 6, n). See `pieper.kinematics.jacobian.hessian`."""
        return _jacobian.hessian(self.chain, q)

    def manipulability(self, q: ArrayLike, *, threads: int = 1) -> Any:
        """Yoshikawa's manipulability, (..., n) -> (...); 0 at a singular pose. See `pieper.kinematics.jacobian.manipulability`."""
        return _jacobian.manipulability(self.chain, q, threads=threads)

    # --- how to get there

    @cached_property
    def _solver(self) -> Solver:
        from pieper.ik.solve import solver

        return solver(self.chain)

    @property
    def ik_info(self) -> IKInfo:
        """How the arm is solved: the structure of its axes in words, the tolerance, the most answers, the self-test.

        >>> load("ur5e").ik_info.structure
        'axes 2, 3 and 4 are parallel, and axes 5 and 6 meet: up to 8 answers (exact)'
        """
        return self._solver.info

    def ik(self, T_base_tip: ArrayLike | Target, seed: ArrayLike | None = None, **options: Any) -> IKSolutions:
        """Every joint vector that brings the tip to a target, each with its own measured error.

        Parameters
        ----------
        T_base_tip : (..., 4, 4) array_like, or Target
            Poses of the tip in the base frame [m, -]; or less than a pose, from `pieper.ik.target`.
        seed : (..., n) array_like, optional
            Joint values [rad or m] that the answers are brought near to by whole turns, the nearest first.
        **options
            As for `pieper.ik.solve.solve`.

        Returns
        -------
        IKSolutions
            ``q`` (..., k, n), padded with NaN; which are ``valid``; errors in metres and radians; names of branches.
            A target out of reach is a result, with the nearest pose, and no exception.

        Raises
        ------
        ArrayError
            Something that is no pose, a wrong shape, a number that is not finite.

        See Also
        --------
        pieper.ik.solve.solve : the same for a chain, with all options.

        Examples
        --------
        >>> arm = load("ur5e")
        >>> answers = arm.ik(arm.fk([0.1, -1.2, 1.4, -1.7, -1.5, 0.3]))
        >>> int(answers.count), answers.labels[0]
        (8, 'front, elbow up, no flip')
        """
        try:
            return self._solver.solve(T_base_tip, seed, **options)
        except TypeError:
            from pieper.ik.solve import solve

            return solve(self.chain, T_base_tip, seed=seed, **options)  # says which option there is not

    def self_motion(self, T_base_tip: ArrayLike, **options: Any) -> list[SolutionCurve]:
        """The curves along which an arm with seven joints can move while its tip stays at `T_base_tip`, (4, 4).

        See `pieper.ik.redundancy.self_motion`; for other arms and targets `IKSolutions.curves`.
        """
        from pieper.ik.redundancy import self_motion

        return self_motion(self.chain, T_base_tip, **options)

    def nearest_ik(self, T_base_tip: ArrayLike, q: ArrayLike, *, within_limits: bool = True) -> FloatArray:
        """The joint values nearest to `q` of all that bring the tip to `T_base_tip`, (4, 4): (n,) [rad or m].

        Whole turns of joints count: the copy nearest to `q` is given. With seven joints it is the nearest point of the curves of
        solutions, not of samples, and takes a fraction of a second. At poses of six joints where one is free, as with a straight
        wrist, it is the answer that grows out of `q`, near but not always nearest.

        Parameters
        ----------
        T_base_tip : (4, 4) array_like
            One pose of the tip in the base frame [m, -].
        q : (n,) array_like
            Where the arm is [rad or m].
        within_limits : bool
            Whether to look inside the joint limits only.

        Returns
        -------
        (n,) array
            Joint values [rad or m].

        Raises
        ------
        ArrayError
            Nothing reaches the pose, or nothing within the limits; the message says why.

        Examples
        --------
        >>> arm = load("panda")
        >>> q = [0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.7]
        >>> T = arm.fk([0.15, -0.45, 0.2, -2.1, 0.3, 1.7, 0.7])
        >>> bool(abs(arm.nearest_ik(T, q) - q).max() < 0.12)
        True
        """
        here = as_joints(self.chain, q)
        answers = self.ik(T_base_tip, here if here.ndim == 1 else None)
        if answers.status.ndim or here.ndim != 1:
            raise ArrayError(
                f"nearest_ik takes one pose (4, 4) and one joint vector ({self.dof},), got a batch of poses of shape "
                f"{answers.status.shape} and joints of shape {here.shape}"
            )
        if self.ik_info.method == "redundancy":
            from pieper.ik.redundancy import nearest_on_self_motion

            nearest = nearest_on_self_motion(self.chain, T_base_tip, here, within_limits=within_limits).q
            if np.isnan(nearest).any():
                raise ArrayError(f"no joint values of {self.name!r} to take: {answers.reason}")
            return nearest
        usable = answers.within_limits if within_limits else answers.valid
        if not usable.any():
            raise ArrayError(f"no joint values of {self.name!r} to take: {answers.reason}")
        distance = np.linalg.norm(answers.q - here, axis=-1)
        return np.asarray(answers.q[int(np.argmin(np.where(usable, distance, np.inf)))])

    def project(self, target: ArrayLike | Target) -> Projections:
        """The poses nearest to a target, (..., 4, 4), that an arm with five joints can take: position exact, angle least.

        See `pieper.ik.projection.project`.
        """
        from pieper.ik.projection import project

        return project(self.chain, target)

    # --- a changed arm

    def with_tool(self, T_tip_tool: ArrayLike, *, name: str = "tool") -> Arm:
        """The arm with a tool, at `T_tip_tool` (4, 4) [m, -] in the frame of its tip: the tip becomes ``T_base_tip @ T_tip_tool``."""
        return Arm(self.chain.with_tool(T_tip_tool, name=name), self.description)

    def with_base(self, T_world_base: ArrayLike, *, name: str = "world") -> Arm:
        """The arm mounted at `T_world_base`, (4, 4) [m, -]: poses are given in the world frame from now on."""
        return Arm(self.chain.with_base(T_world_base, name=name), self.description)

    def lock(self, joints: Mapping[str, float] | None = None, /, **more: float) -> Arm:
        """A smaller arm with joints held: ``arm.lock(joint_4_r=0.0)``, or a mapping for names that are no identifiers."""
        held = {str(name): value for name, value in {**(joints or {}), **more}.items()}
        return Arm(self.chain.lock(**held), self.description)

    def __repr__(self) -> str:
        return f"Arm({self.name!r}, {self.dof} joints, {self.base!r} -> {self.tip!r})"


def load(
    what: str | bytes | os.PathLike[str] | Chain | Description | DhTable,
    *,
    base: str | None = None,
    tip: str | None = None,
    nominal: bool = False,
    packages: PackageFolders | None = None,
    xacro_args: Mapping[str, str] | None = None,
) -> Arm:
    """Load an arm from whatever describes it.

    Parameters
    ----------
    what : str, bytes, path, Chain, Description or DhTable
        A built-in name or alias (``"ur5e"``, ``"mh12"``), a file name of a URDF or xacro, the text of one, or an
        arm that was made with `pieper.model`.
    base, tip : str, optional
        Link names. Default: the one sensible chain; where that is ambiguous the error lists the candidates.
    nominal : bool
        For built-in robots: exact multiples of pi/4 instead of the rounded angles that the source prints.
    packages : mapping or iterable of folders, optional
        Where to look for ``package://`` and ``$(find ...)``, besides the ROS paths and the folders above the file.
    xacro_args : mapping, optional
        Arguments of a xacro file.

    Returns
    -------
    Arm

    Raises
    ------
    UnknownNameError
        No built-in robot, file or link of that name; near matches are listed.
    AmbiguousError
        Several chains fit.
    UrdfError, XacroError
        The description is malformed; the message names file, element and reason.

    Examples
    --------
    >>> arm = load("mh12")
    >>> arm.dof, arm.joint_names[0], arm.tip
    (6, 'joint_1_s', 'tool0')
    """
    from pieper.model.dh import DhTable, from_dh

    if isinstance(what, DhTable):
        what = from_dh(what)
    if isinstance(what, Chain):
        if base is not None or tip is not None:
            what = Description.from_chain(what)
        else:
            return Arm(what)
    description = what if isinstance(what, Description) else _describe(what, nominal, packages, xacro_args)
    return Arm(description.chain(base, tip), description)


def _describe(
    what: str | bytes | os.PathLike[str],
    nominal: bool,
    packages: PackageFolders | None,
    xacro_args: Mapping[str, str] | None,
) -> Description:
    """The description behind a name, a file or a text."""
    from pieper.model.urdf import from_urdf

    if isinstance(what, bytes):
        return from_urdf(what, packages=packages)
    if isinstance(what, str) and what.lstrip("\ufeff \t\r\n").startswith("<"):
        from pieper.model.xacro import from_xacro, is_xacro

        if is_xacro(what):
            return from_xacro(what, args=xacro_args, packages=packages)
        return from_urdf(what, packages=packages)
    if not isinstance(what, (str, os.PathLike)):
        raise DescriptionError(
            type(what).__name__,
            "robot",
            "expected a built-in name, a file name, URDF text, a Description, a Chain or a DhTable",
        )
    path = Path(what)
    if path.suffix == ".xacro":
        from pieper.model.xacro import from_xacro

        return from_xacro(path, args=xacro_args, packages=packages)
    if isinstance(what, os.PathLike) or path.suffix or len(path.parts) > 1 or os.path.isfile(path):  # noqa: PTH113
        return from_urdf(path, packages=packages)
    from pieper.model import catalog

    try:
        return catalog.describe(str(what), nominal=nominal)
    except UnknownNameError as error:
        raise UnknownNameError(f"{error}; a file needs its suffix, as in {what!s}.urdf") from None
