// Newton's method on the loop, one start per lane, and a damped version for starts that are not near enough.
#pragma once

#include "simd/general_6r/back_substitution.hpp"

namespace {

using pieper::GeneralArm;

constexpr double polished = 4e-15;  // residual [rad, lengths of the scaled arm] at which a lane is done
constexpr double acceptable = pieper::acceptable_residual;
// Residual below which a step that does not help is the last. Above, it may have gone through a fold, where the residual of
// the middle between two solutions is small and the way to either of them leads uphill.
constexpr double settled = 3e-14;
constexpr double longest_step = 0.3;  // rad

// Residual of the loop at the joints: position and rotation (first order), and by `J` its columns z x (p - o), z; those of a
// slide are z, 0.
struct Loop {
  Vec e[6], residual;
  Vec J[6][7];
  Vec pivot;  // the least one of J, where a step was made
};

// `G` is the target, 3x4.
PIEPER_INLINE void evaluate(const GeneralArm& arm, const double* G, const Joints& q, Loop& loop) {
  Vec X[3] = {splat(1.0), splat(0.0), splat(0.0)}, Y[3] = {splat(0.0), splat(1.0), splat(0.0)};
  Vec Z[3] = {splat(0.0), splat(0.0), splat(1.0)}, O[3] = {splat(0.0), splat(0.0), splat(0.0)};
  Vec origin[6][3];
  for (int i = 0; i < 6; ++i) {
    for (int r = 0; r < 3; ++r) origin[i][r] = O[r], loop.J[3 + r][i] = Z[r];
    Vec c = q.c[i], s = q.s[i];
    if (i == arm.slide) {
      for (int r = 0; r < 3; ++r) O[r] += s * Z[r];
      c = splat(arm.slide_cosine), s = splat(arm.slide_sine);
    }
    for (int r = 0; r < 3; ++r) {
      const Vec x = c * X[r] + s * Y[r];
      Y[r] = c * Y[r] - s * X[r], X[r] = x;
    }
    if (i == 5) break;
    const pieper::JointStep& step = arm.steps[i];
    for (int r = 0; r < 3; ++r) {
      O[r] += step.x * X[r] + step.y * Y[r] + step.z * Z[r];
      const Vec y = step.cos_twist * Y[r] + step.sin_twist * Z[r];
      Z[r] = step.cos_twist * Z[r] - step.sin_twist * Y[r], Y[r] = y;
    }
  }
  for (int i = 0; i < 6; ++i) {
    Vec d[3];
    for (int r = 0; r < 3; ++r) d[r] = O[r] - origin[i][r];
    const Vec z[3] = {loop.J[3][i], loop.J[4][i], loop.J[5][i]};
    loop.J[0][i] = z[1] * d[2] - z[2] * d[1], loop.J[1][i] = z[2] * d[0] - z[0] * d[2];
    loop.J[2][i] = z[0] * d[1] - z[1] * d[0];
    if (i == arm.slide)
      for (int r = 0; r < 3; ++r) loop.J[r][i] = z[r], loop.J[3 + r][i] = splat(0.0);
  }
  Vec turn[3] = {splat(0.0), splat(0.0), splat(0.0)}, trace = splat(0.0);
  const Vec* axes[3] = {X, Y, Z};
  for (int k = 0; k < 3; ++k) {
    const Vec* a = axes[k];
    const double g[3] = {G[k], G[4 + k], G[8 + k]};
    turn[0] += a[1] * g[2] - a[2] * g[1], turn[1] += a[2] * g[0] - a[0] * g[2], turn[2] += a[0] * g[1] - a[1] * g[0];
    trace += a[0] * g[0] + a[1] * g[1] + a[2] * g[2];
  }
  Vec square = splat(0.0);
  for (int r = 0; r < 3; ++r) {
    loop.e[r] = G[4 * r + 3] - O[r], loop.e[3 + r] = 0.5 * turn[r];
    square += loop.e[r] * loop.e[r] + loop.e[3 + r] * loop.e[3 + r];
  }
  // the first order is also zero for half a turn, where the trace is not 3
  const Vec residual = square_root(square);
  loop.residual = larger(residual, 3.0 - trace - 1e-14);
  loop.residual = select(loop.residual < 1e300, loop.residual, splat(1e300));  // not a number becomes large
}

// Moves the joints by small steps (at most longest_step).
PIEPER_INLINE void move_joints(int slide, Joints& q, const Vec* step) {
  for (int i = 0; i < 6; ++i) {
    if (i == slide) {
      q.s[i] += step[i];
      continue;
    }
    const Vec d = step[i], z = d * d;
    const Vec s = d * (1.0 + z * (-1.0 / 6 + z * (1.0 / 120 + z * (-1.0 / 5040 + z * (1.0 / 362880)))));
    const Vec c = 1.0 + z * (-0.5 + z * (1.0 / 24 + z * (-1.0 / 720 + z * (1.0 / 40320))));
    const Vec x = q.c[i] * c - q.s[i] * s, y = q.s[i] * c + q.c[i] * s;
    const Vec unit = 1.5 - 0.5 * (x * x + y * y);
    q.c[i] = x * unit, q.s[i] = y * unit;
  }
}

PIEPER_INLINE void limit_step(Vec* step) {
  Vec largest = splat(longest_step);
  for (int i = 0; i < 6; ++i) largest = larger(largest, magnitude(step[i]));
  const Vec factor = longest_step / largest;
  for (int i = 0; i < 6; ++i) step[i] = select(magnitude(step[i]) < 1e300, step[i] * factor, splat(0.0));
}

// J step = e by reflections.
PIEPER_INLINE void newton_step(Loop& loop, Vec* step) {
  Vec diagonal[6];
  for (int r = 0; r < 6; ++r) loop.J[r][6] = loop.e[r];
  for (int j = 0; j < 5; ++j) diagonal[j] = reflect<6, 7, true>(loop.J, j, j, j + 1, 7);
  diagonal[5] = loop.J[5][5];
  loop.pivot = magnitude(diagonal[0]);
  for (int j = 1; j < 6; ++j) loop.pivot = smaller(loop.pivot, magnitude(diagonal[j]));
  for (int i = 5; i >= 0; --i) {
    Vec x = loop.J[i][6];
    for (int j = i + 1; j < 6; ++j) x -= loop.J[i][j] * step[j];
    step[i] = x / select(magnitude(diagonal[i]) < 1e-14, with_sign(splat(1e-14), diagonal[i]), diagonal[i]);
  }
  limit_step(step);
}

// (J^T J + damping) step = J^T e by Cholesky's factorisation.
PIEPER_INLINE void damped_step(const Loop& loop, Vec damping, Vec* step) {
  Vec A[6][6];
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j <= i; ++j) {
      A[i][j] = i == j ? damping : splat(0.0);
      for (int r = 0; r < 6; ++r) A[i][j] += loop.J[r][i] * loop.J[r][j];
    }
    step[i] = splat(0.0);
    for (int r = 0; r < 6; ++r) step[i] += loop.J[r][i] * loop.e[r];
  }
  Vec inverse[6];
  for (int j = 0; j < 6; ++j) {
    Vec d = A[j][j];
    for (int k = 0; k < j; ++k) d -= A[j][k] * A[j][k];
    inverse[j] = 1.0 / square_root(larger(d, splat(1e-30)));
    for (int i = j + 1; i < 6; ++i) {
      for (int k = 0; k < j; ++k) A[i][j] -= A[i][k] * A[j][k];
      A[i][j] *= inverse[j];
    }
  }
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k < i; ++k) step[i] -= A[i][k] * step[k];
    step[i] *= inverse[i];
  }
  for (int i = 5; i >= 0; --i) {
    for (int k = i + 1; k < 6; ++k) step[i] -= A[k][i] * step[k];
    step[i] *= inverse[i];
  }
  limit_step(step);
}

