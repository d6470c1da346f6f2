// Loss, gradients and the optimiser step of one view.
#pragma once

#include <functional>

#include "frame.h"

namespace cotton {

struct LossReport {
    double loss, l1, ssim;
};

// The photograph with which an image, or a window of it, is compared.
struct Target {
    const uint8_t* rgb;  // of the first pixel
    int64_t row;         // pixels from row to row
    double share;        // share of the photograph in the comparison
    double dssim;        // λ

    static Target of(const uint8_t* photograph, const View& view, double dssim) {
        const int64_t first = int64_t(view.top) * view.image_width + view.left;
        return {photograph + 3 * first, view.image_width, double(view.pixels()) / double(view.image_pixels()), dssim};
    }
};

// (1 - λ) L1 + λ (1 - SSIM) of a planar image (3, H, W), and the gradient, of the same size, of the target's share of
// the loss: so a pixel weighs the same in a window as in the whole image.
template <class Real>
LossReport image_loss(const Real* image, const Target& target, int width, int height, int threads, Real* v_image);

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
