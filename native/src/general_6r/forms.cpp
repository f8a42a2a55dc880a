// The twelve forms of the loop of an arm, and the choice among them by measurement.
#include <algorithm>
#include <array>
#include <vector>

#include "general_6r/motion.hpp"
#include "general_6r/sequence.hpp"
#include "general_6r/solution_set.hpp"
#include "general_6r/tables.hpp"
#include "pieper/general_6r.hpp"
#include "pieper/kernels.hpp"
#include "simd/general_6r/left_line.hpp"

namespace pieper {
namespace {

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// Shift and direction of the forms, with the target on the right: q3 q1 q2 and, backwards, q4 q6 q5; on the left: q4 q5 q6
// and, backwards, q3 q2 q1.
constexpr int target_left_from = 6;
constexpr int form_shifts[form_count] = {0, 4, 5, 0, 4, 5, 1, 2, 3, 1, 2, 3};

// Which joint of the arm is joint `place` of the loop, both counted from 0.
int joint_at(const LoopForm& form, int place) {
  const int joint = (place + form.shift) % 6;
  return form.reversed ? 5 - joint : joint;
}

int remaining_joint(const LoopForm& form) { return joint_at(form, 2); }

// The remaining joint must turn, and so must the dropped one: a slide there would move the line along itself.
bool takes_slide(const LoopForm& form, int slide) { return joint_at(form, 2) != slide && joint_at(form, 5) != slide; }

constexpr double always_twice = 0.5;  // share of requests and twins that belongs to the arm
constexpr double worst_tail = 1e-9, least_found = 0.8, per_work = 2e-4, per_flag = 0.02;

// Which of the known solutions of a pose a form found.
using Hits = std::array<bool, SolutionSet::capacity>;

// What one form did at the poses that all were tried on.
struct Trial {
  std::vector<double> tails, works;
  std::vector<Hits> hits;  // pose by pose
  int flagged = 0, looked_twice = 0, looked_closely = 0;
  bool dropped = false;

  void add(const FormResult& result, const SolutionSet& known) {
    tails.push_back(result.tail), works.push_back(static_cast<double>(result.work));
    flagged += (result.flags & flag_hard) != 0;
    looked_twice += (result.flags & (flag_request | flag_twins)) != 0;
    looked_closely += (result.flags & (flag_some_requests | flag_near_twins)) != 0;
    for (std::size_t k = 0; k < result.count; ++k)
      for (std::size_t j = 0; j < known.count; ++j) {
        double apart = 0;
        for (int i = 0; i < 6; ++i)
          apart = std::max(
              {apart, std::abs(result.cosine[i][k] - known.c[j][i]), std::abs(result.sine[i][k] - known.s[j][i])});
        if (apart < 10 * same_solution) hits.back()[j] = true;
      }
  }

  // Whether that happened at so many poses that it is the structure of the arm, and tells nothing.
  bool often(int poses) const { return poses >= always_twice * static_cast<double>(tails.size()); }
};

// The forms tried on poses of the arm. What is known of a pose is the union of what they find there.
class Trials {
 public:
  explicit Trials(const GeneralArm& arm) : arm_(arm) {
    for (int f = 0; f < form_count; ++f) trials_[f].dropped = !takes_slide(arm.forms[f], arm.slide);
  }

  const Trial& operator[](int form) const { return trials_[form]; }

  void add_pose(const double* c, const double* s) {
    const Motion G = product(arm_, c, s);
    SolutionSet known;
    std::vector<FormResult> results(form_count);
    for (int f = 0; f < form_count; ++f) {
      if (trials_[f].dropped) continue;
      kernels().general->solve_form(trigonometric_tables(), arm_, arm_.forms[f], G.data(), results[f]);
      known.add_all(results[f], same_solution);
    }
    counts_.push_back(known.count);
    known_ += known.count;
    found_again_ += known.holds(c, s);
    for (int f = 0; f < form_count; ++f) {
      trials_[f].hits.emplace_back();
      if (!trials_[f].dropped) trials_[f].add(results[f], known);
    }
  }

