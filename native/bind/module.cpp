// Table of contents of pieper._native.kernels.
#include "chain.hpp"
#include "pieper/kernels.hpp"

NB_MODULE(kernels, module) {
  using namespace pieper::bind;
  module.doc() = "Compiled kernels. Arguments are plain arrays that pieper has checked.";

  // Chains kept in caches outlive the module at exit; that is no leak worth a page of text.
  nb::set_leak_warnings(false);

  nb::class_<NativeChain> chain(module, "NativeChain");
  chain.def(
      "__init__",
      [](NativeChain* self, nb::handle screws, nb::handle home, nb::handle coupling, nb::handle limits) {
        const Input S(screws, {6}, "screws"), T(home, {4, 4}, "home"), L(limits, {2}, "limits");
        const Input C(coupling, {L.count()}, "coupling");
        if (C.count() != S.count()) not_plain("coupling");
        new (self) NativeChain(S, T, C, L, S.count(), L.count());
      },
      nb::arg("screws"), nb::arg("home"), nb::arg("coupling"), nb::arg("limits"));
  bind_forward_kinematics(chain);
  bind_jacobian(chain);
  bind_numeric_ik(module, chain);
  bind_closed_form(module, chain);
  bind_general_6r(module);
  bind_answers(module, chain);
  bind_scores(chain);
  bind_instruction_sets(module);
  bind_segmentation(module);
}
