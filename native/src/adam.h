// SPDX-License-Identifier: Apache-2.0
// Adam (Kingma and Ba 2015) for the Gaussians that a view shows, each with step counters of its own: a row that is not
// seen keeps its parameters and moments.
#pragma once

#include "harmonics.h"
#include "optimiser.h"
#include "projection.h"

namespace cotton::COTTON_ISA {
namespace {

using V = Vec<float>;

// A longer gradient would square to Inf in the second moment.
constexpr float kLargestGradient = 1e15f;

// 1 / (1 - beta^t) of both moments, for each of several parameters.
struct Bias {
    V first, second;
};

COTTON_INLINE void update(const LearningRates& rates, Bias bias, V gradient, V rate, V& parameter, V& first,
                          V& second) {
    const V g = minimum(maximum(gradient, V{} - kLargestGradient), V{} + kLargestGradient);
    first = rates.beta1 * first + (1 - rates.beta1) * g;
    second = rates.beta2 * second + (1 - rates.beta2) * g * g;
    parameter -= rate * (first * bias.first) / (sqrt(second * bias.second) + rates.epsilon);
}

// The geometry of a row: mean, quat, log scales and opacity logit, gathered into one padded array.
constexpr int kGeometry = 11, kGeometryPadded = 16;

template <class Copy>
COTTON_INLINE void each_geometry(int64_t row, const Copy& copy) {
    for (int k = 0; k < 3; ++k) copy(row_gradient::mean + k, 0, 3 * row + k);
    for (int k = 0; k < 4; ++k) copy(row_gradient::quat + k, 1, 4 * row + k);
    for (int k = 0; k < 3; ++k) copy(row_gradient::log_scale + k, 2, 3 * row + k);
    copy(row_gradient::logit, 3, row);
}

void update_geometry(const AdamRows& a, int64_t row, BiasCorrection bias, const float* gradient, const float* rates) {
    float* const parameters[] = {a.parameters.means, a.parameters.quats, a.parameters.log_scales,
                                 a.parameters.opacity_logits};
    float* const first[] = {a.first.means, a.first.quats, a.first.log_scales, a.first.opacity_logits};
    float* const second[] = {a.second.means, a.second.quats, a.second.log_scales, a.second.opacity_logits};
    alignas(64) float p[kGeometryPadded] = {}, m[kGeometryPadded] = {}, s[kGeometryPadded] = {},
                      g[kGeometryPadded] = {};
    each_geometry(row, [&](int k, int array, int64_t at) {
        p[k] = parameters[array][at], m[k] = first[array][at], s[k] = second[array][at], g[k] = gradient[k];
    });
    const Bias same = {V{} + bias.first, V{} + bias.second};
    for (int k = 0; k < kGeometryPadded; k += kLanes<float>) {
        V pv = load(p + k), mv = load(m + k), sv = load(s + k);
        update(a.rates, same, load(g + k), load(rates + k), pv, mv, sv);
        store(p + k, pv), store(m + k, mv), store(s + k, sv);
    }
    each_geometry(row, [&](int k, int array, int64_t at) {
        parameters[array][at] = p[k], first[array][at] = m[k], second[array][at] = s[k];
    });
}

// Each band counts its own updates in `bias`: one that joins late begins with moments of zero.
template <int degree>
COTTON_INLINE void update_sh(const AdamRows& a, int64_t row, const BiasCorrection* bias, const PackOf<float>* basis,
                             int lane, const float* v_colour) {
    constexpr int coefficients = (degree + 1) * (degree + 1), n = 3 * coefficients;
    constexpr int padded = (n + kLanes<float> - 1) / kLanes<float> * kLanes<float>;
    alignas(64) float g[padded] = {}, rates[padded] = {}, first_bias[padded] = {}, second_bias[padded] = {};
    for (int k = 0; k < coefficients; ++k) {
        const int band = k == 0 ? 0 : k < 4 ? 1 : k < 9 ? 2 : 3;
        for (int c = 0; c < 3; ++c) {
            g[3 * k + c] = basis[k][lane] * v_colour[c];
            rates[3 * k + c] = k == 0 ? a.rates.sh0 : a.rates.sh_rest;
            first_bias[3 * k + c] = bias[band].first;
            second_bias[3 * k + c] = bias[band].second;
        }
    }
    const int64_t base = 3 * a.sh_stored * row;
    float *p = a.parameters.sh + base, *m = a.first.sh + base, *s = a.second.sh + base;
    for (int k = 0; k < n; k += kLanes<float>) {
        const int count = n - k < kLanes<float> ? n - k : kLanes<float>;
        const Bias own = {load(first_bias + k), load(second_bias + k)};
        V pv = load_part(p + k, count), mv = load_part(m + k, count), sv = load_part(s + k, count);
        update(a.rates, own, load(g + k), load(rates + k), pv, mv, sv);
        store_part(p + k, pv, count), store_part(m + k, mv, count), store_part(s + k, sv, count);
    }
}

// The unit vectors that project_backward left in up to kPack rows of the gradient; the last is repeated to fill up.
COTTON_INLINE void row_directions(const float* rows, int64_t n, PackOf<float> unit[3]) {
    float lanes[3][kPack];
    for (int lane = 0; lane < kPack; ++lane) {
        const float* from = rows + (lane < n ? lane : n - 1) * row_gradient::size + row_gradient::unit;
        for (int k = 0; k < 3; ++k) lanes[k][lane] = from[k];
    }
    std::memcpy(unit, lanes, sizeof lanes);
}

}  // namespace

void adam(const AdamRows& a, const uint32_t* visible, int64_t n, const float* rows) {
    alignas(64) float rates[kGeometryPadded] = {};
    for (int k = 0; k < 4; ++k) rates[row_gradient::quat + k] = a.rates.quats;
    rates[row_gradient::logit] = a.rates.opacity_logits;

    PackOf<float> unit[3], basis[kMostCoefficients];
    for (int64_t i = 0; i < n; ++i) {
        const int lane = int(i % kPack);
        if (lane == 0) {
            row_directions(rows + i * row_gradient::size, n - i, unit);
            with_degree(a.sh_degree, [&]<int degree>() { sh_basis<degree, float>(unit, basis); });
        }
        const int64_t row = visible[i];
        const float* gradient = rows + i * row_gradient::size;
        const float weight = gradient[row_gradient::weight];
        if (!(weight > 0)) continue;
        BiasCorrection bias[kBands];
        for (int band = 0; band <= a.sh_degree; ++band) {
            const int32_t step = ++a.steps[kBands * row + band];
            bias[band] = a.bias[step < a.bias_count ? step : a.bias_count - 1];
        }
        with_degree(a.sh_degree, [&]<int degree>() {
            update_sh<degree>(a, row, bias, basis, lane, gradient + row_gradient::colour);
        });
        for (int k = 0; k < 3; ++k) {
            rates[row_gradient::mean + k] = a.rates.means * a.rate_factors[2 * row];
            rates[row_gradient::log_scale + k] = a.rates.log_scales * a.rate_factors[2 * row + 1];
        }
        update_geometry(a, row, bias[0], gradient, rates);

        const Statistics& s = a.statistics;
        s.abs_grad_px[row] += gradient[row_gradient::abs_grad_px];
        s.weight[row] += weight * s.pixel;
        ++s.count[row];
    }
}

}  // namespace cotton::COTTON_ISA