  // After a first look: those that see noise, and those that are not needed beside faster ones.
  void drop_some() {
    int clean = 0;
    for (int f = 0; f < form_count; ++f) {
      Trial& trial = trials_[f];
      trial.dropped = trial.dropped || median(trial.tails) > worst_tail;
      const bool doubtful = trial.flagged >= always_doubtful * static_cast<double>(counts_.size());
      // those with the target on the left take longer: only where three of the others will not do
      if (f >= target_left_from && (clean >= 3 || (clean >= 1 && doubtful))) trial.dropped = true;
      clean += !trial.dropped && !doubtful;
    }
  }

  // Of all known solutions.
  double share(const std::vector<Hits>& hits) const {
    std::size_t found = 0;
    for (std::size_t p = 0; p < hits.size(); ++p)
      found += std::count(hits[p].begin(), hits[p].begin() + counts_[p], true);
    return known_ ? static_cast<double>(found) / static_cast<double>(known_) : 0.0;
  }

  // Of the poses, those at which the joints that made them are known.
  double found_again() const { return static_cast<double>(found_again_) / static_cast<double>(counts_.size()); }

  std::vector<Hits> together(const std::vector<Hits>& hits, int form) const {
    std::vector<Hits> with = hits;
    for (std::size_t p = 0; p < with.size(); ++p)
      for (std::size_t j = 0; j < counts_[p]; ++j) with[p][j] = with[p][j] || trials_[form].hits[p][j];
    return with;
  }

  FormReport report(int form) const {
    const Trial& trial = trials_[form];
    FormReport report{};
    report.remaining_joint = remaining_joint(arm_.forms[form]);
    report.harmonics = arm_.forms[form].harmonics, report.even = arm_.forms[form].even;
    report.median_tail = median(trial.tails), report.median_work = median(trial.works);
    report.found = trial.dropped ? 0 : share(trial.hits);
    const auto tried = static_cast<double>(std::max<std::size_t>(trial.tails.size(), 1));
    report.flagged = trial.flagged / tried, report.looked_twice = trial.looked_twice / tried;
    report.rank = -1;
    return report;
  }

