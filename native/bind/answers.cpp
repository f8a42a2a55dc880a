#include "pieper/answers.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "chain.hpp"
#include "pieper/general_6r.hpp"
#include "pieper/kernels.hpp"

namespace pieper::bind {
namespace {

constexpr const char* answers_type =
    "tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], "
    "numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], "
    "numpy.typing.NDArray[numpy.int8], numpy.typing.NDArray[numpy.int8]";

constexpr const char* complete_type = ", numpy.typing.NDArray[numpy.bool_], int, int]";

// A C-contiguous buffer of signed bytes.
class Bytes {
 public:
  Bytes(nb::handle object, const char* what) {
    if (PyObject_GetBuffer(object.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
      PyErr_Clear();
      not_plain(what);
    }
    if (view_.itemsize == 1) return;
    PyBuffer_Release(&view_);
    not_plain(what);
  }
  ~Bytes() { PyBuffer_Release(&view_); }
  Bytes(const Bytes&) = delete;
  Bytes& operator=(const Bytes&) = delete;
  const signed char* data() const { return static_cast<const signed char*>(view_.buf); }
  std::size_t count() const { return static_cast<std::size_t>(view_.len); }

 private:
  Py_buffer view_{};
};

bool is_positive(double x) { return x > 0 && std::isfinite(x); }

// Targets and seeds as every method here takes them.
struct Question {
  Input T;
  std::optional<Input> starts;

  Question(const NativeChain& self, nb::handle targets, nb::handle seeds, const AnswerOptions& options,
           std::size_t threads)
      : T(targets, {4, 4}, "targets") {
    T.require_finite();
    if (threads == 0) not_plain("threads");
    if (!is_positive(options.position_tolerance) || !is_positive(options.rotation_tolerance)) not_plain("tolerances");
    if (!all_poses(T.data(), T.count())) not_plain("targets");
    if (seeds.is_none()) return;
    starts.emplace(seeds, std::initializer_list<std::size_t>{self.chain.joints()}, "seeds");
    starts->require_within(largest_joint_value);
    if (starts->count() != T.count()) not_plain("seeds");
  }
  const double* seeds() const { return starts ? starts->data() : nullptr; }
};

// New arrays for the answers to some targets.
class Outcome {
 public:
  Outcome(const Input& T, std::size_t slots, std::size_t n)
      : slots_(slots),
        q_(T.leading(), {slots, n}, nb::none()),
        position_(T.leading(), {slots}, nb::none()),
        rotation_(T.leading(), {slots}, nb::none()),
        valid_(T.leading(), {slots}, "?"),
        within_(T.leading(), {slots}, "?"),
        branch_(T.leading(), {slots}, "b"),
        status_(T.leading(), {}, "b") {}
  Answers answers() const {
    return {slots_,        q_.data(),      position_.data(), rotation_.data(),
            valid_.data(), within_.data(), branch_.data(),   status_.data()};
  }
  nb::object alone(std::size_t missed) const {
    return nb::make_tuple(q_.array(), valid_.array(), position_.array(), rotation_.array(), within_.array(),
                          branch_.array(), status_.array(), missed);
  }
  // With what was doubtful, which becomes what is complete, and counts.
  nb::object with(std::size_t count, const NewArray<bool>& doubtful, const bool* singular) const {
    std::size_t doubts = 0, missed = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const bool sure = !doubtful.data()[i] && !(singular && singular[i]);
      doubts += !sure;
      doubtful.data()[i] = sure;
      missed += status_.data()[i] != static_cast<signed char>(AnswerStatus::reached);
    }
    return nb::make_tuple(q_.array(), valid_.array(), position_.array(), rotation_.array(), within_.array(),
                          branch_.array(), status_.array(), doubtful.array(), doubts, missed);
  }

