"""Coefficients of the sine and cosine polynomials in native/src/simd/sincos.hpp.

On |x| <= pi/4 with z = x^2:

    sin x = x + x z P(z),        P of degree 5
    cos x = 1 - z/2 + z^2 Q(z),  Q of degree 5

P and Q are weighted least-squares fits (weight: their share of the result) at 60 Chebyshev nodes of [0, (pi/4)^2] in
60-digit arithmetic, which is within a small factor of the minimax error. Coefficients are rounded to double one at a
time, lowest first, and the rest is fitted again, so that later coefficients take up the rounding of earlier ones. The
error that remains, relative to the result, is printed.

    python native/derivations/sincos_polynomials.py
"""

import mpmath as mp

mp.mp.dps = 60
END = (mp.pi / 4) ** 2 * mp.mpf("1.0001")


def p(z):
    """(sin x - x) / (x z)."""
    return mp.nsum(lambda k: (-1) ** (k + 1) * z**k / mp.factorial(2 * k + 3), [0, 30], method="d")


def q(z):
    """(cos x - 1 + z/2) / z^2."""
    return mp.nsum(lambda k: (-1) ** k * z**k / mp.factorial(2 * k + 4), [0, 30], method="d")


def fit(function, power, fixed, count):
    """Coefficients of z^len(fixed) ... of the weighted fit to what the fixed ones leave."""
    nodes = [END / 2 * (1 + mp.cos(mp.pi * (2 * k + 1) / 120)) for k in range(60)]
    rows = mp.matrix([[z ** (power + len(fixed) + j) for j in range(count)] for z in nodes])
    rest = mp.matrix([z**power * (function(z) - mp.polyval([*reversed(fixed), 0], z) / z) for z in nodes])
    return list(mp.qr_solve(rows, rest)[0])


if __name__ == "__main__":
    for name, function, power in (("sine", p, 1), ("cosine", q, 2)):
        rounded = []
        while len(rounded) < 6:
            rounded.append(mp.mpf(float(fit(function, power, rounded, 6 - len(rounded))[0])))
        worst = max(
            abs(mp.polyval(rounded[::-1], z) - function(z)) * z**power for z in (END * k / 400 for k in range(1, 401))
        )
        print(name, f"error 2^{float(mp.log(worst, 2)):.1f}")
        for c in rounded:
            print(f"    {float(c)!r},  // {float(c).hex()}")
