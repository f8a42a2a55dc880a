// The best of the answers to groups of poses: a group is what is asked in one voxel of a map.
#pragma once

#include <cstddef>
#include <cstdint>

#include "pieper/chain.hpp"

namespace pieper {

struct ScoreOptions {
  std::size_t poses = 1;  // of a group; groups follow each other
  std::size_t slots = 0;  // for answers of a pose
  std::size_t rows = 6;   // of the Jacobian that count: 6, or 3 for the velocity of the tip alone
  double alike = 1e-9;    // answers whose manipulability is less by this much, relatively, are as good as the best
  bool measures = true;   // false: the counts alone
};

// What answers q (groups, poses, slots, n) are worth, those alone that `counted` (groups, poses, slots) marks.
struct Scores {
  std::int64_t* reached;    // (groups): poses with an answer
  std::int64_t* solutions;  // (groups): answers
  std::int64_t* most;       // (groups): of one pose
  // (groups), not a number where there is no answer; not written for the counts alone
  double* manipulability;  // greatest product of the singular values that count
  double* singularity;     // smallest of these of the answer with that product; of answers that are alike, the greatest
  double* margin;          // greatest distance of the joint nearest to one of its limits
};

// False when a joint value that counts is too large or no number. What is found is the same for any number of threads.
bool score_answers(const Chain&, const double* q, const bool* counted, std::size_t groups, const ScoreOptions&,
                   std::size_t threads, const Scores& out);

// One after the other: a part of the groups, see dispatch.cpp.
bool score_some(const Chain&, const double* q, const bool* counted, std::size_t groups, const ScoreOptions&,
                const Scores& out);

}  // namespace pieper
