// Inverse kinematics by damped least squares, one starting point per lane.
//
// Levenberg-Marquardt with the damping of Chan and Lawrence (1988), as Sugihara (2011) compares it: the step
// J^T (J J^T + lambda I)^-1 e with lambda proportional to the squared error. J J^T is 6 x 6 for any number of joints.
// Joints at a limit whose step would leave it are held (an active set of columns), and every step is clamped to the
// box. Lanes that stop getting nearer are given the next starting point. Starting points come from a table of poses: of
// each stratum of a page the entry nearest to the target, then a low-discrepancy sequence.
#pragma once

#include "pieper/numeric_ik.hpp"
#include "simd/jacobian.hpp"

namespace {

using pieper::NumericAnswer;
using pieper::NumericOptions;
using pieper::NumericStatus;
using pieper::RotationTarget;
using pieper::SearchSpace;
using pieper::TargetRows;

// Number of starting points that one page of the table gives, whatever the width of a vector.
constexpr std::size_t strata = 16;

inline Vec square_root(Vec value) {
#if PIEPER_LANES > 1
  Vec root;
  for (std::size_t l = 0; l < lanes; ++l) root[l] = __builtin_sqrt(value[l]);
  return root;
#else
  return std::sqrt(value);
#endif
}

inline bool get(IntVec mask, std::size_t l) {
#if PIEPER_LANES > 1
  return mask[l] != 0;
#else
  return (void)l, mask != 0;
#endif
}

inline void set(IntVec& mask, std::size_t l, bool value) {
#if PIEPER_LANES > 1
  mask[l] = -static_cast<std::int64_t>(value);
#else
  (void)l, mask = -static_cast<std::int64_t>(value);
#endif
}

inline Vec larger(Vec a, Vec b) { return select(a > b, a, b); }
inline Vec smaller(Vec a, Vec b) { return select(a < b, a, b); }

// The target in the form that the lanes use.
struct Goal {
  double R[9], p[3];
  double position_axes[9], rotation_axes[9];  // columns are the axes that the rows are taken along, in the base frame
  bool turn_position, turn_rotation;          // false where they are the base axes
  double weights[6];
  double direction[3], tool_axis[3];  // RotationTarget::axis
  RotationTarget rotation;
  bool part_of_rotation;  // some but not all components of the rotation vector
};

struct Errors {
  Vec rows[6];               // weighted
  Vec position2, rotation2;  // squared, not weighted
  Vec cost;                  // half the squared length of `rows`
};

using Columns = Vec[max_axes][6];

inline Goal goal_of(const double* target, const TargetRows& rows) {
  Goal goal{};
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) goal.R[3 * r + c] = target[4 * r + c];
    goal.p[r] = target[4 * r + 3];
    goal.weights[r] = rows.weights[r], goal.weights[r + 3] = rows.weights[r + 3];
  }
  goal.rotation = rows.rotation;
  goal.turn_position = rows.position_in_tool;
  goal.turn_rotation = rows.rotation_in_tool;
  for (int k = 0; k < 9; ++k) goal.position_axes[k] = goal.rotation_axes[k] = goal.R[k];
  if (rows.rotation == RotationTarget::free) goal.weights[3] = goal.weights[4] = goal.weights[5] = 0;
  if (rows.rotation == RotationTarget::axis) {
    double* d = goal.direction;
    for (int r = 0; r < 3; ++r) {
      goal.tool_axis[r] = rows.axis[r];
      d[r] = goal.R[3 * r] * rows.axis[0] + goal.R[3 * r + 1] * rows.axis[1] + goal.R[3 * r + 2] * rows.axis[2];
    }
    // two directions across it, so that turning about it has no row
    const int least = d[0] * d[0] < 0.3 ? 0 : d[1] * d[1] < 0.5 ? 1 : 2;
    double x[3] = {-d[0] * d[least], -d[1] * d[least], -d[2] * d[least]};
    x[least] += 1;
    const double size = std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    for (double& number : x) number /= size;
    double y[3];
    cross(d, x, y);
    for (int r = 0; r < 3; ++r) goal.rotation_axes[3 * r] = x[r], goal.rotation_axes[3 * r + 1] = y[r];
    goal.turn_rotation = true;
    goal.weights[4] = goal.weights[3], goal.weights[5] = 0;
  }
  goal.part_of_rotation =
      rows.rotation == RotationTarget::full && (goal.weights[3] == 0 || goal.weights[4] == 0 || goal.weights[5] == 0);
  return goal;
}

