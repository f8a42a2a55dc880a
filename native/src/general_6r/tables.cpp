#include "general_6r/tables.hpp"

#include <cmath>
#include <numbers>

namespace pieper {
namespace {

constexpr double pi = std::numbers::pi;

// Fourier coefficients from 8, 16 or 24 samples.
void set_fourier(TrigonometricTables& t) {
  for (int which = 0; which < 3; ++which) {
    const int n = 8 * (which + 1), half = n / 2;
    for (int j = 0; j < n; ++j) {
      const double angle = 2 * pi * j / n;
      for (int k = 0; k <= half; ++k) {
        const double weight = k == 0 || k == half ? 1.0 / n : 2.0 / n;
        const double phase = 2 * pi * ((j * k) % n) / n;
        t.dft[which][j][k] = weight * std::cos(phase);
        if (k > 0 && k < half) t.dft[which][j][half + k] = weight * std::sin(phase);
      }
      for (int even = 0; even < 2; ++even) {
        t.sample_cosine[which][even][j] = std::cos(even ? angle / 2 : angle);
        t.sample_sine[which][even][j] = std::sin(even ? angle / 2 : angle);
      }
    }
  }
}

// The cells that the circle is cut into for polynomials with K harmonics, and derivatives in a cell.
void set_cells(TrigonometricTables& t) {
  for (int K = 1; K <= 8; ++K) {
    const double half = pi / (8 * K);
    for (int i = 0; i < 8 * K; ++i) {
      const double centre = (2 * i + 1) * half;
      t.cell_centre[K - 1][i] = centre;
      for (int k = 1; k <= K; ++k)
        t.cell_cosine[K - 1][k - 1][i] = std::cos(k * centre), t.cell_sine[K - 1][k - 1][i] = std::sin(k * centre);
    }
    for (int k = 1; k <= K; ++k) {
      double power = 1;
      for (int j = 0; j < 12; ++j) {
        t.powers[K - 1][j][k - 1] = power;
        power *= k * half / (j + 1);
      }
    }
  }
}

// Chebyshev coefficients from samples at their zeros, and the monomials of the polynomials T_0 ... T_11.
void set_local_fit(TrigonometricTables& t) {
  double monomial[12][12] = {};
  monomial[0][0] = 1, monomial[1][1] = 1;
  for (int k = 2; k < 12; ++k)
    for (int j = 0; j < 12; ++j) monomial[k][j] = (j > 0 ? 2 * monomial[k - 1][j - 1] : 0) - monomial[k - 2][j];
  for (int i = 0; i < 16; ++i) {
    t.local_points[i] = std::cos(pi * (i + 0.5) / 16);
    for (int k = 0; k < 16; ++k) {
      const double c = (k == 0 ? 1.0 : 2.0) / 16 * std::cos(k * pi * (i + 0.5) / 16);
      if (k >= 12)
        t.local_fit[i][k] = c;
      else
        for (int j = 0; j <= k; ++j) t.local_fit[i][j] += c * monomial[k][j];
    }
  }
}

TrigonometricTables make_tables() {
  TrigonometricTables t{};
  set_fourier(t);
  set_cells(t);
  set_local_fit(t);
  return t;
}

}  // namespace

const TrigonometricTables& trigonometric_tables() {
  static const TrigonometricTables made = make_tables();
  return made;
}

}  // namespace pieper
