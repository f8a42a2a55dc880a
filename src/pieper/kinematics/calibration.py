"""Kinematic calibration: the screws of an arm as it was built, from where its tip was measured to be.

Given joint values ``q_k`` and measured positions or poses of the tip, find the arm near the one on paper with::

    min  sum_k | r_k / sigma_k |^2,     r_k = (p_k - p(q_k),  log(R(q_k)^T R_k)),

over the parameters of `pieper.kinematics.screw_parameters`: a least-squares problem without redundant parameters, whose Jacobian is the
closed form given there, solved by Levenberg and Marquardt's method with the parameters taken anew at every step. Combinations that the
measurements do not see (`pieper.kinematics.identifiability`) are left as they are on paper, and named.

References
----------
Okamura, Park, Kinematic calibration using the product of exponentials formula, Robotica 14 (1996).
More, The Levenberg-Marquardt algorithm: implementation and theory, Lecture Notes in Mathematics 630 (1978).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pieper.errors import ArrayError, unknown_name
from pieper.kinematics.identifiability import Identifiability, Seen, most_telling, report, take_apart
from pieper.kinematics.joints import as_joints
from pieper.kinematics.screw_parameters import SETS, ScrewParameters
from pieper.spatial import rotation
from pieper.spatial._checks import poses, stack
from pieper.spatial.twist import hat

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from pieper.model.chain import Chain

FloatArray = NDArray[np.float64]

_MOST_STEPS = 200
_STILL = 1e-13  # [scaled] a step below this changes nothing any more
_ROUNDING = (
    1e-11  # of the size of the arm: residuals below this are those of arithmetic, and no measurement stands out of them
)
_LEFT_OUT = 0.2  # share of the measurements that may be left out at most
_CHANCE = 1e-3  # that a measurement of honest noise is left out in one calibration
_FAR = 100.0  # measured this many times farther than the arm is long: not metres
_CANDIDATES = 400


class Check(NamedTuple):
    """How well an arm says where its tip is.

    Attributes
    ----------
    position_error, rotation_error : (k,) arrays
        Of the calibrated arm against each measurement [m] and [rad]; NaN for the rotation where positions were measured.
    position_before, rotation_before : (k,) arrays
        Of the arm on paper.
    position_sigma : (k,) array
        What the calibrated arm is expected to be wrong by, without the noise of the measurement, root of the mean square [m].
    """

    position_error: FloatArray
    rotation_error: FloatArray
    position_before: FloatArray
    rotation_before: FloatArray
    position_sigma: FloatArray


@dataclass(frozen=True, eq=False)
class Calibration:
    """An arm as it was measured, and the evidence for it.

    Attributes
    ----------
    chain : Chain
        The calibrated arm.
    nominal : Chain
        The arm that was started from.
    change : (p,) array
        How far each parameter has come from the arm on paper [m or rad].
    identifiability : Identifiability
        Rank, condition, standard deviation of each parameter, and what is not seen.
    covariance : (p, p) array
        Of the parameters [m, rad], in the directions that are seen; zero in the others.
    offsets : (n,) array
        Added to the joint values read [rad or m], already part of `chain`.
    T_frame_base : (4, 4) array
        Where the base stands in the frame of the measurements; the identity unless it was set free.
    residuals : (k, 3) or (k, 6) array
        Measured minus calibrated: positions in base axes [m], then rotations in tip axes [rad].
    left_out : (l,) array of int
        Measurements that were not used, since they stand out.
    noise : float
        Size of the residuals in units of the standard deviations that were given, or of 1 m and 1 rad: 1 when those were right.
    chi_square, degrees_of_freedom : float and int
    probability : float
        Of a `chi_square` at least as large, if the standard deviations given are right; NaN when none were given.
    converged : bool
    reason : str
        How it ended.
    """

    chain: Chain
    nominal: Chain
    change: FloatArray
    identifiability: Identifiability
    covariance: FloatArray
    offsets: FloatArray
    T_frame_base: FloatArray
    residuals: FloatArray
    left_out: NDArray[np.intp]
    noise: float
    chi_square: float
    degrees_of_freedom: int
    probability: float
    converged: bool
    reason: str
    _model: ScrewParameters
    _information: FloatArray
    _scale: FloatArray
    _weights: FloatArray

    def check(self, q: ArrayLike, measured: ArrayLike) -> Check:
        """Compare with measurements, best of all with ones that were not used.

        Parameters
        ----------
        q : (k, n) array
            Joint values [rad or m].
        measured : (k, 3) or (k, 4, 4) array
            Positions or poses of the tip [m].

        Returns
        -------
        Check
            The errors before and after, in metres and radians.
        """
        values, T_measured, positions_only = _measurements(self.nominal, q, measured)
        T, moves = self._model.jacobian(values)
        after = _errors(T, T_measured, positions_only)
        start = ScrewParameters.of(self.nominal, (), self.T_frame_base)
        before = _errors(start.poses(values), T_measured, positions_only)
        J = _of_positions(T, moves)
        variance = np.einsum("kip,pr,kir->k", J, self.covariance, J)
        return Check(*after, *before, np.sqrt(np.maximum(variance, 0.0)))

    def poses_to_add(self, count: int = 5, *, candidates: ArrayLike | None = None, seed: int = 0) -> FloatArray:
        """Joint values whose measurement would tell most, (count, n) [rad or m].

        Parameters
        ----------
        count : int
        candidates : (c, n) array, optional
            What can be measured. Default: random joint values within the limits, which may touch something.
        seed : int
            Of the random candidates.

        Returns
        -------
        (count, n) array
            Joint values [rad or m], the one that tells most first.

        Raises
        ------
        ArrayError
            More are wanted than there are candidates, or none; candidates of another shape.
        """
        if candidates is None:
            lower, upper = self.nominal.limits.T
            lower, upper = np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)
            tried = np.random.default_rng(seed).uniform(lower, upper, (max(_CANDIDATES, count), len(lower)))
        else:
            tried = as_joints(self.nominal, candidates, name="candidates")
        if tried.ndim != 2 or not 0 < count <= len(tried):
            raise ArrayError(f"count must be from 1 to the number of candidates, got {count} of shape {tried.shape}")
        T, moves = self._model.jacobian(tried)
        J = _of_positions(T, moves)
        if self.residuals.shape[1] == 6:
            turns = np.swapaxes(T[:, :3, :3], 1, 2) @ moves[:, 3:]
            J = np.concatenate([J, turns], axis=1)
        weights = np.median(self._weights, axis=0)
        J = J * weights[:, None] * self._scale / max(self.noise, np.finfo(float).tiny)
        size = np.abs(self._information).max()
        if (
            not np.isfinite(J).all() or np.abs(J).max() > 1e8
        ):  # without noise every pose tells everything: only the directions count
            J, information = J / np.abs(J).max(), self._information / size
        else:
            information = self._information / self.noise**2
        return tried[most_telling(information, J, count)]

    @property
    def position_rms(self) -> float:
        """Root of the mean square of the distances that are left, of the measurements used [m]."""
        used = np.delete(self.residuals, self.left_out, axis=0)
        return float(np.sqrt(np.mean(np.sum(used[:, :3] ** 2, axis=1))))

    def __str__(self) -> str:
        known = self.identifiability
        text = (
            f"{self.nominal.name}: {known.rank} of {len(known.parameters)} parameters seen, "
            f"{self.position_rms:.3g} m left in {len(self.residuals) - len(self.left_out)} measurements"
        )
        return text if self.converged else f"{text}; not converged: {self.reason}"


def calibrate(
    chain: Chain,
    q: ArrayLike,
    measured: ArrayLike,
    *,
    free: Iterable[str] = ("screws", "home"),
    position_sigma: ArrayLike | None = None,
    rotation_sigma: ArrayLike | None = None,
    leave_out: bool = True,
) -> Calibration:
    """Fit the screws of an arm to measured positions or poses of its tip.

    Parameters
    ----------
    chain : Chain
        The arm on paper.
    q : (k, n) array
        Joint values that were read [rad or m].
    measured : (k, 3) or (k, 4, 4) array
        Positions of the tip, or its poses, in the base frame [m].
    free : iterable of str
        ``"screws"``: the axes; ``"home"``: the tip on its link; ``"offsets"``: the zeros of the joints; ``"base"``: the measurements are
        in a frame of their own, such as a tracker's, and where the base stands in it is to be found. The first two together are complete:
        zeros and base are then part of them.
    position_sigma, rotation_sigma : float, (k,) or (k, 3) array, optional
        Standard deviations of the measurements [m] and [rad]. Without them 1 m weighs as much as 1 rad, and the scatter is taken from
        the residuals.
    leave_out : bool
        Whether measurements that stand far out of the others are left out, a fifth at most.

    Returns
    -------
    Calibration
        What cannot be seen is left as it is on paper and named in `Calibration.identifiability`.

    Raises
    ------
    ArrayError
        Arrays of the wrong shape or not finite; fewer numbers than parameters; all joint values or all measurements the same; positions
        that cannot be metres.

    Notes
    -----
    Positions alone never show the orientation of the tip, nor, where the tip lies on the last axis, that axis beyond where it passes.

    Examples
    --------
    >>> from pieper.kinematics.fk import fk
    >>> from pieper.model.catalog import describe
    >>> arm = describe("ur5e").chain()
    >>> q = np.random.default_rng(1).uniform(-2.0, 2.0, (30, 6))
    >>> built = arm.with_base(np.array([[1, 0, 0, 0.001], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    >>> found = calibrate(arm, q, fk(built, q))
    >>> found.identifiability.rank, bool(np.abs(fk(found.chain, q) - fk(built, q)).max() < 1e-12)
    (30, True)
    """
    sets = _free_sets(free)
    values, T_measured, positions_only = _measurements(chain, q, measured)
    weights, given = _weights(len(values), positions_only, position_sigma, rotation_sigma)
    _refuse_useless(chain, values, T_measured, positions_only)
    T_frame_base = None
    if "base" in sets:
        T_frame_base = _aligned(ScrewParameters.of(chain, ()).poses(values), T_measured)
        if {"screws", "home"} <= set(sets):
            sets = tuple(name for name in sets if name != "base")  # from there on part of the axes and the tip
    start = ScrewParameters.of(chain, sets, T_frame_base)
    task = _Task(start, values, T_measured, positions_only, weights)
    rows = values.shape[0] * weights.shape[1]
    if rows < len(task.scale):
        each = weights.shape[1]
        raise ArrayError(
            f"{len(values)} {'positions' if positions_only else 'poses'} give {rows} numbers for {len(task.scale)} parameters; "
            f"measure at least {-(-len(task.scale) // each)}, better {-(-3 * len(task.scale) // each)}, or free less than {', '.join(sets)}"
        )
    used = np.ones(len(values), dtype=bool)
    fit = task.fit(used, given)
    while leave_out:
        odd = task.odd_one(fit, used)
        if odd is None or np.count_nonzero(~used) + 1 > _LEFT_OUT * len(values):
            break
        used[odd] = False
        fit = task.fit(used, given)
    return task.result(fit, used, given)


def _free_sets(free: Iterable[str]) -> tuple[str, ...]:
    names = (free,) if isinstance(free, str) else tuple(free)
    for name in names:
        if name not in SETS:
            raise unknown_name("set of parameters", str(name), SETS)
    if not names:
        raise ArrayError(f"free must name what may change, some of {', '.join(SETS)}, got none")
    return tuple(name for name in SETS if name in names)


def _measurements(chain: Chain, q: ArrayLike, measured: ArrayLike) -> tuple[FloatArray, FloatArray, bool]:
    """Joint values (k, n), poses (k, 4, 4), and whether their rotations mean nothing."""
    values = as_joints(chain, q)
    if values.ndim != 2:
        raise ArrayError(f"q must have shape (k, {chain.dof}), one row a measurement, got {values.shape}")
    shape = np.shape(measured)
    if len(shape) == 3:
        T = poses(measured, "measured")
    elif len(shape) == 2:
        T = np.tile(np.eye(4), (shape[0], 1, 1))
        T[:, :3, 3] = stack(measured, (3,), "measured")
    else:
        raise ArrayError(f"measured must have shape (k, 3) for positions or (k, 4, 4) for poses, got {shape}")
    if len(T) != len(values):
        raise ArrayError(f"q and measured must have as many rows, got {len(values)} and {len(T)}")
    return values, T, len(shape) == 2


def _weights(
    count: int, positions_only: bool, position_sigma: ArrayLike | None, rotation_sigma: ArrayLike | None
) -> tuple[FloatArray, bool]:
    """(k, 3) or (k, 6) reciprocals of standard deviations, and whether those were given."""
    if positions_only and rotation_sigma is not None:
        raise ArrayError("rotation_sigma goes with measured poses; positions have no rotation")
    if not positions_only and (position_sigma is None) != (rotation_sigma is None):
        raise ArrayError("measured poses need both position_sigma [m] and rotation_sigma [rad], or neither")
    if position_sigma is None:
        return np.ones((count, 3 if positions_only else 6)), False
    parts = []
    for name, sigma in (("position_sigma", position_sigma), ("rotation_sigma", rotation_sigma)):
        if sigma is None:
            continue
        array = stack(sigma, (), name)
        if array.shape not in ((), (count,), (count, 3)):
            raise ArrayError(f"{name} must be one number, or have shape ({count},) or ({count}, 3), got {array.shape}")
        if not (array > 0.0).all():
            raise ArrayError(f"{name} must be above zero, got {float(array.min())}")
        parts.append(np.broadcast_to(array[:, None] if array.ndim == 1 else array, (count, 3)))
    return 1.0 / np.hstack(parts), True


def _refuse_useless(chain: Chain, q: FloatArray, T: FloatArray, positions_only: bool) -> None:
    if not len(q):
        raise ArrayError("q and measured must hold at least one measurement, better some thirty, got none")
    if len(q) > 1 and (q == q[0]).all():
        raise ArrayError(f"all {len(q)} measurements have the same joint values; move the arm between them")
    p = T[:, :3, 3]
    if len(q) > 1 and (p == p[0]).all() and (positions_only or (T[0] == T).all()):
        raise ArrayError(f"all {len(q)} measurements are the same, {p[0].tolist()}, though the joint values are not")
    size = _size(chain)
    spread = float(np.median(np.linalg.norm(p - np.median(p, axis=0), axis=1)))
    if spread > _FAR * size:
        raise ArrayError(
            f"measured positions are spread over {spread:.3g}, the arm is {size:.3g} m long; they must be in metres, not in millimetres"
        )


def _size(chain: Chain) -> float:
    """Length of the arm along its axes at home [m]; what one radian is worth."""
    start = ScrewParameters.of(chain, ())
    points = np.vstack([start.anchors, chain.home[:3, 3]])
    return max(float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()), 1e-3)


def _aligned(T: FloatArray, T_measured: FloatArray) -> FloatArray:
    """The frame change that takes positions nearest to the measured ones (Kabsch 1976), (4, 4)."""
    p, wanted = T[:, :3, 3], T_measured[:, :3, 3]
    H = (wanted - wanted.mean(axis=0)).T @ (p - p.mean(axis=0))
    U, _, Vt = np.linalg.svd(H)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    found = np.eye(4)
    found[:3, :3] = R
    found[:3, 3] = wanted.mean(axis=0) - R @ p.mean(axis=0)
    return found


def _of_positions(T: FloatArray, moves: FloatArray) -> FloatArray:
    """How positions change by each parameter, (k, 3, p): ``v + w x p``."""
    return np.asarray(moves[:, :3] - hat(T[:, :3, 3]) @ moves[:, 3:])


def _errors(T: FloatArray, T_measured: FloatArray, positions_only: bool) -> tuple[FloatArray, FloatArray]:
    position = np.linalg.norm(T[:, :3, 3] - T_measured[:, :3, 3], axis=1)
    if positions_only:
        return position, np.full(len(T), np.nan)
    return position, rotation.distance(T[:, :3, :3], T_measured[:, :3, :3])


def _inverse_left_jacobian(r: FloatArray) -> FloatArray:
    """How a rotation vector changes when its rotation is turned a little from the left, (k, 3, 3).

    ``1 - hat(r)/2 + (1/x^2 - (1 + cos x)/(2 x sin x)) hat(r)^2`` (Chirikjian, Stochastic Models, vol. 2, eq. 10.86).
    """
    x = np.linalg.norm(r, axis=1)
    small = x < 1e-3
    y = np.where(small, 1.0, x)
    factor = np.where(small, 1.0 / 12.0 + x**2 / 720.0, 1.0 / y**2 - 1.0 / (2.0 * y * np.tan(0.5 * y)))
    H = hat(r)
    return np.asarray(np.eye(3) - 0.5 * H + factor[:, None, None] * (H @ H))


class _Fit(NamedTuple):
    model: ScrewParameters
    seen: Seen
    residuals: FloatArray
    J: FloatArray
    cost: float
    noise: float
    converged: bool
    reason: str


class _Task:
    """The least-squares problem."""

    def __init__(
        self,
        start: ScrewParameters,
        q: FloatArray,
        T_measured: FloatArray,
        positions_only: bool,
        weights: FloatArray,
    ) -> None:
        self.start, self.q, self.T_measured = start, q, T_measured
        self.positions_only, self.weights = positions_only, weights
        self.parameters = start.parameters
        self.size = _size(start.nominal)
        self.scale = np.array([self.size if p.unit == "m" else 1.0 for p in self.parameters])

    def residuals(self, model: ScrewParameters) -> FloatArray:
        """Measured minus modelled, (k, 3) or (k, 6)."""
        return self._residuals(model.poses(self.q))

    def _residuals(self, T: FloatArray) -> FloatArray:
        r = self.T_measured[:, :3, 3] - T[:, :3, 3]
        if self.positions_only:
            return np.asarray(r)
        turn = rotation.as_rotation_vector(np.swapaxes(T[:, :3, :3], 1, 2) @ self.T_measured[:, :3, :3])
        return np.hstack([r, turn])

    def linear(self, model: ScrewParameters) -> tuple[FloatArray, FloatArray]:
        """Residuals, and their Jacobian by scaled parameters with its sign turned, (k, d, p)."""
        T, moves = model.jacobian(self.q)
        r = self._residuals(T)
        J = _of_positions(T, moves)
        if not self.positions_only:
            R_tip_frame = np.swapaxes(T[:, :3, :3], 1, 2)
            J = np.concatenate([J, _inverse_left_jacobian(r[:, 3:]) @ R_tip_frame @ moves[:, 3:]], axis=1)
        return r, J * self.scale

    def fit(self, used: NDArray[np.bool_], given: bool) -> _Fit:
        """Fit to the measurements that are used; what noise does not let be seen is held."""
        fit = self._fit(used, 1.0 if given else 0.0)
        if given or fit.seen.tolerance >= fit.noise / 0.05 or fit.seen.s[fit.seen.rank - 1] > fit.noise / 0.05:
            return fit
        return self._fit(used, fit.noise)

    def _fit(self, used: NDArray[np.bool_], noise: float) -> _Fit:
        w = self.weights[used]
        model = self.start

        def whitened(at: ScrewParameters) -> tuple[FloatArray, Seen, FloatArray, FloatArray]:
            r, J = self.linear(at)
            flat = (J[used] * w[:, :, None]).reshape(-1, J.shape[2])
            return (r[used] * w).ravel(), take_apart(flat, noise), r, J

        b, seen, r, J = whitened(model)
        cost = float(b @ b)
        floor = b.size * (1e-15 * self.size * float(w.max())) ** 2  # what arithmetic leaves
        damping = 1e-4 * float(seen.s[0]) ** 2 if seen.s.size else 0.0
        converged, reason = False, f"no end after {_MOST_STEPS} steps"
        for _ in range(_MOST_STEPS):
            s, c = seen.s[: seen.rank], seen.U[:, : seen.rank].T @ b
            step = seen.Vt[: seen.rank].T @ (s * c / (s**2 + damping))
            gain = float(np.sum(c**2 * (s**2 * (s**2 + 2.0 * damping)) / (s**2 + damping) ** 2))
            if float(np.abs(step).max(initial=0.0)) < _STILL or gain <= 1e-16 * cost or gain <= floor:
                converged, reason = True, "nothing is left to gain"
                break
            trial = model.moved(step * self.scale) if np.abs(step).max() < 1.0 else None
            left = np.inf if trial is None else float(np.sum((self.residuals(trial)[used] * w) ** 2))
            if trial is not None and left < cost:
                damping *= 0.1 if left < cost - 0.25 * gain else 2.0
                model = trial
                b, seen, r, J = whitened(model)
                cost = float(b @ b)
            elif damping > 1e12 * float(seen.s[0]) ** 2:
                converged = gain <= 1e-9 * cost
                reason = "no step makes the residuals smaller"
                break
            else:
                damping = max(damping * 8.0, 1e-12 * float(seen.s[0]) ** 2)
        freedom = b.size - seen.rank
        return _Fit(model, seen, r, J, cost, float(np.sqrt(cost / freedom)) if freedom > 0 else 0.0, converged, reason)

    def odd_one(self, fit: _Fit, used: NDArray[np.bool_]) -> int | None:
        """The measurement that stands out most of the others, if one does: by its residual, with what the fit took of it put back."""
        from scipy.special import chdtri

        d = self.weights.shape[1]
        blocks = fit.seen.U[:, : fit.seen.rank].reshape(-1, d, fit.seen.rank)
        if len(blocks) * d - fit.seen.rank <= d:
            return None
        room = np.eye(d) - blocks @ np.swapaxes(blocks, 1, 2)
        r = (fit.residuals * self.weights)[used]
        with np.errstate(all="ignore"):
            try:
                distance = np.einsum("ki,ki->k", r, np.linalg.solve(room, r[..., None])[..., 0])
            except np.linalg.LinAlgError:  # one measurement alone decides a parameter: it fits, whatever it says
                return None
        ordinary = float(np.median(distance)) / float(chdtri(d, 0.5))
        floor = (_ROUNDING * self.size * float(self.weights[used].max())) ** 2
        limit = max(ordinary, floor) * float(chdtri(d, _CHANCE / len(r)))
        worst = int(np.argmax(distance))
        if not distance[worst] > limit:
            return None
        return int(np.flatnonzero(used)[worst])

    def result(self, fit: _Fit, used: NDArray[np.bool_], given: bool) -> Calibration:
        from scipy.special import chdtrc

        seen = fit.seen
        noise = 1.0 if given else fit.noise
        still = self._still(used)
        known = report(seen, self.parameters, self.scale, noise, positions_only=self.positions_only, still=still)
        rows = seen.Vt[: seen.rank] / seen.s[: seen.rank, None] * noise * self.scale
        whitened = seen.s[:, None] * seen.Vt
        freedom = int(np.count_nonzero(used)) * self.weights.shape[1] - seen.rank
        return Calibration(
            chain=fit.model.chain(),
            nominal=self.start.nominal,
            change=_read_only(fit.model.since_nominal()),
            identifiability=known,
            covariance=_read_only(rows.T @ rows),
            offsets=_read_only(fit.model.offsets),
            T_frame_base=_read_only(fit.model.T_frame_base),
            residuals=_read_only(fit.residuals),
            left_out=np.flatnonzero(~used),
            noise=fit.noise,
            chi_square=fit.cost,
            degrees_of_freedom=freedom,
            probability=float(chdtrc(freedom, fit.cost)) if given and freedom > 0 else float("nan"),
            converged=fit.converged,
            reason=fit.reason,
            _model=fit.model,
            _information=whitened.T @ whitened,
            _scale=self.scale,
            _weights=self.weights,
        )

    def _still(self, used: NDArray[np.bool_]) -> Sequence[str]:
        spread = np.ptp(self.q[used], axis=0)
        return [name for name, way in zip(self.start.nominal.joint_names, spread, strict=True) if way == 0.0]


def _read_only(array: FloatArray) -> FloatArray:
    copy = np.array(array)
    copy.setflags(write=False)
    return copy
