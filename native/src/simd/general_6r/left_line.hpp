// The left side of the loop: the line after K3 Rz4 K4 Rz5 K5, in the half angles of joints 4 and 5. Internal linkage: see
// lanes.hpp.
#pragma once

#include "line_numbers.hpp"
#include "pieper/general_6r.hpp"

namespace {

using pieper::LoopForm;

// The numbers of the left line on (s4^2, s4 k4, k4^2) x (s5^2, sqrt2 s5 k5, k5^2).
inline void expand_left_line(LoopForm& form) {
  // constant, cosine and sine parts by angle 5, then by angle 4; of a slide constant, linear and quadratic ones
  double line[line_size], by5[3][line_size], parts[3][3][line_size];
  line_of_frame(form.K5, line);
  (form.slide == 5 ? slide_line : turn_line)(line, 1, by5[0], by5[1], by5[2]);
  for (int b = 0; b < 3; ++b) {
    double moved[line_size], by4[3][line_size];
    move_line(form.K4, by5[b], moved);
    (form.slide == 4 ? slide_line : turn_line)(moved, 1, by4[0], by4[1], by4[2]);
    for (int a = 0; a < 3; ++a) move_line(form.K3, by4[a], parts[a][b]);
  }
  constexpr double root2 = 1.4142135623730951;
  // half angles: 1 = s^2 + k^2, cos = k^2 - s^2, sin = 2 s k
  constexpr double half_4[3][3] = {{1, -1, 0}, {0, 0, 2}, {1, 1, 0}};
  constexpr double half_5[3][3] = {{1, -1, 0}, {0, 0, root2}, {1, 1, 0}};
  // the displacement of a slide is s / k: 1 = k^2, d = s k, d^2 = s^2
  constexpr double slid_4[3][3] = {{0, 0, 1}, {0, 1, 0}, {1, 0, 0}};
  constexpr double slid_5[3][3] = {{0, 0, 1}, {0, 1 / root2, 0}, {1, 0, 0}};
  const auto& to_half_4 = form.slide == 4 ? slid_4 : half_4;
  const auto& to_half_5 = form.slide == 5 ? slid_5 : half_5;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) form.one[3 * a + b] = to_half_4[a][0] * to_half_5[b][0];
  for (int a = 0; a < 3; ++a)
    for (int k = 0; k < 14; ++k) {
      double with[3];
      for (int j = 0; j < 3; ++j)
        with[j] =
            to_half_4[a][0] * parts[0][j][k] + to_half_4[a][1] * parts[1][j][k] + to_half_4[a][2] * parts[2][j][k];
      for (int b = 0; b < 3; ++b)
        form.left[k][3 * a + b] = to_half_5[b][0] * with[0] + to_half_5[b][1] * with[1] + to_half_5[b][2] * with[2];
    }
}

// K3 and K4 end with the generic turns of the angles 4 and 5.
inline void turned_on(const double* K, bool slides, double angle, double c, double s, double* out) {
  for (int r = 0; r < 3; ++r) {
    const double x = K[4 * r], y = K[4 * r + 1], z = K[4 * r + 2];
    out[4 * r] = slides ? x : c * x + s * y, out[4 * r + 1] = slides ? y : c * y - s * x, out[4 * r + 2] = z;
    out[4 * r + 3] = K[4 * r + 3] + (slides ? angle * z : 0);
  }
}

inline void set_K3(LoopForm& form, const double* K) {
  turned_on(K, form.slide == 4, turn_4, turn_4_cosine, turn_4_sine, form.K3);
}

inline void set_K4(LoopForm& form, const double* K) {
  turned_on(K, form.slide == 5, turn_5, turn_5_cosine, turn_5_sine, form.K4);
}

// A form that holds the target on the left, for one target.
inline void put_target_left(LoopForm& form, const double* X) {
  if (form.target_in == 3) set_K3(form, X);
  if (form.target_in == 4) set_K4(form, X);
  if (form.target_in == 5)
    for (int k = 0; k < 12; ++k) form.K5[k] = X[k];
  expand_left_line(form);
}

}  // namespace
