// Inverse kinematics by damped least squares, one starting point per lane.
//
// Levenberg-Marquardt with the damping of Chan and Lawrence (1988), as Sugihara (2011) compares it: the step
// J^T (J J^T + lambda I)^-1 e with lambda proportional to the squared error. J J^T is 6 x 6 for any number of joints.
// Joints at a limit whose step would leave it are held (an active set of columns), and every step is clamped to the
// box. Lanes that stop getting nearer are given the next starting point.
#pragma once

#include "simd/starts.hpp"

namespace {

using pieper::NumericAnswer;
using pieper::NumericOptions;
using pieper::NumericStatus;

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

// q + step, shortened as a whole until no joint goes beyond its longest step, and clamped to the box.
inline void move(const SearchSpace& space, const Vec* step, Vec* q) {
  const std::size_t n = space.joints;
  Vec excess = splat(1.0);
  for (std::size_t i = 0; i < n; ++i) excess = larger(excess, magnitude(step[i]) / space.longest_step[i]);
  const Vec scale = 1.0 / excess;
  for (std::size_t i = 0; i < n; ++i)
    q[i] = larger(smaller(q[i] + scale * step[i], splat(space.upper[i])), splat(space.lower[i]));
}

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
  // Eight are tried in any case, so that every instruction set gets as near: by fewer lanes one after the other.
  NumericStatus settle(Near& near) {
    const std::size_t n = space_.joints;
    Vec ladder[goes], leaps[goes];
    double rung = 1, leap = 1;
    for (std::size_t g = 0; g < goes; ++g)
      for (std::size_t l = 0; l < lanes; ++l, rung *= 0.125, leap *= 3)
        lane(ladder[g], l) = rung, lane(leaps[g], l) = leap;
    double damping = near.cost;
    std::size_t idle = 0;
    for (int k = 0; k < settle_steps && idle < 4; ++k) {
      const Near from = near;
      for (std::size_t i = 0; i < n; ++i) q_[i] = splat(from.q[i]);
      const Errors here = evaluate(chain_, space_, goal_, q_, columns_);
      ++answer_.steps;
      hold_at_limits(space_, q_, here, columns_);
      Vec step[goes][max_axes], tried[max_axes];
      for (std::size_t g = 0; g < goes; ++g)
        damped_step(columns_, n, here.rows, damping * ladder[g] + least_damping, step[g]);
      double won = 0;
      for (std::size_t g = 0; g < goes; ++g) {
        for (std::size_t i = 0; i < n; ++i) tried[i] = q_[i];
        move(space_, step[g], tried);
        const std::size_t winner = improve(near, tried);
        if (winner != lanes) won = lane(ladder[g], winner);
      }
      if (won == 0) {
        damping *= 32;
      } else {
        damping *= won * 8;
        const Near first = near;
        for (std::size_t g = 0; g < goes; ++g) {
          for (std::size_t i = 0; i < n; ++i)
            tried[i] = splat(first.q[i]), step[g][i] = leaps[g] * (first.q[i] - from.q[i]);
          move(space_, step[g], tried);
          improve(near, tried);
        }
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
  static constexpr int settle_steps = 1000;
  static constexpr std::size_t goes = 8 / lanes;  // so that every instruction set tries as many dampings
  static constexpr double almost_there = 1e-10;   // half the squared error below which a solution is likely
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
