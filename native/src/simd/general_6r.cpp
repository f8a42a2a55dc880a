// The general solver of one instruction set: this file is compiled once for each, like kernels.cpp.
#include "pieper/general_6r.hpp"

#include "pieper/kernels.hpp"
#include "simd/general_6r/polish.hpp"

namespace {

using pieper::FormResult;

constexpr int newton_steps = 12;
constexpr int damped_steps = 25;
// Least pivot of the Jacobian at a solution that may be one of two that have nearly met.
constexpr double near_fold = 1e-3;
// Third singular value, to the largest, below which solutions nearby do not explain it.
constexpr double exactly_shared = 1e-8;

void load_joints(const FormResult& result, std::size_t first, Joints& q) {
  for (int i = 0; i < 6; ++i) q.c[i] = load(result.cosine[i] + first), q.s[i] = load(result.sine[i] + first);
}

void store_joints(const Joints& q, Vec residual, FormResult& result, std::size_t first) {
  for (int i = 0; i < 6; ++i) store(result.cosine[i] + first, q.c[i]), store(result.sine[i] + first, q.s[i]);
  store(result.residual + first, residual);
}

// Keeps the converged ones of `count` joints in place.
void compact(FormResult& result, std::size_t count, double residual) {
  result.count = 0;
  for (std::size_t k = 0; k < count; ++k) {
    if (!(result.residual[k] < residual)) continue;
    for (int i = 0; i < 6; ++i)
      result.cosine[i][result.count] = result.cosine[i][k], result.sine[i][result.count] = result.sine[i][k];
    result.residual[result.count++] = result.residual[k];
  }
}

// Distinct solutions whose joint `i` is near an angle; counted up to four. Between two double roots that are some hundredths
// of a radian apart the matrix has nearly as many null vectors as at one fourfold root.
int solutions_near(const FormResult& result, int i, double angle) {
  constexpr double near = 0.25, distinct = 1e-5;
  const double c = std::cos(angle), s = std::sin(angle);
  std::size_t found[4];
  int count = 0;
  for (std::size_t k = 0; k < result.count && count < 4; ++k) {
    if (std::fabs(result.cosine[i][k] - c) > near || std::fabs(result.sine[i][k] - s) > near) continue;
    bool known = false;
    for (int f = 0; f < count && !known; ++f) {
      double apart = 0;
      for (int j = 0; j < 6; ++j)
        apart += std::fabs(result.cosine[j][k] - result.cosine[j][found[f]]) +
                 std::fabs(result.sine[j][k] - result.sine[j][found[f]]);
      known = apart < distinct;
    }
    if (!known) found[count++] = k;
  }
  return count;
}

// The form with the target in it, where it is on the left: `room` holds that.
const LoopForm& with_target(const LoopForm& form, const double* G, LoopForm& room) {
  if (form.target_in < 3 || form.target_in > 5) return form;
  room = form;
  double G_inverse[12];
  invert_motion(G, G_inverse);
  put_target_left(room, form.reversed ? G : G_inverse);
  return room;
}

void solve_form(const TrigonometricTables& tables, const GeneralArm& arm, const LoopForm& given, const double* G,
                FormResult& result) {
  LoopForm room;
  const LoopForm& form = with_target(given, G, room);
  Equations equations;
  eliminate_outer_joints(form, G, equations);
  RootFinder roots(tables, form, equations);
  roots.run();
  result.flags = roots.flags, result.tail = roots.tail, result.count = 0, result.simple_roots = 0;
  result.work = 5 + roots.work;
  if (roots.count == 0) return;
  Starts starts;
  Shared shared;
  result.flags |= find_null_vectors(equations, roots.candidates, roots.count, starts, shared);
  result.work += 6 * ((starts.count + 7) / 8);
  bool found[RootFinder::most_candidates] = {};
  for (std::size_t first = 0; first < starts.count; first += lanes) {
    Vec row[Starts::width];
    read_rows<Starts::width>(starts.rows + first * Starts::width, row);
    const std::size_t some = starts.count - first < lanes ? starts.count - first : lanes;
    const IntVec valid = first_lanes(some);
    for (auto& number : row) number = select(valid, number, splat(0.5));
    Joints q;
    back_substitute(form, equations, row, q);
    const Joints start = q;
    Vec residual;
    Vec pivot = splat(1.0);
    std::size_t steps = newton(arm, G, valid, q, residual, pivot, newton_steps);
    const IntVec failed = valid & none(residual < acceptable);
    if (any(failed)) {
      Joints again = start;
      Vec left;
      steps += 2 * damped(arm, G, failed, again, left, damped_steps);
      steps += newton(arm, G, failed, again, left, pivot, 4);
      keep_better(again, left, q, residual);
    }
    if (any(valid & (residual < acceptable) & (pivot < near_fold))) result.flags |= pieper::flag_near_fold;
    store_joints(q, residual, result, first);
    result.work += 4 + 2 * steps;
    for (std::size_t l = 0; l < some; ++l)
      if (lane(residual, l) < acceptable) found[starts.candidate[first + l]] = true;
  }
  for (std::size_t i = 0; i < roots.count; ++i) {
    if (!roots.candidates[i].simple) continue;
    if (!found[shared.same_as[i]]) result.flags |= pieper::flag_lost;
    result.simple_roots += shared.same_as[i] == i;
  }
  compact(result, starts.count, acceptable);
  const int remaining = form.reversed ? 5 - (2 + form.shift) % 6 : (2 + form.shift) % 6;
  for (std::size_t i = 0; i < roots.count; ++i)
    if (shared.third[i] &&
        (shared.third_size[i] < exactly_shared ||
         solutions_near(result, remaining, form.reversed ? -roots.candidates[i].angle : roots.candidates[i].angle) < 4))
      result.flags |= pieper::flag_third;
}

// Damped steps and then Newton's, on the joints that `result` holds.
void refine(const GeneralArm& arm, const double* G, const pieper::Refinement& how, FormResult& result) {
  for (std::size_t first = 0; first < result.count; first += lanes) {
    const std::size_t some = result.count - first < lanes ? result.count - first : lanes;
    const IntVec valid = first_lanes(some);
    Joints q;
    load_joints(result, first, q);
    for (int i = 0; i < 6; ++i) q.c[i] = select(valid, q.c[i], splat(1.0)), q.s[i] = select(valid, q.s[i], splat(0.0));
    Vec residual;
    if (how.wandering)
      wander(arm, G, valid, q, residual, how.damped_steps);
    else
      damped(arm, G, valid, q, residual, how.damped_steps);
    Vec pivot;
    newton(arm, G, valid, q, residual, pivot, how.newton_steps);
    store_joints(q, residual, result, first);
  }
  compact(result, result.count, how.residual);
}

// A rough arc tangent (Hastings, Approximations for Digital Computers, 1955, sheet 11), set right by its own sine and cosine.
void angles(const double* cosine, const double* sine, std::size_t count, double* out) {
  constexpr double quarter = 1.5707963267948966;
  for (std::size_t k = 0; k < count; k += lanes) {
    const Vec c = load(cosine + k), s = load(sine + k);
    const Vec x = magnitude(c), y = magnitude(s);
    const Vec r = smaller(x, y) / (larger(x, y) + 1e-300), z = r * r;
    Vec t = r * (0.999866 + z * (-0.3302995 + z * (0.180141 + z * (-0.085133 + z * 0.0208351))));
    t = select(y > x, quarter - t, t);
    t = with_sign(select(c < 0.0, 2 * quarter - t, t), s);
    Vec st, ct;
    sincos_reduced(t, st, ct);
    const Vec d = s * ct - c * st;
    store(out + k, t + d * (1.0 + d * d * (1.0 / 6)));
  }
}

// |c_k| of the determinant of one form at one target, divided by the largest sample; `most` harmonics in t, from 24 samples.
bool spectrum(const TrigonometricTables& tables, const LoopForm& given, const double* G, double* size) {
  LoopForm room;
  const LoopForm& form = with_target(given, G, room);
  Equations equations;
  eliminate_outer_joints(form, G, equations);
  double f[24], largest = 0;
  for (std::size_t k = 0; k < 24; k += lanes) {
    const Vec value =
        determinant(equations.S, load(tables.sample_cosine[2][0] + k), load(tables.sample_sine[2][0] + k));
    store(f + k, value);
  }
  for (double value : f) largest = std::fabs(value) > largest ? std::fabs(value) : largest;
  if (!(largest > 1e-290) || !(largest < 1e290)) return false;
  double x[24] = {};
  for (int j = 0; j < 24; ++j)
    for (int k = 0; k < 24; ++k) x[k] += f[j] / largest * tables.dft[2][j][k];
  size[0] = std::fabs(x[0]);
  for (int k = 1; k <= 12; ++k) {
    const double b = k < 12 ? x[12 + k] : 0;
    size[k] = std::sqrt(x[k] * x[k] + b * b);
  }
  return true;
}

}  // namespace

#define PIEPER_JOIN_(a, b) a##b
#define PIEPER_JOIN(a, b) PIEPER_JOIN_(a, b)

namespace pieper {
extern const GeneralKernels PIEPER_JOIN(general_kernels_, PIEPER_ISA);
const GeneralKernels PIEPER_JOIN(general_kernels_, PIEPER_ISA){solve_form, refine, angles, spectrum};
}  // namespace pieper
