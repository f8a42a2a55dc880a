// Real roots of k0 + k1 cos + k2 sin + k3 cos 2a + k4 sin 2a, of which there are at most four.
//
// With z = exp(i a) it is a quartic in z whose roots come in pairs z, 1 / conj(z); the real angles are those on the
// unit circle. All four are found together by Aberth's iteration (Math. Comp. 27, 1973), which needs no starting
// values, and the angles are then brought to rounding by Newton's method on the real function.
#pragma once

#include <cmath>

#include "simd/lanes.hpp"

namespace {

struct Complex {
  double re, im;
};
inline Complex operator+(Complex a, Complex b) { return {a.re + b.re, a.im + b.im}; }
inline Complex operator-(Complex a, Complex b) { return {a.re - b.re, a.im - b.im}; }
inline Complex operator*(Complex a, Complex b) { return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re}; }
inline double square_of(Complex a) { return a.re * a.re + a.im * a.im; }
inline Complex operator/(Complex a, Complex b) {
  const double scale = 1.0 / square_of(b);
  return {(a.re * b.re + a.im * b.im) * scale, (a.im * b.re - a.re * b.im) * scale};
}

struct Wave {
  double k[5];
  double at(double c, double s) const { return k[0] + k[1] * c + k[2] * s + k[3] * (c * c - s * s) + 2 * k[4] * c * s; }
  double slope(double c, double s) const {
    return k[2] * c - k[1] * s + 2 * (k[4] * (c * c - s * s) - 2 * k[3] * c * s);
  }
};

// A wave of one period: a0 + a1 cos + a2 sin.
struct Linear {
  double a[3];
};

// Adds factor * p * q.
inline void add_product(Wave& to, double factor, const Linear& p, const Linear& q) {
  const double *a = p.a, *b = q.a;
  to.k[0] += factor * (a[0] * b[0] + 0.5 * (a[1] * b[1] + a[2] * b[2]));
  to.k[1] += factor * (a[0] * b[1] + a[1] * b[0]);
  to.k[2] += factor * (a[0] * b[2] + a[2] * b[0]);
  to.k[3] += factor * 0.5 * (a[1] * b[1] - a[2] * b[2]);
  to.k[4] += factor * 0.5 * (a[1] * b[2] + a[2] * b[1]);
}

// Cosines and sines of the roots; NaN in unused places. Those close to a pair that has just left the circle
// are among them: what they are worth shows when the pose is measured.
// Returns whether two of the four lie within `margin` of each other, so that a slightly different wave may have two more
// or two less.
inline bool real_roots(const Wave& wave, double margin, double* cosine, double* sine) {
  const double* k = wave.k;
  constexpr double off_circle = 0.02;
  Complex coefficient[5] = {{0.5 * k[3], 0.5 * k[4]},
                            {0.5 * k[1], 0.5 * k[2]},
                            {k[0], 0},
                            {0.5 * k[1], -0.5 * k[2]},
                            {0.5 * k[3], -0.5 * k[4]}};
  double size = 0;
  for (const Complex& c : coefficient) size = std::fmax(size, square_of(c));
  // a wave of one period has two roots and no fourth power
  int degree = 4, first = 0;
  if (square_of(coefficient[4]) < 1e-26 * size) degree = 2, first = 1;
  const Complex* p = coefficient + first;
  Complex z[4];
  for (int i = 0; i < degree; ++i) {
    const double angle = 0.7 + 6.283185307179586 * i / degree;
    const double radius = i % 2 ? 1.1 : 0.9;
    z[i] = {radius * std::cos(angle), radius * std::sin(angle)};
  }
  constexpr int most = 60;
  for (int step = 0; step < most; ++step) {
    double largest = 0;
    for (int i = 0; i < degree; ++i) {
      Complex value = p[degree], slope{0, 0};
      for (int d = degree - 1; d >= 0; --d) slope = slope * z[i] + value, value = value * z[i] + p[d];
      if (square_of(value) == 0) continue;
      const Complex newton = slope / value;
      Complex push{0, 0};
      for (int j = 0; j < degree; ++j)
        if (j != i) {
          const Complex apart = z[i] - z[j];
          if (square_of(apart) > 1e-300) push = push + Complex{1, 0} / apart;
        }
      const Complex step_size = Complex{1, 0} / (newton - push);
      if (!(square_of(step_size) < 1e300)) continue;
      z[i] = z[i] - step_size;
      largest = std::fmax(largest, square_of(step_size) / (1e-300 + square_of(z[i])));
    }
    if (largest < 1e-28) break;
  }
  bool close = false;
  for (int i = 0; i < degree; ++i)
    for (int j = 0; j < i; ++j) close = close || square_of(z[i] - z[j]) < margin * margin;
  int found = 0;
  for (int i = 0; i < degree; ++i) {
    const double radius = std::sqrt(square_of(z[i]));
    if (!(std::fabs(radius - 1) < off_circle)) continue;
    double c = z[i].re / radius, s = z[i].im / radius;
    for (int step = 0; step < 3; ++step) {
      const double slope = wave.slope(c, s), value = wave.at(c, s);
      const double turn = value / slope;
      if (!(std::fabs(turn) < 1e-3)) break;  // beside an extremum, or there already
      const double turned_c = c + turn * s, turned_s = s - turn * c,
                   scale = 1 / std::sqrt(turned_c * turned_c + turned_s * turned_s);
      if (std::fabs(wave.at(turned_c * scale, turned_s * scale)) > std::fabs(value)) break;
      c = turned_c * scale, s = turned_s * scale;
    }
    cosine[found] = c, sine[found] = s, ++found;
  }
  for (int i = found; i < 4; ++i) cosine[i] = sine[i] = static_cast<double>(NAN);
  return close;
}

}  // namespace
