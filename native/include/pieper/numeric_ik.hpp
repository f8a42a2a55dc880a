// Inverse kinematics by iteration, for any chain: what is asked, and what comes back. Plain data, like Folded.
#pragma once

#include <cstddef>
#include <vector>

#include "pieper/chain.hpp"

namespace pieper {

// Which rotation of the target counts: none, only the direction of one tool axis, or all three components.
enum class RotationTarget : int { free = 0, axis = 1, full = 2 };

// Rows of a target. A weight of 0 leaves a row out; the others say how much a metre or a radian counts in the nearest
// pose.
struct TargetRows {
  double weights[6] = {1, 1, 1, 1, 1, 1};  // position x y z, rotation vector x y z
  bool position_in_tool = false;           // rows along the axes of the target pose instead of the base axes
  bool rotation_in_tool = false;
  RotationTarget rotation = RotationTarget::full;
  double axis[3] = {0, 0, 1};  // unit vector in tool axes, for RotationTarget::axis
};

struct PoseError {
  double position, rotation;  // [m], [rad]
};

// Errors of the chosen rows at a pose (3x4 of a 4x4, row-major), without weights.
PoseError pose_error(const double* target, const double* pose, const TargetRows&);

struct NumericOptions {
  double position_tolerance = 1e-9;  // m
  double rotation_tolerance = 1e-9;  // rad
  std::size_t restarts = 512;        // starting points, a given seed included
  std::size_t iterations = 40;       // of one starting point
  std::size_t count = 1;             // distinct solutions to look for
  double distinct = 1e-3;            // two solutions differ by more than this in some joint [rad or m]
};

// Where solutions are looked for. Joints that can turn a full turn are left to turn freely and are brought back later.
struct SearchSpace {
  std::size_t joints = 0;
  const double* lower = nullptr;  // box that the iteration keeps to; infinite for a joint that turns freely
  const double* upper = nullptr;
  const double* first = nullptr;  // box of the starting points
  const double* last = nullptr;
  const double* longest_step = nullptr;  // of each joint in one iteration [rad or m]
  const bool* turns = nullptr;           // joints that turn freely
  const double* coupling = nullptr;      // (axes, joints), or null where every joint moves its own axis
  // Starting points by their poses: twelve rows (position, rotation row-major) of `entries` numbers, page after page.
  const double* poses = nullptr;
  const double* starts = nullptr;  // (pages * entries, joints)
  std::size_t pages = 0, entries = 0;
  const double* steps = nullptr;  // (joints) of the sequence that goes on beyond the table
};

// How a target ended.
enum class NumericStatus : int { reached = 0, unreachable = 1, not_converged = 2 };

struct NumericAnswer {
  double* solutions;  // (count, joints), in the search space
  std::size_t found = 0;
  double* nearest;  // (joints): the best that was found when nothing was reached
  NumericStatus status = NumericStatus::not_converged;
  std::size_t starts = 0;
  std::size_t steps = 0;  // vector steps of all lanes together
};

// What a batch of targets gives back; pointers to (targets, ...) arrays. Lanes of `q` that hold nothing are NaN.
struct NumericResults {
  double* q;               // (targets, count, n)
  double* position_error;  // (targets, count) [m], over the chosen rows
  double* rotation_error;  // (targets, count) [rad]
  bool* valid;             // (targets, count)
  bool* within_limits;     // (targets, count)
  double* nearest;         // (targets, n)
  double* nearest_position_error;
  double* nearest_rotation_error;
  signed char* status;  // (targets)
};

// `targets` (count, 4, 4); `seeds` (count, n) or null. Answers depend on nothing but their own target and seed. Returns
// the number of targets that were not reached.
std::size_t solve_numeric(const Chain&, const double* targets, const double* seeds, std::size_t count,
                          const TargetRows&, const NumericOptions&, std::size_t threads, const NumericResults&);

}  // namespace pieper
