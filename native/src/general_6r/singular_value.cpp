#include "general_6r/singular_value.hpp"

#include <algorithm>
#include <cmath>

#include "general_6r/motion.hpp"
#include "simd/general_6r/line_numbers.hpp"

namespace pieper {

double least_singular_value(const GeneralArm& arm, const double* c, const double* s, double* direction) {
  double z[6][3], o[6][3], J[6][6];
  Motion T = motion_of_joint(arm, 0, c[0], s[0]);
  for (int i = 0; i < 6; ++i) {
    if (i > 0) T = T * motion_of(arm.steps[i - 1]) * motion_of_joint(arm, i, c[i], s[i]);
    for (int r = 0; r < 3; ++r) z[i][r] = T[4 * r + 2], o[i][r] = T[4 * r + 3];
  }
  for (int i = 0; i < 6; ++i) {
    double moment[3];
    cross_product(o[i], z[i], moment);
    for (int r = 0; r < 3; ++r) J[r][i] = moment[r], J[3 + r][i] = z[i][r];
    if (i == arm.slide)
      for (int r = 0; r < 3; ++r) J[r][i] = z[i][r], J[3 + r][i] = 0;
  }
  // J = Q R by the method of Gram and Schmidt in its stable order; forming J^T J would hide what is below 1e-8
  double R[6][6] = {};
  for (int j = 0; j < 6; ++j) {
    double square = 0;
    for (int r = 0; r < 6; ++r) square += J[r][j] * J[r][j];
    R[j][j] = std::max(std::sqrt(square), 1e-18);
    for (int r = 0; r < 6; ++r) J[r][j] /= R[j][j];
    for (int k = j + 1; k < 6; ++k) {
      for (int r = 0; r < 6; ++r) R[j][k] += J[r][j] * J[r][k];
      for (int r = 0; r < 6; ++r) J[r][k] -= R[j][k] * J[r][j];
    }
  }
  double x[6] = {0.61, -0.43, 0.37, 0.52, -0.29, 0.33}, growth = 1;
  for (int step = 0; step < 3; ++step) {
    for (int i = 0; i < 6; ++i) {
      for (int k = 0; k < i; ++k) x[i] -= R[k][i] * x[k];
      x[i] /= R[i][i];
    }
    for (int i = 5; i >= 0; --i) {
      for (int k = i + 1; k < 6; ++k) x[i] -= R[i][k] * x[k];
      x[i] /= R[i][i];
    }
    growth = 0;
    for (double v : x) growth += v * v;
    growth = std::sqrt(growth);
    for (double& v : x) v /= growth;
  }
  std::copy_n(x, 6, direction);
  return 1 / std::sqrt(growth);
}

}  // namespace pieper
