#include "pieper/general_6r.hpp"

#include <nanobind/stl/vector.h>

#include "chain.hpp"

namespace pieper::bind {
namespace {

GeneralResults results_in(const Output& q, const Output& position, const Output& rotation, const NewArray<bool>& valid,
                          const NewArray<int>& flags) {
  return {q.data(), position.data(), rotation.data(), valid.data(), flags.data()};
}

constexpr const char* solved_type =
    "tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], "
    "numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.int32]]";

}  // namespace

void bind_general_6r(nb::module_& module) {
  nb::enum_<GeneralMode>(module, "GeneralMode")
      .value("fast", GeneralMode::fast)
      .value("checked", GeneralMode::checked)
      .value("complete", GeneralMode::complete);
  nb::class_<FormReport>(module, "FormReport")
      .def_ro("remaining_joint", &FormReport::remaining_joint)
      .def_ro("harmonics", &FormReport::harmonics)
      .def_ro("even", &FormReport::even)
      .def_ro("median_tail", &FormReport::median_tail)
      .def_ro("found", &FormReport::found)
      .def_ro("flagged", &FormReport::flagged)
      .def_ro("looked_twice", &FormReport::looked_twice)
      .def_ro("median_work", &FormReport::median_work)
      .def_ro("rank", &FormReport::rank);
  static const std::string solve_signature =
      std::string("def solve(self, targets: object, mode: GeneralMode, threads: int) -> ") + solved_type;
  static const std::string one_form_signature =
      std::string("def solve_one_form(self, form: int, targets: object) -> ") + solved_type;
  nb::class_<General6R>(module, "NativeGeneral6R")
      .def(
          "__init__",
          [](General6R* self, const NativeChain& chain) {
            if (!General6R::fits(chain.chain)) throw nb::value_error("not six joints of which at least five turn");
            new (self) General6R(chain.chain);
          },
          nb::arg("chain"), nb::keep_alive<1, 2>())
      .def(
          "solve",
          [](const General6R& self, nb::handle targets, GeneralMode mode, std::size_t threads) {
            const Input T(targets, {4, 4}, "targets");
            T.require_finite();
            if (threads == 0) not_plain("a number");
            if (!all_poses(T.data(), T.count())) not_plain("targets");
            const Output q(T.leading(), {most_solutions, 6}, nb::none()),
                position(T.leading(), {most_solutions}, nb::none()),
                rotation(T.leading(), {most_solutions}, nb::none());
            const NewArray<bool> valid(T.leading(), {most_solutions}, "?");
            const NewArray<int> flags(T.leading(), {}, "i");
            {
              nb::gil_scoped_release released;
              self.solve(T.data(), T.count(), mode, threads, results_in(q, position, rotation, valid, flags));
            }
            return nb::make_tuple(q.array(), position.array(), rotation.array(), valid.array(), flags.array());
          },
          nb::arg("targets"), nb::arg("mode"), nb::arg("threads"), nb::sig(solve_signature.c_str()),
          "Joints (..., 16, 6) for poses (..., 4, 4), padded with NaN; position_error, rotation_error, valid (..., 16); "
          "flags (...).")
      .def(
          "solve_one_form",
          [](const General6R& self, int form, nb::handle targets) {
            const Input T(targets, {4, 4}, "targets");
            T.require_finite();
            if (form < 0 || form >= form_count) throw nb::index_error("form");
            if (!all_poses(T.data(), T.count())) not_plain("targets");
            const Output q(T.leading(), {most_solutions, 6}, nb::none()),
                position(T.leading(), {most_solutions}, nb::none()),
                rotation(T.leading(), {most_solutions}, nb::none());
            const NewArray<bool> valid(T.leading(), {most_solutions}, "?");
            const NewArray<int> flags(T.leading(), {}, "i");
            self.solve_one_form(form, T.data(), T.count(), results_in(q, position, rotation, valid, flags));
            return nb::make_tuple(q.array(), position.array(), rotation.array(), valid.array(), flags.array());
          },
          nb::arg("form"), nb::arg("targets"), nb::sig(one_form_signature.c_str()),
          "As solve(), by one of the twelve forms alone; to measure them.")
      .def_prop_ro("reports", &General6R::reports, "What was measured about each form.");
}

}  // namespace pieper::bind
