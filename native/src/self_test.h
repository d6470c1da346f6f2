// SPDX-License-Identifier: Apache-2.0
// Whether NaN and Inf are still recognised in this build.
#pragma once

#include "simd.h"

namespace cotton::COTTON_ISA {

inline bool self_test() {
    volatile float zero = 0.0f;
    const float nan = zero / zero, infinity = 1.0f / zero;
    const bool scalar = nan != nan && !(nan <= 0.0f) && !(nan > 0.0f) && infinity - infinity != 0.0f;
    return scalar && !any(broadcast(nan) == broadcast(nan)) && !any(broadcast(nan) > broadcast(zero + 0.0f));
}

}  // namespace cotton::COTTON_ISA
