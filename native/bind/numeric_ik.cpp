#include "pieper/numeric_ik.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "chain.hpp"
#include "pieper/kernels.hpp"

namespace pieper::bind {
namespace {

// A new numpy array of another type than float64, by numpy.empty(shape, dtype).
template <class Number>
class NewArray {
 public:
  NewArray(const std::vector<Py_ssize_t>& leading, std::initializer_list<std::size_t> inner, const char* dtype) {
    static PyObject* empty = nb::object(nb::module_::import_("numpy").attr("empty")).release().ptr();
    nb::list shape;
    for (Py_ssize_t size : leading) shape.append(size);
    for (std::size_t size : inner) shape.append(size);
    array_ = nb::handle(empty)(nb::tuple(shape), dtype);
    if (PyObject_GetBuffer(array_.ptr(), &view_, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE) != 0) throw nb::python_error();
  }
  ~NewArray() { PyBuffer_Release(&view_); }
  NewArray(const NewArray&) = delete;
  NewArray& operator=(const NewArray&) = delete;
  Number* data() const { return static_cast<Number*>(view_.buf); }
  nb::object array() const { return array_; }

 private:
  nb::object array_;
  Py_buffer view_{};
};

// As pieper.spatial checks poses: a rotation to 1e-9, and the last row 0 0 0 1.
bool all_poses(const double* T, std::size_t count) {
  constexpr double tolerance = 1e-9;
  for (std::size_t k = 0; k < count; ++k, T += 16) {
    double worst = std::max({std::abs(T[12]), std::abs(T[13]), std::abs(T[14]), std::abs(T[15] - 1)});
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c <= r; ++c) {
        const double dot = T[4 * r] * T[4 * c] + T[4 * r + 1] * T[4 * c + 1] + T[4 * r + 2] * T[4 * c + 2];
        worst = std::max(worst, std::abs(dot - (r == c ? 1.0 : 0.0)));
      }
    const double determinant =
        T[0] * (T[5] * T[10] - T[6] * T[9]) - T[1] * (T[4] * T[10] - T[6] * T[8]) + T[2] * (T[4] * T[9] - T[5] * T[8]);
    if (!(worst <= tolerance) || !(determinant > 0)) return false;
  }
  return true;
}

TargetRows rows_from(nb::handle weights, bool position_in_tool, bool rotation_in_tool, RotationTarget rotation,
                     nb::handle axis) {
  const Input w(weights, {6}, "weights"), a(axis, {3}, "axis");
  TargetRows rows;
  std::copy_n(w.data(), 6, rows.weights);
  std::copy_n(a.data(), 3, rows.axis);
  rows.position_in_tool = position_in_tool, rows.rotation_in_tool = rotation_in_tool, rows.rotation = rotation;
  return rows;
}

}  // namespace

void bind_numeric_ik(nb::module_& module, nb::class_<NativeChain>& chain) {
  nb::enum_<RotationTarget>(module, "RotationTarget")
      .value("free", RotationTarget::free)
      .value("axis", RotationTarget::axis)
      .value("full", RotationTarget::full);
  nb::enum_<NumericStatus>(module, "NumericStatus")
      .value("reached", NumericStatus::reached)
      .value("unreachable", NumericStatus::unreachable)
      .value("not_converged", NumericStatus::not_converged);
  nb::class_<TargetRows>(module, "TargetRows")
      .def(
          "__init__",
          [](TargetRows* self, nb::handle weights, bool position_in_tool, bool rotation_in_tool,
             RotationTarget rotation, nb::handle axis) {
            new (self) TargetRows(rows_from(weights, position_in_tool, rotation_in_tool, rotation, axis));
          },
          nb::arg("weights"), nb::arg("position_in_tool"), nb::arg("rotation_in_tool"), nb::arg("rotation"),
          nb::arg("axis"),
          nb::sig("def __init__(self, weights: object, position_in_tool: bool, rotation_in_tool: bool, "
                  "rotation: RotationTarget, axis: object) -> None"));
  chain.def(
      "solve_numeric",
      [](const NativeChain& self, nb::handle targets, nb::handle seeds, const TargetRows& rows,
         double position_tolerance, double rotation_tolerance, std::size_t restarts, std::size_t iterations,
         std::size_t count, double distinct, std::size_t threads) {
        const std::size_t n = self.chain.joints();
        const Input T(targets, {4, 4}, "targets");
        T.require_finite();
        if (restarts == 0 || iterations == 0 || count == 0 || threads == 0) not_plain("a number");
        if (!all_poses(T.data(), T.count())) not_plain("targets");
        std::optional<Input> starts;
        if (!seeds.is_none()) {
          starts.emplace(seeds, std::initializer_list<std::size_t>{n}, "seeds");
          starts->require_within(largest_joint_value);
          if (starts->count() != T.count()) not_plain("seeds");
        }
        const NumericOptions options{position_tolerance, rotation_tolerance, restarts, iterations, count, distinct};
        const Output q(T.leading(), {count, n}, nb::none()), position(T.leading(), {count}, nb::none()),
            rotation(T.leading(), {count}, nb::none()), nearest(T.leading(), {n}, nb::none()),
            nearest_position(T.leading(), {}, nb::none()), nearest_rotation(T.leading(), {}, nb::none());
        const NewArray<bool> valid(T.leading(), {count}, "?"), within(T.leading(), {count}, "?");
        const NewArray<signed char> status(T.leading(), {}, "b");
        const NumericResults results{q.data(),      position.data(), rotation.data(),         valid.data(),
                                     within.data(), nearest.data(),  nearest_position.data(), nearest_rotation.data(),
                                     status.data()};
        std::size_t missed = 0;
        {
          nb::gil_scoped_release released;
          missed = solve_numeric(self.chain, T.data(), starts ? starts->data() : nullptr, T.count(), rows, options,
                                 threads, results);
        }
        return nb::make_tuple(q.array(), position.array(), rotation.array(), valid.array(), within.array(),
                              nearest.array(), nearest_position.array(), nearest_rotation.array(), status.array(),
                              missed);
      },
      nb::arg("targets"), nb::arg("seeds").none(), nb::arg("rows"), nb::arg("position_tolerance"),
      nb::arg("rotation_tolerance"), nb::arg("restarts"), nb::arg("iterations"), nb::arg("count"), nb::arg("distinct"),
      nb::arg("threads"),
      nb::sig(
          "def solve_numeric(self, targets: object, seeds: object, rows: TargetRows, position_tolerance: float, "
          "rotation_tolerance: float, restarts: int, iterations: int, count: int, distinct: float, threads: int) -> "
          "tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], "
          "numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_], "
          "numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], "
          "numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int8], int]"),
      "Joints (..., count, n) for poses (..., 4, 4), and how well they do: position_error, rotation_error, valid, "
      "within_limits (..., count), nearest (..., n), its errors (...), status (...), and how many were missed.");
}

}  // namespace pieper::bind
