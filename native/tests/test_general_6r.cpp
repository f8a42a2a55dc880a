// The general solver, with and without a slide: poses of the arm are found again, every answer is one, and what is out of reach has none.
#include "pieper/general_6r.hpp"

#include <algorithm>
#include <memory>

#include "check.hpp"

namespace {

constexpr double tolerance = 1e-9;  // m and rad
constexpr double same = 1e-6;       // rad

struct Answers {
  std::vector<double> q, position_error, rotation_error;
  std::unique_ptr<bool[]> valid;
  std::vector<int> flags;

  Answers(const pieper::General6R& solver, const std::vector<double>& targets) {
    const std::size_t count = targets.size() / 16, most = pieper::most_solutions;
    q.resize(count * most * 6), position_error.resize(count * most), rotation_error.resize(count * most);
    valid = std::make_unique<bool[]>(count * most), flags.resize(count);
    solver.solve(targets.data(), count, pieper::GeneralMode::fast, 1,
                 {q.data(), position_error.data(), rotation_error.data(), valid.get(), flags.data()});
  }
};

// The industrial arm with one axis that slides along itself.
check::Arm with_slide(int place) {
  check::Arm arm = check::industrial();
  if (place < 0) return arm;
  double* screw = &arm.screws[6 * static_cast<std::size_t>(place)];
  for (int r = 0; r < 3; ++r) screw[r] = screw[3 + r], screw[3 + r] = 0;
  arm.limits[2 * static_cast<std::size_t>(place)] = -0.5, arm.limits[2 * static_cast<std::size_t>(place) + 1] = 0.8;
  return arm;
}

void poses_of_the_arm_are_found_again(const std::string& where, int slide) {
  const check::Arm arm = with_slide(slide);
  const pieper::Chain chain = arm.chain();
  const pieper::General6R solver(chain);
  const std::size_t count = 200, most = pieper::most_solutions;
  const std::vector<double> q = check::configurations(arm, count, 4);
  std::vector<double> targets(16 * count);
  pieper::forward_kinematics(chain, q.data(), count, 1, targets.data());
  const Answers answers(solver, targets);
  for (std::size_t k = 0; k < count; ++k) {
    double nearest = 10;
    for (std::size_t s = k * most; s < (k + 1) * most; ++s) {
      if (!answers.valid[s]) continue;
      check::that(answers.position_error[s] < tolerance && answers.rotation_error[s] < tolerance,
                  where + ": an answer meets the target");
      double apart = 0;
      for (int j = 0; j < 6; ++j) {
        const double off = answers.q[6 * s + j] - q[6 * k + j];
        apart = std::max(apart, std::abs(j == slide ? off : std::remainder(off, 2 * check::pi)));
      }
      nearest = std::min(nearest, apart);
    }
    check::that(nearest < same, where + ": the joints that made the pose are among the answers");
  }
}

void two_slides_do_not_fit() {
  check::Arm arm = with_slide(1);
  check::that(pieper::General6R::fits(arm.chain()), "one slide fits");
  for (int r = 0; r < 3; ++r) arm.screws[24 + r] = arm.screws[27 + r], arm.screws[27 + r] = 0;
  check::that(!pieper::General6R::fits(arm.chain()), "two slides do not fit");
}

void out_of_reach_has_no_answer(const std::string& where) {
  const check::Arm arm = check::industrial();
  const pieper::Chain chain = arm.chain();
  std::vector<double> target(arm.home.begin(), arm.home.end());
  target[3] = 10.0;
  const Answers answers(pieper::General6R(chain), target);
  for (std::size_t s = 0; s < pieper::most_solutions; ++s)
    check::that(!answers.valid[s], where + ": ten metres away is not reached");
}

}  // namespace

int main() {
  check::with_every_instruction_set([](const std::string& name) {
    // a slide in place of the first joint or of one of the wrist would leave an arm that does not reach all of space
    for (int slide : {-1, 1, 2}) poses_of_the_arm_are_found_again(name, slide);
    two_slides_do_not_fit();
    out_of_reach_has_no_answer(name);
  });
  return check::result();
}