 private:
  const GeneralArm& arm_;
  Trial trials_[form_count];
  std::vector<std::size_t> counts_;  // known solutions of each pose
  std::size_t known_ = 0, found_again_ = 0;
};

// What a form is worth that finds a share of the known solutions.
double score(double found, const FormReport& report) {
  return found - per_work * report.median_work - per_flag * report.flagged;
}

}  // namespace

void General6R::set_forms() {
  const Motion unit_motion{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  for (int f = 0; f < form_count; ++f) {
    LoopForm& form = arm_.forms[f];
    form = {};
    form.shift = form_shifts[f], form.reversed = f / 3 % 2;
    form.target_in = 6 - form.shift;
    Motion K[6];
    for (int j = 0; j < 6; ++j) {
      const int i = (j + form.shift) % 6;
      if (i == 5) {
        K[j] = unit_motion;
        continue;
      }
      const int from = form.reversed ? 4 - i : i;
      Motion step = motion_of(arm_.steps[from]);
      if (from == arm_.slide) step = turn_about_z(arm_.slide_cosine, arm_.slide_sine) * step;
      K[j] = form.reversed ? inverse(step) : step;
    }
    for (int place = 0; place < 6 && arm_.slide >= 0; ++place)
      if (joint_at(form, place) == arm_.slide) form.slide = place + 1;
    if (form.slide == 3 || form.slide == 6) form.slide = 0;  // not to be used
    const auto put = [](const Motion& from, double* to) { std::copy_n(from.begin(), 12, to); };
    put(inverse(K[0]), form.K1_inverse), put(K[1], form.K2), put(inverse(K[5]), form.K6_inverse);
    set_K3(form, K[2].data()), set_K4(form, K[3].data());
    put(K[4], form.K5);
    expand_left_line(form);
  }
}

// Which harmonics the determinant of each form has; structured arms lack some.
void General6R::measure_support() {
  constexpr int probes = 48;
  constexpr double present = 3e-13;
  const GeneralKernels& kernel = *kernels().general;
  Sequence numbers(1);
  std::vector<Motion> targets(probes);
  for (int p = 0; p < probes; ++p) {
    double c[6], s[6];
    draw_joints(numbers, c, s);
    targets[p] = product(arm_, c, s);
    if (p % 2)
      for (int r = 0; r < 3; ++r) targets[p][4 * r + 3] = numbers.between(-1.5, 1.5);
  }
  for (LoopForm& form : arm_.forms) {
    if (!takes_slide(form, arm_.slide)) continue;
    std::vector<double> sizes[13];
    for (const Motion& G : targets) {
      double size[13];
      if (!kernel.spectrum(trigonometric_tables(), form, G.data(), size)) continue;
      for (int k = 0; k <= 12; ++k) sizes[k].push_back(size[k]);
    }
    int highest = 1;
    bool odd = false;
    for (int k = 1; k <= 12 && sizes[k].size() > probes / 2; ++k) {
      const auto quartile = sizes[k].begin() + 3 * sizes[k].size() / 4;
      std::nth_element(sizes[k].begin(), quartile, sizes[k].end());
      if (*quartile <= present) continue;
      highest = k;
      odd = odd || k % 2;
    }
    highest = std::min(highest, 8);
    form.even = !odd && highest >= 2;
    form.harmonics = form.even ? highest / 2 : highest;
    form.samples = form.harmonics <= 2 ? 8 : form.harmonics <= 6 ? 16 : 24;
  }
}

// Tries the forms on random poses: the best single form comes first, then those that add most to it.
void General6R::choose_forms() {
  constexpr int poses = 200, first_look = 24, most_forms = 3;
  constexpr double least_found_again = 0.95;
  Trials trials(arm_);
  Sequence numbers(2);
  for (int p = 0; p < poses; ++p) {
    if (p == first_look) trials.drop_some();
    double c[6], s[6];
    draw_joints(numbers, c, s);
    trials.add_pose(c, s);
  }
  for (int f = 0; f < form_count; ++f) reports_.push_back(trials.report(f));

  const auto usable = [&](int f) {
    return !trials[f].dropped && reports_[f].median_tail <= worst_tail && reports_[f].found >= least_found;
  };
  int best = 0;
  for (int f = 1; f < form_count; ++f) {
    const bool better = score(reports_[best].found, reports_[best]) < score(reports_[f].found, reports_[f]);
    if (usable(f) == usable(best) ? better : usable(f)) best = f;
  }
  dependable_ = usable(best) && trials.found_again() >= least_found_again;
  // where roots coincide, or nearly do, by the structure of the arm, that they do tells nothing
  if (!trials[best].often(trials[best].looked_twice))
    unclear_ |= flag_request | flag_twins;
  else if (!trials[best].often(trials[best].looked_closely))
    unclear_ |= flag_some_requests | flag_near_twins;

  order_ = {best};
  std::vector<Hits> covered = trials[best].hits;
  while (order_.size() < most_forms) {
    int next = -1;
    double most = 0;
    for (int f = 0; f < form_count; ++f) {
      if (!usable(f) || std::find(order_.begin(), order_.end(), f) != order_.end()) continue;
      const double value = score(trials.share(trials.together(covered, f)), reports_[f]);
      if (next < 0 || value > most) next = f, most = value;
    }
    if (next < 0) break;
    covered = trials.together(covered, next);
    order_.push_back(next);
  }
  for (std::size_t rank = 0; rank < order_.size(); ++rank) reports_[order_[rank]].rank = static_cast<int>(rank);
}

}  // namespace pieper
