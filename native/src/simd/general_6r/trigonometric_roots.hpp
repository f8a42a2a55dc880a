// All real roots of the determinant as a trigonometric polynomial: recursion on local Taylor polynomials, in which every
// interval that is dropped has a certificate, and fresh samples of the determinant where the polynomial is noise.
#pragma once

#include "simd/general_6r/determinant.hpp"
#include "simd/sincos.hpp"

namespace {

using pieper::TrigonometricTables;

// A root, or a place where there may be one.
struct Candidate {
  double angle;    // t
  bool simple;     // a sign change
  bool resampled;  // found on fresh samples
  double error;    // how far off it may be [rad]; of simple ones
};

class RootFinder {
 public:
  static constexpr std::size_t most_candidates = 64;

  RootFinder(const TrigonometricTables& tables, const LoopForm& form, const Equations& equations)
      : tables_(tables), form_(form), S_(equations.S) {}

  void run() {
    if (!fit()) {
      flags |= pieper::flag_noise;
      return;
    }
    list_cells();
    split_items();
    close_brackets();
    for (round_ = 1; request_count_ > 0 && round_ <= last_round; ++round_) {
      flags |= pieper::flag_request;
      sample_requests();
      split_items();
      close_brackets();
    }
    if (resampled_ > some_resampled) flags |= pieper::flag_some_requests;
    if (resampled_ > many_resampled) flags |= pieper::flag_many_requests;
    std::size_t simple = 0;
    for (std::size_t i = 0; i < count; ++i) simple += candidates[i].simple;
    if (!(flags & pieper::flag_request) && simple % 2) flags |= pieper::flag_parity;
    if (form_.even) double_candidates();
  }

  Candidate candidates[most_candidates];
  std::size_t count = 0;
  unsigned flags = 0;
  double tail = 0;
  std::size_t work = 0;

 private:
  static constexpr int degree = 11;
  static constexpr int last_round = 4;
  static constexpr std::size_t item_size = 16;
  enum { centre_at = 12, half_at = 13, noise_at = 14 };
  static constexpr std::size_t item_capacity = 320, bracket_capacity = 96, request_capacity = 64;
  static constexpr std::size_t requests_per_round = 32;
  static constexpr std::size_t some_resampled = 10, many_resampled = 24;  // intervals
  static constexpr double same_root = 1e-5;                               // rad: closer roots of f' and f count as one
  static constexpr double least_request = 5e-4;                           // rad
  static constexpr double least_half_width = 1e-9;                        // rad

  struct Request {
    double centre, half;
  };

  // Samples of the determinant, divided by the largest, to coefficients; false when there is nothing to see.
  bool fit() {
    const int n = form_.samples, table = n / 8 - 1;
    alignas(64) double f[24];
    double largest = 0;
    for (int k = 0; k < n; k += static_cast<int>(lanes)) {
      const Vec c = load(tables_.sample_cosine[table][form_.even] + k),
                s = load(tables_.sample_sine[table][form_.even] + k);
      store(f + k, determinant(S_, c, s));
    }
    work += static_cast<std::size_t>(n) / 2;
    for (int k = 0; k < n; ++k) largest = f[k] > largest ? f[k] : -f[k] > largest ? -f[k] : largest;
    if (!(largest > 1e-290) || !(largest < 1e290)) return false;
    const double scale = 1 / largest;
    alignas(64) double x[24];
    for (int k = 0; k < n; k += static_cast<int>(lanes)) {
      Vec sum = splat(0.0);
      for (int j = 0; j < n; ++j) sum += (scale * f[j]) * load(tables_.dft[table][j] + k);
      store(x + k, sum);
    }
    // x: c0, A1 ... A(n/2), B1 ... B(n/2 - 1)
    const int K = form_.harmonics, half = n / 2;
    constant_ = x[0];
    sum_ = constant_ < 0 ? -constant_ : constant_;
    for (int k = 1; k <= half; ++k) {
      const double a = x[k], b = k < half ? x[half + k] : 0;
      const double size = std::sqrt(a * a + b * b);
      if (k <= K) {
        cosines_[k - 1] = a, sines_[k - 1] = b;
        sum_ += std::fabs(a) + std::fabs(b);
      } else if (size > tail) {
        tail = size;
      }
    }
    if (!(tail < 1e-2)) return false;  // it vanishes: what there is, is rounding
    if (tail > 1e-11) flags |= pieper::flag_noise;
    noise_ = larger_of(1e-15 * sum_, 4 * tail);
    return true;
  }

