#include "chain.hpp"
#include "pieper/kernels.hpp"

namespace pieper::bind {

namespace {

template <JacobianKind kind>
nb::object jacobians_of(const NativeChain& self, nb::handle q, nb::handle out, std::size_t threads) {
  if (threads == 0) not_plain("threads");
  const std::size_t n = self.chain.joints();
  const Input joints(q, {n}, "q");
  const Output jacobians(joints.leading(), {6, n}, out, self.jacobian_shape);
  if (!without_lock(joints.count(), [&] {
        return jacobian(self.chain, joints.data(), joints.count(), kind, threads, jacobians.data());
      }))
    not_plain("q");
  return jacobians.array();
}

template <JacobianKind kind>
void def_jacobian(nb::class_<NativeChain>& chain, const char* name, const char* signature) {
  chain.def(name, &jacobians_of<kind>, nb::sig(signature), nb::arg("q"), nb::arg("out") = nb::none(),
            nb::arg("threads") = 1, "Jacobians (..., 6, n), linear part first.");
}

}  // namespace

void bind_jacobian(nb::class_<NativeChain>& chain) {
  def_jacobian<JacobianKind::geometric>(
      chain, "jacobian",
      "def jacobian(self, q: object, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]");
  def_jacobian<JacobianKind::space>(
      chain, "jacobian_space",
      "def jacobian_space(self, q: object, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]");
  def_jacobian<JacobianKind::body>(
      chain, "jacobian_body",
      "def jacobian_body(self, q: object, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]");
  chain.def(
      "jacobian_rate",
      [](const NativeChain& self, nb::handle q, nb::handle dq) {
        const std::size_t n = self.chain.joints();
        const Input joints(q, {n}, "q"), speeds(dq, {n}, "dq");
        joints.require_within(largest_joint_value), speeds.require_within(largest_joint_value);
        if (joints.leading() != speeds.leading()) not_plain("dq");
        const Output rates(joints.leading(), {6, n}, nb::none());
        without_lock(joints.count(),
                     [&] { jacobian_rate(self.chain, joints.data(), speeds.data(), joints.count(), rates.data()); });
        return rates.array();
      },
      nb::sig("def jacobian_rate(self, q: object, dq: object) -> numpy.typing.NDArray[numpy.float64]"), nb::arg("q"),
      nb::arg("dq"), "Time derivative (..., 6, n) of the geometric Jacobian.");
  chain.def(
      "hessian",
      [](const NativeChain& self, nb::handle q) {
        const std::size_t n = self.chain.joints();
        const Input joints(q, {n}, "q");
        joints.require_within(largest_joint_value);
        const Output derivatives(joints.leading(), {n, 6, n}, nb::none());
        without_lock(joints.count(), [&] { hessian(self.chain, joints.data(), joints.count(), derivatives.data()); });
        return derivatives.array();
      },
      nb::sig("def hessian(self, q: object) -> numpy.typing.NDArray[numpy.float64]"), nb::arg("q"),
      "Derivatives (..., n, 6, n) of the geometric Jacobian by each joint.");
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
