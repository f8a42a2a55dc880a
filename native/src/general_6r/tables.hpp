// Constants of the root finder, made once.
#pragma once

#include "pieper/general_6r.hpp"

namespace pieper {

const TrigonometricTables& trigonometric_tables();

}  // namespace pieper