// The same by reflections of J above the root of the damping: its condition is not squared.
PIEPER_INLINE void careful_step(const Loop& loop, Vec damping, Vec* step) {
  Vec A[12][7], diagonal[6];
  const Vec root = square_root(damping);
  for (int i = 0; i < 6; ++i) {
    for (int r = 0; r < 6; ++r) A[r][i] = loop.J[r][i], A[6 + r][i] = r == i ? root : splat(0.0);
    A[i][6] = loop.e[i], A[6 + i][6] = splat(0.0);
  }
  for (int j = 0; j < 6; ++j) diagonal[j] = reflect<12, 7, true>(A, j, j, j + 1, 7);
  for (int i = 5; i >= 0; --i) {
    Vec x = A[i][6];
    for (int j = i + 1; j < 6; ++j) x -= A[i][j] * step[j];
    step[i] = x / diagonal[i];
  }
  limit_step(step);
}

PIEPER_INLINE void keep_better(const Joints& from, Vec residual, Joints& best, Vec& best_residual) {
  const IntVec better = residual < best_residual;
  for (int i = 0; i < 6; ++i) {
    best.c[i] = select(better, from.c[i], best.c[i]), best.s[i] = select(better, from.s[i], best.s[i]);
  }
  best_residual = select(better, residual, best_residual);
}

