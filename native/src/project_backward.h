// SPDX-License-Identifier: Apache-2.0
// Gradient by projected Gaussians -> gradient by their parameters.
#pragma once

#include "harmonics.h"
#include "projection.h"

namespace cotton::COTTON_ISA {
namespace {

// Sum of a Gaussian's pair gradients, tile by tile: the order does not depend on threads.
template <class Real>
COTTON_INLINE void fold(const Real* pair_rows, PairRange pairs, Real sums[pair_gradient::size]) {
    constexpr int n = pair_gradient::size / kLanes<Real>;
    Vec<Real> total[n] = {};
    for (int64_t pair = pairs.begin; pair < int64_t(pairs.begin) + pairs.count; ++pair) {
        for (int k = 0; k < n; ++k) total[k] += load(pair_rows + pair * pair_gradient::size + k * kLanes<Real>);
    }
    for (int k = 0; k < n; ++k) store(sums + k * kLanes<Real>, total[k]);
}

struct ParameterGradient {
    Pack mean[3], quat[4], log_scale[3];
};

// `v_mean` (px⁻¹) and `v_cov` (xx, xy, yy; the xy entry counts once for each of the two) back through `footprint`.
COTTON_INLINE ParameterGradient footprint_backward(const View& view, const Footprint& f, const Pack v_mean[2],
                                                   const Pack v_cov[3]) {
    ParameterGradient g;
    const double* w = view.rotation;
    const double focal[2] = {view.fx, view.fy};

    Pack v_factor[6];
    for (int j = 0; j < 3; ++j) {
        v_factor[j] = 2 * (v_cov[0] * f.factor[j] + v_cov[1] * f.factor[3 + j]);
        v_factor[3 + j] = 2 * (v_cov[1] * f.factor[j] + v_cov[2] * f.factor[3 + j]);
    }

    Pack v_affine[6] = {}, v_rotation[9];
    for (int j = 0; j < 3; ++j) {
        Pack v_scale{};
        for (int i = 0; i < 3; ++i) {
            const Pack v_axis = f.affine[i] * v_factor[j] + f.affine[3 + i] * v_factor[3 + j];  // by rotation * scale
            v_rotation[3 * i + j] = v_axis * f.scale[j];
            v_scale += v_axis * f.rotation[3 * i + j];
            v_affine[i] += v_factor[j] * f.rotation[3 * i + j] * f.scale[j];
            v_affine[3 + i] += v_factor[3 + j] * f.rotation[3 * i + j] * f.scale[j];
        }
        g.log_scale[j] = f.scale_free[j] ? v_scale * f.scale[j] : Pack{};
    }

    Pack v_cam[3] = {};
    for (int k = 0; k < 2; ++k) {
        Pack v_ratio{};
        for (int c = 0; c < 3; ++c) {
            v_ratio -= v_affine[3 * k + c] * w[6 + c];
            v_cam[2] -= v_affine[3 * k + c] * f.affine[3 * k + c] * f.inv_z;
        }
        v_ratio = f.ratio_free[k] ? v_ratio * focal[k] * f.inv_z : Pack{};
        v_cam[k] += v_ratio * f.inv_z;
        v_cam[2] -= v_ratio * f.ratio[k] * f.inv_z;
        v_cam[k] += v_mean[k] * focal[k] * f.inv_z;
        v_cam[2] -= v_mean[k] * focal[k] * f.cam[k] * f.inv_z * f.inv_z;
    }
    for (int k = 0; k < 3; ++k) g.mean[k] = w[k] * v_cam[0] + w[3 + k] * v_cam[1] + w[6 + k] * v_cam[2];

    const Pack qw = f.quat[0], qx = f.quat[1], qy = f.quat[2], qz = f.quat[3];
    const Pack* v = v_rotation;
    const Pack v_unit[4] = {
        2 * (qx * (v[7] - v[5]) + qy * (v[2] - v[6]) + qz * (v[3] - v[1])),
        2 * (qw * (v[7] - v[5]) + qy * (v[1] + v[3]) + qz * (v[2] + v[6]) - 2 * qx * (v[4] + v[8])),
        2 * (qw * (v[2] - v[6]) + qx * (v[1] + v[3]) + qz * (v[5] + v[7]) - 2 * qy * (v[0] + v[8])),
        2 * (qw * (v[3] - v[1]) + qx * (v[2] + v[6]) + qy * (v[5] + v[7]) - 2 * qz * (v[0] + v[4]))};
    Pack along{};
    for (int k = 0; k < 4; ++k) along += v_unit[k] * f.quat[k];
    for (int k = 0; k < 4; ++k) g.quat[k] = (v_unit[k] - along * f.quat[k]) * f.inv_norm;
    return g;
}

// Gradient that reaches the means through the viewing directions of their colours.
template <class Real>
COTTON_INLINE void colour_backward(const Scene<Real>& scene, const PackRows& rows, const Directions<Real>& d,
                                   const Real v_colour[kPack][3], PackOf<Real> v_mean[3]) {
    for (int k = 0; k < 3; ++k) v_mean[k] = PackOf<Real>{};
    if (scene.sh_degree == 0) return;
    with_degree(scene.sh_degree, [&]<int degree>() {
        constexpr int n = (degree + 1) * (degree + 1);
        Real weights[n][kPack];
        for (int lane = 0; lane < kPack; ++lane) {
            const Real *sh = scene.sh + 3 * scene.sh_stored * rows[lane], *v = v_colour[lane];
            for (int k = 0; k < n; ++k)
                weights[k][lane] = sh[3 * k] * v[0] + sh[3 * k + 1] * v[1] + sh[3 * k + 2] * v[2];
        }
        PackOf<Real> w[n], v[3];
        std::memcpy(w, weights, sizeof weights);
        sh_direction_gradient<degree, Real>(d.unit, w, v);
        const PackOf<Real> along = v[0] * d.unit[0] + v[1] * d.unit[1] + v[2] * d.unit[2];
        for (int k = 0; k < 3; ++k) v_mean[k] = (v[k] - along * d.unit[k]) * d.inv_length;
    });
}

// Sets the weight to 0 in each of `n` rows that is not entirely finite; returns how many there are.
template <class Real>
int64_t drop_spoilt(Real* rows, int64_t n) {
    int64_t spoilt = 0;
    for (Real* row = rows; row < rows + n * row_gradient::size; row += row_gradient::size) {
        bool finite = true;
        for (int k = 0; k < row_gradient::unit; ++k) finite &= row[k] - row[k] == 0;
        if (finite) continue;
        row[row_gradient::weight] = 0;
        ++spoilt;
    }
    return spoilt;
}

}  // namespace

static_assert(row_gradient::unit % kLanes<float> == 0 && row_gradient::unit + 3 <= row_gradient::size);

template <class Real>
int64_t project_backward(const Scene<Real>& scene, const View& view, const uint32_t* visible, int64_t n,
                         const Real* records, int record_stride, const PairRange* ranges, const Real* pair_rows,
                         Real* rows) {
    const RatioLimits limits(view);
    double centre[3];
    camera_centre(view, centre);
    int64_t spoilt = 0;
    for (int64_t first = 0; first < n; first += kPack) {
        const PackRows pack = pack_rows(visible + first, n - first);
        alignas(64) Real sums[kPack][pair_gradient::size];
        for (int lane = 0; lane < kPack; ++lane) fold(pair_rows, ranges[pack[lane]], sums[lane]);
        const auto moment = [&](int k) {
            Pack result{};
            for (int lane = 0; lane < kPack; ++lane) result[lane] = double(sums[lane][k]);
            return result;
        };

        const Footprint f = footprint(scene, view, limits, pack);
        const Pack r = sqrt(kScale2 / f.yy), p = sqrt(kScale2 * f.yy / f.det), q = -p * f.xy / f.yy;
        namespace pg = pair_gradient;
        const Pack gu = moment(pg::gu), gv = moment(pg::gv), guu = moment(pg::guu), guv = moment(pg::guv),
                   gvv = moment(pg::gvv);
        // With F = (p q; 0 r), Fᵀ F = kScale2 Σ⁻¹ and e = F d, and since ln alpha = ln 2 (log2 opacity - |e|²):
        // v_mean = 2 ln 2 Fᵀ ΣGe and v_Σ = ln 2 Fᵀ (ΣG e eᵀ) F / kScale2, where kScale2 = 1 / (2 ln 2).
        const Pack v_mean[2] = {2 * kLn2 * p * gu, 2 * kLn2 * (q * gu + r * gv)};
        constexpr double scale = kLn2 / kScale2;
        const Pack v_cov[3] = {scale * p * p * guu, scale * p * (q * guu + r * guv),
                               scale * (q * q * guu + 2 * q * r * guv + r * r * gvv)};
        const ParameterGradient g = footprint_backward(view, f, v_mean, v_cov);

        const Pack logit = gather(scene.opacity_logits, 1, 0, pack);
        const Pack odds = odds_against(logit);
        const Pack v_logit = moment(pg::g) * (odds / (1 + odds));
        const double half[2] = {0.5 * view.image_width, 0.5 * view.image_height};
        const Pack ax = 2 * kLn2 * moment(pg::abs_x) * half[0], ay = 2 * kLn2 * moment(pg::abs_y) * half[1];
        const Pack abs_grad_px = sqrt(ax * ax + ay * ay);

        Real v_colour[kPack][3];
        for (int lane = 0; lane < kPack; ++lane) {
            const Real* colour = records + pack[lane] * record_stride + field::values;
            for (int c = 0; c < 3; ++c) v_colour[lane][c] = colour[c] > 0 ? sums[lane][pg::value0 + c] : Real(0);
        }
        const Directions<Real> directions(f.position, centre);
        PackOf<Real> through_colour[3];
        colour_backward(scene, pack, directions, v_colour, through_colour);

        Vec<Real> doubt{};
        for (int lane = 0; lane < pack.count; ++lane) {
            Real* row = rows + (first + lane) * row_gradient::size;
            for (int k = 0; k < 3; ++k) {
                row[row_gradient::mean + k] = Real(g.mean[k][lane]) + through_colour[k][lane];
                row[row_gradient::unit + k] = directions.unit[k][lane];
            }
            for (int k = 0; k < 4; ++k) row[row_gradient::quat + k] = Real(g.quat[k][lane]);
            for (int k = 0; k < 3; ++k) row[row_gradient::log_scale + k] = Real(g.log_scale[k][lane]);
            row[row_gradient::logit] = Real(v_logit[lane]);
            for (int c = 0; c < 3; ++c) row[row_gradient::colour + c] = v_colour[lane][c];
            row[row_gradient::weight] = sums[lane][pg::weight];
            row[row_gradient::abs_grad_px] = Real(abs_grad_px[lane]);
            for (int k = 0; k < row_gradient::unit; k += kLanes<Real>) doubt += load(row + k) * Real(0);
        }
        if (!(sum<Real>(doubt) == 0)) spoilt += drop_spoilt(rows + first * row_gradient::size, pack.count);
    }
    return spoilt;
}

}  // namespace cotton::COTTON_ISA
