// The angle of a vector of points, as std::atan2, to about one unit in the last place.
//
// The point is folded to 0 <= y <= x; beyond tan(pi/8) the angle is measured from pi/4 by (y - x) / (y + x), which
// costs no second division. The polynomial comes from native/derivations/arctangent_polynomial.py.
#pragma once

#include "simd/lanes.hpp"

namespace {

// atan2(y, x); 0 where both are 0.
PIEPER_INLINE Vec arctangent(Vec y, Vec x) {
  constexpr double tan_eighth = 0x1.a827999fcef32p-2;
  constexpr double quarter = 0x1.921fb54442d18p-1, quarter_rest = 0x1.1a62633145c07p-55;
  constexpr double half = 0x1.921fb54442d18p+0, half_rest = 0x1.1a62633145c07p-54;
  constexpr double whole = 0x1.921fb54442d18p+1, whole_rest = 0x1.1a62633145c07p-53;
  const Vec ax = magnitude(x), ay = magnitude(y);
  const IntVec steep = ay > ax;
  const Vec low = select(steep, ax, ay), high = select(steep, ay, ax);
  const IntVec far = low > tan_eighth * high;
  const Vec under = select(far, low + high, high);
  const Vec t = select(far, low - high, low) / select(under == 0.0, splat(1.0), under);
  const Vec z = t * t;
  Vec p = splat(0x1.0acd9e91a5a35p-6);
  p = p * z - 0x1.1b311bb48c215p-5;
  p = p * z + 0x1.74dccfb93fff0p-5;
  p = p * z - 0x1.ac7a5a79b3f26p-5;
  p = p * z + 0x1.e19a0bfa3eef9p-5;
  p = p * z - 0x1.110e87b4357d2p-4;
  p = p * z + 0x1.3b1392d519db1p-4;
  p = p * z - 0x1.745d165dc9713p-4;
  p = p * z + 0x1.c71c71c303dbbp-4;
  p = p * z - 0x1.249249248d7dcp-3;
  p = p * z + 0x1.9999999999953p-3;
  p = p * z - 0x1.5555555555555p-2;
  Vec small = t * z * p;
  Vec angle = t;  // angle + small
  const Vec zero = splat(0.0);
  small += select(far, splat(quarter_rest), zero);
  angle = select(far, quarter + (angle + small), angle + small);
  angle = select(steep, half - (angle - half_rest), angle);
  angle = select(x < 0.0, whole - (angle - whole_rest), angle);
  return from_bits(bits(angle) ^ (bits(y) & INT64_MIN));
}

}  // namespace
