"""Coefficients of the arc tangent in native/src/simd/arctangent.hpp.

atan(t) = t + t z p(z) with z = t^2, for t up to tan(pi/8); p is the Chebyshev interpolation of the rest, highest power first.
Run: python native/derivations/arctangent_polynomial.py
"""

import mpmath as mp

mp.mp.dps = 60
END = (mp.sqrt(2) - 1) ** 2 * mp.mpf("1.0001")


def rest(z: mp.mpf) -> mp.mpf:
    if z < mp.mpf(10) ** -20:
        return -mp.mpf(1) / 3 + z / 5
    t = mp.sqrt(z)
    return (mp.atan(t) / t - 1) / z


if __name__ == "__main__":
    coefficients, error = mp.chebyfit(rest, [mp.mpf(10) ** -25, END], 12, error=True)
    print("error", mp.nstr(error, 3))
    for c in coefficients:
        print(float(c).hex())
