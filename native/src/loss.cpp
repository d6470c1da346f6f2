// SPDX-License-Identifier: Apache-2.0
#include "loss.h"

#include "frame.h"

namespace cotton {
namespace {

constexpr int kBandRows = 64;  // each band blurs 10 more rows at its seams

template <class Real>
struct Scratch {
    Buffer<Real> target, d_mean, d_square, d_product, bands;
};

}  // namespace

template <class Real>
LossReport image_loss(const Real* image, const Target& target, int width, int height, int threads, Real* v_image) {
    const auto& k = kernels<Real>();
    thread_local Scratch<Real> kept;
    Scratch<Real>& s = kept;  // the calling thread's, used in all threads
    const int64_t pixels = int64_t(width) * height, maps = 3 * height * loss_row(width);
    const int64_t bands = (height + kBandRows - 1) / kBandRows;
    s.target.reserve(3 * pixels);
    s.d_mean.reserve(maps), s.d_square.reserve(maps), s.d_product.reserve(maps);
    s.bands.reserve(3 * bands * loss_scratch_size(width));

    const double norm = 1 / (3 * double(pixels)), weight = target.share * norm;
    const auto band = [&](int64_t task) {
        const int64_t channel = task / bands, b = task % bands, map = channel * height * loss_row(width);
        return LossBand<Real>{image + channel * pixels,
                              s.target.data() + channel * pixels,
                              width,
                              height,
                              int(b * kBandRows),
                              int(std::min<int64_t>(height, (b + 1) * kBandRows)),
                              s.d_mean.data() + map,
                              s.d_square.data() + map,
                              s.d_product.data() + map,
                              v_image + channel * pixels,
                              s.bands.data() + task * loss_scratch_size(width),
                              Real((1 - target.dssim) * weight),
                              Real(-target.dssim * weight)};
    };
    parallel_for(bands, threads, [&](int64_t b) {
        for (int64_t y = band(b).row_begin; y < band(b).row_end; ++y) {
            const uint8_t* rgb = target.rgb + 3 * y * target.row;
            Real* to = s.target.data() + y * width;
            for (int64_t x = 0; x < width; ++x) {
                for (int c = 0; c < 3; ++c) to[c * pixels + x] = Real(rgb[3 * x + c]) * Real(1.0 / 255.0);
            }
        }
    });
    std::vector<LossSums> sums(size_t(3 * bands));
    parallel_for(3 * bands, threads, [&](int64_t task) { sums[size_t(task)] = k.loss_forward(band(task)); });
    parallel_for(3 * bands, threads, [&](int64_t task) { k.loss_backward(band(task)); });
    LossReport report = {0, 0, 0};
    for (const LossSums& sum : sums) report.l1 += sum.l1 * norm, report.ssim += sum.ssim * norm;
    report.loss = (1 - target.dssim) * report.l1 + target.dssim * (1 - report.ssim);
    return report;
}

template LossReport image_loss(const float*, const Target&, int, int, int, float*);
template LossReport image_loss(const double*, const Target&, int, int, int, double*);

}  // namespace cotton
