#include <algorithm>

#include "chain.hpp"
#include "pieper/kernels.hpp"

namespace pieper::bind {

void bind_forward_kinematics(nb::class_<NativeChain>& chain) {
  chain.def(
      "fk",
      [](const NativeChain& self, nb::handle q, nb::handle out, std::size_t threads) {
        if (threads == 0) not_plain("threads");
        const Input joints(q, {self.chain.joints()}, "q");
        const Output poses(joints.leading(), {4, 4}, out, self.pose_shape);
        if (!without_lock(joints.count(), [&] {
              return forward_kinematics(self.chain, joints.data(), joints.count(), threads, poses.data());
            }))
          not_plain("q");
        return poses.array();
      },
      nb::sig("def fk(self, q: object, out: object = None, threads: int = 1) -> numpy.typing.NDArray[numpy.float64]"),
      nb::arg("q"), nb::arg("out") = nb::none(), nb::arg("threads") = 1,
      "Poses of the tip in the base frame, (..., 4, 4), from joints (..., n).");
  chain.def(
      "link_poses",
      [](const NativeChain& self, nb::handle q, nb::handle after, nb::handle homes) {
        const Input joints(q, {self.chain.joints()}, "q");
        joints.require_within(largest_joint_value);
        const Input home(homes, {4, 4}, "homes");
        std::vector<LinkFrame> frames;
        for (nb::handle item : after) {
          const std::size_t axes = nb::cast<std::size_t>(item);
          if (axes > self.chain.axes() || frames.size() >= home.count()) not_plain("after");
          LinkFrame frame{axes, {}};
          std::copy_n(home.data() + 16 * frames.size(), 12, frame.home.begin());
          frames.push_back(frame);
        }
        const Output poses(joints.leading(), {frames.size(), 4, 4}, nb::none());
        without_lock(joints.count(),
                     [&] { link_poses(self.chain, frames, joints.data(), joints.count(), poses.data()); });
        return poses.array();
      },
      nb::sig("def link_poses(self, q: object, after: object, homes: object) -> numpy.typing.NDArray[numpy.float64]"),
      nb::arg("q"), nb::arg("after"), nb::arg("homes"),
      "Poses (..., k, 4, 4) of k frames with home poses (k, 4, 4), each moved by its first `after` axes.");
}

}  // namespace pieper::bind
