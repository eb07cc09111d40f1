// The result of `kincal intrinsics` for people.
#pragma once

#include <string>

#include "../../models/intrinsics/intrinsics.h"

namespace kincal {

std::string intrinsics_table(const Rig& rig, const IntrinsicsResult& result);

}  // namespace kincal
