#include "pieper/numeric_ik.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "chain.hpp"
#include "pieper/kernels.hpp"

namespace pieper::bind {
namespace {

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