  static double larger_of(double a, double b) { return a > b ? a : b; }

  // The cells that a short expansion does not exclude, as polynomials of degree 11 on [-1, 1].
  void list_cells() {
    const int K = form_.harmonics, cells = 8 * K;
    const auto& powers = tables_.powers[K - 1];
    double remainder = 0;
    for (int k = 0; k < K; ++k) remainder += (std::fabs(cosines_[k]) + std::fabs(sines_[k])) * powers[5][k];
    remainder *= 1.05;
    const double half = 3.14159265358979323846 / cells;
    for (int first = 0; first < cells; first += static_cast<int>(lanes)) {
      Vec u[8], v[8], a[item_size];
      for (int k = 0; k < K; ++k) {
        const Vec c = load(tables_.cell_cosine[K - 1][k] + first), s = load(tables_.cell_sine[K - 1][k] + first);
        u[k] = cosines_[k] * c + sines_[k] * s, v[k] = sines_[k] * c - cosines_[k] * s;
      }
      a[0] = splat(constant_);
      for (int k = 0; k < K; ++k) a[0] += u[k];
      const auto coefficient = [&](int j) {
        const Vec* part = j % 2 ? v : u;
        Vec sum = splat(0.0);
        for (int k = 0; k < K; ++k) sum += part[k] * powers[j][k];
        return j % 4 == 2 || j % 4 == 3 ? -sum : sum;
      };
      Vec rest = splat(remainder + 4 * noise_);
      for (int j = 1; j <= 4; ++j) a[j] = coefficient(j), rest += magnitude(a[j]);
      const IntVec open = magnitude(a[0]) <= rest;
      if (!any(open)) continue;
      for (int j = 5; j <= degree; ++j) a[j] = coefficient(j);
      a[centre_at] = load(tables_.cell_centre[K - 1] + first), a[half_at] = splat(half), a[noise_at] = splat(noise_);
      a[15] = splat(0.0);
      if (!append_rows<item_size>(a, open, items_, item_count_, item_capacity)) flags |= pieper::flag_overflow;
    }
    work += static_cast<std::size_t>(K) / 2;
    half_cell_ = half;
  }

  PIEPER_INLINE static Vec value_at(const Vec* a, Vec x) {
    Vec f = a[degree];
    for (int j = degree - 1; j >= 0; --j) f = f * x + a[j];
    return f;
  }

  PIEPER_INLINE static void value_and_slope(const Vec* a, Vec x, Vec& f, Vec& slope) {
    f = a[degree], slope = splat(0.0);
    for (int j = degree - 1; j >= 0; --j) slope = slope * x + f, f = f * x + a[j];
  }

  PIEPER_INLINE static void slope_and_curvature(const Vec* a, Vec x, Vec& slope, Vec& curvature) {
    slope = splat(0.0), curvature = splat(0.0);
    for (int j = degree; j >= 1; --j)
      curvature = curvature * x + slope, slope = slope * x + static_cast<double>(j) * a[j];
  }