 private:
  std::size_t slots_;
  Output q_, position_, rotation_;
  NewArray<bool> valid_, within_;
  NewArray<signed char> branch_, status_;
};

// Answers that are put in order aside, because how many places they need is known only then.
class Aside {
 public:
  Aside(const Input& q, const Input& position, const Input& rotation, std::size_t count, std::size_t slots,
        std::size_t n)
      : count_(count),
        slots_(slots),
        n_(n),
        q_(q.data(), q.data() + count * slots * n),
        position_(position.data(), position.data() + count * slots),
        rotation_(rotation.data(), rotation.data() + count * slots),
        valid_(new bool[count * slots]),
        within_(new bool[count * slots]),
        branch_(count * slots),
        status_(count) {
    std::fill_n(valid_.get(), count * slots, true);
  }
  Answers answers() {
    return {slots_,       q_.data(),     position_.data(), rotation_.data(),
            valid_.get(), within_.get(), branch_.data(),   status_.data()};
  }
  // Places that hold every answer to every target.
  std::size_t needed() const {
    std::size_t most = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      const bool* valid = valid_.get() + i * slots_;
      most = std::max<std::size_t>(most, std::find(valid, valid + slots_, false) - valid);
    }
    return most;
  }
  std::size_t missed() const {
    return count_ - std::count(status_.begin(), status_.end(), static_cast<signed char>(AnswerStatus::reached));
  }
  // The first ones of each target; places beyond those there are hold none.
  void copy_to(const Answers& out) const {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    const std::size_t kept = std::min(out.slots, slots_), empty = out.slots - kept;
    for (std::size_t i = 0; i < count_; ++i) {
      const std::size_t from = i * slots_, to = i * out.slots;
      std::fill_n(std::copy_n(q_.data() + from * n_, kept * n_, out.q + to * n_), empty * n_, nan);
      std::fill_n(std::copy_n(position_.data() + from, kept, out.position_error + to), empty, nan);
      std::fill_n(std::copy_n(rotation_.data() + from, kept, out.rotation_error + to), empty, nan);
      std::fill_n(std::copy_n(valid_.get() + from, kept, out.valid + to), empty, false);
      std::fill_n(std::copy_n(within_.get() + from, kept, out.within_limits + to), empty, false);
      std::fill_n(std::copy_n(branch_.data() + from, kept, out.branch + to), empty, static_cast<signed char>(-1));
    }
    std::copy(status_.begin(), status_.end(), out.status);
  }

 private:
  std::size_t count_, slots_, n_;
  std::vector<double> q_, position_, rotation_;
  std::unique_ptr<bool[]> valid_, within_;
  std::vector<signed char> branch_, status_;
};

}  // namespace

