// Inverse kinematics in closed form: the constants of an arm that has one, and what comes back. Plain data, like
// Folded.
#pragma once

#include <cstddef>

#include "pieper/chain.hpp"

namespace pieper {

// Axes 4, 5, 6 meet in one point; or axes 2, 3, 4 are parallel, and axes 5 and 6 meet or there is no axis 6; or they
// are skew. Two or three parallel axes alone, perhaps with a slide along them (planar arms, SCARA); three slides, then
// up to three axes of any kind (gantries).
enum class ClosedFormFamily : int {
  spherical_wrist = 0,
  three_parallel = 1,
  three_parallel_skew = 2,
  planar = 3,
  gantry = 4
};

// How the first three axes of an arm with a spherical wrist lie.
enum class FirstThree : int {
  parallel_23 = 0,
  parallel_12 = 1,
  intersecting_12 = 2,
  intersecting_23 = 3,
  general = 4,
  sliding_3 = 5,  // axes 1 and 2 meet, joint 3 slides
};

// Unit vectors for subproblem 4: the axis, e along the part of the other axis across it, and f = axis x e.
struct HeightFrame {
  double axis[3], e[3], f[3];
  double cosine, inverse_sine;  // of the angle between the two axes
};

// Up to this many answers for one pose.
inline constexpr std::size_t closed_form_branches = 8;

struct ClosedForm {
  ClosedFormFamily family;
  FirstThree first_three;
  bool reversed;  // constants are those of the arm read from tip to base
  std::size_t joints;
  // Turns are found by slots, those of axes 1 to 6 as below; a slot has a joint (-1: none), which turns or slides.
  int joint_of[6];
  bool slides[6];
  bool uses_front, uses_elbow, uses_wrist;  // signs that lead to different answers
  double axis[6][3];                        // directions
  double point[6][3];                       // a point on each
  double meet[3];                           // where the axes of the wrist meet, or axes 5 and 6
  double corner[3];                         // where axes 1 and 2, or 2 and 3, meet
  double undo_home[12];
  HeightFrame front;     // of the first stage
  HeightFrame pair;      // axes 4 and 5, or 5 and 6
  HeightFrame shoulder;  // axes 1 and 2, or 2 and 3, where they meet
  double height;         // of the first stage
  // The two arms of the elbow across its axis, and their lengths.
  double near_arm[3], far_arm[3], near_length, far_length;
  double offset;          // along the axis of the elbow
  double unmix[9];        // of a gantry: slides from a displacement
  double across_last[3];  // a unit vector across axis 6 (or 4) that tells how far it has turned
  double scale;           // a length of the arm, by which errors in metres and in radians are compared
  double capture;         // answers off by no more than this [scaled] are polished on the arm itself

  // Of quartics. Common normal of axes 1 and 2: from axis 1 to the foot on axis 2.
  double foot_1[3], foot_2[3], normal[3], normal_length, sine_12;
  signed char branch_of_slot[closed_form_branches] = {0, 1, 2, 3, 4, 5, 6, 7};  // its number as the caller names it
  double widened;  // least square of the sine of an angle at a fold; 0 for an arm that is what it is taken for

  // `screws` (joints, 6) of the arm in its own order, idealised where its numbers are rounded, and its home pose (4,
  // 4).
  ClosedForm(ClosedFormFamily, FirstThree, bool reversed, const double* screws, std::size_t joints, const double* home,
             double scale, double capture, double widened);
};

// Pointers to (poses, 8, ...) arrays. The place of an answer is its branch; places that hold none are NaN.
struct ClosedFormResults {
  double* q;               // (poses, 8, joints)
  double* position_error;  // (poses, 8) [m]
  double* rotation_error;  // (poses, 8) [rad]
  bool* valid;             // (poses, 8)
  bool* singular;          // (poses): two answers meet, or a joint is free; null where nobody asks
  bool* doubtful;          // (poses): an ideal arm stands beside a fold, where the arm itself may have other answers
};

struct ClosedFormOptions {
  double position_tolerance = 1e-9;  // m
  double rotation_tolerance = 1e-9;  // rad
};

void solve_closed_form(const Chain&, const ClosedForm&, const double* targets, std::size_t count,
                       const ClosedFormOptions&, std::size_t threads, const ClosedFormResults&);

}  // namespace pieper