  // Works the list off: every interval is dropped, closed in on, asked for again, or halved.
  void split_items() {
    while (item_count_ > 0) {
      const std::size_t some = item_count_ < lanes ? item_count_ : lanes;
      item_count_ -= some;
      Vec a[item_size];
      read_rows<item_size>(items_ + item_count_ * item_size, a);
      IntVec left = first_lanes(some);
      ++work;
      const Vec noise = a[noise_at];
      Vec from1 = splat(0.0), from2 = splat(0.0), from3 = splat(0.0);  // of f, f', f''
      Vec even = a[0], odd = a[1], even_slope = a[1], odd_slope = splat(0.0);
      for (int j = 1; j <= degree; ++j) {
        const Vec size = magnitude(a[j]);
        const double d = j;
        from1 += size;
        if (j >= 2) {
          from2 += d * size;
          (j % 2 ? odd : even) += a[j];
          (j % 2 ? even_slope : odd_slope) += d * a[j];
        }
        if (j >= 3) from3 += (d * (d - 1)) * size;
      }
      left &= magnitude(a[0]) <= 1.001 * from1 + 4.0 * noise;
      if (!any(left)) continue;
      const Vec f_first = even - odd, f_last = even + odd;
      const Vec slope_first = even_slope - odd_slope, slope_last = even_slope + odd_slope;
      const Vec bend = magnitude(a[2]);
      IntVec monotone = left & (magnitude(a[1]) > 1.001 * from2 + noise);
      const IntVec convex = left & none(monotone) & (2.0 * bend > 1.001 * from3 + noise);
      const IntVec turns = convex & ((slope_first * slope_last < 0.0) | (magnitude(slope_first) < 1e-3 * bend) |
                                     (magnitude(slope_last) < 1e-3 * bend));
      monotone |= convex & none(turns);
      add_bracket(a, monotone, splat(-1.0), splat(1.0), f_first, f_last);
      if (any(turns)) turning_point(a, turns, f_first, f_last);
      left &= none(monotone) & none(turns);
      if (!any(left)) continue;
      const IntVec asked = left & ((from1 + magnitude(a[0]) < 300.0 * noise) | (a[half_at] < least_half_width));
      for (std::size_t l = 0; l < lanes; ++l)
        if (lane_bits(asked) >> l & 1) request(lane(a[centre_at], l), lane(a[half_at], l));
      left &= none(asked);
      if (any(left)) halve(a, left);
    }
  }

  void halve(Vec* a, IntVec which) {
    double power = 1;
    for (int j = 1; j <= degree; ++j) power *= 0.5, a[j] *= power;
    a[half_at] *= 0.5;
    const Vec centre = a[centre_at];
    for (int side = 0; side < 2; ++side) {
      Vec b[item_size];
      for (std::size_t j = 0; j < item_size; ++j) b[j] = a[j];
      if (side == 0)
        for (int i = 0; i < degree; ++i)
          for (int j = degree - 1; j >= i; --j) b[j] -= b[j + 1];
      else
        for (int i = 0; i < degree; ++i)
          for (int j = degree - 1; j >= i; --j) b[j] += b[j + 1];
      b[centre_at] = side == 0 ? centre - a[half_at] : centre + a[half_at];
      if (!append_rows<item_size>(b, which, items_, item_count_, item_capacity)) flags |= pieper::flag_overflow;
    }
  }

  // A sign change between lo and hi becomes a bracket; an end that may itself be a root, a candidate.
  void add_bracket(const Vec* a, IntVec which, Vec lo, Vec hi, Vec f_lo, Vec f_hi) {
    const IntVec crossed = which & (f_lo * f_hi < 0.0);
    const unsigned chosen = lane_bits(crossed);
    if (chosen) {
      for (std::size_t l = 0, k = bracket_count_; l < lanes && k < bracket_capacity; ++l)
        if (chosen >> l & 1) bracket_lo_[k] = lane(lo, l), bracket_hi_[k] = lane(hi, l), ++k;
      if (!append_rows<item_size>(a, crossed, brackets_, bracket_count_, bracket_capacity))
        flags |= pieper::flag_overflow;
    }
    const IntVec lo_touches = magnitude(f_lo) < 2.0 * a[noise_at], hi_touches = magnitude(f_hi) < 2.0 * a[noise_at];
    const unsigned touching = lane_bits(which & none(crossed) & (lo_touches | hi_touches));
    if (!touching) return;
    const Vec x = select(lo_touches, lo, hi);
    for (std::size_t l = 0; l < lanes; ++l)
      if (touching >> l & 1) emit(lane_of(a[centre_at], l) + lane_of(a[half_at], l) * lane_of(x, l), false);
  }

