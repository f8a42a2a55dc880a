// All inverse-kinematics solutions of any arm with six revolute joints, or five and a prismatic one, from one trigonometric
// polynomial of degree 8.
// The mathematics is in docs/derivations/general_6r.md.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "pieper/chain.hpp"

namespace pieper {

// No arm with six revolute joints has more isolated solutions (Primrose 1986), and none with a slide among them.
inline constexpr std::size_t most_solutions = 16;

// Residual of the loop [rad, lengths of the scaled arm] at which joints count as a solution.
inline constexpr double acceptable_residual = 1e-10;

// Candidates that one form may follow up.
inline constexpr std::size_t most_starts = 64;

// fast: a second form only when the first one shows that something went wrong. checked: also when it had to look twice.
// complete: always two forms.
enum class GeneralMode : int { fast = 0, checked = 1, complete = 2 };

// What a form reports beside its solutions. The hard ones say that a solution may be missing.
enum FormFlag : unsigned {
  flag_noise = 1,           // harmonics that cannot be there are
  flag_parity = 2,          // an odd number of simple roots
  flag_lost = 4,            // a simple root led to no solution, or their number is odd
  flag_overflow = 8,        // a list was full
  flag_unclean = 16,        // a simple root where the matrix is regular
  flag_third = 32,          // three or more solutions at one angle, of which four were not found
  flag_many_requests = 64,  // much of the circle was sampled again
  flag_hard = 127,
  flag_request = 128,        // some of the circle was sampled again
  flag_twins = 256,          // two solutions at one angle
  flag_some_requests = 512,  // a good part of the circle was sampled again; hard where that left something unclear
  flag_near_twins = 1024,    // nearly two solutions at one angle
  flag_near_fold = 2048,     // a solution next to a singular pose, where another may have fallen together with it
  flag_singular = 1 << 16,   // a solution at a singular pose
};

// Rz(angle) Trans(x, y, z) Rx(twist) from one joint frame to the next, lengths divided by the scale of the arm.
struct JointStep {
  double x, y, z, cos_twist, sin_twist;
};

// One of twelve ways to write the loop Rz1 K1 Rz2 K2 ... Rz6 K6 = 1: which joint remains when the others are eliminated. A
// prismatic joint has Tz(d) in place of Rz(t).
struct LoopForm {
  int shift;      // new joint i is joint (i + shift) mod 6 of the loop
  bool reversed;  // the loop walked from the tip to the base
  int target_in;  // which of K1 ... K6 holds the target
  int slide = 0;  // which joint of the loop is prismatic: 1, 2, 4 or 5; 0 for none
  // 3x4, row-major; those that hold the target are filled in for each pose.
  double K1_inverse[12], K2[12], K6_inverse[12];
  double K3[12], K4[12], K5[12];  // K3 and K4 with the generic turns of the angles 4 and 5
  double left[14][9];             // the numbers of the left line on (s4^2, s4 k4, k4^2) x (s5^2, sqrt2 s5 k5, k5^2)
  double one[9];                  // 1 on them
  int harmonics = 8;              // of the determinant, in tau
  bool even = false;              // only even harmonics: tau = 2 t, else tau = t
  int samples = 24;
};

inline constexpr int form_count = 12;

// What the kernels need of an arm; plain data.
struct GeneralArm {
  JointStep steps[5];
  // The prismatic joint, -1 for none: Tz(d), then the constant turn about z that the angle of a revolute joint would hold.
  // Wherever joints are given by cosines and sines, those of a prismatic one are 0 and d.
  int slide = -1;
  double slide_cosine = 1, slide_sine = 0;
  LoopForm forms[form_count];
};

// Constants of the root finder, the same for every arm; plain data.
struct TrigonometricTables {
  alignas(64) double dft[3][24][24];           // 8, 16, 24 samples: [sample][coefficient]
  alignas(64) double sample_cosine[3][2][24];  // at t = tau, t = tau / 2
  alignas(64) double sample_sine[3][2][24];
  alignas(64) double cell_cosine[8][8][64];  // [K - 1][k - 1][cell]
  alignas(64) double cell_sine[8][8][64];
  alignas(64) double cell_centre[8][64];
  double powers[8][12][8];               // [K - 1][j][k - 1]: (k r)^j / j!
  alignas(64) double local_points[16];   // Chebyshev
  alignas(64) double local_fit[16][16];  // [sample][0..11 monomials, 12..15 Chebyshev tail]
};

// Solutions of one form: cosines and sines of the joint angles in the frames of GeneralArm (0 and d of a prismatic joint).
struct FormResult {
  alignas(64) double cosine[6][most_starts];
  alignas(64) double sine[6][most_starts];
  alignas(64) double residual[most_starts];
  std::size_t count = 0;
  std::size_t simple_roots = 0;  // each has a solution of its own
  unsigned flags = 0;
  double tail = 0;  // noise of the determinant, of its largest sample
  std::size_t work =
      0;  // counted steps, in units of about a tenth of a microsecond: the same on every machine with the same lanes
};

// How joints are iterated towards a target.
struct Refinement {
  int damped_steps, newton_steps;
  double residual;  // that counts as arrived
  bool wandering;   // damped by the residual alone, and every step is taken
};

// The parts that exist once per instruction set; Kernels points to them.
struct GeneralKernels {
  // One form for one target (3x4).
  void (*solve_form)(const TrigonometricTables&, const GeneralArm&, const LoopForm&, const double* G, FormResult&);
  // Iterates the joints in FormResult towards the target and keeps those that arrive within a residual.
  void (*refine)(const GeneralArm&, const double* G, const Refinement&, FormResult&);
  // Angles in [-pi, pi] of unit pairs; reads and writes up to seven numbers beyond `count`.
  void (*angles)(const double* cosine, const double* sine, std::size_t count, double* out);
  // Sizes of the 13 harmonics of the determinant; false when it vanishes.
  bool (*spectrum)(const TrigonometricTables&, const LoopForm&, const double* G, double* size);
};

// What a batch of targets gives back.
struct GeneralResults {
  double* q;               // (targets, 16, 6), NaN where there is nothing
  double* position_error;  // (targets, 16) [m]
  double* rotation_error;  // (targets, 16) [rad]
  bool* valid;             // (targets, 16)
  int* flags;              // (targets): of the first form, and bits for what was done then
};

// Bits above FormFlag in GeneralResults::flags.
enum SolveFlag : int {
  solve_second_form = 1 << 12,
  solve_third_form = 1 << 13,
  solve_last_resort = 1 << 14,
  solve_doubtful = 1 << 15,  // every form raised a hard flag: a solution may be missing
};

// What was measured about a form when the arm was prepared.
struct FormReport {
  int remaining_joint;  // counted from 0
  int harmonics;
  bool even;
  double median_tail;
  double found;         // share of all known solutions over the probe poses
  double flagged;       // share of the probe poses with a hard flag
  double looked_twice;  // share with requests or twins
  double median_work;
  int rank;  // 0 for the first choice, -1 for those that are not used
};

// A form with a larger share of hard flags says nothing by them.
inline constexpr double always_doubtful = 0.2;

class Sequence;      // see src/general_6r/sequence.hpp
struct SolutionSet;  // see src/general_6r/solution_set.hpp

class General6R {
 public:
  // The chain must have six revolute joints, or five and a prismatic one, without couplings, and must outlive this object.
  explicit General6R(const Chain&);
  General6R(const General6R&) = delete;
  General6R& operator=(const General6R&) = delete;