inline Vec dot(const Vec* a, const Vec* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// v = A^T v for a matrix of plain numbers
inline void along(const double* A, Vec* v) {
  const Vec a = v[0], b = v[1], c = v[2];
  for (int r = 0; r < 3; ++r) v[r] = A[r] * a + A[3 + r] * b + A[6 + r] * c;
}

// angle / sin(angle) from the cosine, as 2 atan(t) / t with t = tan(angle / 4); the polynomial for the arc tangent is
// Abramowitz and Stegun, 4.4.49, with its first coefficient set to 1 so that small angles are exact.
inline Vec angle_over_sine(Vec cosine) {
  const Vec half = square_root(larger(0.5 + 0.5 * cosine, splat(1e-30)));  // cos(angle / 2)
  const Vec x = (1.0 - half) / (1.0 + half);
  Vec p = splat(0.0028662257);
  p = p * x - 0.0161657367;
  p = p * x + 0.0429096138;
  p = p * x - 0.0752896400;
  p = p * x + 0.1065626393;
  p = p * x - 0.1420889944;
  p = p * x + 0.1999355085;
  p = p * x - 0.3333314528;
  p = p * x + 1.0;
  return 2.0 * p / (half * (1.0 + half));
}

// Turned by half a turn the cross products vanish; any axis that does it will do to move on.
inline void turn_back(Vec cosine, const Vec* direction, Vec* rotation) {
  const IntVec opposite = (cosine < -1.0 + 1e-9) & (dot(rotation, rotation) < 1e-12);
  if (!any(opposite)) return;
  for (int r = 0; r < 3; ++r) rotation[r] = select(opposite, 3.0 * direction[r], rotation[r]);
}

inline void rotation_error(const Goal& goal, const Pose<Vec>& tip, Vec* e) {
  Vec cosine = splat(0.0);
  for (int r = 0; r < 3; ++r) e[r] = splat(0.0);
  if (goal.rotation == RotationTarget::axis) {
    Vec a[3], d[3];
    for (int r = 0; r < 3; ++r) {
      a[r] = tip.x[r] * goal.tool_axis[0] + tip.y[r] * goal.tool_axis[1] + tip.z[r] * goal.tool_axis[2];
      d[r] = splat(goal.direction[r]);
    }
    cross(a, d, e);
    cosine = dot(a, d);
  } else {
    // R_target R^T = sum of t_k r_k^T over the columns; its antisymmetric part is half the sum of r_k x t_k
    const Vec* columns[3] = {tip.x, tip.y, tip.z};
    for (int k = 0; k < 3; ++k) {
      const Vec* a = columns[k];
      const double t[3] = {goal.R[k], goal.R[3 + k], goal.R[6 + k]};
      e[0] += 0.5 * (a[1] * t[2] - a[2] * t[1]);
      e[1] += 0.5 * (a[2] * t[0] - a[0] * t[2]);
      e[2] += 0.5 * (a[0] * t[1] - a[1] * t[0]);
      cosine += 0.5 * (a[0] * t[0] + a[1] * t[1] + a[2] * t[2]);
    }
    cosine -= 0.5;
  }
  const Vec scale = angle_over_sine(cosine);
  for (int r = 0; r < 3; ++r) e[r] *= scale;
  Vec across[3];
  for (int r = 0; r < 3; ++r) across[r] = splat(goal.rotation_axes[3 * r]);
  turn_back(cosine, across, e);
}

// Derivative of the rotation vector by a turn of the tip: the inverse right Jacobian of SO(3),
// I + [e]/2 + (1 - x cot x) / |e|^2 [e]^2 with x = |e| / 2; its last coefficient as a series.
inline void differentiate_rotation(const Vec* e, Vec* w) {
  const Vec square = dot(e, e);
  Vec c = splat(1.0 / 47900160);
  c = c * square + 1.0 / 1209600;
  c = c * square + 1.0 / 30240;
  c = c * square + 1.0 / 720;
  c = c * square + 1.0 / 12;
  Vec once[3], twice[3];
  cross(e, w, once);
  cross(e, once, twice);
  for (int r = 0; r < 3; ++r) w[r] += 0.5 * once[r] + c * twice[r];
}

// Errors of every lane, and the columns of the Jacobian of the rows.
inline Errors evaluate(const Folded& chain, const SearchSpace& space, const Goal& goal, const Vec* q,
                       Columns& columns) {
  const std::size_t m = chain.count, n = space.joints;
  Vec moved[max_axes];
  const Vec* angles = q;
  if (space.coupling) {
    for (std::size_t i = 0; i < m; ++i) {
      moved[i] = splat(0.0);
      for (std::size_t k = 0; k < n; ++k) moved[i] += space.coupling[i * n + k] * q[k];
    }
    angles = moved;
  }
  JointState<Vec> state;
  states_of_lanes(chain, chain.count, angles, state);
  Axes<Vec> axes;
  const Pose<Vec> tip = walk_with_axes(chain, state, axes);

  Errors errors;
  Vec position[3], rotation[3];
  for (int r = 0; r < 3; ++r) position[r] = goal.p[r] - tip.p[r], rotation[r] = splat(0.0);
  if (goal.rotation != RotationTarget::free) rotation_error(goal, tip, rotation);
  Vec whole[3] = {rotation[0], rotation[1], rotation[2]};
  if (goal.turn_position) along(goal.position_axes, position);
  if (goal.turn_rotation) along(goal.rotation_axes, rotation);
  errors.position2 = errors.rotation2 = errors.cost = splat(0.0);
  for (int r = 0; r < 3; ++r) {
    if (goal.weights[r] != 0) errors.position2 += position[r] * position[r];
    if (goal.weights[r + 3] != 0) errors.rotation2 += rotation[r] * rotation[r];
    errors.rows[r] = goal.weights[r] * position[r], errors.rows[r + 3] = goal.weights[r + 3] * rotation[r];
  }
  for (int r = 0; r < 6; ++r) errors.cost += 0.5 * errors.rows[r] * errors.rows[r];

  if (space.coupling)
    for (std::size_t k = 0; k < n; ++k)
      for (int r = 0; r < 6; ++r) columns[k][r] = splat(0.0);
  for (std::size_t i = 0; i < m; ++i) {
    Vec six[6];
    column(chain, tip, axes, i, pieper::JacobianKind::geometric, six);
    if (goal.part_of_rotation) differentiate_rotation(whole, six + 3);
    if (goal.turn_position) along(goal.position_axes, six);
    if (goal.turn_rotation) along(goal.rotation_axes, six + 3);
    for (int r = 0; r < 6; ++r) six[r] *= goal.weights[r];
    if (space.coupling) {
      for (std::size_t k = 0; k < n; ++k) {
        const double factor = space.coupling[i * n + k];
        if (factor != 0)
          for (int r = 0; r < 6; ++r) columns[k][r] += factor * six[r];
      }
    } else {
      for (int r = 0; r < 6; ++r) columns[i][r] = six[r];
    }
  }
  return errors;
}

// Columns of joints that stand at a limit and would be pushed out of the box are set to zero.
inline void hold_at_limits(const SearchSpace& space, const Vec* q, const Errors& errors, Columns& columns) {
  for (std::size_t i = 0; i < space.joints; ++i) {
    const double lower = space.lower[i], upper = space.upper[i];
    const IntVec at_lower = q[i] <= lower, at_upper = q[i] >= upper;
    if (!any(at_lower | at_upper)) continue;
    Vec pull = splat(0.0);
    for (int r = 0; r < 6; ++r) pull += columns[i][r] * errors.rows[r];
    const IntVec held = (at_lower & (pull < 0.0)) | (at_upper & (pull > 0.0));
    for (int r = 0; r < 6; ++r) columns[i][r] = select(held, splat(0.0), columns[i][r]);
  }
}

// The damped step, J^T (J J^T + damping I)^-1 e, by a factorisation L D L^T in every lane.
inline void damped_step(const Columns& columns, std::size_t n, const Vec* e, Vec damping, Vec* step) {
  Vec A[6][6];
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c <= r; ++c) A[r][c] = columns[0][r] * columns[0][c];
  for (std::size_t i = 1; i < n; ++i)
    for (int r = 0; r < 6; ++r)
      for (int c = 0; c <= r; ++c) A[r][c] += columns[i][r] * columns[i][c];
  Vec y[6], inverse[6];
  for (int r = 0; r < 6; ++r) A[r][r] += damping, y[r] = e[r];
  for (int k = 0; k < 6; ++k) {
    inverse[k] = 1.0 / A[k][k];
    for (int r = k + 1; r < 6; ++r) {
      const Vec factor = A[r][k] * inverse[k];
      for (int c = k + 1; c <= r; ++c) A[r][c] -= factor * A[c][k];
      y[r] -= factor * y[k];
    }
  }
  for (int k = 5; k >= 0; --k) {
    for (int r = k + 1; r < 6; ++r) y[k] -= A[r][k] * y[r];
    y[k] *= inverse[k];
  }
  for (std::size_t i = 0; i < n; ++i) {
    step[i] = splat(0.0);
    for (int r = 0; r < 6; ++r) step[i] += columns[i][r] * y[r];
  }
}

