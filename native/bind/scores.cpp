#include "pieper/scores.hpp"

#include <memory>

#include "chain.hpp"
#include "pieper/kernels.hpp"

namespace pieper::bind {
namespace {

// A C-contiguous buffer of truth values.
class Marks {
 public:
  explicit Marks(nb::handle object) {
    if (PyObject_GetBuffer(object.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
      PyErr_Clear();
      not_plain("counted");
    }
    if (view_.format && view_.format[0] == '?' && view_.format[1] == '\0') return;
    PyBuffer_Release(&view_);
    not_plain("counted");
  }
  ~Marks() { PyBuffer_Release(&view_); }
  Marks(const Marks&) = delete;
  Marks& operator=(const Marks&) = delete;
  const bool* data() const { return static_cast<const bool*>(view_.buf); }
  std::size_t count() const { return static_cast<std::size_t>(view_.len); }

 private:
  Py_buffer view_{};
};

}  // namespace

void bind_scores(nb::class_<NativeChain>& chain) {
  chain.def(
      "score_answers",
      [](const NativeChain& self, nb::handle q, nb::handle counted, std::size_t poses, std::size_t rows, double alike,
         bool measures, std::size_t threads) {
        if (threads == 0) not_plain("threads");
        if (rows != 3 && rows != 6) not_plain("rows");
        const std::size_t n = self.chain.joints();
        const Input joints(q, {n}, "q");
        const Marks marks(counted);
        const std::vector<Py_ssize_t>& leading = joints.leading();
        if (leading.size() != 2 || n == 0) not_plain("q");
        const std::size_t all = static_cast<std::size_t>(leading[0]), slots = static_cast<std::size_t>(leading[1]);
        if (marks.count() != joints.count()) not_plain("counted");
        if (poses == 0 || all % poses != 0) not_plain("poses");
        const std::size_t groups = all / poses;
        const std::vector<Py_ssize_t> shape{static_cast<Py_ssize_t>(groups)};
        const NewArray<std::int64_t> reached(shape, {}, "int64"), solutions(shape, {}, "int64"),
            most(shape, {}, "int64");
        const std::vector<Py_ssize_t> rated{measures ? shape[0] : 0};
        const Output manipulability(rated, {}, nb::none()), singularity(rated, {}, nb::none()),
            margin(rated, {}, nb::none());
        const Scores out{reached.data(),        solutions.data(),   most.data(),
                         manipulability.data(), singularity.data(), margin.data()};
        const ScoreOptions options{poses, slots, rows, alike, measures};
        if (!without_lock(joints.count(), [&] {
              return score_answers(self.chain, joints.data(), marks.data(), groups, options, threads, out);
            }))
          not_plain("q");
        return nb::make_tuple(reached.array(), solutions.array(), most.array(), manipulability.array(),
                              singularity.array(), margin.array());
      },
      nb::sig(
          "def score_answers(self, q: object, counted: object, poses: int, rows: int, alike: float, measures: bool, "
          "threads: int) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64], "
          "numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], "
          "numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64]]"),
      nb::arg("q"), nb::arg("counted"), nb::arg("poses"), nb::arg("rows"), nb::arg("alike"), nb::arg("measures"),
      nb::arg("threads"),
      "Of answers (g * poses, k, n), those marked (g * poses, k), for each group of poses that follow each other, all (g,): poses "
      "with an answer, answers, most of one pose; greatest manipulability over `rows` of the Jacobian, smallest singular value "
      "of the best, greatest distance to the limits, the last three empty without measures.");
}

}  // namespace pieper::bind
