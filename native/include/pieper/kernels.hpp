// The kernels that exist once per instruction set, and the choice among them at run time.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "pieper/chain.hpp"
#include "pieper/closed_form.hpp"
#include "pieper/general_6r.hpp"
#include "pieper/numeric_ik.hpp"
#include "pieper/scores.hpp"
#include "pieper/segmentation.hpp"

namespace pieper {

// geometric: velocity of the tip origin and angular velocity, both in base axes; space and body: twists of the tip.
enum class JacobianKind : int { geometric = 0, space = 1, body = 2 };

// Configurations are (count, n) row-major. The batch kernels return false when a joint value is too large or no number; what they wrote
// until then means nothing. Poses are written as (count, 4, 4), Jacobians as (count, 6, n).
// Chains with mimic joints or more than max_axes axes are not for these: see forward_kinematics() below.
struct Kernels {
  const char* name;
  std::size_t lanes;
  bool (*poses)(const Folded&, const double* q, std::size_t count, double* out);
  bool (*jacobians)(const Folded&, const double* q, std::size_t count, JacobianKind, double* out);
  bool (*manipulability)(const Folded&, const double* q, std::size_t count, double* out);
  // One configuration: pose as 3x4 row-major, and the geometric Jacobian as 6 x m row-major (either may be null).
  void (*pose_and_jacobian)(const Folded&, const double* q, double* pose, double* jacobian);
  void (*sincos)(const double* angle, std::size_t count, double* sine, double* cosine);
  // True when no magnitude exceeds the limit and every number is one.
  bool (*all_within)(const double* numbers, std::size_t count, double limit);
  // One target (4x4); `seed` is null or a point of the search space that is tried first.
  void (*solve_numeric)(const Folded&, const SearchSpace&, const TargetRows&, const NumericOptions&,
                        const double* target, const double* seed, NumericAnswer&);
  void (*solve_closed_form)(const Folded&, const ClosedForm&, const ClosedFormOptions&, const double* targets,
                            std::size_t count, const ClosedFormResults&);
  void (*arctangent)(const double* y, const double* x, std::size_t count, double* angle);
  // Of configurations inside the limits (n, 2): Yoshikawa's measure of all six rows, and how far the joint nearest to a limit is from it.
  bool (*score)(const Folded&, const double* limits, const double* q, std::size_t count, double* measure,
                double* margin);
  // The product of the singular values of the first `rows` rows of Jacobians (count, 6, n), and the smallest of them.
  void (*singular_values)(const double* jacobians, std::size_t count, std::size_t n, std::size_t rows, double* product,
                          double* smallest);
  const GeneralKernels* general;            // one target of an arm with six revolute joints
  const SegmentationKernels* segmentation;  // one row of a frame
};

// No joint value may exceed this [rad or m]: an angle beyond it has no digits left, and nothing overflows below it.
inline constexpr double largest_joint_value = 1e15;

// Number of axes that the kernels take.
inline constexpr std::size_t kernel_axes = 32;

// The kernels in use: the widest that this processor runs, unless PIEPER_INSTRUCTION_SET names another.
const Kernels& kernels();

// Names of the instruction sets that were compiled in and run here, narrowest first.
std::vector<std::string> instruction_sets();

// Chooses by name; false when it is not among instruction_sets().
bool use_instruction_set(const std::string& name);

// The public entry points: any chain, any count, `threads` workers. False when a joint value is too large or no number.
bool forward_kinematics(const Chain&, const double* q, std::size_t count, std::size_t threads, double* out);
bool jacobian(const Chain&, const double* q, std::size_t count, JacobianKind, std::size_t threads, double* out);
bool manipulability(const Chain&, const double* q, std::size_t count, std::size_t threads, double* out);

// Rate of the geometric Jacobian, (count, 6, n), for joint velocities dq (count, n).
void jacobian_rate(const Chain&, const double* q, const double* dq, std::size_t count, double* out);

// Derivative of the geometric Jacobian by each joint: (count, n, 6, n), first index the joint.
void hessian(const Chain&, const double* q, std::size_t count, double* out);

// Poses of link frames: (count, frames, 4, 4).
void link_poses(const Chain&, const std::vector<LinkFrame>&, const double* q, std::size_t count, double* out);

}  // namespace pieper