void bind_answers(nb::module_& module, nb::class_<NativeChain>& chain) {
  nb::enum_<AnswerStatus>(module, "AnswerStatus")
      .value("reached", AnswerStatus::reached)
      .value("unreachable", AnswerStatus::unreachable)
      .value("outside_limits", AnswerStatus::outside_limits);
  static const std::string closed_form_type =
      std::string(
          "def answer_by_closed_form(self, form: ClosedForm, targets: object, seeds: object, "
          "position_tolerance: float, rotation_tolerance: float, threads: int) -> ") +
      answers_type + complete_type;
  chain.def(
      "answer_by_closed_form",
      [](const NativeChain& self, const ClosedForm& form, nb::handle targets, nb::handle seeds,
         double position_tolerance, double rotation_tolerance, std::size_t threads) {
        const std::size_t n = form.joints;
        if (self.chain.joints() != n || self.chain.axes() != n || self.chain.coupled()) not_plain("form");
        const AnswerOptions options{position_tolerance, rotation_tolerance};
        const Question question(self, targets, seeds, options, threads);
        const Outcome out(question.T, closed_form_branches, n);
        const NewArray<bool> doubtful(question.T.leading(), {}, "?");
        const std::size_t count = question.T.count();
        const std::unique_ptr<bool[]> many(count > 1 ? new bool[count] : nullptr);
        bool single = false, *const singular = many ? many.get() : &single;
        without_lock(count, [&] {
          answer_by_closed_form(self.chain, form, question.T.data(), question.seeds(), count, options, threads,
                                out.answers(), singular, doubtful.data());
        });
        return out.with(count, doubtful, singular);
      },
      nb::arg("form"), nb::arg("targets"), nb::arg("seeds").none(), nb::arg("position_tolerance"),
      nb::arg("rotation_tolerance"), nb::arg("threads"), nb::sig(closed_form_type.c_str()),
      "Joints (..., 8, n) for poses (..., 4, 4) in the order of their use, valid, position_error, rotation_error, "
      "within_limits, branch (..., 8), status and complete (...); how many are not complete, and how many were not "
      "reached.");
  static const std::string polynomial_type =
      std::string(
          "def answer_by_polynomial(self, solver: NativeGeneral6R, mode: GeneralMode, targets: object, "
          "seeds: object, position_tolerance: float, rotation_tolerance: float, threads: int) -> ") +
      answers_type + complete_type;
  chain.def(
      "answer_by_polynomial",
      [](const NativeChain& self, const General6R& solver, GeneralMode mode, nb::handle targets, nb::handle seeds,
         double position_tolerance, double rotation_tolerance, std::size_t threads) {
        if (!General6R::fits(self.chain)) not_plain("solver");
        const AnswerOptions options{position_tolerance, rotation_tolerance};
        const Question question(self, targets, seeds, options, threads);
        const std::size_t count = question.T.count();
        const Outcome out(question.T, most_solutions, self.chain.joints());
        const NewArray<bool> doubtful(question.T.leading(), {}, "?");
        without_lock(2 * count, [&] {
          const Answers answers = out.answers();
          std::vector<int> flags(count);
          solver.solve(question.T.data(), count, mode, threads,
                       {answers.q, answers.position_error, answers.rotation_error, answers.valid, flags.data()});
          for (std::size_t i = 0; i < count; ++i) doubtful.data()[i] = (flags[i] & solve_doubtful) != 0;
          arrange(self.chain, question.T.data(), question.seeds(), count, options, answers);
        });
        return out.with(count, doubtful, nullptr);
      },
      nb::arg("solver"), nb::arg("mode"), nb::arg("targets"), nb::arg("seeds").none(), nb::arg("position_tolerance"),
      nb::arg("rotation_tolerance"), nb::arg("threads"), nb::sig(polynomial_type.c_str()),
      "As answer_by_closed_form, with (..., 16) places and without branches.");
  static const std::string arrange_type =
      std::string(
          "def arrange(self, q: object, position_error: object, rotation_error: object, branch: object, "
          "targets: object, seeds: object, rows: TargetRows, position_tolerance: float, "
          "rotation_tolerance: float, most: int) -> ") +
      answers_type + ", int]";
  chain.def(
      "arrange",
      [](const NativeChain& self, nb::handle found, nb::handle position_error, nb::handle rotation_error,
         nb::handle branches, nb::handle targets, nb::handle seeds, const TargetRows& rows, double position_tolerance,
         double rotation_tolerance, std::size_t most) {
        AnswerOptions options{position_tolerance, rotation_tolerance};
        const Question question(self, targets, seeds, options, 1);
        const Input& T = question.T;
        const std::size_t n = self.chain.joints(), count = T.count();
        const Input before(found, {n}, "q");
        const std::size_t all = before.count(), k = count > 0 ? all / count : 0;
        const Input position_before(position_error, {}, "position_error"),
            rotation_before(rotation_error, {}, "rotation_error");
        std::optional<Bytes> branches_before;
        if (!branches.is_none()) branches_before.emplace(branches, "branch");
        if (k * count != all || position_before.count() != all || rotation_before.count() != all ||
            (branches_before && branches_before->count() != all))
          not_plain("q");
        options.rows = rows;
        if (branches_before) options.branches = branches_before->data();
        Aside aside(before, position_before, rotation_before, count, k, n);
        arrange(self.chain, T.data(), question.seeds(), count, options, aside.answers());
        const std::size_t places = most > 0 ? most : std::max<std::size_t>(aside.needed(), 1);
        const Outcome out(T, places, n);
        aside.copy_to(out.answers());
        return out.alone(aside.missed());
      },
      nb::arg("q"), nb::arg("position_error"), nb::arg("rotation_error"), nb::arg("branch").none(), nb::arg("targets"),
      nb::arg("seeds").none(), nb::arg("rows"), nb::arg("position_tolerance"), nb::arg("rotation_tolerance"),
      nb::arg("most"), nb::sig(arrange_type.c_str()),
      "Joints (..., k, n) that were found for poses (..., 4, 4), with errors (..., k) that are NaN where there is none, "
      "in the order of their use: q, valid, position_error, rotation_error, within_limits, branch with `most` places, or with as many "
      "as are needed where that is 0, status (...), and how many were not reached.");
}

}  // namespace pieper::bind