  static bool fits(const Chain&);

  void solve(const double* targets, std::size_t count, GeneralMode, std::size_t threads, const GeneralResults&) const;
  // For measurements: one form alone (0 ... 11), without merging with others.
  void solve_one_form(int form, const double* targets, std::size_t count, const GeneralResults&) const;

  const std::vector<FormReport>& reports() const { return reports_; }

 private:
  struct Scratch;
  void set_frames();
  void set_forms();
  void measure_support();
  void choose_forms();
  void normalise_target(const double* target, double* G) const;
  void draw_joints(Sequence&, double* c, double* s) const;
  // The other one of two solutions that have nearly met: looked for to both sides of those next to a singular pose.
  // True when one of them is at a singular pose: it may belong to a curve of solutions.
  bool add_fold_partners(const double* G, Scratch&, SolutionSet&) const;
  // Adds what a form finds; true when that can be trusted to be all.
  bool run_form(int form, const double* G, Scratch&, SolutionSet&, unsigned& flags) const;
  void solve_one(const double* target, GeneralMode, int only_form, Scratch&, const GeneralResults&,
                 std::size_t k) const;
  void last_resort(const double* G, Scratch&, SolutionSet&) const;
  void write(const double* target, const SolutionSet&, const GeneralResults&, std::size_t k) const;

  const Chain& chain_;
  GeneralArm arm_;
  double scale_ = 1;
  double base_inverse_[12], tip_inverse_[12];  // G = base_inverse T tip_inverse, before scaling
  double offset_[6];                           // joint angle in the frames of arm_ = q + offset; 0 for a slide
  double reach_ = 0;                           // no target is farther away, in scaled lengths; infinite with a slide
  double slide_low_ = 0, slide_high_ = 0;      // where poses are tried, in scaled lengths
  std::vector<int> order_;                     // forms in the order of their use
  // False when the forms together do not find the joints that made a pose: arms whose solutions form curves everywhere.
  bool dependable_ = true;
  // Flags of the first form after which GeneralMode::checked tries the second one.
  unsigned unclear_ = flag_near_fold | flag_some_requests;
  std::vector<FormReport> reports_;
};

}  // namespace pieper