  // One extremum within the interval: no root, two, or a double one.
  void turning_point(const Vec* a, IntVec which, Vec f_first, Vec f_last) {
    Vec x = -0.5 * a[1] / a[2];
    const auto clamp = [](Vec y) { return smaller(larger(y, splat(-1.001)), splat(1.001)); };
    x = clamp(x);
    Vec slope, curvature;
    for (int k = 0; k < 12; ++k) {
      slope_and_curvature(a, x, slope, curvature);
      const Vec next = clamp(x - slope / curvature);
      const bool done = !any(which & (magnitude(next - x) > 1e-9));
      x = next;
      if (done) break;
    }
    slope_and_curvature(a, x, slope, curvature);
    Vec f = value_at(a, x);
    const Vec noise = a[noise_at], half = a[half_at], bent = 0.5 * magnitude(curvature) + 1e-300;
    const IntVec low = which & (magnitude(f) < 10.0 * noise);
    Vec uncertain = square_root(10.0 * noise / bent) * half;
    const IntVec asked = low & (uncertain > same_root);
    Vec offset = square_root(magnitude(f) / bent) * half;
    const IntVec twice = which & none(asked) & (low | (offset < same_root));
    for (std::size_t l = 0; l < lanes; ++l) {
      const double at = lane_of(a[centre_at], l) + lane_of(a[half_at], l) * lane(x, l);
      if (lane_bits(asked) >> l & 1) request(at, larger_of(5 * lane(uncertain, l), least_request));
      if (lane_bits(twice) >> l & 1) emit(at, false);
    }
    const IntVec apart = which & none(asked);
    const Vec inner = smaller(larger(x, splat(-1.0)), splat(1.0));
    const Vec f_inner = select(inner == x, f, select(x < 0.0, f_first, f_last));
    add_bracket(a, apart & (inner > -1.0), splat(-1.0), inner, f_first, f_inner);
    add_bracket(a, apart & (inner < 1.0), inner, splat(1.0), f_inner, f_last);
  }

  // Newton steps kept within the bracket.
  void close_brackets() {
    for (std::size_t first = 0; first < bracket_count_; first += lanes) {
      const std::size_t some = bracket_count_ - first < lanes ? bracket_count_ - first : lanes;
      Vec a[item_size];
      read_rows<item_size>(brackets_ + first * item_size, a);
      const IntVec valid = first_lanes(some);
      Vec lo = load(bracket_lo_ + first), hi = load(bracket_hi_ + first);
      const Vec f_lo = value_at(a, lo), f_hi = value_at(a, hi);
      Vec x = lo - f_lo * (hi - lo) / (f_hi - f_lo), f, slope;
      ++work;
      for (int k = 0; k < 60; ++k) {
        value_and_slope(a, x, f, slope);
        const IntVec below = (f < 0.0) == (f_lo < 0.0);
        lo = select(below, x, lo), hi = select(below, hi, x);
        const Vec newton = x - f / slope;
        const Vec next = select((newton >= lo) & (newton <= hi), newton, 0.5 * (lo + hi));
        const bool done = !any(valid & (magnitude(next - x) > 1e-7));
        x = next;
        if (done) break;
      }
      value_and_slope(a, x, f, slope);
      const Vec newton = x - f / slope;
      x = select((newton >= lo) & (newton <= hi), newton, x);
      Vec uncertain = a[noise_at] * a[half_at] / (magnitude(slope) + 1e-300);
      for (std::size_t l = 0; l < some; ++l) {
        const double at = lane(a[centre_at], l) + lane(a[half_at], l) * lane(x, l);
        if (lane(uncertain, l) > same_root && round_ < last_round)
          request(at, larger_of(20 * lane(uncertain, l), least_request));
        else
          emit(at, true, lane(uncertain, l));
      }
    }
    bracket_count_ = 0;
  }

  void emit(double tau, bool simple, double error = 0) {
    if (count == most_candidates) {
      flags |= pieper::flag_overflow;
      return;
    }
    candidates[count++] = {form_.even ? 0.5 * tau : tau, simple, round_ > 0, error};
  }

  void request(double centre, double half) {
    if (round_ >= last_round) return emit(centre, false);
    if (request_count_ == request_capacity) {
      flags |= pieper::flag_overflow;
      return emit(centre, false);
    }
    requests_[request_count_++] = {centre, half};
  }

