"""A Kalman filter as the textbook has it, slow and plain: matrices of the whole state, noise by Van Loan's integral, gain by an inverse."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm


def discrete(q, dt):
    """Transition and noise of p' = v, v' = white noise of spectral densities q, over dt (Van Loan 1978)."""
    n = len(q)
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    noise = np.zeros((2 * n, 2 * n))
    noise[n:, n:] = np.diag(q)
    block = expm(np.block([[-A, noise], [np.zeros_like(A), A.T]]) * dt)
    F = block[2 * n :, 2 * n :].T
    return F, F @ block[: 2 * n, 2 * n :]


class DenseKalman:
    """Position and velocity in n coordinates; the angles among them are wrapped."""

    def __init__(self, z, R, q, rates, angles=()):
        n = len(z)
        self.x = np.concatenate([z, np.zeros(n)])
        self.P = np.zeros((2 * n, 2 * n))
        self.P[:n, :n] = R
        self.P[n:, n:] = np.diag(np.square(rates))
        self.q, self.angles = np.asarray(q), list(angles)

    def step(self, dt, z=None, R=None):
        F, Q = discrete(self.q, dt)
        self.x, self.P = F @ self.x, F @ self.P @ F.T + Q
        if z is not None:
            H = np.eye(len(z), len(self.x))
            y = z - H @ self.x
            y[self.angles] = np.angle(np.exp(1j * y[self.angles]))
            K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
            self.x = self.x + K @ y
            self.P = (np.eye(len(self.x)) - K @ H) @ self.P
        self.x[self.angles] = np.angle(np.exp(1j * self.x[self.angles]))
        return self.x, self.P
