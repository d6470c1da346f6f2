// SPDX-License-Identifier: Apache-2.0
// Code that the bindings of the training and the bindings of its parts for the tests share.
#pragma once

#include "bindings.h"
#include "train.h"

namespace cotton {

// The whole photograph; the loss compares the view's window of it. The caller must keep the array alive.
inline Target checked_target(const py::object& image, double dssim, const View& view) {
    if (!(dssim >= 0 && dssim <= 1)) throw py::value_error("dssim must be between 0 and 1");
    const auto photograph = checked<uint8_t>(image, "target", {view.image_height, view.image_width, 3});
    return Target::of(photograph.data(), view, dssim);
}

inline py::dict report_of(const LossReport& report) {
    return py::dict("loss"_a = report.loss, "l1"_a = report.l1, "ssim"_a = report.ssim);
}

template <class Real>
ImageLoss<Real> loss_against(const Target& target, const View& view, int threads) {
    return [&target, &view, threads](const Real* image, Real* v_image) {
        return image_loss(image, target, view.width, view.height, threads, v_image);
    };
}

}  // namespace cotton