constexpr double least_damping = 1e-18;
constexpr double longest_step = 1.0;  // rad or m, of one joint

// q + step, shortened as a whole to the longest step allowed, and clamped to the box.
inline void move(const SearchSpace& space, const Vec* step, Vec* q) {
  const std::size_t n = space.joints;
  Vec longest = splat(longest_step);
  for (std::size_t i = 0; i < n; ++i) longest = larger(longest, magnitude(step[i]));
  const Vec scale = longest_step / longest;
  for (std::size_t i = 0; i < n; ++i)
    q[i] = larger(smaller(q[i] + scale * step[i], splat(space.upper[i])), splat(space.lower[i]));
}

// Starting points for one target, in the order in which they are tried.
class Starts {
 public:
  Starts(const SearchSpace& space, const Goal& goal, const double* seed) : space_(space), goal_(goal), seed_(seed) {}

  // Writes the next starting point into lane l of q.
  void next(std::size_t l, Vec* q) {
    const std::size_t n = space_.joints;
    if (seed_) {
      for (std::size_t i = 0; i < n; ++i) lane(q[i], l) = seed_[i];
      seed_ = nullptr;
      return;
    }
    if (at_ == strata && page_ < space_.pages) read_page();
    if (at_ < strata) {
      const double* start = space_.starts + n * order_[at_++];
      for (std::size_t i = 0; i < n; ++i) lane(q[i], l) = start[i];
      return;
    }
    ++beyond_;
    for (std::size_t i = 0; i < n; ++i) {
      double part = 0.5 + static_cast<double>(space_.pages * space_.entries + beyond_) * space_.steps[i];
      part -= std::floor(part);
      lane(q[i], l) = space_.first[i] + part * (space_.last[i] - space_.first[i]);
    }
  }

