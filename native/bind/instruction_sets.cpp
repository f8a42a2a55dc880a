#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "chain.hpp"
#include "pieper/kernels.hpp"

namespace pieper::bind {

void bind_instruction_sets(nb::module_& module) {
  module.def("instruction_set", [] { return kernels().name; }, "Name of the instruction set in use.");
  module.def("instruction_sets", &instruction_sets,
             "Names of those that were compiled in and run here, narrowest first.");
  module.def(
      "use_instruction_set",
      [](const std::string& name) {
        if (!use_instruction_set(name)) throw nb::value_error("not among instruction_sets()");
      },
      nb::arg("name"), "Chooses the kernels by name, for every chain.");
  module.def(
      "sincos",
      [](nb::handle angle) {
        const Input angles(angle, {}, "angle");
        angles.require_finite();
        const Output sine(angles.leading(), {}, nb::none()), cosine(angles.leading(), {}, nb::none());
        kernels().sincos(angles.data(), angles.count(), sine.data(), cosine.data());
        return nb::make_tuple(sine.array(), cosine.array());
      },
      nb::sig(
          "def sincos(angle: object) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64]]"),
      nb::arg("angle"), "Sines and cosines as the kernels compute them.");
}

}  // namespace pieper::bind
