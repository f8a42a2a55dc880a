"""Compiled kernels. Arguments are plain arrays that pieper has checked."""

from collections.abc import Sequence
import enum

import numpy
import numpy.typing


class NativeChain:
    def __init__(self, screws: object, home: object, coupling: object, limits: object) -> None: ...

    def fk(self, q: object, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]:
        """Poses of the tip in the base frame, (..., 4, 4), from joints (..., n)."""

    def link_poses(self, q: object, after: object, homes: object) -> numpy.typing.NDArray[numpy.float64]:
        """
        Poses (..., k, 4, 4) of k frames with home poses (k, 4, 4), each moved by its first `after` axes.
        """

    def jacobian(self, q: object, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]:
        """Jacobians (..., 6, n), linear part first."""

    def jacobian_space(self, q: object, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]:
        """Jacobians (..., 6, n), linear part first."""

    def jacobian_body(self, q: object, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]:
        """Jacobians (..., 6, n), linear part first."""

    def jacobian_rate(self, q: object, dq: object) -> numpy.typing.NDArray[numpy.float64]:
        """Time derivative (..., 6, n) of the geometric Jacobian."""

    def hessian(self, q: object) -> numpy.typing.NDArray[numpy.float64]:
        """Derivatives (..., n, 6, n) of the geometric Jacobian by each joint."""

    def manipulability(self, q: object, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]:
        """Yoshikawa's manipulability (...)."""

    def solve_numeric(self, targets: object, seeds: object, rows: TargetRows, position_tolerance: float, rotation_tolerance: float, restarts: int, iterations: int, count: int, distinct: float, threads: int) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int8], int]:
        """
        Joints (..., count, n) for poses (..., 4, 4), and how well they do: position_error, rotation_error, valid, within_limits (..., count), nearest (..., n), its errors (...), status (...), and how many were missed.
        """

    def solve_closed_form(self, form: ClosedForm, targets: object, position_tolerance: float, rotation_tolerance: float, threads: int) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_]]:
        """
        Joints (..., 8, n) of every branch for poses (..., 4, 4), valid, position_error and rotation_error (..., 8), and doubtful (...).
        """

    def answer_by_closed_form(self, form: ClosedForm, targets: object, seeds: object, position_tolerance: float, rotation_tolerance: float, threads: int) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.int8], numpy.typing.NDArray[numpy.int8], numpy.typing.NDArray[numpy.bool_], int, int]:
        """
        Joints (..., 8, n) for poses (..., 4, 4) in the order of their use, valid, position_error, rotation_error, within_limits, branch (..., 8), status and complete (...); how many are not complete, and how many were not reached.
        """

    def answer_by_polynomial(self, solver: NativeGeneral6R, mode: GeneralMode, targets: object, seeds: object, position_tolerance: float, rotation_tolerance: float, threads: int) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.int8], numpy.typing.NDArray[numpy.int8], numpy.typing.NDArray[numpy.bool_], int, int]:
        """As answer_by_closed_form, with (..., 16) places and without branches."""

    def arrange(self, q: object, position_error: object, rotation_error: object, branch: object, targets: object, seeds: object, rows: TargetRows, position_tolerance: float, rotation_tolerance: float, most: int) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.int8], numpy.typing.NDArray[numpy.int8], int]:
        """
        Joints (..., k, n) that were found for poses (..., 4, 4), with errors (..., k) that are NaN where there is none, in the order of their use: q, valid, position_error, rotation_error, within_limits, branch with `most` places, or with as many as are needed where that is 0, status (...), and how many were not reached.
        """

    def score_answers(self, q: object, counted: object, poses: int, rows: int, alike: float, measures: bool, threads: int) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64]]:
        """
        Of answers (g * poses, k, n), those marked (g * poses, k), for each group of poses that follow each other, all (g,): poses with an answer, answers, most of one pose; greatest manipulability over `rows` of the Jacobian, smallest singular value of the best, greatest distance to the limits, the last three empty without measures.
        """

class RotationTarget(enum.Enum):
    free = 0

    axis = 1

    full = 2

class NumericStatus(enum.Enum):
    reached = 0

    unreachable = 1

    not_converged = 2

class TargetRows:
    def __init__(self, weights: object, position_in_tool: bool, rotation_in_tool: bool, rotation: RotationTarget, axis: object) -> None: ...

class ClosedFormFamily(enum.Enum):
    spherical_wrist = 0

    three_parallel = 1

    three_parallel_skew = 2

    planar = 3

    gantry = 4

class FirstThree(enum.Enum):
    parallel_23 = 0

    parallel_12 = 1

    intersecting_12 = 2

    intersecting_23 = 3

    general = 4

    sliding_3 = 5

class ClosedForm:
    def __init__(self, family: ClosedFormFamily, first_three: FirstThree, reversed: bool, screws: object, home: object, scale: float, capture: float, widened: float) -> None: ...

    def name_branches(self, branch_of_slot: Sequence[int]) -> None:
        """
        Gives each of the eight slots the number of its branch, by which answers are ordered.
        """

def arctangent(y: object, x: object) -> numpy.typing.NDArray[numpy.float64]:
    """The angle of points (x, y), as the kernels compute it."""

class GeneralMode(enum.Enum):
    fast = 0

    checked = 1

    complete = 2

class FormReport:
    @property
    def remaining_joint(self) -> int: ...

    @property
    def harmonics(self) -> int: ...

    @property
    def even(self) -> bool: ...

    @property
    def median_tail(self) -> float: ...

    @property
    def found(self) -> float: ...

    @property
    def flagged(self) -> float: ...

    @property
    def looked_twice(self) -> float: ...

    @property
    def median_work(self) -> float: ...

    @property
    def rank(self) -> int: ...

class NativeGeneral6R:
    def __init__(self, chain: NativeChain) -> None: ...

    def solve(self, targets: object, mode: GeneralMode, threads: int) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.int32]]:
        """
        Joints (..., 16, 6) for poses (..., 4, 4), padded with NaN; position_error, rotation_error, valid (..., 16); flags (...).
        """

    def solve_one_form(self, form: int, targets: object) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.int32]]:
        """As solve(), by one of the twelve forms alone; to measure them."""

    @property
    def reports(self) -> list[FormReport]:
        """What was measured about each form."""

class AnswerStatus(enum.Enum):
    reached = 0

    unreachable = 1

    outside_limits = 3

def instruction_set() -> str:
    """Name of the instruction set in use."""

def instruction_sets() -> list[str]:
    """Names of those that were compiled in and run here, narrowest first."""

def use_instruction_set(name: str) -> None:
    """Chooses the kernels by name, for every chain."""

def sincos(angle: object) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64]]:
    """Sines and cosines as the kernels compute them."""

class PixelLayout(enum.Enum):
    packed = 0

    i420 = 1

    nv12 = 2

    yuyv = 3

largest_side: int = 32768

class ColorLookUp:
    def __init__(self, labels: object, reversed: bool) -> None:
        """Labels (2^k, 2^k, 2^k) by the bytes of a pixel, or by their reverse."""

    def segment(self, image: object, layout: PixelLayout, min_area: int, max_area: int, refine: bool, numbered: bool) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int32]]:
        """
        Of k blobs: color (k,), centroid (k, 2), covariance (k, 2, 2), area (k,), extent (k, 4), circularity (k,); and the number of each pixel's blob, from 1, if they are to be numbered.
        """

    def classify(self, image: object, layout: PixelLayout) -> numpy.typing.NDArray[numpy.uint8]:
        """The label of each pixel, (height, width)."""
