// SPDX-License-Identifier: Apache-2.0
// Scene -> projected Gaussians: culling, footprint, colour.
#pragma once

#include "harmonics.h"
#include "projection.h"

namespace cotton::COTTON_ISA {
namespace {

constexpr double kPixelMargin = 1e-3;   // px by which a footprint is widened before its tiles are counted
constexpr double kCutMargin = 1.00001;  // factor by which the squared radius of the block test is widened
template <class Real>
constexpr double kRounding = sizeof(Real) == 4 ? 1e-6 : 1e-14;  // of u and v, relative to their largest terms

COTTON_INLINE bool finite(double value) { return __builtin_fabs(value) <= 3e38; }

COTTON_INLINE double clamp(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}

// Tiles whose pixel centres may lie within `half` px of `mean`, along one axis.
COTTON_INLINE void tile_range(double mean, double half, int size, uint16_t& begin, uint16_t& end) {
    const double tiles = (size + kTile - 1) / kTile;
    const double first = clamp(__builtin_floor((mean - half - (0.5 + kPixelMargin)) / kTile), 0, tiles);
    const double last = clamp(__builtin_floor((mean + half - (0.5 - kPixelMargin)) / kTile) + 1, 0, tiles);
    begin = uint16_t(first);
    end = uint16_t(last > first ? last : first);
}

// Writes the channels of a record; returns whether they are finite and, for colours, within kMaxColour.
template <class Real>
bool write_values(const Scene<Real>& scene, const PackOf<Real>* basis, int lane, int64_t row, double depth, Real* to) {
    if (scene.values) {
        for (int c = 0; c < scene.channels; ++c) to[c] = scene.values[row * scene.channels + c];
    } else if (scene.sh) {
        const Real* sh = scene.sh + 3 * scene.sh_stored * row;
        with_degree(scene.sh_degree, [&]<int degree>() { sh_colour<degree, Real>(sh, basis, lane, to); });
    }
    bool usable = true;
    for (int c = 0; c < scene.channels; ++c) {
        usable &= scene.sh ? to[c] <= Real(kMaxColour) && to[c] >= Real(-kMaxColour) : to[c] - to[c] == 0;
        if (scene.sh) to[c] = to[c] > 0 ? to[c] : 0;
    }
    if (scene.with_depth) to[scene.channels] = Real(depth);
    return usable;
}

// Logits above it mean opacities above the alpha cut: logit a = ln a - ln(1 - a), and -ln(1 - a) < a / (1 - a).
constexpr double kSurelyInImage = kLog2AlphaCut * kLn2 + kAlphaCut / (1 - kAlphaCut);
constexpr double kWidest = 3.33;  // standard deviations from which on the most opaque is below the alpha cut

constexpr bool nearly(double value, double wanted, double share) {
    return value >= wanted * (1 - share) && value <= wanted * (1 + share);
}

constexpr double exp_of_positive(double x) {  // by its series: std::exp is not constexpr before C++26
    double sum = 1, term = 1;
    for (int k = 1; k < 100; ++k) sum += term *= x / k;
    return sum;
}

static_assert(nearly(kAlphaCut * exp_of_positive(-kLog2AlphaCut * kLn2), 1, 1e-14), "kLog2AlphaCut is of another cut");
static_assert(kScale2 * kWidest * kWidest > -kLog2AlphaCut && nearly(kScale2 * kWidest * kWidest, -kLog2AlphaCut, 1e-3),
              "kWidest is of another cut");

// Whether a pack shows nothing, checked before the costly work: neighbours in space are neighbours in memory, so most
// packs are completely in view or out of it. Counts their rows. Unusual rows take the full computation.
template <class Real>
COTTON_INLINE bool is_unseen(const Scene<Real>& scene, const View& view, const RatioLimits& limits,
                             const PackRows& rows, ProjectionCount& count) {
    Pack position[3], cam[3], unusual{}, log_scale = Pack{} - kMaxLogScale;
    for (int k = 0; k < 3; ++k) {
        position[k] = gather(scene.means, 3, k, rows);
        const Pack scale = gather(scene.log_scales, 3, k, rows);
        unusual += position[k] * 0.0 + scale * 0.0;
        log_scale = maximum(log_scale, scale);
    }
    const double* w = view.rotation;
    for (int k = 0; k < 3; ++k) {
        cam[k] = w[3 * k] * position[0] + w[3 * k + 1] * position[1] + w[3 * k + 2] * position[2] + view.translation[k];
    }
    const PackMask behind = cam[2] < view.near_plane;
    const Pack sigma = exp2<double>(minimum(log_scale, Pack{} + kMaxLogScale) * kLog2E), inv_z = 1 / cam[2];
    const double focal[2] = {view.fx, view.fy}, centre[2] = {view.cx, view.cy};
    const int tiles[2] = {view.tiles_x(), view.tiles_y()};
    PackMask unseen = behind;
    for (int k = 0; k < 2; ++k) {
        const Pack ratio = cam[k] * inv_z, mean = focal[k] * ratio + centre[k];
        const Pack frozen = minimum(maximum(ratio, Pack{} + limits.low[k]), Pack{} + limits.high[k]);
        const Pack spread = focal[k] * inv_z * sqrt(1 + frozen * frozen) * sigma;  // the longest axis, face on
        const Pack half = kWidest * (spread + 1) + 1;  // 1 px: more than dilation and rounding add
        unseen |= (mean + half < 0.0) | (mean - half > double(tiles[k] * kTile));
    }
    if (any(~unseen)) return false;
    Pack largest{};
    for (int k = 0; k < 4; ++k) {
        const Pack quat = gather(scene.quats, 4, k, rows);
        unusual += quat * 0.0;
        largest = maximum(largest, absolute(quat));
    }
    const Pack logit = gather(scene.opacity_logits, 1, 0, rows);
    unusual += logit * 0.0;
    if (any(~((unusual == 0.0) & (behind | ((largest > 1e-30) & (logit > kSurelyInImage)))))) return false;
    for (int lane = 0; lane < rows.count; ++lane) ++count.culled[behind[lane] ? kBehind : kOutside];
    return true;
}

}  // namespace

template <class Real>
void project(const Scene<Real>& scene, const View& view, int64_t begin, int64_t end, const Projection<Real>& out,
             ProjectionCount& count) {
    const RatioLimits limits(view);
    double centre[3];
    camera_centre(view, centre);
    count = {};
    uint32_t* visible = out.visible + begin;
    for (int64_t first = begin; first < end; first += kPack) {
        PackRows rows;
        rows.count = int(end - first < kPack ? end - first : kPack);
        for (int lane = 0; lane < kPack; ++lane) rows.row[lane] = lane < rows.count ? first + lane : end - 1;
        if (is_unseen(scene, view, limits, rows, count)) continue;
        const Footprint f = footprint(scene, view, limits, rows);

        const Pack logit = gather(scene.opacity_logits, 1, 0, rows);
        const Pack not_finite = f.not_finite + logit * 0.0;
        const Pack log2_opacity = -log2(1 + odds_against(logit));
        const Pack cut2 = log2_opacity - kLog2AlphaCut;  // u² + v² beyond it is below the alpha cut
        const Pack reach = sqrt(maximum(cut2, Pack{}) / kScale2);
        const Pack half_x = reach * sqrt(f.xx), half_y = reach * sqrt(f.yy);
        const Pack r = sqrt(kScale2 / f.yy), p = sqrt(kScale2 * f.yy / f.det), q = -p * f.xy / f.yy;
        // The block test runs in the kernels' precision: widen it by the rounding error of u and v within reach.
        const Pack slack =
            kRounding<Real> * (p * (half_x + kTile) + absolute(q) * (half_y + kTile) + r * (half_y + kTile));
        PackOf<Real> basis[kMostCoefficients];
        if (scene.sh) {
            const Directions<Real> directions(f.position, centre);
            with_degree(scene.sh_degree, [&]<int degree>() { sh_basis<degree, Real>(directions.unit, basis); });
        }
        const Pack padded = sqrt(maximum(cut2, Pack{})) + slack, padded2 = padded * padded * kCutMargin;

        for (int lane = 0; lane < rows.count; ++lane) {
            const int64_t row = first + lane;
            const double depth = f.cam[2][lane];
            const Cull reason = !(not_finite[lane] == 0)      ? kNonFinite
                                : !(depth >= view.near_plane) ? kBehind
                                : f.degenerate[lane]          ? kDegenerate
                                : !(cut2[lane] >= 0)          ? kFaint
                                                              : kCullReasons;
            if (reason != kCullReasons) {
                ++count.culled[reason];
                continue;
            }
            const double numbers[] = {f.mean[0][lane], f.mean[1][lane], p[lane],      q[lane],
                                      r[lane],         half_x[lane],    half_y[lane], depth};
            bool all_finite = true;
            for (double number : numbers) all_finite &= finite(number);
            Real* record = out.records + row * out.stride;
            if (!all_finite || !write_values(scene, basis, lane, row, depth, record + field::values)) {
                ++count.culled[kNonFinite];
                continue;
            }
            TileRect rect;
            tile_range(f.mean[0][lane], half_x[lane], view.width, rect.x0, rect.x1);
            tile_range(f.mean[1][lane], half_y[lane], view.height, rect.y0, rect.y1);
            if (rect.area() == 0) {
                ++count.culled[kOutside];
                continue;
            }
            record[field::x] = Real(f.mean[0][lane]);
            record[field::y] = Real(f.mean[1][lane]);
            record[field::p] = Real(p[lane]);
            record[field::q] = Real(q[lane]);
            record[field::r] = Real(r[lane]);
            record[field::log2_opacity] = Real(log2_opacity[lane]);
            record[field::cut_radius2] = Real(padded2[lane]);
            record[field::depth] = Real(depth);
            out.rects[row] = rect;
            count.most_pairs += rect.area();
            visible[count.visible++] = uint32_t(row);
        }
    }
}

}  // namespace cotton::COTTON_ISA
