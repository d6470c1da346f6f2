// SPDX-License-Identifier: Apache-2.0
// Gradients and the optimiser step of one view.
#pragma once

#include <functional>

#include "frame.h"
#include "loss.h"
#include "optimiser.h"

namespace cotton {

// The gradient of one view by the parameters: a row_gradient row for each visible Gaussian.
template <class Real>
struct ViewGradient {
    LossReport report;
    bool finite;     // whether the loss is finite
    int64_t spoilt;  // rows that are not finite and have a weight of 0
    const Real* rows;
};

// The loss of a planar image (3, H, W); writes its gradient by the image, of the same size, to `v_image`.
template <class Real>
using ImageLoss = std::function<LossReport(const Real* image, Real* v_image)>;

// Renders the scene's spherical harmonics (3 channels, no depth) and carries the gradient of the loss back.
template <class Real>
ViewGradient<Real> view_gradient(Frame<Real>& frame, const Scene<Real>&, const View&, const Real* background,
                                 int threads, const ImageLoss<Real>& loss);

// Adam update of the Gaussians that the view shows and whose gradient is finite, in place, and their statistics.
void adam_step(const Frame<float>& frame, const ViewGradient<float>& gradient, AdamRows rows);

}  // namespace cotton