 private:
  // The nearest entry of every stratum of the next page, the nearest of all first.
  void read_page() {
    constexpr std::size_t width = strata / lanes;
    Vec best[width], where[width];
    for (std::size_t w = 0; w < width; ++w) best[w] = splat(1e300), where[w] = splat(0.0);
    double weight_p = 0, turn[9] = {};
    for (int r = 0; r < 3; ++r) weight_p += goal_.weights[r] * goal_.weights[r] / 3;
    if (goal_.rotation == RotationTarget::full) {
      const double weight = (goal_.weights[3] + goal_.weights[4] + goal_.weights[5]) / 3;
      if (!goal_.part_of_rotation)
        for (int k = 0; k < 9; ++k) turn[k] = weight * weight * goal_.R[k];
    } else if (goal_.rotation == RotationTarget::axis) {
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
          turn[3 * r + c] = 2 * goal_.weights[3] * goal_.weights[3] * goal_.direction[r] * goal_.tool_axis[c];
    }
    const std::size_t entries = space_.entries;
    const double* page = space_.poses + page_ * 12 * entries;
    for (std::size_t k = 0; k < entries; k += strata)
      for (std::size_t w = 0; w < width; ++w) {
        const double* from = page + k + w * lanes;
        const Vec x = load(from) - goal_.p[0], y = load(from + entries) - goal_.p[1],
                  z = load(from + 2 * entries) - goal_.p[2];
        Vec score = weight_p * (x * x + y * y + z * z);
        for (std::size_t j = 0; j < 9; ++j) score -= turn[j] * load(from + (3 + j) * entries);
        const IntVec nearer = score < best[w];
        best[w] = select(nearer, score, best[w]);
        where[w] = select(nearer, splat(static_cast<double>(k + w * lanes)), where[w]);
      }
    double scores[strata];
    for (std::size_t w = 0; w < width; ++w)
      for (std::size_t l = 0; l < lanes; ++l) {
        const double score = lane(best[w], l);
        const std::size_t entry = page_ * entries + static_cast<std::size_t>(lane(where[w], l)) + l;
        std::size_t k = w * lanes + l;
        for (; k > 0 && scores[k - 1] > score; --k) scores[k] = scores[k - 1], order_[k] = order_[k - 1];
        scores[k] = score, order_[k] = entry;
      }
    ++page_, at_ = 0;
  }

