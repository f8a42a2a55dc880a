// The general solver around its kernels: the forms in the order of their use, and what to do when one says that something
// went wrong. What it knows of an arm is made in general_6r/.
#include "pieper/general_6r.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>

#include "general_6r/motion.hpp"
#include "general_6r/sequence.hpp"
#include "general_6r/singular_value.hpp"
#include "general_6r/solution_set.hpp"
#include "general_6r/tables.hpp"
#include "pieper/kernels.hpp"
#include "simd/general_6r/line_numbers.hpp"
#include "workers.hpp"

namespace pieper {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double nearly_vanishing = 1e-13;  // median noise of a form that cannot say that there is nothing

}  // namespace

struct General6R::Scratch {
  FormResult form, partners;
};

bool General6R::fits(const Chain& chain) {
  if (chain.coupled() || chain.axes() != 6) return false;
  int slides = 0;
  for (std::size_t i = 0; i < 6; ++i) slides += slides_along(chain.screw(i));
  return slides <= 1;
}

General6R::General6R(const Chain& chain) : chain_(chain) {
  set_frames();
  for (const JointStep& step : arm_.steps) reach_ += std::hypot(step.x, step.y, step.z);
  constexpr double rounding = 1e-9;
  reach_ = arm_.slide < 0 ? reach_ * (1 + rounding) : std::numeric_limits<double>::infinity();
  set_forms();
  measure_support();
  choose_forms();
}

void General6R::draw_joints(Sequence& numbers, double* c, double* s) const {
  for (int i = 0; i < 6; ++i) {
    if (i == arm_.slide) {
      c[i] = 0, s[i] = numbers.between(slide_low_, slide_high_);
      continue;
    }
    const double q = numbers.between(-pi, pi);
    c[i] = std::cos(q), s[i] = std::sin(q);
  }
}

bool General6R::add_fold_partners(const double* G, Scratch& scratch, SolutionSet& set) const {
  constexpr double nearly_singular = 1e-4, on_a_curve = 3e-9;  // least singular value of the Jacobian
  constexpr double rounding = 4e-14, most_uncertain = 3e-2;
  constexpr double distances[] = {1e-3, -1e-3, 2e-2, -2e-2};
  constexpr Refinement to_a_double_root{0, 24, acceptable_residual, false};
  FormResult& starts = scratch.partners;
  starts.count = 0;
  for (std::size_t k = 0; k < set.count && starts.count + 4 <= most_starts; ++k) {
    double direction[6];
    const double least = least_singular_value(arm_, set.c[k], set.s[k], direction);
    if (least > nearly_singular) continue;
    for (double distance : distances) {
      const std::size_t at = starts.count++;
      for (int i = 0; i < 6; ++i) {
        const double d = distance * direction[i];
        const bool slides = i == arm_.slide;
        starts.cosine[i][at] = slides ? 0 : set.c[k][i] * std::cos(d) - set.s[k][i] * std::sin(d);
        starts.sine[i][at] = slides ? set.s[k][i] + d : set.s[k][i] * std::cos(d) + set.c[k][i] * std::sin(d);
      }
    }
  }
  if (starts.count == 0) return false;
  kernels().general->refine(arm_, G, to_a_double_root, starts);
  for (std::size_t k = 0; k < starts.count; ++k) {
    double c[6], s[6], direction[6];
    for (int i = 0; i < 6; ++i) c[i] = starts.cosine[i][k], s[i] = starts.sine[i][k];
    // as far as rounding lets it slide along a flat valley, it is the solution that it comes from
    const double uncertain = rounding / std::max(least_singular_value(arm_, c, s, direction), 1e-12);
    set.add(starts, k, std::clamp(uncertain, same_solution, most_uncertain));
  }
  double direction[6];
  for (std::size_t k = 0; k < set.count; ++k)
    if (least_singular_value(arm_, set.c[k], set.s[k], direction) < on_a_curve) return true;
  return false;
}

