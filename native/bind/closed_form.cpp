#include "pieper/closed_form.hpp"

#include <nanobind/stl/vector.h>

#include <algorithm>

#include "chain.hpp"
#include "pieper/kernels.hpp"

namespace pieper::bind {

void bind_closed_form(nb::module_& module, nb::class_<NativeChain>& chain) {
  nb::enum_<ClosedFormFamily>(module, "ClosedFormFamily")
      .value("spherical_wrist", ClosedFormFamily::spherical_wrist)
      .value("three_parallel", ClosedFormFamily::three_parallel)
      .value("three_parallel_skew", ClosedFormFamily::three_parallel_skew)
      .value("planar", ClosedFormFamily::planar)
      .value("gantry", ClosedFormFamily::gantry);
  nb::enum_<FirstThree>(module, "FirstThree")
      .value("parallel_23", FirstThree::parallel_23)
      .value("parallel_12", FirstThree::parallel_12)
      .value("intersecting_12", FirstThree::intersecting_12)
      .value("intersecting_23", FirstThree::intersecting_23)
      .value("general", FirstThree::general)
      .value("sliding_3", FirstThree::sliding_3);
  nb::class_<ClosedForm>(module, "ClosedForm")
      .def(
          "__init__",
          [](ClosedForm* self, ClosedFormFamily family, FirstThree first_three, bool reversed, nb::handle screws,
             nb::handle home, double scale, double capture, double widened) {
            const Input S(screws, {6}, "screws"), M(home, {4, 4}, "home");
            if (S.count() < 2 || S.count() > 6) not_plain("screws");
            new (self)
                ClosedForm(family, first_three, reversed, S.data(), S.count(), M.data(), scale, capture, widened);
          },
          nb::arg("family"), nb::arg("first_three"), nb::arg("reversed"), nb::arg("screws"), nb::arg("home"),
          nb::arg("scale"), nb::arg("capture"), nb::arg("widened"))
      .def(
          "name_branches",
          [](ClosedForm& self, const std::vector<int>& branch_of_slot) {
            unsigned seen = 0;
            for (int b : branch_of_slot) seen |= b >= 0 && b < 8 ? 1u << b : 0u;
            if (branch_of_slot.size() != closed_form_branches || seen != 255u) not_plain("branch_of_slot");
            std::copy(branch_of_slot.begin(), branch_of_slot.end(), self.branch_of_slot);
          },
          nb::arg("branch_of_slot"),
          "Gives each of the eight slots the number of its branch, by which answers are ordered.");
  chain.def(
      "solve_closed_form",
      [](const NativeChain& self, const ClosedForm& form, nb::handle targets, double position_tolerance,
         double rotation_tolerance, std::size_t threads) {
        const std::size_t n = form.joints, k = closed_form_branches;
        if (self.chain.joints() != n || self.chain.axes() != n || self.chain.coupled()) not_plain("form");
        if (threads == 0) not_plain("threads");
        const Input T(targets, {4, 4}, "targets");
        T.require_finite();
        if (!all_poses(T.data(), T.count())) not_plain("targets");
        const Output q(T.leading(), {k, n}, nb::none()), position(T.leading(), {k}, nb::none()),
            rotation(T.leading(), {k}, nb::none());
        const NewArray<bool> valid(T.leading(), {k}, "?"), doubtful(T.leading(), {}, "?");
        without_lock(T.count(), [&] {
          solve_closed_form(self.chain, form, T.data(), T.count(), {position_tolerance, rotation_tolerance}, threads,
                            {q.data(), position.data(), rotation.data(), valid.data(), nullptr, doubtful.data()});
        });
        return nb::make_tuple(q.array(), valid.array(), position.array(), rotation.array(), doubtful.array());
      },
      nb::arg("form"), nb::arg("targets"), nb::arg("position_tolerance"), nb::arg("rotation_tolerance"),
      nb::arg("threads"),
      nb::sig("def solve_closed_form(self, form: ClosedForm, targets: object, position_tolerance: float, "
              "rotation_tolerance: float, threads: int) -> tuple[numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_]]"),
      "Joints (..., 8, n) of every branch for poses (..., 4, 4), valid, position_error and rotation_error (..., 8), "
      "and "
      "doubtful (...).");
  module.def(
      "arctangent",
      [](nb::handle y, nb::handle x) {
        const Input ys(y, {}, "y"), xs(x, {}, "x");
        if (ys.count() != xs.count()) not_plain("x");
        const Output angle(ys.leading(), {}, nb::none());
        kernels().arctangent(ys.data(), xs.data(), ys.count(), angle.data());
        return angle.array();
      },
      nb::arg("y"), nb::arg("x"),
      nb::sig("def arctangent(y: object, x: object) -> numpy.typing.NDArray[numpy.float64]"),
      "The angle of points (x, y), as the kernels compute it.");
}

}  // namespace pieper::bind
