#include "train.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "threads.h"

namespace cotton {
namespace {

constexpr int kBandRows = 64;  // each band blurs 10 more rows at its seams

template <class Real>
struct Scratch {
    Buffer<Real> image, v_image, target, d_mean, d_square, d_product, bands, pair_rows, rows;
};

template <class Real>
Scratch<Real>& scratch() {
    thread_local Scratch<Real> kept;
    return kept;
}

// Gradient by the image (planar) -> gradient by the parameters. Returns how many rows of it are not finite.
template <class Real>
int64_t parameter_gradient(Frame<Real>& frame, const Real* image, const Real* v_image) {
    const auto& k = kernels<Real>();
    Scratch<Real>& s = scratch<Real>();
    const int64_t pixels = frame.view.pixels();
    Plane<const Real> images[3], gradients[3];
    for (int c = 0; c < 3; ++c) images[c] = {image + c * pixels, 1}, gradients[c] = {v_image + c * pixels, 1};
    s.pair_rows.reserve(frame.pair_count * pair_gradient::size);
    parallel_for(frame.tiles(), frame.threads, [&](int64_t t) {
        k.backward(frame.tile(t), frame.records.data(), images, gradients, s.pair_rows.data());
    });
    s.rows.reserve(frame.visible_count * row_gradient::size);
    const int64_t chunks = (frame.visible_count + kChunk - 1) / kChunk;
    std::vector<int64_t> spoilt(size_t(chunks), 0);
    parallel_for(chunks, frame.threads, [&](int64_t c) {
        const int64_t begin = c * kChunk, n = std::min(kChunk, frame.visible_count - begin);
        spoilt[size_t(c)] = k.project_backward(frame.scene, frame.view, frame.visible.data() + begin, n,
                                               frame.records.data(), frame.stride(), frame.ranges.data(),
                                               s.pair_rows.data(), s.rows.data() + begin * row_gradient::size);
    });
    return std::accumulate(spoilt.begin(), spoilt.end(), int64_t(0));
}

template <class Real>
Real* render_planar(Frame<Real>& frame, const Scene<Real>& scene, const View& view, const Real* background,
                    int threads) {
    frame.prepare(scene, view, threads);
    Real* image = scratch<Real>().image.reserve(3 * view.pixels());
    Plane<Real> planes[3];
    for (int c = 0; c < 3; ++c) planes[c] = {image + c * view.pixels(), 1};
    frame.blend(background, planes, nullptr);
    return image;
}

constexpr double kNoBias = 1e-8;        // if the start's share of a moment is smaller, its correction is 1 in float
constexpr size_t kMostBiased = 100000;  // largest number of steps, for beta near 1

// The corrections up to the step from which both are 1 in float.
std::vector<BiasCorrection> bias_corrections(const LearningRates& rates) {
    std::vector<BiasCorrection> table = {{1, 1}};
    double first = 1, second = 1;
    do {
        first *= rates.beta1;
        second *= rates.beta2;
        table.push_back({float(1 / (1 - first)), float(1 / (1 - second))});
    } while ((first > kNoBias || second > kNoBias) && table.size() < kMostBiased);
    return table;
}

}  // namespace

template <class Real>
LossReport image_loss(const Real* image, const Target& target, int width, int height, int threads, Real* v_image) {
    const auto& k = kernels<Real>();
    Scratch<Real>& s = scratch<Real>();
    const int64_t pixels = int64_t(width) * height, maps = 3 * height * loss_row(width);
    const int64_t bands = (height + kBandRows - 1) / kBandRows;
    s.target.reserve(3 * pixels);
    s.d_mean.reserve(maps), s.d_square.reserve(maps), s.d_product.reserve(maps);
    s.bands.reserve(3 * bands * loss_scratch_size(width));

    const double norm = 1 / (3 * double(pixels)), weight = target.share * norm;
    parallel_for(bands, threads, [&](int64_t b) {
        const int64_t end = std::min<int64_t>(height, (b + 1) * kBandRows);
        for (int64_t y = b * kBandRows; y < end; ++y) {
            const uint8_t* rgb = target.rgb + 3 * y * target.row;
            Real* to = s.target.data() + y * width;
            for (int64_t x = 0; x < width; ++x) {
                for (int c = 0; c < 3; ++c) to[c * pixels + x] = Real(rgb[3 * x + c]) * Real(1.0 / 255.0);
            }
        }
    });
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
    std::vector<LossSums> sums(size_t(3 * bands));
    parallel_for(3 * bands, threads, [&](int64_t task) { sums[size_t(task)] = k.loss_forward(band(task)); });
    parallel_for(3 * bands, threads, [&](int64_t task) { k.loss_backward(band(task)); });
    LossReport report = {0, 0, 0};
    for (const LossSums& sum : sums) report.l1 += sum.l1 * norm, report.ssim += sum.ssim * norm;
    report.loss = (1 - target.dssim) * report.l1 + target.dssim * (1 - report.ssim);
    return report;
}

template <class Real>
ViewGradient<Real> view_gradient(Frame<Real>& frame, const Scene<Real>& scene, const View& view, const Real* background,
                                 int threads, const ImageLoss<Real>& loss) {
    const Real* image = render_planar(frame, scene, view, background, threads);
    Real* v_image = scratch<Real>().v_image.reserve(3 * view.pixels());
    const LossReport report = loss(image, v_image);
    const bool finite = std::isfinite(report.loss);
    const int64_t spoilt = finite ? parameter_gradient(frame, image, v_image) : 0;
    return {report, finite, spoilt, scratch<Real>().rows.data()};
}

void adam_step(const Frame<float>& frame, const ViewGradient<float>& gradient, AdamRows rows) {
    const std::vector<BiasCorrection> bias = bias_corrections(rows.rates);
    rows.bias = bias.data();
    rows.bias_count = int32_t(bias.size());
    const int64_t chunks = (frame.visible_count + kChunk - 1) / kChunk;
    parallel_for(chunks, frame.threads, [&](int64_t c) {
        const int64_t begin = c * kChunk, n = std::min(kChunk, frame.visible_count - begin);
        kernels<float>().adam(rows, frame.visible.data() + begin, n, gradient.rows + begin * row_gradient::size);
    });
}

template LossReport image_loss(const float*, const Target&, int, int, int, float*);
template LossReport image_loss(const double*, const Target&, int, int, int, double*);
template ViewGradient<float> view_gradient(Frame<float>&, const Scene<float>&, const View&, const float*, int,
                                           const ImageLoss<float>&);
template ViewGradient<double> view_gradient(Frame<double>&, const Scene<double>&, const View&, const double*, int,
                                            const ImageLoss<double>&);

}  // namespace cotton
