// Per-Gaussian values with frozen geometry: their gradient, and the blending weights themselves.
#pragma once

#include <vector>

#include "frame.h"

namespace cotton {

// Gradient by the values (N, channels), added to `v_values`, given the gradient by the image (H, W, channels).
// The frame's scene needs no channels of its own.
template <class Real>
void values_gradient(Frame<Real>& frame, int channels, const Real* v_image, Real* v_values);

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
