// SPDX-License-Identifier: Apache-2.0
// Front-to-back blending of one tile and its full gradient (the seeds' Eq. 1-3 are this one sum).
#pragma once

#include "blending.h"
#include "kernels.h"

namespace cotton::COTTON_ISA {
namespace {

template <class Real, int channels>
void forward_tile(const Tile& tile, const Real* records, const Real* background, const Plane<Real>* planes,
                  Real* transmittance_out) {
    alignas(64) Real transmittance[kTilePixels], sums[channels][kTilePixels] = {};
    const uint32_t open = start(tile, transmittance);
    Splat<Real> splat;
    const Real* values = nullptr;
    walk(
        tile, records, record_stride(channels), open, static_cast<const Real*>(nullptr), 0,
        [&](const Real* record) {
            splat = Splat<Real>::from(record, tile);
            values = record + field::values;
        },
        [&](int i) COTTON_INLINE_BODY {
            Blend<Real> b;
            const bool still_open = blend(splat, i, transmittance, b);
            for (int j = 0; j < kVectors<Real>; ++j) {
                for (int c = 0; c < channels; ++c) {
                    Real* sum = sums[c] + i + j * kLanes<Real>;
                    store(sum, fma(b.weight[j], broadcast(values[c]), load(sum)));
                }
            }
            return still_open;
        },
        [](int64_t, uint32_t) {}, [](int64_t) {});

    for (int c = 0; c < channels; ++c) {
        for (int i = 0; i < kTilePixels; ++i) sums[c][i] += transmittance[i] * background[c];
        copy_tile(tile, sums[c], planes[c]);
    }
    if (transmittance_out) copy_tile(tile, transmittance, Plane<Real>{transmittance_out, 1});
}

}  // namespace

template <class Real>
typename Kernels<Real>::Forward forward(int channels) {
    return channels == 2    ? forward_tile<Real, 2>
           : channels == 3  ? forward_tile<Real, 3>
           : channels == 4  ? forward_tile<Real, 4>
           : channels == 5  ? forward_tile<Real, 5>
           : channels == 17 ? forward_tile<Real, 17>
           : channels == 33 ? forward_tile<Real, 33>
                            : nullptr;
}

// Front to back again: the loop keeps only the transmittance and one scalar per pixel, the gradient-weighted colour
// still to come. With c·g the Gaussian's colour times the image gradient,
//   d loss / d alpha_i = T_i (c_i·g) - (sum_{j>i} w_j (c_j·g) + T_end (background·g)) / (1 - alpha_i).
template <class Real>
void backward(const Tile& tile, const Real* records, const Plane<const Real>* image, const Plane<const Real>* v_image,
              Real* rows) {
    using V = Vec<Real>;
    constexpr int channels = 3;
    alignas(64) Real transmittance[kTilePixels], to_come[kTilePixels] = {}, v_tile[channels][kTilePixels] = {};
    for (int c = 0; c < channels; ++c) prefetch_tile(tile, image[c]), prefetch_tile(tile, v_image[c]);
    const uint32_t open = start(tile, transmittance);
    for (int c = 0; c < channels; ++c) {
        alignas(64) Real colour[kTilePixels] = {};
        copy_tile(tile, image[c], colour);
        copy_tile(tile, v_image[c], v_tile[c]);
        for (int i = 0; i < kTilePixels; ++i) to_come[i] += v_tile[c][i] * colour[i];
    }

    Splat<Real> splat;
    const Real* values = nullptr;
    Blend<Real> blends[kTilePixels / kBlockPixels];
    walk(
        tile, records, record_stride(channels), open, rows, pair_gradient::size,
        [&](const Real* record) {
            splat = Splat<Real>::from(record, tile);
            values = record + field::values;
        },
        [&](int i) COTTON_INLINE_BODY { return blend(splat, i, transmittance, blends[i / kBlockPixels]); },
        [&](int64_t pair, uint32_t blocks) COTTON_INLINE_BODY {
            using namespace pair_gradient;
            V sums[size] = {};
            // A second loop over the blocks, so that the processor overlaps the long chains of both.
            each_block(blocks, [&](int block) COTTON_INLINE_BODY {
                const Blend<Real>& b = blends[block];
                for (int j = 0; j < kVectors<Real>; ++j) {
                    const int at = block * kBlockPixels + j * kLanes<Real>;
                    V cg = load(v_tile[0] + at) * values[0];
                    for (int c = 1; c < channels; ++c) cg = fma(load(v_tile[c] + at), broadcast(values[c]), cg);
                    const V here = b.weight[j] * cg, rest = load(to_come + at) - here;
                    store(to_come + at, rest);
                    const V odds = b.alpha[j] / (1 - b.alpha[j]);
                    const V v_power = b.alpha[j] < Real(kAlphaCap) ? fnma(odds, rest, here) : V{};
                    const V gu_i = v_power * b.u[j], gv_i = v_power * b.v[j];
                    sums[g] += v_power;
                    sums[gu] += gu_i;
                    sums[gv] += gv_i;
                    sums[guu] = fma(gu_i, b.u[j], sums[guu]);
                    sums[guv] = fma(gu_i, b.v[j], sums[guv]);
                    sums[gvv] = fma(gv_i, b.v[j], sums[gvv]);
                    for (int c = 0; c < channels; ++c) {
                        sums[value0 + c] = fma(b.weight[j], load(v_tile[c] + at), sums[value0 + c]);
                    }
                    sums[abs_x] += absolute(gu_i);
                    sums[abs_y] += absolute(fma(splat.q, gu_i, splat.r * gv_i));
                    sums[weight] += b.weight[j];
                }
            });
            Real* row = rows + int64_t(tile.numbers[pair]) * size;
            sums[abs_x] *= splat.p;
            for (int k = 0; k < size; k += kLanes<Real>) store(row + k, sums_of_lanes<Real>(sums + k));
        },
        [&](int64_t pair) {
            Real* row = rows + int64_t(tile.numbers[pair]) * pair_gradient::size;
            for (int k = 0; k < pair_gradient::size; ++k) row[k] = 0;
        });
}

}  // namespace cotton::COTTON_ISA
