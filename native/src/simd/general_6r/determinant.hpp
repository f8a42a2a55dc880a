// The 12x12 dialytic matrix of the six equations, reduced to 6x6 by reflections only; one angle per lane.
//
// With S = A s4^2 + B s4 k4 + C k4^2 (blocks 6x3), multiplying by s4 and by k4 gives [A B C 0; 0 A B C] on
// (s4^3, s4^2 k4, s4 k4^2, k4^3) b. Reducing the first block column of [A | B C] and the last of [C | A B] leaves three
// rows each, together M on (s4 b, k4 b). Nothing is pivoted, so the sign of the determinant is the same for all angles.
#pragma once

#include "simd/general_6r/elimination.hpp"

namespace {

// Reduces column `p` below row j of an n-row matrix and applies the reflection to columns [from, to). Returns the entry
// that is left at (j, p).
template <int rows, int width, bool keep_row>
PIEPER_INLINE Vec reflect(Vec (&E)[rows][width], int j, int p, int from, int to) {
  Vec square = E[j][p] * E[j][p] + 1e-300;
  for (int i = j + 1; i < rows; ++i) square += E[i][p] * E[i][p];
  const Vec alpha = with_sign(square_root(square), -E[j][p]);
  const Vec v = E[j][p] - alpha, factor = 1.0 / (alpha * v);
  for (int k = from; k < to; ++k) {
    Vec d = v * E[j][k];
    for (int i = j + 1; i < rows; ++i) d += E[i][p] * E[i][k];
    d *= factor;
    if (keep_row) E[j][k] += d * v;
    for (int i = j + 1; i < rows; ++i) E[i][k] += d * E[i][p];
  }
  return alpha;
}

// M at the angles with these cosines and sines, and the product of the entries left by the reductions.
PIEPER_NOINLINE Vec reduced_matrix(const double (*S)[9][8], Vec c, Vec s, Vec (&M)[6][6]) {
  Vec E[6][9], F[6][9];
  for (int i = 0; i < 6; ++i)
    for (int k = 0; k < 9; ++k) E[i][k] = F[i][k] = S[0][k][i] + c * S[1][k][i] + s * S[2][k][i];
  Vec product = reflect<6, 9, false>(E, 0, 0, 1, 9);
  product *= reflect<6, 9, false>(E, 1, 1, 2, 9);
  product *= reflect<6, 9, false>(E, 2, 2, 3, 9);
  product *= reflect<6, 9, false>(F, 0, 8, 0, 8);
  product *= reflect<6, 9, false>(F, 1, 7, 0, 7);
  product *= reflect<6, 9, false>(F, 2, 6, 0, 6);
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 6; ++k) M[i][k] = E[3 + i][3 + k], M[3 + i][k] = F[3 + i][k];
  return product;
}

// Reduces M to upper triangular form; returns the product of its diagonal. With `keep`, M holds R above the diagonal and
// `diagonal` its diagonal.
template <bool keep>
PIEPER_INLINE Vec triangularise(Vec (&M)[6][6], Vec* diagonal) {
  Vec product = splat(1.0);
  for (int j = 0; j < 5; ++j) {
    const Vec d = reflect<6, 6, keep>(M, j, j, j + 1, 6);
    if (keep) diagonal[j] = d;
    product *= d;
  }
  if (keep) diagonal[5] = M[5][5];
  return product * M[5][5];
}

PIEPER_NOINLINE Vec determinant(const double (*S)[9][8], Vec c, Vec s) {
  Vec M[6][6];
  const Vec product = reduced_matrix(S, c, s, M);
  return product * triangularise<false>(M, nullptr);
}

}  // namespace
