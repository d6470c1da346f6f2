// SPDX-License-Identifier: Apache-2.0
#include "train.h"

#include <array>
#include <atomic>
#include <cmath>

namespace cotton {
namespace {

template <class Real>
struct Scratch {
    Buffer<Real> image, v_image, pair_rows, rows;
};

template <class Real>
Scratch<Real>& scratch() {
    thread_local Scratch<Real> kept;
    return kept;
}

template <class Real>
std::array<Plane<Real>, 3> planes_of(Real* image, const View& view) {
    return {Plane<Real>{image, 1}, {image + view.pixels(), 1}, {image + 2 * view.pixels(), 1}};
}

// Gradient by the image (planar) -> gradient by the parameters. Returns how many rows of it are not finite.
template <class Real>
int64_t parameter_gradient(Frame<Real>& frame, const Real* image, const Real* v_image) {
    const auto& k = kernels<Real>();
    Scratch<Real>& s = scratch<Real>();
    const auto images = planes_of(image, frame.view), gradients = planes_of(v_image, frame.view);
    s.pair_rows.reserve(frame.pair_count * pair_gradient::size);
    parallel_for(frame.tiles(), frame.threads, [&](int64_t t) {
        k.backward(frame.tile(t), frame.records.data(), images.data(), gradients.data(), s.pair_rows.data());
    });
    s.rows.reserve(frame.visible_count * row_gradient::size);
    std::atomic<int64_t> spoilt{0};
    frame.each_visible_chunk([&](int64_t first, int64_t n) {
        spoilt += k.project_backward(frame.scene, frame.view, frame.visible.data() + first, n, frame.records.data(),
                                     frame.stride(), frame.ranges.data(), s.pair_rows.data(),
                                     s.rows.data() + first * row_gradient::size);
    });
    return spoilt;
}

constexpr double kNoBias = 1e-8;        // if the start's share of a moment is smaller, its correction is 1 in float
constexpr size_t kMostBiased = 100000;  // largest number of steps, for beta near 1

// The corrections up to the step from which both are 1 in float. Some 18,000: they are kept for the next step.
const std::vector<BiasCorrection>& bias_corrections(float beta1, float beta2) {
    thread_local float kept_beta1 = -1, kept_beta2 = -1;
    thread_local std::vector<BiasCorrection> table;
    if (beta1 == kept_beta1 && beta2 == kept_beta2) return table;
    table = {{1, 1}};
    double first = 1, second = 1;
    do {
        first *= beta1;
        second *= beta2;
        table.push_back({float(1 / (1 - first)), float(1 / (1 - second))});
    } while ((first > kNoBias || second > kNoBias) && table.size() < kMostBiased);
    kept_beta1 = beta1, kept_beta2 = beta2;
    return table;
}

}  // namespace

template <class Real>
ViewGradient<Real> view_gradient(Frame<Real>& frame, const Scene<Real>& scene, const View& view, const Real* background,
                                 int threads, const ImageLoss<Real>& loss) {
    Scratch<Real>& s = scratch<Real>();
    frame.prepare(scene, view, threads);
    Real *image = s.image.reserve(3 * view.pixels()), *v_image = s.v_image.reserve(3 * view.pixels());
    frame.blend(background, planes_of(image, view).data(), nullptr);
    const LossReport report = loss(image, v_image);
    const bool finite = std::isfinite(report.loss);
    const int64_t spoilt = finite ? parameter_gradient<Real>(frame, image, v_image) : 0;
    return {report, finite, spoilt, s.rows.data()};
}

void adam_step(const Frame<float>& frame, const ViewGradient<float>& gradient, AdamRows rows) {
    const std::vector<BiasCorrection>& bias = bias_corrections(rows.rates.beta1, rows.rates.beta2);
    rows.bias = bias.data();
    rows.bias_count = int32_t(bias.size());
    frame.each_visible_chunk([&](int64_t first, int64_t n) {
        kernels<float>().adam(rows, frame.visible.data() + first, n, gradient.rows + first * row_gradient::size);
    });
}

template ViewGradient<float> view_gradient(Frame<float>&, const Scene<float>&, const View&, const float*, int,
                                           const ImageLoss<float>&);
template ViewGradient<double> view_gradient(Frame<double>&, const Scene<double>&, const View&, const double*, int,
                                            const ImageLoss<double>&);

}  // namespace cotton
