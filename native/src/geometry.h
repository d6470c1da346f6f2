// SPDX-License-Identifier: Apache-2.0
// From a 3D Gaussian to its 2D footprint, several Gaussians at once. Always in double: the squares and minors of
// needle-thin or huge Gaussians leave the range of float. Zwicker et al. 2001 (EWA splatting), Kerbl et al. 2023.
#pragma once

#include "simd.h"

namespace cotton::COTTON_ISA {

using Pack = Vec<double>;
using PackMask = Mask<double>;
inline constexpr int kPack = kLanes<double>;
// The same number of values in the kernels' precision.
template <class Real>
struct PackOfReal {
    typedef Real type __attribute__((vector_size(kPack * sizeof(Real))));
};
template <class Real>
using PackOf = typename PackOfReal<Real>::type;
inline constexpr double kLog2E = 1.4426950408889634;
inline constexpr double kLn2 = 0.6931471805599453;
// u² + v² = kScale2 * dᵀ Σ⁻¹ d, so that alpha = 2^(log2 opacity - u² - v²).
inline constexpr double kScale2 = 0.5 * kLog2E;

// 2 to the power of this, or of minus this, is beyond the odds of any opacity that a float distinguishes from 0 and 1.
inline constexpr double kMostLog2Odds = 100.0;

// (1 - opacity) / opacity.
COTTON_INLINE Pack odds_against(Pack logit) {
    return exp2<double>(minimum(maximum(logit * -kLog2E, Pack{} - kMostLog2Odds), Pack{} + kMostLog2Odds));
}

// Component `c` of up to kPack rows with `width` components; the last row is repeated when there are fewer.
template <class Real, class Rows>
COTTON_INLINE Pack gather(const Real* array, int width, int c, const Rows& rows) {
    Pack result{};
    for (int lane = 0; lane < kPack; ++lane) result[lane] = double(array[int64_t(rows[lane]) * width + c]);
    return result;
}

// 1.3 times the half field of view, measured from the principal point, as in gsplat: beyond it the Jacobian is frozen.
struct RatioLimits {
    double low[2], high[2];

