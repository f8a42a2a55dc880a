"""Compiled kernels. Arguments are plain arrays that pieper has checked."""

import enum

import numpy
import numpy.typing


class JacobianKind(enum.Enum):
    geometric = 0

    space = 1

    body = 2

class NativeChain:
    def __init__(self, screws: object, home: object, coupling: object, limits: object) -> None: ...

    def fk(self, q: object, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]:
        """Poses of the tip in the base frame, (..., 4, 4), from joints (..., n)."""

    def link_poses(self, q: object, after: object, homes: object) -> numpy.typing.NDArray[numpy.float64]:
        """
        Poses (..., k, 4, 4) of k frames with home poses (k, 4, 4), each moved by its first `after` axes.
        """

    def jacobian(self, q: object, kind: JacobianKind, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]:
        """Jacobians (..., 6, n), linear part first."""

    def jacobian_rate(self, q: object, dq: object) -> numpy.typing.NDArray[numpy.float64]:
        """Time derivative (..., 6, n) of the geometric Jacobian."""

    def hessian(self, q: object) -> numpy.typing.NDArray[numpy.float64]:
        """Derivatives (..., n, 6, n) of the geometric Jacobian by each joint."""

    def manipulability(self, q: object, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]:
        """Yoshikawa's manipulability (...)."""

def instruction_set() -> str:
    """Name of the instruction set in use."""

def instruction_sets() -> list[str]:
    """Names of those that were compiled in and run here, narrowest first."""

def use_instruction_set(name: str) -> None:
    """Chooses the kernels by name, for every chain."""

def sincos(angle: object) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64]]:
    """Sines and cosines as the kernels compute them."""
