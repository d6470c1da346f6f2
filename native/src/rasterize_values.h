// SPDX-License-Identifier: Apache-2.0
// Gradient by the blended values alone (geometry frozen): sums over pixels of weight * gradient. With indicator planes
// in place of gradients the same sums are the blending weights that each Gaussian has inside a mask.
#pragma once

#include "blending.h"
#include "kernels.h"

namespace cotton::COTTON_ISA {
namespace {

template <class Real, int channels>
void values_backward_tile(const Tile& tile, const Real* records, int stride, const Real* v_tile, Real* rows,
                          int row_stride) {
    using V = Vec<Real>;
    alignas(64) Real transmittance[kTilePixels];
    const uint32_t open = start(tile, transmittance);
    Splat<Real> splat;
    V sums[channels];
    walk(
        tile, records, stride, open, rows, row_stride,
        [&](const Real* record) {
            splat = Splat<Real>::from(record, tile);
            for (V& s : sums) s = V{};
        },
        [&](int i) COTTON_INLINE_BODY {
            Blend<Real> b;
            const bool still_open = blend(splat, i, transmittance, b);
            for (int j = 0; j < kVectors<Real>; ++j) {
                const Real* v = v_tile + i + j * kLanes<Real>;
                for (int c = 0; c < channels; ++c) sums[c] = fma(b.weight[j], load(v + c * kTilePixels), sums[c]);
            }
            return still_open;
        },
        [&](int64_t pair, uint32_t) {
            Real* row = rows + int64_t(tile.numbers[pair]) * row_stride;
            for (int c = 0; c < channels; ++c) row[c] = sum<Real>(sums[c]);
        },
        [&](int64_t pair) {
            Real* row = rows + int64_t(tile.numbers[pair]) * row_stride;
            for (int c = 0; c < channels; ++c) row[c] = 0;
        });
}

}  // namespace

template <class Real>
typename Kernels<Real>::ValuesBackward values_backward(int channels) {
    return channels == 1 ? values_backward_tile<Real, 1> : channels == 4 ? values_backward_tile<Real, 4> : nullptr;
}

}  // namespace cotton::COTTON_ISA
