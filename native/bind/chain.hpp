#pragma once

#include "arrays.hpp"
#include "pieper/chain.hpp"

namespace pieper::bind {

// pieper::Chain as Python holds it.
struct NativeChain {
  Chain chain;
  nb::object pose_shape = shape_tuple({}, {4, 4}), jacobian_shape = shape_tuple({}, {6, chain.joints()});
  NativeChain(const Input& screws, const Input& home, const Input& coupling, const Input& limits, std::size_t m,
              std::size_t n)
      : chain(screws.data(), m, home.data(), coupling.data(), n, limits.data()) {}
};

void bind_forward_kinematics(nb::class_<NativeChain>& chain);
void bind_jacobian(nb::class_<NativeChain>& chain);
void bind_numeric_ik(nb::module_& module, nb::class_<NativeChain>& chain);
void bind_closed_form(nb::module_& module, nb::class_<NativeChain>& chain);
void bind_general_6r(nb::module_& module);
void bind_answers(nb::module_& module, nb::class_<NativeChain>& chain);
void bind_scores(nb::class_<NativeChain>& chain);
void bind_instruction_sets(nb::module_& module);
void bind_segmentation(nb::module_& module);

}  // namespace pieper::bind
