// The plain product of exponentials, for chains that the kernels do not take (mimic joints, none or very many axes), and
// the derivatives of the Jacobian. One configuration at a time.
#pragma once

#include <cstddef>

#include "pieper/chain.hpp"
#include "pieper/kernels.hpp"

namespace pieper {

void plain_poses(const Chain&, const double* q, std::size_t count, double* out);
void plain_jacobians(const Chain&, const double* q, std::size_t count, JacobianKind, double* out);
void plain_manipulability(const Chain&, const double* q, std::size_t count, double* out);

}  // namespace pieper