    explicit RatioLimits(const View& view) {
        const double size[2] = {double(view.image_width), double(view.image_height)}, focal[2] = {view.fx, view.fy},
                     centre[2] = {view.cx + view.left, view.cy + view.top};
        for (int k = 0; k < 2; ++k) {
            const double margin = 0.3 * 0.5 * size[k] / focal[k];
            low[k] = -centre[k] / focal[k] - margin;
            high[k] = (size[k] - centre[k]) / focal[k] + margin;
        }
    }
};

struct Footprint {
    Pack not_finite;         // 0, or NaN when the mean, the quaternion or a log scale is not finite
    Pack position[3];        // su
    Pack cam[3];             // position in the camera frame, su
    Pack ratio[2];           // x / z and y / z, clamped
    PackMask ratio_free[2];  // not clamped
    Pack inv_z;
    Pack quat[4], inv_norm;  // unit quaternion wxyz, 1 / its length before
    PackMask degenerate;     // the quaternion has no direction
    Pack rotation[9];        // of the unit quaternion
    Pack scale[3];           // standard deviations, su
    PackMask scale_free[3];  // not clamped
    Pack affine[6];          // 2x3: Jacobian times camera rotation
    Pack factor[6];          // 2x3: affine * rotation * scale; covariance = factor factorᵀ + dilation
    Pack mean[2];            // px
    Pack xx, xy, yy, det;    // covariance, px², and its determinant
};

COTTON_INLINE void rotation_matrix(const Pack q[4], Pack r[9]) {
    const Pack w = q[0], x = q[1], y = q[2], z = q[3];
    r[0] = 1 - 2 * (y * y + z * z), r[1] = 2 * (x * y - w * z), r[2] = 2 * (x * z + w * y);
    r[3] = 2 * (x * y + w * z), r[4] = 1 - 2 * (x * x + z * z), r[5] = 2 * (y * z - w * x);
    r[6] = 2 * (x * z - w * y), r[7] = 2 * (y * z + w * x), r[8] = 1 - 2 * (x * x + y * y);
}

template <class Real, class Rows>
COTTON_INLINE Footprint footprint(const Scene<Real>& scene, const View& view, const RatioLimits& limits,
                                  const Rows& rows) {
    Footprint f;
    f.not_finite = Pack{};
    for (int k = 0; k < 3; ++k) {
        f.position[k] = gather(scene.means, 3, k, rows);
        f.not_finite += f.position[k] * 0.0;
    }
    const double* w = view.rotation;
    for (int k = 0; k < 3; ++k) {
        f.cam[k] = w[3 * k] * f.position[0] + w[3 * k + 1] * f.position[1] + w[3 * k + 2] * f.position[2] +
                   view.translation[k];
    }
    f.inv_z = 1 / f.cam[2];
    const double focal[2] = {view.fx, view.fy}, centre[2] = {view.cx, view.cy};
    for (int k = 0; k < 2; ++k) {
        const Pack ratio = f.cam[k] * f.inv_z;
        f.mean[k] = focal[k] * ratio + centre[k];
        f.ratio_free[k] = (ratio > limits.low[k]) & (ratio < limits.high[k]);
        f.ratio[k] = minimum(maximum(ratio, Pack{} + limits.low[k]), Pack{} + limits.high[k]);
        for (int c = 0; c < 3; ++c) {
            f.affine[3 * k + c] = focal[k] * f.inv_z * (w[3 * k + c] - f.ratio[k] * w[6 + c]);
        }
    }

    Pack largest{};
    for (int k = 0; k < 4; ++k) {
        f.quat[k] = gather(scene.quats, 4, k, rows);
        largest = maximum(largest, absolute(f.quat[k]));
        f.not_finite += f.quat[k] * 0.0;
    }
    f.degenerate = ~(largest > 1e-30);
    Pack norm2{};
    for (int k = 0; k < 4; ++k) norm2 += f.quat[k] * f.quat[k];
    f.inv_norm = 1 / sqrt(norm2);
    for (int k = 0; k < 4; ++k) f.quat[k] *= f.inv_norm;
    rotation_matrix(f.quat, f.rotation);

    for (int k = 0; k < 3; ++k) {
        const Pack log_scale = gather(scene.log_scales, 3, k, rows);
        f.not_finite += log_scale * 0.0;
        f.scale_free[k] = (log_scale > -kMaxLogScale) & (log_scale < kMaxLogScale);
        f.scale[k] = exp2<double>(minimum(maximum(log_scale, Pack{} - kMaxLogScale), Pack{} + kMaxLogScale) * kLog2E);
    }
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 3; ++j) {
            f.factor[3 * i + j] =
                f.scale[j] * (f.affine[3 * i] * f.rotation[j] + f.affine[3 * i + 1] * f.rotation[3 + j] +
                              f.affine[3 * i + 2] * f.rotation[6 + j]);
        }
    }
    const Pack* m = f.factor;
    const Pack a = m[0] * m[0] + m[1] * m[1] + m[2] * m[2], c = m[3] * m[3] + m[4] * m[4] + m[5] * m[5];
    f.xx = a + kDilation;
    f.yy = c + kDilation;
    f.xy = m[0] * m[3] + m[1] * m[4] + m[2] * m[5];
    // det(M Mᵀ) is the sum of the squared 2x2 minors of M (Cauchy-Binet): no cancellation.
    const Pack m0 = m[1] * m[5] - m[2] * m[4], m1 = m[2] * m[3] - m[0] * m[5], m2 = m[0] * m[4] - m[1] * m[3];
    f.det = m0 * m0 + m1 * m1 + m2 * m2 + kDilation * (a + c) + kDilation * kDilation;
    return f;
}

// The rows of one pack out of a list; the last is repeated to fill up.
struct PackRows {
    int64_t row[kPack];
    int count;

    int64_t operator[](int lane) const { return row[lane]; }
};

COTTON_INLINE PackRows pack_rows(const uint32_t* rows, int64_t n) {
    PackRows result;
    result.count = int(n < kPack ? n : kPack);
    for (int lane = 0; lane < kPack; ++lane) result.row[lane] = rows[lane < result.count ? lane : result.count - 1];
    return result;
}

}  // namespace cotton::COTTON_ISA
