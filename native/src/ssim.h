// SPDX-License-Identifier: Apache-2.0
// The loss, forward and backward, by row bands of one channel. SSIM as in Kerbl et al. 2023: 11 x 11
// Gaussian window of sigma 1.5, zero padding; the window is separable and symmetric, so its adjoint is itself.
#pragma once

#include "loss.h"
#include "simd.h"

namespace cotton::COTTON_ISA {
namespace {

constexpr int kRadius = 5, kTaps = 2 * kRadius + 1;
constexpr double kWindow[kRadius + 1] = {0.26601172486179436,  0.21300553771125369,  0.10936068950970002,
                                         0.036000772128430829, 0.007598758135239185, 0.0010283800844791101};
constexpr double kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;

// Values at distance 0 to 5 on both sides, weighted by the window.
template <class Real, class At>
COTTON_INLINE Vec<Real> window(const At& at) {
    Vec<Real> result = at(0) * Real(kWindow[0]);
    for (int k = 1; k <= kRadius; ++k) result = fma(at(-k) + at(k), broadcast(Real(kWindow[k])), result);
    return result;
}

// Blurs `maps` quantities over the band. `fill(y, x, n, values)` gives those of the n pixels from (x, y) on and zeros
// for the other lanes; `emit(y, x, n, blurred)` takes them.
template <int maps, class Real, class Fill, class Emit>
COTTON_INLINE void blur(const LossBand<Real>& band, const Fill& fill, const Emit& emit) {
    constexpr int lanes = kLanes<Real>;
    const int64_t stride = loss_row(band.width);
    Real* padded[maps];
    for (int m = 0; m < maps; ++m) {
        padded[m] = band.scratch + (kTaps * maps + m) * stride;
        for (int64_t x = 0; x < stride; ++x) padded[m][x] = 0;
    }
    const auto ring = [&](int y, int m) { return band.scratch + ((y + kTaps) % kTaps * maps + m) * stride; };
    for (int y = band.row_begin - kRadius; y < band.row_end + kRadius; ++y) {
        const bool inside = y >= 0 && y < band.height;
        for (int x = 0; inside && x < band.width; x += lanes) {
            Vec<Real> values[maps];
            fill(y, x, band.width - x < lanes ? band.width - x : lanes, values);
            for (int m = 0; m < maps; ++m) store(padded[m] + kRadius + x, values[m]);
        }
        for (int m = 0; m < maps; ++m) {
            Real* to = ring(y, m);
            for (int x = 0; x < band.width; x += lanes) {
                const Real* from = padded[m] + kRadius + x;
                store(to + x, inside ? window<Real>([&](int k) { return load(from + k); }) : Vec<Real>{});
            }
        }
        const int centre = y - kRadius;
        if (centre < band.row_begin) continue;
        const Real* rows[maps][kTaps];
        for (int m = 0; m < maps; ++m) {
            for (int k = -kRadius; k <= kRadius; ++k) rows[m][k + kRadius] = ring(centre + k, m);
        }
        for (int x = 0; x < band.width; x += lanes) {
            Vec<Real> blurred[maps];
            for (int m = 0; m < maps; ++m) {
                blurred[m] = window<Real>([&](int k) { return load(rows[m][k + kRadius] + x); });
            }
            emit(centre, x, band.width - x < lanes ? band.width - x : lanes, blurred);
        }
    }
}

// One in the first n lanes, zero beyond, where no pixels are that count.
template <class Real>
COTTON_INLINE Vec<Real> ones(int n) {
    if (n == kLanes<Real>) return broadcast(Real(1));
    Vec<Real> result{};
    for (int i = 0; i < n; ++i) result[i] = 1;
    return result;
}

}  // namespace

template <class Real>
LossSums loss_forward(const LossBand<Real>& band) {
    using V = Vec<Real>;
    const int64_t stride = loss_row(band.width);
    LossSums total = {0, 0};
    V row_l1{}, row_ssim{};
    blur<4>(
        band,
        [&](int y, int x, int n, V* values) {
            const int64_t pixel = int64_t(y) * band.width + x;
            const V a = load_part(band.image + pixel, n), b = load_part(band.target + pixel, n);
            values[0] = a, values[1] = b, values[2] = fma(a, a, b * b), values[3] = a * b;
        },
        [&](int y, int x, int n, const V* blurred) {
            const V m1 = blurred[0], m2 = blurred[1];
            const V m11 = m1 * m1, m22 = m2 * m2, m12 = m1 * m2;
            const V a1 = 2 * m12 + Real(kC1), b1 = m11 + m22 + Real(kC1);
            const V b2 = maximum(blurred[2] - m11 - m22, V{}) + Real(kC2);  // both variances
            const V a2 = minimum(2 * (blurred[3] - m12) + Real(kC2), b2);   // Cauchy-Schwarz, in spite of rounding
            const V scale = 1 / (b1 * b2), ssim = a1 * a2 * scale;
            const int64_t pixel = int64_t(y) * band.width + x;
            const V counted = ones<Real>(n);
            const V d_product = 2 * a1 * scale, d_square = -ssim / b2;
            const V d_mean = 2 * (m2 * a2 * scale - m1 * ssim / b1 - m1 * d_square) - m2 * d_product;
            const int64_t at = y * stride + x;
            store(band.d_mean + at, counted * d_mean);
            store(band.d_square + at, counted * d_square);
            store(band.d_product + at, counted * d_product);
            row_ssim += counted * ssim;
            row_l1 += counted * absolute(load_part(band.image + pixel, n) - load_part(band.target + pixel, n));
            if (x + n == band.width) {
                total.ssim += double(sum<Real>(row_ssim));
                total.l1 += double(sum<Real>(row_l1));
                row_ssim = row_l1 = V{};
            }
        });
    return total;
}

template <class Real>
void loss_backward(const LossBand<Real>& band) {
    using V = Vec<Real>;
    const int64_t stride = loss_row(band.width);
    blur<3>(
        band,
        [&](int y, int x, int n, V* values) {
            const Real* maps[3] = {band.d_mean, band.d_square, band.d_product};
            for (int m = 0; m < 3; ++m) values[m] = load_part(maps[m] + y * stride + x, n);
        },
        [&](int y, int x, int n, const V* blurred) {
            const int64_t pixel = int64_t(y) * band.width + x;
            const V a = load_part(band.image + pixel, n), b = load_part(band.target + pixel, n);
            const V one = broadcast(Real(1)), sign = a > b ? one : a < b ? -one : V{};
            const V ssim = fma(2 * a, blurred[1], fma(b, blurred[2], blurred[0]));
            const V v = band.ssim_factor * ssim + band.l1_factor * sign;
            store_part(band.v_image + pixel, v, n);
        });
}

}  // namespace cotton::COTTON_ISA
