// SPDX-License-Identifier: Apache-2.0
// (1 - λ) L1 + λ (1 - SSIM), the loss of Kerbl et al. 2023, of an image against a photograph.
#pragma once

#include "scene.h"

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

    COTTON_SHARED static Target of(const uint8_t* photograph, const View& view, double dssim) {
        const int64_t first = int64_t(view.top) * view.image_width + view.left;
        return {photograph + 3 * first, view.image_width, double(view.pixels()) / double(view.image_pixels()), dssim};
    }
};

// The loss of a planar image (3, H, W), and the gradient, of the same size, of the target's share of the loss: so a
// pixel weighs the same in a window as in the whole image.
template <class Real>
LossReport image_loss(const Real* image, const Target& target, int width, int height, int threads, Real* v_image);

struct LossSums {
    double l1, ssim;
};

// The rows of one channel that a kernel works on at a time.
template <class Real>
struct LossBand {
    const Real *image, *target;  // one channel, H x W
    int width, height, row_begin, row_end;
    Real *d_mean, *d_square, *d_product;  // H x loss_row(W): derivatives of the SSIM by the local moments
    Real* v_image;
    Real* scratch;  // loss_scratch_size(width)
    Real l1_factor, ssim_factor;
};

COTTON_SHARED constexpr int64_t loss_row(int width) { return (int64_t(width) + 10 + 31) / 16 * 16; }
COTTON_SHARED constexpr int64_t loss_scratch_size(int width) { return loss_row(width) * 12 * 4; }

}  // namespace cotton
