#include "chain.hpp"
#include "pieper/kernels.hpp"

namespace pieper::bind {

void bind_jacobian(nb::class_<NativeChain>& chain) {
  chain.def(
      "jacobian",
      [](const NativeChain& self, nb::handle q, JacobianKind kind, nb::handle out, std::size_t threads) {
        if (threads == 0) not_plain("threads");
        const std::size_t n = self.chain.joints();
        const Input joints(q, {n}, "q");
        const Output jacobians(joints.leading(), {6, n}, out);
        if (!without_lock(joints.count(), [&] {
              return jacobian(self.chain, joints.data(), joints.count(), kind, threads, jacobians.data());
            }))
          not_plain("q");
        return jacobians.array();
      },
      nb::sig("def jacobian(self, q: object, kind: JacobianKind, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]"),
      nb::arg("q"), nb::arg("kind"), nb::arg("out") = nb::none(), nb::arg("threads") = 1,
      "Jacobians (..., 6, n), linear part first.");
  chain.def(
      "jacobian_rate",
      [](const NativeChain& self, nb::handle q, nb::handle dq) {
        const std::size_t n = self.chain.joints();
        const Input joints(q, {n}, "q"), speeds(dq, {n}, "dq");
        joints.require_finite(), speeds.require_finite();
        if (joints.leading() != speeds.leading()) not_plain("dq");
        const Output rates(joints.leading(), {6, n}, nb::none());
        without_lock(joints.count(), [&] {
          jacobian_rate(self.chain, joints.data(), speeds.data(), joints.count(), rates.data());
        });
        return rates.array();
      },
      nb::sig("def jacobian_rate(self, q: object, dq: object) -> numpy.typing.NDArray[numpy.float64]"),
      nb::arg("q"), nb::arg("dq"), "Time derivative (..., 6, n) of the geometric Jacobian.");
  chain.def(
      "hessian",
      [](const NativeChain& self, nb::handle q) {
        const std::size_t n = self.chain.joints();
        const Input joints(q, {n}, "q");
        joints.require_finite();
        const Output derivatives(joints.leading(), {n, 6, n}, nb::none());
        without_lock(joints.count(), [&] { hessian(self.chain, joints.data(), joints.count(), derivatives.data()); });
        return derivatives.array();
      },
      nb::sig("def hessian(self, q: object) -> numpy.typing.NDArray[numpy.float64]"),
      nb::arg("q"), "Derivatives (..., n, 6, n) of the geometric Jacobian by each joint.");
  chain.def(
      "manipulability",
      [](const NativeChain& self, nb::handle q, std::size_t threads) {
        if (threads == 0) not_plain("threads");
        const Input joints(q, {self.chain.joints()}, "q");
        const Output measures(joints.leading(), {}, nb::none());
        if (!without_lock(joints.count(), [&] {
              return manipulability(self.chain, joints.data(), joints.count(), threads, measures.data());
            }))
          not_plain("q");
        return measures.array();
      },
      nb::sig("def manipulability(self, q: object, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]"),
      nb::arg("q"), nb::arg("threads") = 1, "Yoshikawa's manipulability (...).");
}

}  // namespace pieper::bind
