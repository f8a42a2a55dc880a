// How near joints are to a singular pose.
#pragma once

#include "pieper/general_6r.hpp"

namespace pieper {

// Smallest singular value of the Jacobian and its direction in the joints, by three steps of inverse iteration.
double least_singular_value(const GeneralArm&, const double* cosines, const double* sines, double* direction);

}  // namespace pieper
