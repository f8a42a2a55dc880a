// Sine and cosine of a vector, to less than one unit in the last place.
//
// Argument reduction after Cody and Waite (Software Manual for the Elementary Functions, 1980, ch. 8): k pi/2 is taken off
// in three parts. With fused multiply-add the first may be a full double, because that step cancels and is exact; without
// it, it has 33 bits. The second has 33 bits, so that its product with k < 2^20 is exact and its rounding can be caught.
// The reduced angle is a sum r + e. The polynomials come from native/derivations/sincos_polynomials.py.
#pragma once

#include <cmath>

#include "simd/lanes.hpp"

// The compiler contracts a - b * c to one rounding.
#if defined(__GNUC__) && (defined(__FMA__) || defined(__ARM_FEATURE_FMA))
#define PIEPER_FUSED
#endif

namespace {

// Beyond this the products above are no longer exact; such lanes go through the C library.
constexpr double exact_reduction_limit = 1.6e6;

// All lanes must be finite with magnitude below exact_reduction_limit.
PIEPER_INLINE void sincos_reduced(Vec angle, Vec& sine, Vec& cosine) {
  constexpr double two_over_pi = 0x1.45f306dc9c883p-1;
  constexpr double round_to_int = 0x1.8p+52;

  const Vec shifted = angle * two_over_pi + round_to_int;
  const IntVec quadrant = bits(shifted);
  const Vec k = shifted - round_to_int;
#if defined(PIEPER_FUSED)
  constexpr double half_pi_1 = 0x1.921fb54442d18p+0, half_pi_2 = 0x1.1a626331p-54, half_pi_3 = 0x1.1701b839a252p-88;
  const Vec coarse = angle - k * half_pi_1;
  const Vec r = coarse - k * half_pi_2;
  const Vec e = ((coarse - r) - k * half_pi_2) - k * half_pi_3;
#else
  constexpr double half_pi_1 = 0x1.921fb544p+0, half_pi_2 = 0x1.0b4611a6p-34, half_pi_3 = 0x1.3198a2e037073p-69;
  const Vec coarse = angle - k * half_pi_1;
  const Vec second = k * half_pi_2;
  const Vec fine = coarse - second;
  const Vec lost = (coarse - fine) - second - k * half_pi_3;
  const Vec r = fine + lost;
  const Vec e = (fine - r) + lost;
#endif

  // The polynomials take r^2, which is there before e; what multiplies them takes (r + e)^2 in one rounding.
  const Vec z = r * r, square = multiply_add(r, r, r * (e + e));
  Vec p = splat(0x1.5d8fa7fd5c9d2p-33);
  p = p * z - 0x1.ae5e594b78a4cp-26;
  p = p * z + 0x1.71de3564d2b7bp-19;
  p = p * z - 0x1.a01a019bf7efap-13;
  p = p * z + 0x1.111111110f77dp-7;
  p = p * z - 0x1.5555555555548p-3;
  Vec q = splat(-0x1.8fa9952065738p-37);
  q = q * z + 0x1.1ee9e15f38979p-29;
  q = q * z - 0x1.27e4f7f8eae3ap-22;
  q = q * z + 0x1.a01a019c97777p-16;
  q = q * z - 0x1.6c16c16c1504bp-10;
  q = q * z + 0x1.555555555554bp-5;

  const Vec s = r + (r * square * p + e);
#if defined(PIEPER_FUSED)
  const Vec c = 1.0 + square * (z * q - 0.5);
#else
  const Vec half = 0.5 * z, top = 1.0 - half;
  const Vec c = top + (((1.0 - top) - half) + (z * z * q - r * e));
#endif

  const IntVec sine_sign = (quadrant << 62) & INT64_MIN;
  const IntVec cosine_sign = ((quadrant + 1) << 62) & INT64_MIN;
  sine = from_bits(bits(select_odd(quadrant, c, s)) ^ sine_sign);
  cosine = from_bits(bits(select_odd(quadrant, s, c)) ^ cosine_sign);
}

// Any finite angle.
inline void sincos(Vec angle, Vec& sine, Vec& cosine) {
  if (!any(magnitude(angle) >= exact_reduction_limit)) {
    sincos_reduced(angle, sine, cosine);
    return;
  }
  for (std::size_t l = 0; l < lanes; ++l) {
    lane(sine, l) = std::sin(lane(angle, l));
    lane(cosine, l) = std::cos(lane(angle, l));
  }
}

}  // namespace
