// What the tests share: checks that count, two arms, and the product of exponentials written out plainly.
#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "pieper/chain.hpp"
#include "pieper/kernels.hpp"

namespace check {

inline int failures = 0;

inline void that(bool fine, const std::string& what) {
  if (fine) return;
  ++failures;
  std::printf("failed: %s\n", what.c_str());
}

inline void near(double got, double expected, double tolerance, const std::string& what) {
  that(std::abs(got - expected) <= tolerance,
       what + ": got " + std::to_string(got) + ", expected " + std::to_string(expected));
}

inline int result() {
  std::printf("%s\n", failures == 0 ? "all passed" : "failures above");
  return failures == 0 ? 0 : 1;
}

constexpr double pi = 3.14159265358979323846;

// An arm by screws (linear part first), home pose and limits; every joint moves its own axis.
struct Arm {
  std::string name;
  std::vector<double> screws;
  std::array<double, 16> home;
  std::vector<double> limits;

  std::size_t n() const { return screws.size() / 6; }

  pieper::Chain chain() const {
    std::vector<double> identity(n() * n(), 0.0);
    for (std::size_t i = 0; i < n(); ++i) identity[i * n() + i] = 1.0;
    return {screws.data(), n(), home.data(), identity.data(), n(), limits.data()};
  }
};

inline std::vector<double> same_limits(std::size_t n, double lower, double upper) {
  std::vector<double> limits;
  for (std::size_t i = 0; i < n; ++i) limits.push_back(lower), limits.push_back(upper);
  return limits;
}

// Six turning joints with a spherical wrist.
inline Arm industrial() {
  return {"industrial",
          {0, 0,      0, 0,  0, 1, -0.45, 0, 0.155,  0, 1,  0, 1.064, 0,      -0.155, 0,  -1, 0,
           0, -1.264, 0, -1, 0, 0, 1.264, 0, -0.795, 0, -1, 0, 0,     -1.264, 0,      -1, 0,  0},
          {0, 0, 1, 0.895, 0, -1, 0, 0, 1, 0, 0, 1.264, 0, 0, 0, 1},
          same_limits(6, -2.5, 2.5)};
}

// A slide, a joint askew to it, and one askew to that: nothing is parallel or square.
inline Arm askew() {
  const double s = std::sqrt(0.5), t = 1.0 / std::sqrt(3.0);
  const double p[3] = {0.3, -0.2, 0.5};
  const std::array<double, 3> w{t, -t, t};
  return {"askew",
          {0.6, 0, 0.8, 0, 0, 0,  //
           0, 0, 0, 0, s, s,      //
           p[1] * w[2] - p[2] * w[1], p[2] * w[0] - p[0] * w[2], p[0] * w[1] - p[1] * w[0], w[0], w[1], w[2]},
          {1, 0, 0, 0.4, 0, 1, 0, 0.1, 0, 0, 1, 0.7, 0, 0, 0, 1},
          same_limits(3, -1.0, 1.0)};
}

using Pose = std::array<double, 16>;

inline Pose product(const Pose& A, const Pose& B) {
  Pose C{};
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      for (int k = 0; k < 4; ++k) C[4 * i + j] += A[4 * i + k] * B[4 * k + j];
  return C;
}

// exp([S] q) by Rodrigues' formula for unit screws (Modern Robotics, eq. 3.88), linear part first.
inline Pose exponential(const double* screw, double q) {
  const double *v = screw, *w = screw + 3;
  Pose T{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  if (w[0] == 0 && w[1] == 0 && w[2] == 0) {
    for (int i = 0; i < 3; ++i) T[4 * i + 3] = v[i] * q;
    return T;
  }
  const double W[3][3] = {{0, -w[2], w[1]}, {w[2], 0, -w[0]}, {-w[1], w[0], 0}};
  for (int i = 0; i < 3; ++i) {
    double moved = 0;
    for (int j = 0; j < 3; ++j) {
      double W2 = 0;
      for (int k = 0; k < 3; ++k) W2 += W[i][k] * W[k][j];
      T[4 * i + j] += std::sin(q) * W[i][j] + (1 - std::cos(q)) * W2;
      moved += ((i == j ? q : 0.0) + (1 - std::cos(q)) * W[i][j] + (q - std::sin(q)) * W2) * v[j];
    }
    T[4 * i + 3] = moved;
  }
  return T;
}

inline Pose slow_pose(const Arm& arm, const double* q) {
  Pose T{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  for (std::size_t i = 0; i < arm.n(); ++i) T = product(T, exponential(&arm.screws[6 * i], q[i]));
  return product(T, arm.home);
}

inline std::vector<double> configurations(const Arm& arm, std::size_t count, unsigned seed) {
  std::mt19937_64 random(seed);
  std::vector<double> q;
  for (std::size_t k = 0; k < count; ++k)
    for (std::size_t i = 0; i < arm.n(); ++i)
      q.push_back(std::uniform_real_distribution<double>(arm.limits[2 * i], arm.limits[2 * i + 1])(random));
  return q;
}

// Runs a test once for every instruction set that this processor has.
template <typename Test>
void with_every_instruction_set(Test test) {
  for (const std::string& name : pieper::instruction_sets()) {
    that(pieper::use_instruction_set(name), "instruction set " + name + " can be chosen");
    test(name);
  }
}

}  // namespace check
