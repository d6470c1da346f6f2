// SPDX-License-Identifier: Apache-2.0
// What a training step of the core spends its time on, and how many (pixel, Gaussian) pairs it blends.
//
//     bench_parts SCENE INSTRUCTION_SET THREADS REPEATS
//
// SCENE, as bench_kernels.py writes it: int32 count, sh_stored, width, height; float64 fx, fy, cx, cy, rotation (9),
// translation (3), near plane; float32 means, quats, log_scales, opacity_logits, sh; uint8 target (H, W, 3).
// Prints one JSON object. Times are medians over the repeats of the processor time of all threads.
#include <time.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

#include "train.h"

namespace cotton {

#define DECLARE(isa)                           \
    namespace isa {                            \
    extern const Kernels<float> float_kernels; \
    }
DECLARE(baseline)
#if defined(__x86_64__)
DECLARE(avx2)
DECLARE(avx512)
#endif

namespace {

enum Part : int { kProject, kListPairs, kForward, kLoss, kBackward, kProjectBackward, kAdam, kParts };
constexpr const char* kNames[kParts] = {"project",  "list_pairs",       "forward", "loss",
                                        "backward", "project_backward", "adam"};
std::atomic<int64_t> spent_ns[kParts];
Kernels<float> measured;  // those that the timed ones call

int64_t clock_ns(clockid_t clock) {
    timespec t;
    clock_gettime(clock, &t);
    return int64_t(t.tv_sec) * 1000000000 + t.tv_nsec;
}

// A kernel with the same arguments that adds its time to a part's.
template <Part part, auto member, class Function>
struct Timed;
template <Part part, auto member, class Result, class... Arguments>
struct Timed<part, member, Result (*)(Arguments...)> {
    static Result run(Arguments... arguments) {
        struct Stop {
            const int64_t begin = clock_ns(CLOCK_THREAD_CPUTIME_ID);
            ~Stop() { spent_ns[part] += clock_ns(CLOCK_THREAD_CPUTIME_ID) - begin; }
        } stop;
        return (measured.*member)(arguments...);
    }
};
template <Part part, auto member>
constexpr auto timed = Timed<part, member, std::remove_reference_t<decltype(measured.*member)>>::run;

Kernels<float>::Forward blend_tile;

void timed_forward(const Tile& tile, const float* records, const float* background, const Plane<float>* planes,
                   float* transmittance) {
    const int64_t begin = clock_ns(CLOCK_THREAD_CPUTIME_ID);
    blend_tile(tile, records, background, planes, transmittance);
    spent_ns[kForward] += clock_ns(CLOCK_THREAD_CPUTIME_ID) - begin;
}

Kernels<float> table;

void choose(const std::string& isa) {
    if (isa == "baseline") measured = baseline::float_kernels;
#if defined(__x86_64__)
    if (isa == "avx2") measured = avx2::float_kernels;
    if (isa == "avx512") measured = avx512::float_kernels;
#endif
    if (!measured.project) throw std::invalid_argument("no instruction set " + isa);
    using K = Kernels<float>;
    table = measured;
    table.project = timed<kProject, &K::project>;
    table.list_pairs = timed<kListPairs, &K::list_pairs>;
    table.loss_forward = timed<kLoss, &K::loss_forward>;
    table.loss_backward = timed<kLoss, &K::loss_backward>;
    table.backward = timed<kBackward, &K::backward>;
    table.project_backward = timed<kProjectBackward, &K::project_backward>;
    table.adam = timed<kAdam, &K::adam>;
    blend_tile = measured.forward(3);
    table.forward = [](int) -> K::Forward { return timed_forward; };
}

// Pairs that the kernels evaluate (whole blocks with an open pixel) and those of them that contribute to the image.
struct Pairs {
    int64_t evaluated = 0, contributing = 0;
};

Pairs count_pairs(const Frame<float>& frame) {
    Pairs pairs;
    for (int64_t t = 0; t < frame.tiles(); ++t) {
        const Tile tile = frame.tile(t);
        double transmittance[kTilePixels];
        for (int i = 0; i < kTilePixels; ++i) {
            transmittance[i] = tile.x0 + pixel_x(i) < tile.width && tile.y0 + pixel_y(i) < tile.height;
        }
        for (int64_t pair = 0; pair < tile.count; ++pair) {
            const float* g = frame.records.data() + int64_t(tile.pairs[pair].row) * frame.stride();
            for (uint32_t blocks = tile.pairs[pair].blocks; blocks != 0; blocks &= blocks - 1) {
                double* open = transmittance + __builtin_ctz(blocks) * kBlockPixels;
                if (std::none_of(open, open + kBlockPixels, [](double x) { return x > kStop; })) continue;
                pairs.evaluated += kBlockPixels;
                for (double* x = open; x < open + kBlockPixels; ++x) {
                    const int i = int(x - transmittance);
                    const double dx = tile.x0 + pixel_x(i) + 0.5 - g[field::x];
                    const double dy = tile.y0 + pixel_y(i) + 0.5 - g[field::y];
                    const double u = g[field::p] * dx + g[field::q] * dy, v = g[field::r] * dy;
                    const double alpha = std::min(kAlphaCap, std::exp2(g[field::log2_opacity] - u * u - v * v));
                    if (*x <= kStop || alpha < kAlphaCut) continue;
                    ++pairs.contributing;
                    *x *= 1 - alpha;
                }
            }
        }
    }
    return pairs;
}

template <class T>
std::vector<T> read(FILE* file, int64_t count) {
    std::vector<T> values(static_cast<size_t>(count));
    if (std::fread(values.data(), sizeof(T), values.size(), file) != values.size()) {
        throw std::runtime_error("the scene is cut short");
    }
    return values;
}

double median(std::vector<double> values) {
    std::nth_element(values.begin(), values.begin() + int64_t(values.size() / 2), values.end());
    return values[values.size() / 2];
}

void benchmark(FILE* file, int threads, int repeats) {
    const auto sizes = read<int32_t>(file, 4);
    const auto camera = read<double>(file, 17);
    const int64_t n = sizes[0], coefficients = sizes[1], widths[5] = {3, 4, 3, 1, 3 * coefficients};
    View view = {sizes[2], sizes[3], camera[0], camera[1], camera[2], camera[3], {}, {}, camera[16],
                 sizes[2], sizes[3], 0, 0};
    std::copy_n(camera.begin() + 4, 9, view.rotation);
    std::copy_n(camera.begin() + 13, 3, view.translation);
    std::vector<float> parameters[5], first[5], second[5], statistics[2];
    for (int k = 0; k < 5; ++k) {
        parameters[k] = read<float>(file, n * widths[k]);
        first[k].resize(parameters[k].size()), second[k].resize(parameters[k].size());
    }
    for (auto& sums : statistics) sums.resize(size_t(n));
    const std::vector<float> factors(size_t(2 * n), 1.0f);
    const auto photograph = read<uint8_t>(file, 3 * view.pixels());
    std::vector<int32_t> steps(static_cast<size_t>(n * kBands)), count(static_cast<size_t>(n));

    int degree = 0;
    while ((degree + 1) * (degree + 1) < coefficients) ++degree;
    Scene<float> scene = {};
    scene.count = n;
    scene.means = parameters[0].data(), scene.quats = parameters[1].data(), scene.log_scales = parameters[2].data();
    scene.opacity_logits = parameters[3].data(), scene.sh = parameters[4].data();
    scene.sh_stored = int(coefficients), scene.sh_degree = degree, scene.channels = 3;
    const auto moments = [](std::vector<float>* m) {
        return GaussianPointers{m[0].data(), m[1].data(), m[2].data(), m[3].data(), m[4].data()};
    };
    AdamRows rows = {};
    rows.parameters = moments(parameters);
    rows.sh_stored = int(coefficients), rows.sh_degree = degree;
    rows.first = moments(first), rows.second = moments(second);
    rows.steps = steps.data();
    rows.rates = {0, 0, 0, 0, 0, 0, 0.9f, 0.999f, 1e-15f};  // the same work every time
    rows.rate_factors = factors.data();
    rows.statistics = {statistics[0].data(), statistics[1].data(), count.data(), float(1 / double(view.pixels()))};

    const Target target = Target::of(photograph.data(), view, 0.2);
    const ImageLoss<float> loss = [&](const float* image, float* v_image) {
        return image_loss(image, target, view.width, view.height, threads, v_image);
    };
    const float black[3] = {0, 0, 0};
    Frame<float>& frame = scratch_frame<float>();
    std::vector<double> cpu_ms[kParts], total_cpu_ms, wall_ms;
    ViewGradient<float> gradient = {};
    for (int r = -1; r < repeats; ++r) {  // the first is not counted
        for (auto& ns : spent_ns) ns = 0;
        const int64_t begin = clock_ns(CLOCK_MONOTONIC), begin_cpu = clock_ns(CLOCK_PROCESS_CPUTIME_ID);
        gradient = view_gradient(frame, scene, view, black, threads, loss);
        adam_step(frame, gradient, rows);
        if (r < 0) continue;
        wall_ms.push_back(1e-6 * double(clock_ns(CLOCK_MONOTONIC) - begin));
        total_cpu_ms.push_back(1e-6 * double(clock_ns(CLOCK_PROCESS_CPUTIME_ID) - begin_cpu));
        for (int k = 0; k < kParts; ++k) cpu_ms[k].push_back(1e-6 * double(spent_ns[k]));
    }
    const Pairs pairs = count_pairs(frame);
    double length2 = 0, bin_and_rest = median(total_cpu_ms);
    for (int64_t i = 0; i < frame.visible_count * row_gradient::size; ++i) {
        if (i % row_gradient::size <= row_gradient::abs_grad_px) length2 += double(gradient.rows[i]) * gradient.rows[i];
    }
    std::printf("{\"visible\": %lld, \"tile_pairs\": %lld, \"evaluated_per_px\": %.2f, \"contributing_per_px\": %.2f, ",
                static_cast<long long>(frame.visible_count), static_cast<long long>(frame.pair_count),
                double(pairs.evaluated) / double(view.pixels()), double(pairs.contributing) / double(view.pixels()));
    std::printf("\"loss\": %.9g, \"gradient_length\": %.9g, \"wall_ms\": %.2f, \"cpu_ms\": %.2f, \"parts_cpu_ms\": {",
                gradient.report.loss, std::sqrt(length2), median(wall_ms), median(total_cpu_ms));
    for (int k = 0; k < kParts; ++k) {
        std::printf("\"%s\": %.2f, ", kNames[k], median(cpu_ms[k]));
        bin_and_rest -= median(cpu_ms[k]);
    }
    std::printf("\"sort_bin_rest\": %.2f}, \"forward_ns_per_pair\": %.3f, \"backward_ns_per_pair\": %.3f}\n",
                bin_and_rest, 1e6 * median(cpu_ms[kForward]) / double(pairs.evaluated),
                1e6 * median(cpu_ms[kBackward]) / double(pairs.evaluated));
}

}  // namespace

template <>
const Kernels<float>& kernels() {
    return table;
}

// The other precision is not measured.
template <>
const Kernels<double>& kernels() {
    std::abort();
}

}  // namespace cotton

int main(int count, char** arguments) {
    if (count != 5) return std::fprintf(stderr, "bench_parts SCENE INSTRUCTION_SET THREADS REPEATS\n"), 2;
    FILE* file = std::fopen(arguments[1], "rb");
    if (!file) return std::fprintf(stderr, "cannot open %s\n", arguments[1]), 1;
    cotton::choose(arguments[2]);
    cotton::benchmark(file, std::atoi(arguments[3]), std::atoi(arguments[4]));
}
