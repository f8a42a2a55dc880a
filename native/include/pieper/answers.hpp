// Answers as a caller wants them: the copy of each joint that suits, those inside limits first, the nearest to a seed first.
#pragma once

#include <cstddef>

#include "pieper/chain.hpp"
#include "pieper/closed_form.hpp"
#include "pieper/numeric_ik.hpp"

namespace pieper {

// How a target ended, as a complete method tells it; the numbers go on from NumericStatus.
enum class AnswerStatus : int { reached = 0, unreachable = 1, outside_limits = 3 };

struct AnswerOptions {
  double position_tolerance = 1e-9;  // m
  double rotation_tolerance = 1e-9;  // rad
  // Branch of each slot, the same for every target (slots), or of each slot of each target (targets, slots); or null.
  const signed char* branch_of_slot = nullptr;
  const signed char* branches = nullptr;
  TargetRows rows;  // that count, where an answer is measured again
};

// Pointers to (targets, slots, ...) arrays. The first four come from a solver and are put in order in place.
struct Answers {
  std::size_t slots;
  double* q;               // (targets, slots, n)
  double* position_error;  // (targets, slots) [m]
  double* rotation_error;  // (targets, slots) [rad]
  bool* valid;             // (targets, slots)
  bool* within_limits;     // (targets, slots)
  signed char* branch;     // (targets, slots): -1 where there is none
  signed char* status;     // (targets): an AnswerStatus
};

// A joint that turns is given as the copy nearest to the seed (or to the middle of its limits) among those inside its limits,
// values that rounding left outside are put on the limit. Then answers inside limits come first, within each kind the nearest to
// the seed first (without a seed: in the order of their branches, or of the slots). `seeds` (targets, n) or null.
void arrange(const Chain&, const double* targets, const double* seeds, std::size_t count, const AnswerOptions&,
             const Answers&);

// Every branch of a closed form, arranged; eight slots. `singular` and `doubtful` (targets), see ClosedFormResults.
void answer_by_closed_form(const Chain&, const ClosedForm&, const double* targets, const double* seeds,
                           std::size_t count, const AnswerOptions&, std::size_t threads, const Answers&, bool* singular,
                           bool* doubtful);

}  // namespace pieper
