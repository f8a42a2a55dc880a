// Scores of groups of answers against the same by plain loops, from memory that ends where the answers end; singular values that are known.
#include "pieper/scores.hpp"

#include <algorithm>
#include <limits>
#include <memory>

#include "check.hpp"

namespace {

constexpr double rounding = 1e-12;

struct Found {
  std::vector<std::int64_t> reached, solutions, most;
  std::vector<double> manipulability, singularity, margin;
  explicit Found(std::size_t groups)
      : reached(groups), solutions(groups), most(groups), manipulability(groups), singularity(groups), margin(groups) {}
  pieper::Scores scores() {
    return {reached.data(), solutions.data(), most.data(), manipulability.data(), singularity.data(), margin.data()};
  }
};

void groups_are_scored(const check::Arm& arm, std::size_t poses, std::size_t slots, unsigned seed) {
  constexpr std::size_t groups = 700;  // enough for three threads
  const std::size_t all = groups * poses * slots, n = arm.n();
  const pieper::Chain chain = arm.chain();
  const std::vector<double> drawn = check::configurations(arm, all, seed);
  const std::unique_ptr<double[]> q(new double[all * n]);
  std::copy(drawn.begin(), drawn.end(), q.get());
  const std::unique_ptr<bool[]> counted(new bool[all]);
  std::mt19937_64 random(seed);
  for (std::size_t k = 0; k < all; ++k) counted[k] = random() % 2 == 0;
  std::fill_n(&counted[poses * slots], poses * slots, false);

  const pieper::ScoreOptions options{poses, slots, 6, 1e-9, true};
  Found found(groups), by_three(groups);
  check::that(pieper::score_answers(chain, q.get(), counted.get(), groups, options, 1, found.scores()), "in range");
  check::that(pieper::score_answers(chain, q.get(), counted.get(), groups, options, 3, by_three.scores()), "in range");
  std::vector<double> measure(all);
  check::that(pieper::manipulability(chain, q.get(), all, 1, measure.data()), "in range");
  for (std::size_t g = 0; g < groups; ++g) {
    std::int64_t reached = 0, solutions = 0, most = 0;
    double best = 0, margin = -1;
    for (std::size_t pose = 0; pose < poses; ++pose) {
      std::int64_t here = 0;
      for (std::size_t k = (g * poses + pose) * slots; k < (g * poses + pose + 1) * slots; ++k) {
        if (!counted[k]) continue;
        ++here;
        best = std::max(best, measure[k]);
        double nearest = std::numeric_limits<double>::infinity();
        for (std::size_t i = 0; i < n; ++i)
          nearest = std::min({nearest, q[k * n + i] - arm.limits[2 * i], arm.limits[2 * i + 1] - q[k * n + i]});
        margin = std::max(margin, nearest);
      }
      reached += here > 0, solutions += here, most = std::max(most, here);
    }
    const std::string what = arm.name + ", group " + std::to_string(g);
    check::that(found.reached[g] == reached && found.solutions[g] == solutions && found.most[g] == most,
                what + ": counts");
    if (solutions == 0) {
      check::that(
          std::isnan(found.manipulability[g]) && std::isnan(found.singularity[g]) && std::isnan(found.margin[g]),
          what + ": nothing to tell");
      continue;
    }
    check::near(found.manipulability[g], best, rounding, what + ": manipulability");
    check::that(found.margin[g] == margin, what + ": margin");
    // the smallest of k factors is at most the root of their product
    const double root = std::pow(best, 1.0 / static_cast<double>(std::min<std::size_t>(6, n)));
    check::that(found.singularity[g] > 0 && found.singularity[g] <= root + rounding, what + ": singularity");
    check::that(found.manipulability[g] == by_three.manipulability[g] &&
                    found.singularity[g] == by_three.singularity[g] && found.margin[g] == by_three.margin[g] &&
                    found.solutions[g] == by_three.solutions[g],
                what + ": the same by three threads");
  }
}

void a_value_that_is_none_is_told(const check::Arm& arm) {
  std::vector<double> q = check::configurations(arm, 3, 1);
  q[arm.n() + 1] = std::numeric_limits<double>::quiet_NaN();
  const bool counted[3] = {true, true, true}, without[3] = {true, false, true};
  const pieper::ScoreOptions options{3, 1, 6, 1e-9, true};
  Found found(1);
  check::that(!pieper::score_answers(arm.chain(), q.data(), counted, 1, options, 1, found.scores()), "no number");
  check::that(pieper::score_answers(arm.chain(), q.data(), without, 1, options, 1, found.scores()), "not looked at");
}

// Diagonal matrices, turned in every plane on both sides.
void singular_values_are_known(std::size_t rows, std::size_t n, std::size_t count) {
  const std::size_t rank = std::min(rows, n);
  std::vector<double> matrices(count * 6 * n, 0.0), product(count), smallest(count), expected;
  for (std::size_t k = 0; k < count; ++k) {
    double* J = &matrices[k * 6 * n];
    const double least = std::pow(10.0, -static_cast<double>(k));
    for (std::size_t i = 0; i < rank; ++i) J[i * n + i] = i + 1 == rank ? least : 1.0 + static_cast<double>(i);
    for (std::size_t a = 0; a < rows; ++a)
      for (std::size_t b = a + 1; b < rows; ++b)
        for (std::size_t j = 0; j < n; ++j) {
          const double x = J[a * n + j], y = J[b * n + j], t = 0.3 + static_cast<double>(a + 2 * b + k);
          J[a * n + j] = std::cos(t) * x - std::sin(t) * y, J[b * n + j] = std::sin(t) * x + std::cos(t) * y;
        }
    for (std::size_t a = 0; a < n; ++a)
      for (std::size_t b = a + 1; b < n; ++b)
        for (std::size_t i = 0; i < rows; ++i) {
          const double x = J[i * n + a], y = J[i * n + b], t = 0.7 + static_cast<double>(3 * a + b + k);
          J[i * n + a] = std::cos(t) * x - std::sin(t) * y, J[i * n + b] = std::sin(t) * x + std::cos(t) * y;
        }
    double all = least;
    for (std::size_t i = 0; i + 1 < rank; ++i) all *= 1.0 + static_cast<double>(i);
    expected.insert(expected.end(), {all, least});
  }
  pieper::kernels().singular_values(matrices.data(), count, n, rows, product.data(), smallest.data());
  for (std::size_t k = 0; k < count; ++k) {
    check::near(smallest[k], expected[2 * k + 1], 1e-14, "smallest singular value");
    check::near(product[k], expected[2 * k], 1e-11, "product of the singular values");
  }
}

}  // namespace

int main() {
  check::with_every_instruction_set([](const std::string&) {
    groups_are_scored(check::industrial(), 5, 8, 1);
    groups_are_scored(check::industrial(), 1, 200, 2);
    groups_are_scored(check::askew(), 5, 3, 3);
    a_value_that_is_none_is_told(check::industrial());
    a_value_that_is_none_is_told(check::askew());
    for (std::size_t n : {1, 2, 3, 6, 7, 9}) {
      singular_values_are_known(6, n, 11);
      singular_values_are_known(3, n, 3);
    }
  });
  return check::result();
}