  const SearchSpace& space_;
  const Goal& goal_;
  const double* seed_;
  std::size_t order_[strata];
  std::size_t at_ = strata, page_ = 0, beyond_ = 0;
};

// One target. Every lane iterates from its own starting point and remembers the nearest it came.
class NumericSolver {
 public:
  NumericSolver(const Folded& chain, const SearchSpace& space, const TargetRows& rows, const NumericOptions& options,
                const double* target, const double* seed, NumericAnswer& answer)
      : chain_(chain),
        space_(space),
        options_(options),
        answer_(answer),
        goal_(goal_of(target, rows)),
        starts_(space, goal_, seed),
        position2_(options.position_tolerance * options.position_tolerance),
        rotation2_(options.rotation_tolerance * options.rotation_tolerance),
        seed_alone_(seed != nullptr) {}

  void run() {
    restart(0);  // a given seed is tried alone, so that a solution near it wins
    if (!seed_alone_) fill_lanes();
    while (living_ > 0 && answer_.found < options_.count) {
      const Errors errors = evaluate(chain_, space_, goal_, q_, columns_);
      ++answer_.steps;
      const IntVec leave = judge(errors);
      hold_at_limits(space_, q_, errors, columns_);
      Vec step[max_axes];
      damped_step(columns_, space_.joints, errors.rows, damping_factor * errors.cost + least_damping, step);
      move(space_, step, q_);
      if (any(leave)) replace(leave);
    }
    if (answer_.found > 0) return;
    double nearest = 1e300;
    for (Near& near : near_) {
      if (near.cost == 1e300) break;
      const NumericStatus status = settle(near);
      if (near.cost >= nearest) continue;
      nearest = near.cost, answer_.status = status;
      for (std::size_t i = 0; i < space_.joints; ++i) answer_.nearest[i] = near.q[i];
    }
  }

 private:
  // Gives a lane its next starting point, or lets it idle when there are none left.
  void restart(std::size_t l) {
    const bool start = answer_.starts < options_.restarts;
    if (start) starts_.next(l, q_), ++answer_.starts;
    if (start && !get(alive_, l)) ++living_;
    if (!start && get(alive_, l)) --living_;
    set(alive_, l, start), set(arrived_, l, false);
    lane(age_, l) = lane(slow_, l) = 0, lane(mark_, l) = lane(best_cost_, l) = 1e300;
  }