bool General6R::run_form(int form, const double* G, Scratch& scratch, SolutionSet& set, unsigned& flags) const {
  kernels().general->solve_form(trigonometric_tables(), arm_, arm_.forms[form], G, scratch.form);
  flags = scratch.form.flags;
  const std::size_t before = set.count;
  set.add_all(scratch.form, same_solution);
  if ((flags & flag_near_fold) && add_fold_partners(G, scratch, set)) flags |= flag_singular;
  // solutions come in pairs, and simple roots have one each; two roots must not have led to the same
  if (before == 0 && (set.count % 2 != 0 || set.count < scratch.form.simple_roots)) flags |= flag_lost;
  // next to an arm that cannot reach all of space rounding may lift a double root off zero
  if (set.count == 0 && reports_[form].median_tail > nearly_vanishing) return false;
  if (!(flags & flag_hard)) return !(flags & flag_some_requests) || (set.count > 0 && !(flags & flag_near_twins));
  // a form whose roots always coincide (spherical wrists) has doubts at every pose: what counts is that it agrees
  if (before == 0 || set.count != before || reports_[form].flagged < always_doubtful) return false;
  SolutionSet own;
  own.add_all(scratch.form, same_solution);
  if (flags & flag_near_fold) add_fold_partners(G, scratch, own);
  return own.count == before;
}

// For targets at which every form degenerates: targets nearby, and their solutions continued to the true one.
void General6R::last_resort(const double* G, Scratch& scratch, SolutionSet& set) const {
  constexpr double sizes[] = {1e-3, 1e-2, 3e-3, 3e-2, 1e-4, 1e-2, 1e-3, 5e-2};
  constexpr int most_idle = 2, most_batches = 8, patient_from = 4;
  constexpr std::size_t patient_starts = 8;
  constexpr double last_tolerance = 8e-10;  // m and rad: within what answers promise
  const Refinement quick{60, 12, acceptable_residual, false};
  const Refinement patient{300, 4, last_tolerance / std::max(scale_, 1.0), true};
  Sequence numbers(3);
  Motion target;
  std::copy_n(G, 12, target.begin());
  int idle = 0;
  for (int k = 0; k < 8 && !(idle >= most_idle && k >= 3); ++k) {
    double twist[6];
    for (double& value : twist) value = sizes[k] * numbers.between(-1, 1);
    const Motion displaced = small_motion(twist) * target;
    std::size_t added = 0;
    for (int form : order_) {
      if (form != order_[0] && set.count > 0 && reports_[form].flagged >= always_doubtful) continue;
      kernels().general->solve_form(trigonometric_tables(), arm_, arm_.forms[form], displaced.data(), scratch.form);
      const unsigned flags = scratch.form.flags;
      kernels().general->refine(arm_, G, quick, scratch.form);
      added += set.add_all(scratch.form, same_after_resort);
      if (!(flags & flag_hard)) break;
    }
    idle = added ? 0 : idle + 1;
  }
  // where nothing was found, and where there is no second form to confirm what was
  const int least_batches = order_.size() == 1 ? 2 : 0;
  for (int batch = 0; batch < least_batches || (batch < most_batches && set.count == 0); ++batch) {
    scratch.form.count = batch < patient_from ? most_starts : patient_starts;
    for (std::size_t k = 0; k < scratch.form.count; ++k) {
      double c[6], s[6];
      draw_joints(numbers, c, s);
      for (int i = 0; i < 6; ++i) scratch.form.cosine[i][k] = c[i], scratch.form.sine[i][k] = s[i];
    }
    // long valleys: axes that are nearly parallel or coincident
    kernels().general->refine(arm_, G, batch < patient_from ? quick : patient, scratch.form);
    set.add_all(scratch.form, same_after_resort);
  }
}

void General6R::solve_one(const double* target, GeneralMode mode, int only_form, Scratch& scratch,
                          const GeneralResults& out, std::size_t k) const {
  double G[12];
  normalise_target(target, G);
  SolutionSet set;
  unsigned flags = 0;
  if (only_form >= 0) {
    run_form(only_form, G, scratch, set, flags);
    out.flags[k] = static_cast<int>(flags);
    return write(target, set, out, k);
  }
  if (G[3] * G[3] + G[7] * G[7] + G[11] * G[11] > reach_ * reach_) {
    out.flags[k] = 0;
    return write(target, set, out, k);
  }
  bool trusted = run_form(order_[0], G, scratch, set, flags) && dependable_;
  out.flags[k] = static_cast<int>(flags);
  // a pose at which axes lie in a row may slip by one form: a second one has to agree that there is nothing
  constexpr double rarely = 0.02;
  if (trusted && set.count == 0 && mode != GeneralMode::fast && order_.size() > 1 &&
      reports_[order_[1]].flagged < rarely)
    trusted = run_form(order_[1], G, scratch, set, flags) && set.count == 0;
  unsigned seen = flags | static_cast<unsigned>(out.flags[k]);
  const bool shared = (flags & flag_third) != 0;  // not to be settled by a form that always has doubts
  const bool again =
      !trusted || mode == GeneralMode::complete || (mode == GeneralMode::checked && (flags & unclear_) != 0);
  if (again && order_.size() > 1) {
    const bool second = run_form(order_[1], G, scratch, set, flags);
    seen |= flags;
    out.flags[k] |= solve_second_form | static_cast<int>(flags & flag_singular);
    trusted = trusted || (second && dependable_ && !(shared && (flags & flag_hard)));
    if (!trusted && order_.size() > 2) {
      trusted = run_form(order_[2], G, scratch, set, flags) && dependable_ && !(shared && (flags & flag_hard));
      out.flags[k] |= solve_third_form | static_cast<int>(flags & flag_singular);
    }
  }
  // two solutions at one angle, of which none arrived
  if (mode != GeneralMode::fast && set.count == 0 && (seen & flag_twins)) trusted = false;
  if (!trusted) {
    out.flags[k] |= solve_doubtful | solve_last_resort;
    last_resort(G, scratch, set);
    if (add_fold_partners(G, scratch, set)) out.flags[k] |= static_cast<int>(flag_singular);
  }
  if (out.flags[k] & static_cast<int>(flag_singular)) out.flags[k] |= solve_doubtful;
  set.keep_most_regular(arm_);
  write(target, set, out, k);
}

