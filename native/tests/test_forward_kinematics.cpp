// Poses equal the product of exponentials, for every instruction set, count and number of threads.
#include <limits>

#include "check.hpp"

namespace {

constexpr double tolerance = 1e-14;  // m and -: a few dozen roundings on poses of about a metre

void poses_are_the_product_of_exponentials(const check::Arm& arm, const std::string& where) {
  const pieper::Chain chain = arm.chain();
  for (std::size_t count : {0u, 1u, 2u, 3u, 7u, 8u, 9u, 33u, 1000u}) {
    const std::vector<double> q = check::configurations(arm, count, 1);
    for (std::size_t threads : {1u, 2u}) {
      std::vector<double> out(16 * count);
      check::that(pieper::forward_kinematics(chain, q.data(), count, threads, out.data()), where + ": finite");
      for (std::size_t k = 0; k < count; ++k) {
        const check::Pose expected = check::slow_pose(arm, &q[k * arm.n()]);
        for (int i = 0; i < 16; ++i) check::near(out[16 * k + i], expected[i], tolerance, where + ": pose");
      }
    }
  }
}

void what_is_not_finite_is_refused(const check::Arm& arm, const std::string& where) {
  const pieper::Chain chain = arm.chain();
  for (double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (std::size_t place : {std::size_t{0}, 20 * arm.n() - 1}) {
      std::vector<double> q = check::configurations(arm, 20, 2), out(16 * 20);
      q[place] = bad;
      check::that(!pieper::forward_kinematics(chain, q.data(), 20, 1, out.data()),
                  where + ": NaN or infinity is found");
    }
  }
}

// Two axes with one joint: the second turns back half as much as the first.
void coupled_axes_move_together() {
  const std::vector<double> screws{0, 0, 0, 0, 0, 1, 0, -1, 0, 0, 0, 1}, coupling{1, -0.5}, limits{-3, 3};
  const std::array<double, 16> home{1, 0, 0, 2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  const pieper::Chain chain(screws.data(), 2, home.data(), coupling.data(), 1, limits.data());
  check::that(chain.coupled(), "the chain is coupled");
  const double q = 0.8;
  double T[16];
  check::that(pieper::forward_kinematics(chain, &q, 1, 1, T), "finite");
  check::near(T[3], std::cos(q) + std::cos(0.5 * q), tolerance, "x of a coupled arm");
  check::near(T[7], std::sin(q) + std::sin(0.5 * q), tolerance, "y of a coupled arm");
}

}  // namespace

int main() {
  check::that(!pieper::use_instruction_set("abacus"), "an unknown instruction set is refused");
  check::with_every_instruction_set([](const std::string& name) {
    for (const check::Arm& arm : {check::industrial(), check::askew()}) {
      poses_are_the_product_of_exponentials(arm, name + ", " + arm.name);
      what_is_not_finite_is_refused(arm, name + ", " + arm.name);
    }
    coupled_axes_move_together();
  });
  return check::result();
}