  void fill_lanes() {
    seed_alone_ = false;
    for (std::size_t l = 0; l < lanes; ++l)
      if (!get(alive_, l)) restart(l);
  }

  // Keeps the books, and tells the lanes that are done: those that have arrived and made one more step to take the last
  // digits along, those that no longer get nearer, and those that have had their time.
  IntVec judge(const Errors& errors) {
    const IntVec meets = (errors.position2 <= position2_) & (errors.rotation2 <= rotation2_);
    const IntVec better = (meets & ~arrived_) | ((errors.cost < best_cost_) & (meets | ~arrived_));
    best_cost_ = select(better, errors.cost, best_cost_);
    for (std::size_t i = 0; i < space_.joints; ++i) best_[i] = select(better, q_[i], best_[i]);

    const IntVec nearer = errors.cost < worth_going_on * mark_;
    mark_ = select(nearer, errors.cost, mark_);
    slow_ = select(nearer, splat(0.0), slow_ + 1.0);
    age_ += 1.0;
    const IntVec stuck = (slow_ >= patience) | (age_ >= static_cast<double>(options_.iterations));
    const IntVec done = arrived_;
    arrived_ |= meets;
    return alive_ & (done | (stuck & ~arrived_));
  }

  void replace(IntVec leave) {
    for (std::size_t l = 0; l < lanes; ++l) {
      if (!get(leave, l)) continue;
      if (get(arrived_, l)) {
        collect(l);
      } else {
        remember(l);
      }
      if (answer_.found == options_.count) return;
      restart(l);
    }
    if (seed_alone_) fill_lanes();
  }

  // Keeps the nearest point of a lane that did not arrive, if it is among the nearest few.
  void remember(std::size_t l) {
    const double cost = lane(best_cost_, l);
    std::size_t k = kept;
    for (; k > 0 && cost < near_[k - 1].cost; --k)
      if (k < kept) near_[k] = near_[k - 1];
    if (k == kept) return;
    near_[k].cost = cost;
    for (std::size_t i = 0; i < space_.joints; ++i) near_[k].q[i] = lane(best_[i], l);
  }

  // Takes the solution of a lane unless it is already there.
  void collect(std::size_t l) {
    const std::size_t n = space_.joints;
    for (std::size_t s = 0; s < answer_.found; ++s) {
      double farthest = 0;
      for (std::size_t i = 0; i < n; ++i) {
        double difference = std::fabs(lane(best_[i], l) - answer_.solutions[s * n + i]);
        if (space_.turns[i]) difference = std::fabs(std::remainder(difference, 6.283185307179586));
        if (difference > farthest) farthest = difference;
      }
      if (farthest <= options_.distinct) return;
    }
    double* to = answer_.solutions + answer_.found * n;
    for (std::size_t i = 0; i < n; ++i) to[i] = lane(best_[i], l);
    ++answer_.found;
  }

  struct Near {
    double cost = 1e300;
    double q[max_axes];
  };

  // The best lane of `tried`, kept in `near` when it is nearer; returns its number, or `lanes` when none is.
  std::size_t improve(Near& near, const Vec* tried) {
    Vec costs = evaluate(chain_, space_, goal_, tried, columns_).cost;
    ++answer_.steps;
    std::size_t winner = 0;
    for (std::size_t l = 1; l < lanes; ++l)
      if (lane(costs, l) < lane(costs, winner)) winner = l;
    if (!(lane(costs, winner) < near.cost)) return lanes;
    near.cost = lane(costs, winner);
    for (std::size_t i = 0; i < space_.joints; ++i) {
      Vec joint = tried[i];
      near.q[i] = lane(joint, winner);
    }
    return winner;
  }

