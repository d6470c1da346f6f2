// SPDX-License-Identifier: Apache-2.0
// The Gaussians and weights that blend into single pixels.
#pragma once

#include <vector>

#include "frame.h"

namespace cotton {

// A sparse matrix of rays x Gaussians, compressed by rows; each ray's Gaussians front to back.
template <class Real>
struct RayWeights {
    std::vector<int64_t> starts;  // rays + 1
    std::vector<int32_t> rows;
    std::vector<Real> weights;
};

// The non-zero blending weights at `rays` pixels (x, y) of the image, in any order, also repeatedly.
template <class Real>
RayWeights<Real> ray_weights(const Frame<Real>& frame, const int64_t* pixels, int64_t rays);

}  // namespace cotton
