// Loss, gradients and the optimiser step of one view.
#pragma once

#include <functional>

#include "frame.h"

namespace cotton {

struct LossReport {
    double loss, l1, ssim;
};

// The photograph that an image, or a window of it, is compared with.
struct Target {
    const uint8_t* rgb;  // of the first pixel
    int64_t row;         // pixels from row to row
    double share;        // of the photograph that is compared
    double dssim;        // λ

    static Target of(const uint8_t* photograph, const View& view, double dssim) {
        const int64_t first = int64_t(view.top) * view.image_width + view.left;
        return {photograph + 3 * first, view.image_width, double(view.pixels()) / double(view.image_pixels()), dssim};
    }
};

// (1 - λ) L1 + λ (1 - SSIM) of a planar image (3, H, W), and the gradient, as large, of the target's share of it: so a
// pixel weighs the same in a window as in the whole image.
template <class Real>
LossReport image_loss(const Real* image, const Target& target, int width, int height, int threads, Real* v_image);

// What one view asks of the parameters: a row_gradient row for each visible Gaussian.
template <class Real>
struct ViewGradient {
    LossReport report;
    bool finite;     // the loss is
    int64_t spoilt;  // rows that are not, and are without a weight
    const Real* rows;
};

// The loss of a planar image (3, H, W); writes its gradient by the image, as large, to `v_image`.
template <class Real>
using ImageLoss = std::function<LossReport(const Real* image, Real* v_image)>;

// Renders the scene's spherical harmonics (3 channels, no depth) and carries the gradient of the loss back.
template <class Real>
ViewGradient<Real> view_gradient(Frame<Real>& frame, const Scene<Real>&, const View&, const Real* background,
                                 int threads, const ImageLoss<Real>& loss);

// Adam update of the Gaussians that the view shows and whose gradient is finite, in place, and their statistics.
void adam_step(const Frame<float>& frame, const ViewGradient<float>& gradient, AdamRows rows);

}  // namespace cotton
