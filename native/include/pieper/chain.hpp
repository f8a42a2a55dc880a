// A serial chain, given by its screws and its home pose, folded into the form that the kernels run.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <mutex>
#include <vector>

namespace pieper {

// How an axis is tilted against the next one; the cheap cases are worth naming.
// Directions are chosen such that a twist lies between 0 and 90 degrees (180 at the tip).
enum class Twist : unsigned char { parallel, square, general };

// Which part of Trans(x, y, z) lies across the axis; mostly none or x alone.
enum class Reach : unsigned char { none, along_x, both };

// One axis: Rz(angle) Trans(x, y, z) Rx(twist), with angle = sign q + offset when it turns and z + sign q when it slides.
// Axes that are parallel to their successor belong to one group: their angles add up, only the last turns the frame, and
// it carries the z of all of them.
struct Axis {
  double sign, offset;
  double x, y, z;
  double cos_twist, sin_twist;
  bool revolute;
  Twist twist;
  Reach reach;
  double turn;  // sign when the axis turns, 0 when it slides
};

// A frame that moves with the first `after` axes, by its pose at the home configuration (3x4, row-major).
struct LinkFrame {
  std::size_t after;
  std::array<double, 12> home;
};

// Where a joint may be, and whether a whole turn brings it back to where it was.
struct JointRange {
  double lower, upper;
  double centre;  // of the limits; 0 where one of them is infinite
  bool turns;
};

// What the kernels read: plain data, because code compiled for several instruction sets must not share inline functions.
struct Folded {
  const Axis* axes = nullptr;  // m of them
  std::size_t count = 0;
  // Base to first axis, and what is left to the tip after the last one has turned: both constant.
  bool base_turned = false, tip_turned = false;
  double base_rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  double base_position[3] = {0, 0, 0};
  double tip_rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
};

class SearchTable;  // see search_table.hpp

class Chain {
 public:
  // The screws (m, 6) linear part first and the home pose (4, 4), row-major, in the base frame. `coupling` (m, n) gives
  // the axis values from the joint values; `limits` is (n, 2).
  Chain(const double* screws, std::size_t m, const double* home, const double* coupling, std::size_t n,
        const double* limits);
  Chain(const Chain&) = delete;
  Chain& operator=(const Chain&) = delete;

  std::size_t joints() const { return joints_; }
  std::size_t axes() const { return axes_.size(); }
  // True when mimic joints move several axes with one joint.
  bool coupled() const { return !coupling_.empty(); }
  const Folded& folded() const { return folded_; }
  const double* screw(std::size_t axis) const { return &screws_[6 * axis]; }
  const double* home() const { return home_.data(); }  // 3x4, row-major
  const double* coupling(std::size_t axis) const { return &coupling_[joints_ * axis]; }
  double lower(std::size_t joint) const { return ranges_[joint].lower; }
  double upper(std::size_t joint) const { return ranges_[joint].upper; }
  const JointRange& range(std::size_t joint) const { return ranges_[joint]; }
  // Starting points for inverse kinematics; made when first asked for.
  const SearchTable& search_table() const;

 private:
  void fold();
  bool is_periodic(std::size_t joint) const;

  std::size_t joints_;
  std::vector<double> screws_, coupling_;
  std::vector<JointRange> ranges_;
  std::array<double, 12> home_;
  std::vector<Axis> axes_;
  Folded folded_;
  mutable std::once_flag search_table_once_;
  mutable std::shared_ptr<const SearchTable> search_table_;
};

}  // namespace pieper