// Angles of the true arm, and how well they do at the true target.
void General6R::write(const double* target, const SolutionSet& set, const GeneralResults& out, std::size_t k) const {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  double* q = out.q + k * most_solutions * 6;
  const std::size_t count = std::min(set.count, most_solutions);
  double angles[most_solutions * 6 + 8];
  kernels().general->angles(set.c[0], set.s[0], 6 * count, angles);
  std::array<double, 6> rows[most_solutions];
  for (std::size_t j = 0; j < count; ++j)
    for (int i = 0; i < 6; ++i) {
      if (i == arm_.slide) {
        rows[j][i] = set.s[j][i] * scale_;
        continue;
      }
      double angle = angles[6 * j + i] - offset_[i];
      if (angle > pi) angle -= 2 * pi;
      if (angle <= -pi) angle += 2 * pi;
      rows[j][i] = angle;
    }
  std::sort(rows, rows + count);
  for (std::size_t j = 0; j < count; ++j) std::copy_n(rows[j].begin(), 6, q + 6 * j);
  std::fill(q + 6 * count, q + 6 * most_solutions, nan);
  double poses[most_solutions * 16];
  if (count > 0) forward_kinematics(chain_, q, count, 1, poses);
  for (std::size_t j = 0; j < most_solutions; ++j) {
    const std::size_t at = k * most_solutions + j;
    out.valid[at] = j < count;
    out.position_error[at] = out.rotation_error[at] = nan;
    if (j >= count) continue;
    const double* T = poses + 16 * j;
    double turn[3] = {0, 0, 0}, square = 0;
    for (int c = 0; c < 3; ++c) {
      const double a[3] = {T[c], T[4 + c], T[8 + c]}, b[3] = {target[c], target[4 + c], target[8 + c]};
      double part[3];
      cross_product(a, b, part);
      for (int r = 0; r < 3; ++r) turn[r] += 0.5 * part[r];
    }
    for (int r = 0; r < 3; ++r) square += (T[4 * r + 3] - target[4 * r + 3]) * (T[4 * r + 3] - target[4 * r + 3]);
    out.position_error[at] = std::sqrt(square);
    out.rotation_error[at] = std::sqrt(dot_product(turn, turn));  // small: the solver has excluded half turns
  }
}

void General6R::solve(const double* targets, std::size_t count, GeneralMode mode, std::size_t threads,
                      const GeneralResults& out) const {
  const std::size_t workers = std::min(std::max<std::size_t>(threads, 1), std::max<std::size_t>(count / 64, 1));
  // some targets take a hundred times longer than others, so workers fetch a few at a time
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    Scratch scratch;
    for (std::size_t first; (first = next.fetch_add(16)) < count;)
      for (std::size_t k = first; k < std::min(first + 16, count); ++k)
        solve_one(targets + 16 * k, mode, -1, scratch, out, k);
  };
  Workers others;
  for (std::size_t w = 1; w < workers; ++w) others.start(work);
  work();
}

void General6R::solve_one_form(int form, const double* targets, std::size_t count, const GeneralResults& out) const {
  Scratch scratch;
  for (std::size_t k = 0; k < count; ++k) solve_one(targets + 16 * k, GeneralMode::fast, form, scratch, out, k);
}

}  // namespace pieper
