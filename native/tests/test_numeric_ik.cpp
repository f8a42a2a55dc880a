// Inverse kinematics: poses of the arm itself are found again, and what is out of reach says so.
#include <memory>

#include "check.hpp"

namespace {

constexpr double tolerance = 1e-9;  // m and rad, as asked of the solver

struct Answers {
  std::vector<double> q, position_error, rotation_error, nearest, nearest_position, nearest_rotation;
  std::unique_ptr<bool[]> valid, within;
  std::vector<signed char> status;

  Answers(const pieper::Chain& chain, const std::vector<double>& targets) {
    const std::size_t count = targets.size() / 16, n = chain.joints();
    q.resize(count * n), nearest.resize(count * n), status.resize(count);
    for (auto* errors : {&position_error, &rotation_error, &nearest_position, &nearest_rotation}) errors->resize(count);
    valid = std::make_unique<bool[]>(count), within = std::make_unique<bool[]>(count);
    pieper::solve_numeric(chain, targets.data(), nullptr, count, {}, {}, 1,
                          {q.data(), position_error.data(), rotation_error.data(), valid.get(), within.get(),
                           nearest.data(), nearest_position.data(), nearest_rotation.data(), status.data()});
  }
};

void poses_of_the_arm_are_found_again(const std::string& where) {
  const check::Arm arm = check::industrial();
  const pieper::Chain chain = arm.chain();
  const std::size_t count = 50;
  const std::vector<double> q = check::configurations(arm, count, 4);
  std::vector<double> targets(16 * count);
  pieper::forward_kinematics(chain, q.data(), count, 1, targets.data());
  const Answers answers(chain, targets);
  for (std::size_t k = 0; k < count; ++k) {
    check::that(answers.valid[k] && answers.within[k] && answers.status[k] == 0,
                where + ": a pose of the arm is found");
    const check::Pose T = check::slow_pose(arm, &answers.q[6 * k]);
    for (int i = 0; i < 16; ++i)
      check::near(T[i], targets[16 * k + i], 2 * tolerance, where + ": the pose is the target");
    for (int j = 0; j < 6; ++j) check::near(answers.q[6 * k + j], 0.0, 2.5, where + ": within limits");
  }
}

void out_of_reach_is_a_result(const std::string& where) {
  const check::Arm arm = check::industrial();
  std::vector<double> target(arm.home.begin(), arm.home.end());
  target[3] = 10.0;
  const Answers answers(arm.chain(), target);
  check::that(!answers.valid[0] && answers.status[0] != 0, where + ": ten metres away is not reached");
  check::that(answers.nearest_position[0] > 8.0 && answers.nearest_position[0] < 10.0,
              where + ": the nearest pose is far");
}

}  // namespace

int main() {
  check::with_every_instruction_set([](const std::string& name) {
    poses_of_the_arm_are_found_again(name);
    out_of_reach_is_a_result(name);
  });
  return check::result();
}
