"""The values of one joint at which a six-joint loop closes, by plain linear algebra: slow and clear.

The fourteen equations of Raghavan and Roth are set up by sampling products of motions, eliminated by a singular value
decomposition, and put into the 12x12 dialytic determinant. Sampled on the circle, the determinant is a trigonometric
polynomial of degree 8; its roots come from the companion matrix of the complex polynomial of degree 16. A prismatic joint has
1, d, d^2 where the others have 1, cos t, sin t; it may neither remain nor be dropped.
"""

from __future__ import annotations

import numpy as np

DEGREE = 8
SAMPLES = 32  # more than 17, so that the rest of the spectrum shows that the degree is not higher
THIRDS = 2.0 * np.pi / 3.0 * np.arange(3)


def turn(angle: float) -> np.ndarray:
    """Rz, (4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def slide(d: float) -> np.ndarray:
    """Tz, (4, 4)."""
    T = np.eye(4)
    T[2, 3] = d
    return T


# the motion of a joint; three values of it and what its terms are there; the terms on s^2, s k, k^2
TURNING = (
    turn,
    THIRDS,
    np.stack([np.ones(3), np.cos(THIRDS), np.sin(THIRDS)], axis=1),
    np.array([[1, -1, 0], [0, 0, 2], [1, 1, 0.0]]),  # 1 = s^2 + k^2, cos = k^2 - s^2, sin = 2 s k
)
SLIDING = (
    slide,
    np.array([-1.0, 0.0, 1.0]),
    np.array([[1, -1, 1], [1, 0, 0], [1, 1, 1.0]]),
    np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0.0]]),  # d = s / k
)


def fourteen(T: np.ndarray) -> np.ndarray:
    """l, p, p.p, p.l, p x l, (p.p) l - 2 (p.l) p of the z axis and origin of a frame."""
    direction, p = T[:3, 2], T[:3, 3]
    return np.concatenate(
        [direction, p, [p @ p, p @ direction], np.cross(p, direction), (p @ p) * direction - 2.0 * (p @ direction) * p]
    )


def bilinear(first, second, motion) -> np.ndarray:
    """Coefficients (14, 3, 3) on the terms of two joints, TURNING or SLIDING, of the fourteen numbers of ``motion(a, b)``."""
    values = np.array([[fourteen(motion(a, b)) for b in second[1]] for a in first[1]])
    return np.einsum("ia,jb,abk->kij", np.linalg.inv(first[2]), np.linalg.inv(second[2]), values)


def loop(chain, T_base_tip: np.ndarray, remaining: int) -> list[np.ndarray]:
    """K1 ... K6 of ``Rz1 K1 Rz2 K2 ... Rz6 K6 = 1``, starting so that joint `remaining` is the third."""
    frames = []
    for screw in chain.screws:
        v, w = screw[:3], screw[3:]
        if not w.any():
            v, w = 0.0 * v, v
        x = np.cross(w, [0.3, 0.5, 0.8])
        x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3, :3] = np.column_stack([x, np.cross(w, x), w])
        T[:3, 3] = np.cross(w, v)
        frames.append(T)
    K = [np.linalg.inv(frames[i]) @ frames[i + 1] for i in range(5)]
    K.append(np.linalg.inv(frames[5]) @ chain.home @ np.linalg.inv(T_base_tip) @ frames[0])
    return [K[(i + remaining - 2) % 6] for i in range(6)]


def determinants(chain, T_base_tip: np.ndarray, remaining: int, angles: np.ndarray) -> np.ndarray:
    """The dialytic determinant at values of joint `remaining`, up to a common factor."""
    K = loop(chain, T_base_tip, remaining)
    joints = [TURNING if turns else SLIDING for turns in np.roll(chain.is_revolute, 2 - remaining)]
    assert joints[2] is joints[5] is TURNING
    one, two, four, five = joints[0], joints[1], joints[3], joints[4]
    # K2 Rz3 K3 Rz4 K4 Rz5 K5 = Rz2^-1 K1^-1 Rz1^-1 K6^-1 on the z axis that Rz6 keeps
    right = bilinear(
        one, two, lambda t1, t2: two[0](-t2) @ np.linalg.inv(K[0]) @ one[0](-t1) @ np.linalg.inv(K[5])
    ).reshape(14, 9)
    U, _, _ = np.linalg.svd(right[:, 1:])
    rows = U[:, 8:].T  # six rows that annihilate every term with t1 or t2
    constant = rows @ right[:, 0]
    out = []
    for angle in angles:
        left = bilinear(
            four,
            five,
            lambda t4, t5, a=angle: K[1] @ turn(a) @ K[2] @ four[0](t4 + 0.7) @ K[3] @ five[0](t5 - 0.4) @ K[4],
        )
        trigonometric = np.einsum("rk,kij->rij", rows, left)
        trigonometric[:, 0, 0] -= constant
        A, B, C = np.einsum("ai,bj,rij->arb", four[3], five[3], trigonometric)
        zero = np.zeros((6, 3))
        out.append(np.linalg.det(np.block([[A, B, C, zero], [zero, A, B, C]])))
    return np.array(out)


def spectrum(chain, T_base_tip: np.ndarray, remaining: int) -> np.ndarray:
    """Fourier coefficients of the determinant, of its largest sample: frequencies -SAMPLES/2 ... SAMPLES/2 - 1."""
    angles = 2.0 * np.pi / SAMPLES * np.arange(SAMPLES)
    values = determinants(chain, T_base_tip, remaining, angles)
    return np.fft.fftshift(np.fft.fft(values / np.abs(values).max()) / SAMPLES)


def roots(chain, T_base_tip: np.ndarray, remaining: int) -> np.ndarray:
    """Real values of joint `remaining` at which the determinant vanishes, sorted in (-pi, pi]."""
    c = spectrum(chain, T_base_tip, remaining)[SAMPLES // 2 - DEGREE : SAMPLES // 2 + DEGREE + 1]
    z = np.roots(c[::-1])
    return np.sort(np.angle(z[np.abs(np.abs(z) - 1.0) < 1e-6]))
