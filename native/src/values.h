// SPDX-License-Identifier: Apache-2.0
// The blending weights of Gaussians, summed over pixels.
#pragma once

#include <vector>

#include "frame.h"

namespace cotton {

// The blending weight that a Gaussian has inside a mask, summed over its pixels.
struct MaskWeight {
    uint32_t row;
    uint16_t id;
    float weight;
};

// Weights of all Gaussians over one view: `total` (N,) over all pixels, and the non-zero ones inside each mask id > 0
// of `mask_ids` (H, W), by (row, id).
std::vector<MaskWeight> mask_weights(Frame<float>& frame, const uint16_t* mask_ids, float* total);

}  // namespace cotton
