// Numeric inverse kinematics of a batch: sets out the work, and measures what comes back at the true pose.
#include "pieper/numeric_ik.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "pieper/kernels.hpp"
#include "pieper/search_table.hpp"
#include "workers.hpp"

namespace pieper {

PoseError pose_error(const double* target, const double* pose, const TargetRows& rows) {
  double p[3], w[3] = {0, 0, 0};
  const auto R = [&](const double* T, int r, int c) { return T[4 * r + c]; };
  for (int r = 0; r < 3; ++r) p[r] = R(target, r, 3) - R(pose, r, 3);
  const auto in_tool = [&](double* v) {
    double turned[3];
    for (int r = 0; r < 3; ++r) turned[r] = R(target, 0, r) * v[0] + R(target, 1, r) * v[1] + R(target, 2, r) * v[2];
    std::copy(turned, turned + 3, v);
  };
  double sine[3] = {0, 0, 0}, cosine = 1;
  const auto add_cross = [&](const double* a, const double* b, double factor) {
    sine[0] += factor * (a[1] * b[2] - a[2] * b[1]);
    sine[1] += factor * (a[2] * b[0] - a[0] * b[2]);
    sine[2] += factor * (a[0] * b[1] - a[1] * b[0]);
  };
  PoseError distance{0, 0};
  if (rows.rotation == RotationTarget::axis) {
    double a[3] = {0, 0, 0}, d[3] = {0, 0, 0};
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) a[r] += R(pose, r, c) * rows.axis[c], d[r] += R(target, r, c) * rows.axis[c];
    add_cross(a, d, 1.0);
    cosine = a[0] * d[0] + a[1] * d[1] + a[2] * d[2];
    distance.rotation = std::atan2(std::hypot(sine[0], sine[1], sine[2]), cosine);
  } else if (rows.rotation == RotationTarget::full) {
    cosine = -0.5;
    for (int c = 0; c < 3; ++c) {
      const double a[3] = {R(pose, 0, c), R(pose, 1, c), R(pose, 2, c)};
      const double t[3] = {R(target, 0, c), R(target, 1, c), R(target, 2, c)};
      add_cross(a, t, 0.5);
      cosine += 0.5 * (a[0] * t[0] + a[1] * t[1] + a[2] * t[2]);
    }
    const double size = std::hypot(sine[0], sine[1], sine[2]);
    const double angle = std::atan2(size, cosine);
    const double scale = size > 0 ? angle / size : 1.0;
    for (int r = 0; r < 3; ++r) w[r] = scale * sine[r];
    if (rows.rotation_in_tool) in_tool(w);
    double square = 0;
    bool all = true;
    for (int r = 0; r < 3; ++r) {
      all = all && rows.weights[r + 3] != 0;
      if (rows.weights[r + 3] != 0) square += w[r] * w[r];
    }
    distance.rotation = all ? angle : std::sqrt(square);
  }
  if (rows.position_in_tool) in_tool(p);
  for (int r = 0; r < 3; ++r)
    if (rows.weights[r] == 0) p[r] = 0;
  distance.position = std::hypot(p[0], p[1], p[2]);
  return distance;
}

namespace {

class Batch {
 public:
  Batch(const Chain& chain, const double* targets, const double* seeds, const TargetRows& rows,
        const NumericOptions& options, const NumericResults& out)
      : chain_(chain),
        table_(chain.search_table()),
        targets_(targets),
        seeds_(seeds),
        rows_(rows),
        options_(options),
        out_(out),
        solve_(kernels().solve_numeric) {}

  void solve(std::size_t k) const {
    const std::size_t n = chain_.joints(), count = options_.count;
    const double* target = targets_ + 16 * k;
    const double* seed = seeds_ ? seeds_ + n * k : nullptr;
    std::vector<double> start(n), solutions(count * n), nearest(n);
    if (seed) table_.to_search(seed, start.data());
    NumericAnswer answer{};
    answer.solutions = solutions.data(), answer.nearest = nearest.data();
    solve_(chain_.folded(), table_.space(), rows_, options_, target, seed ? start.data() : nullptr, answer);

    std::size_t kept = 0;
    const auto keep = [&](const double* x) {
      double* q = out_.q + (k * count + kept) * n;
      table_.from_search(x, seed, q);
      const PoseError distance = at(target, q);
      if (!reached(distance)) return;
      out_.position_error[k * count + kept] = distance.position;
      out_.rotation_error[k * count + kept] = distance.rotation;
      out_.valid[k * count + kept] = out_.within_limits[k * count + kept] = true;
      ++kept;
    };
    for (std::size_t s = 0; s < answer.found; ++s) keep(&solutions[s * n]);
    if (answer.found > 0) std::copy_n(solutions.data(), n, nearest.data());
    if (kept == 0) keep(nearest.data());  // coming to rest may have brought it there
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    for (std::size_t s = kept; s < count; ++s) {
      std::fill_n(out_.q + (k * count + s) * n, n, nan);
      out_.position_error[k * count + s] = out_.rotation_error[k * count + s] = nan;
      out_.valid[k * count + s] = out_.within_limits[k * count + s] = false;
    }
    double* q = out_.nearest + k * n;
    if (kept > 0) {
      std::fill_n(q, n, nan);
      out_.nearest_position_error[k] = out_.nearest_rotation_error[k] = nan;
      out_.status[k] = static_cast<signed char>(NumericStatus::reached);
      return;
    }
    table_.from_search(nearest.data(), seed, q);
    const PoseError distance = at(target, q);
    out_.nearest_position_error[k] = distance.position, out_.nearest_rotation_error[k] = distance.rotation;
    out_.status[k] = static_cast<signed char>(answer.found > 0 ? NumericStatus::not_converged : answer.status);
  }

 private:
  PoseError at(const double* target, const double* q) const {
    double pose[16];
    if (!forward_kinematics(chain_, q, 1, 1, pose)) return {INFINITY, INFINITY};
    return pose_error(target, pose, rows_);
  }
  bool reached(const PoseError& d) const {
    return d.position <= options_.position_tolerance && d.rotation <= options_.rotation_tolerance;
  }

  const Chain& chain_;
  const SearchTable& table_;
  const double *targets_, *seeds_;
  const TargetRows& rows_;
  const NumericOptions& options_;
  const NumericResults& out_;
  decltype(Kernels::solve_numeric) solve_;
};

}  // namespace

std::size_t solve_numeric(const Chain& chain, const double* targets, const double* seeds, std::size_t count,
                          const TargetRows& rows, const NumericOptions& options, std::size_t threads,
                          const NumericResults& out) {
  const Batch batch(chain, targets, seeds, rows, options, out);
  const std::size_t workers = std::min(std::max<std::size_t>(threads, 1), std::max<std::size_t>(count / 16, 1));
  // some targets take a hundred times longer than others, so workers fetch a few at a time
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t first; (first = next.fetch_add(8)) < count;)
      for (std::size_t k = first; k < std::min(first + 8, count); ++k) batch.solve(k);
  };
  {
    Workers others;
    for (std::size_t w = 1; w < workers; ++w) others.start(work);
    work();
  }
  return static_cast<std::size_t>(std::count_if(out.status, out.status + count, [](signed char status) {
    return status != static_cast<signed char>(NumericStatus::reached);
  }));
}

}  // namespace pieper