  // Splits wide requests, merges overlapping ones, in order of their angles.
  void arrange_requests() {
    const double widest = 0.5 * half_cell_;
    Request split[requests_per_round];
    std::size_t n = 0;
    for (std::size_t i = 1; i < request_count_; ++i)
      for (std::size_t j = i; j > 0 && requests_[j].centre < requests_[j - 1].centre; --j) {
        const Request r = requests_[j];
        requests_[j] = requests_[j - 1], requests_[j - 1] = r;
      }
    for (std::size_t i = 0; i < request_count_; ++i) {
      const Request r = requests_[i];
      const int parts = r.half > widest ? static_cast<int>(r.half / widest) + 1 : 1;
      const double half = r.half / parts;
      for (int part = 0; part < parts; ++part) {
        const double centre = r.centre - r.half + (2 * part + 1) * half;
        if (n > 0) {
          Request& last = split[n - 1];
          const double lo = last.centre - last.half < centre - half ? last.centre - last.half : centre - half;
          const double hi = larger_of(last.centre + last.half, centre + half);
          if (centre - half < last.centre + last.half && hi - lo <= 2 * widest) {
            last = {0.5 * (lo + hi), 0.5 * (hi - lo)};
            continue;
          }
        }
        if (n == requests_per_round) {
          flags |= pieper::flag_overflow;
          emit(centre, false);
          continue;
        }
        split[n++] = {centre, half};
      }
    }
    for (std::size_t i = 0; i < n; ++i) requests_[i] = split[i];
    request_count_ = n;
  }

  // Polynomials from sixteen fresh samples of the determinant on each requested interval.
  void sample_requests() {
    arrange_requests();
    Request now[requests_per_round];
    const std::size_t n = request_count_;
    for (std::size_t i = 0; i < n; ++i) now[i] = requests_[i];
    request_count_ = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const double to_t = form_.even ? 0.5 : 1.0;
      alignas(64) double f[16];
      double largest = 0;
      for (std::size_t k = 0; k < 16; k += lanes) {
        Vec s, c;
        sincos_reduced(to_t * (now[i].centre + now[i].half * load(tables_.local_points + k)), s, c);
        store(f + k, determinant(S_, c, s));
      }
      work += 10;
      for (double value : f) largest = larger_of(largest, std::fabs(value));
      if (!(largest > 1e-300)) {
        emit(now[i].centre, false);
        continue;
      }
      alignas(64) double item[16];
      const double scale = 1 / largest;
      for (std::size_t k = 0; k < 16; k += lanes) {
        Vec sum = splat(0.0);
        for (int j = 0; j < 16; ++j) sum += (scale * f[j]) * load(tables_.local_fit[j] + k);
        store(item + k, sum);
      }
      double local_tail = 0;
      for (int k = 12; k < 16; ++k) local_tail = larger_of(local_tail, std::fabs(item[k]));
      if (local_tail > 1e-8 && round_ < last_round) {
        const double half = 0.5 * now[i].half;
        request(now[i].centre - half, half), request(now[i].centre + half, half);
        continue;
      }
      ++resampled_;
      item[centre_at] = now[i].centre, item[half_at] = now[i].half;
      item[noise_at] = larger_of(1e-13, 4 * local_tail), item[15] = 0;
      if (item_count_ == item_capacity) {
        flags |= pieper::flag_overflow;
        continue;
      }
      std::memcpy(items_ + item_count_++ * item_size, item, sizeof item);
    }
  }

  // Even harmonics only: every root comes with its opposite.
  void double_candidates() {
    if (2 * count > most_candidates) flags |= pieper::flag_overflow;
    const std::size_t n = count;
    for (std::size_t i = 0; i < n && count < most_candidates; ++i) {
      candidates[count] = candidates[i];
      candidates[count++].angle += 3.14159265358979323846;
    }
  }

  const TrigonometricTables& tables_;
  const LoopForm& form_;
  const double (*S_)[9][8];
  double constant_ = 0, cosines_[12], sines_[12], sum_ = 0, noise_ = 0, half_cell_ = 0;
  int round_ = 0;
  alignas(64) double items_[(item_capacity + 8) * item_size];
  alignas(64) double brackets_[(bracket_capacity + 8) * item_size];
  double bracket_lo_[bracket_capacity + 8], bracket_hi_[bracket_capacity + 8];
  Request requests_[request_capacity];
  std::size_t item_count_ = 0, bracket_count_ = 0, request_count_ = 0, resampled_ = 0;
};

}  // namespace