// Newton steps until every lane of `valid` is done or has stopped to improve. The best joints and residual of each lane
// remain, and the least pivot of the last step. Returns the number of steps.
PIEPER_NOINLINE std::size_t newton(const GeneralArm& arm, const double* G, IntVec valid, Joints& q, Vec& residual,
                                   Vec& pivot, int most_steps) {
  Joints best = q;
  residual = splat(1e301);
  Vec before = splat(1e301);
  std::size_t steps = 0;
  for (;; ++steps) {
    Loop loop;
    evaluate(arm, G, q, loop);
    keep_better(q, loop.residual, best, residual);
    const IntVec stalled = (residual < settled) & (loop.residual > 0.5 * before);
    const bool done = static_cast<int>(steps) >= most_steps || !any(valid & none((residual < polished) | stalled));
    if (done && steps > 0) break;
    before = loop.residual;
    Vec step[6];
    newton_step(loop, step);
    pivot = loop.pivot;
    if (done) break;
    move_joints(arm.slide, q, step);
  }
  q = best;
  return steps;
}

// Levenberg and Marquardt's method.
PIEPER_NOINLINE std::size_t damped(const GeneralArm& arm, const double* G, IntVec valid, Joints& q, Vec& residual,
                                   int most_steps) {
  Loop loop;
  evaluate(arm, G, q, loop);
  residual = loop.residual;
  Vec damping = 1e-2 * smaller(residual, splat(1.0));
  std::size_t steps = 0;
  for (; static_cast<int>(steps) < most_steps && any(valid & (residual > acceptable)); ++steps) {
    Vec step[6];
    damped_step(loop, damping, step);
    Joints tried = q;
    move_joints(arm.slide, tried, step);
    Loop there;
    evaluate(arm, G, tried, there);
    const IntVec better = there.residual < residual;
    damping = select(better, larger(0.15 * damping, splat(1e-18)), smaller(6.0 * damping, splat(1e6)));
    keep_better(tried, there.residual, q, residual);
    for (int r = 0; r < 6; ++r) {
      loop.e[r] = select(better, there.e[r], loop.e[r]);
      for (int i = 0; i < 6; ++i) loop.J[r][i] = select(better, there.J[r][i], loop.J[r][i]);
    }
  }
  return steps;
}

// The same with Chan and Lawrence's damping by the residual, which takes every step: through long valleys, where a step that
// is an improvement is a short one.
PIEPER_NOINLINE void wander(const GeneralArm& arm, const double* G, IntVec valid, Joints& q, Vec& residual,
                            int most_steps) {
  Joints best = q;
  residual = splat(1e301);
  for (int steps = 0;; ++steps) {
    Loop loop;
    evaluate(arm, G, q, loop);
    keep_better(q, loop.residual, best, residual);
    if (steps == most_steps || !any(valid & (residual > acceptable))) break;
    Vec step[6];
    const Vec size = smaller(loop.residual, splat(1.0));
    careful_step(loop, larger(0.5 * size * size, splat(1e-26)), step);
    move_joints(arm.slide, q, step);
  }
  q = best;
}

}  // namespace