  // Goes on from a point until it gets no nearer. Each lane tries another damping, a factor of eight apart, and the best of
  // them is taken; then each lane tries to leap further the same way, since far from a solution damped steps come too short.
  NumericStatus settle(Near& near) {
    const std::size_t n = space_.joints;
    Vec ladder = splat(1.0), leaps = splat(1.0);
    for (std::size_t l = 0; l < lanes; ++l)
      for (std::size_t k = 0; k < l; ++k) lane(ladder, l) *= 0.125, lane(leaps, l) *= 3;
    double damping = near.cost;
    std::size_t idle = 0;
    for (int k = 0; k < settle_steps && idle < 4; ++k) {
      const Near from = near;
      for (std::size_t i = 0; i < n; ++i) q_[i] = splat(from.q[i]);
      const Errors here = evaluate(chain_, space_, goal_, q_, columns_);
      ++answer_.steps;
      hold_at_limits(space_, q_, here, columns_);
      Vec step[max_axes];
      damped_step(columns_, n, here.rows, damping * ladder + least_damping, step);
      move(space_, step, q_);
      const std::size_t winner = improve(near, q_);
      if (winner == lanes) {
        damping *= 32;
      } else {
        damping *= lane(ladder, winner) * (lanes > 1 ? 8 : 0.25);
        for (std::size_t i = 0; i < n; ++i) q_[i] = splat(near.q[i]), step[i] = leaps * (near.q[i] - from.q[i]);
        move(space_, step, q_);
        improve(near, q_);
      }
      idle = near.cost < from.cost * (1 - worth_settling) ? 0 : idle + 1;
    }
    if (near.cost < almost_there) cut_across(near);
    return idle > 0 ? NumericStatus::unreachable : NumericStatus::not_converged;
  }

  // At a singular pose the valley of the error is narrow and bent, and steps that must get nearer creep along it. Plain
  // Newton steps may get farther first, and then arrive.
  void cut_across(Near& near) {
    const std::size_t n = space_.joints;
    for (std::size_t i = 0; i < n; ++i) q_[i] = splat(near.q[i]);
    for (int k = 0; k < newton_steps && near.cost > rounding; ++k) {
      Errors here = evaluate(chain_, space_, goal_, q_, columns_);
      ++answer_.steps;
      if (lane(here.cost, 0) < near.cost) {
        near.cost = lane(here.cost, 0);
        for (std::size_t i = 0; i < n; ++i) near.q[i] = lane(q_[i], 0);
      }
      hold_at_limits(space_, q_, here, columns_);
      Vec step[max_axes];
      damped_step(columns_, n, here.rows, splat(least_damping), step);
      move(space_, step, q_);
    }
  }

  static constexpr double damping_factor = 0.2;
  static constexpr double worth_going_on = 0.5;  // of the squared error that was left
  static constexpr double patience = 5;          // steps that may go by without it
  static constexpr int settle_steps = 400;
  static constexpr double almost_there = 1e-10;  // half the squared error below which a solution is likely
  static constexpr int newton_steps = 200;
  static constexpr double rounding = 1e-28;        // half the squared error that is left at the end of the digits
  static constexpr double worth_settling = 1e-10;  // of the squared error, in one step

  const Folded& chain_;
  const SearchSpace& space_;
  const NumericOptions& options_;
  NumericAnswer& answer_;
  const Goal goal_;
  Starts starts_;
  const double position2_, rotation2_;
  bool seed_alone_;
  Vec q_[max_axes]{}, best_[max_axes]{};
  Columns columns_;
  Vec age_{}, slow_{}, mark_{}, best_cost_{};
  IntVec alive_{}, arrived_{};
  std::size_t living_ = 0;
  static constexpr std::size_t kept = 4;
  Near near_[kept];
};

void solve_numeric_target(const Folded& chain, const SearchSpace& space, const TargetRows& rows,
                          const NumericOptions& options, const double* target, const double* seed,
                          NumericAnswer& answer) {
  NumericSolver(chain, space, rows, options, target, seed, answer).run();
  if (answer.found > 0) answer.status = NumericStatus::reached;
}

}  // namespace
