// Jacobians against differences of poses, and their own derivatives against differences of Jacobians.
#include "check.hpp"

namespace {

constexpr double step = 1e-6;
constexpr double tolerance = 1e-8;  // rounding 1e-16 / step, and the third derivative times step^2

using Kind = pieper::JacobianKind;

std::vector<double> jacobian(const check::Arm& arm, const std::vector<double>& q, Kind kind) {
  std::vector<double> J(6 * arm.n());
  check::that(pieper::jacobian(arm.chain(), q.data(), 1, kind, 1, J.data()), "finite");
  return J;
}

std::vector<double> moved(std::vector<double> q, std::size_t joint, double by) {
  q[joint] += by;
  return q;
}

void columns_are_velocities(const check::Arm& arm, const std::vector<double>& q) {
  const std::vector<double> geometric = jacobian(arm, q, Kind::geometric), space = jacobian(arm, q, Kind::space),
                            body = jacobian(arm, q, Kind::body);
  const check::Pose T = check::slow_pose(arm, q.data());
  for (std::size_t j = 0; j < arm.n(); ++j) {
    const check::Pose ahead = check::slow_pose(arm, moved(q, j, step).data()),
                      behind = check::slow_pose(arm, moved(q, j, -step).data());
    // dT/dq: its last column is the velocity of the tip, and dR R^T the angular velocity.
    double v[3], w[3], D[3][3];
    for (int a = 0; a < 3; ++a) {
      v[a] = (ahead[4 * a + 3] - behind[4 * a + 3]) / (2 * step);
      for (int b = 0; b < 3; ++b) D[a][b] = (ahead[4 * a + b] - behind[4 * a + b]) / (2 * step);
    }
    const auto dR_Rt = [&](int a, int b) {
      return D[a][0] * T[4 * b] + D[a][1] * T[4 * b + 1] + D[a][2] * T[4 * b + 2];
    };
    w[0] = dR_Rt(2, 1), w[1] = dR_Rt(0, 2), w[2] = dR_Rt(1, 0);
    const double p[3] = {T[3], T[7], T[11]};
    for (int a = 0; a < 3; ++a) {
      const int b = (a + 1) % 3, c = (a + 2) % 3;
      const auto at = [&](const std::vector<double>& J, int row) { return J[row * arm.n() + j]; };
      check::near(at(geometric, a), v[a], tolerance, arm.name + ": velocity");
      check::near(at(geometric, a + 3), w[a], tolerance, arm.name + ": angular velocity");
      check::near(at(space, a), v[a] - (w[b] * p[c] - w[c] * p[b]), tolerance, arm.name + ": space twist");
      check::near(at(space, a + 3), w[a], tolerance, arm.name + ": space twist");
      check::near(at(body, a), T[a] * v[0] + T[4 + a] * v[1] + T[8 + a] * v[2], tolerance, arm.name + ": body twist");
      check::near(at(body, a + 3), T[a] * w[0] + T[4 + a] * w[1] + T[8 + a] * w[2], tolerance,
                  arm.name + ": body twist");
    }
  }
}

void derivatives_are_differences(const check::Arm& arm, const std::vector<double>& q) {
  const std::size_t n = arm.n();
  std::vector<double> H(n * 6 * n), rate(6 * n), sum(6 * n, 0.0), dq;
  pieper::hessian(arm.chain(), q.data(), 1, H.data());
  for (std::size_t j = 0; j < n; ++j) dq.push_back(0.3 * static_cast<double>(j) - 0.7);
  pieper::jacobian_rate(arm.chain(), q.data(), dq.data(), 1, rate.data());
  for (std::size_t j = 0; j < n; ++j) {
    const std::vector<double> ahead = jacobian(arm, moved(q, j, step), Kind::geometric),
                              behind = jacobian(arm, moved(q, j, -step), Kind::geometric);
    for (std::size_t i = 0; i < 6 * n; ++i) {
      check::near(H[j * 6 * n + i], (ahead[i] - behind[i]) / (2 * step), tolerance, arm.name + ": Hessian");
      sum[i] += H[j * 6 * n + i] * dq[j];
    }
  }
  for (std::size_t i = 0; i < 6 * n; ++i) check::near(rate[i], sum[i], 1e-13, arm.name + ": rate of the Jacobian");
}

}  // namespace

int main() {
  check::with_every_instruction_set([](const std::string&) {
    for (const check::Arm& arm : {check::industrial(), check::askew()}) {
      for (unsigned seed = 0; seed < 20; ++seed) {
        const std::vector<double> q = check::configurations(arm, 1, seed);
        columns_are_velocities(arm, q);
        derivatives_are_differences(arm, q);
      }
    }
  });
  return check::result();
}
