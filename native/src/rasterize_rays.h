// SPDX-License-Identifier: Apache-2.0
// The blending weights themselves, at chosen pixels.
#pragma once

#include "blending.h"

namespace cotton::COTTON_ISA {

template <class Real>
void ray_weights(const Tile& tile, const Real* records, int stride, const uint8_t* pixels, int n, Real* weights) {
    alignas(64) Real transmittance[kTilePixels], blended[kTilePixels];
    uint32_t chosen = 0;
    for (int k = 0; k < n; ++k) chosen |= 1u << (pixels[k] / kBlockPixels);
    const uint32_t open = start(tile, transmittance) & chosen;
    Splat<Real> splat;
    walk(
        tile, records, stride, open, static_cast<const Real*>(nullptr), 0,
        [&](const Real* record) { splat = Splat<Real>::from(record, tile); },
        [&](int i) COTTON_INLINE_BODY {
            Blend<Real> b;
            const bool still_open = blend(splat, i, transmittance, b);
            for (int j = 0; j < kVectors<Real>; ++j) store(blended + i + j * kLanes<Real>, b.weight[j]);
            return still_open;
        },
        [&](int64_t pair, uint32_t blocks) {
            Real* row = weights + pair * n;
            for (int k = 0; k < n; ++k)
                row[k] = blocks >> (pixels[k] / kBlockPixels) & 1 ? blended[pixels[k]] : Real(0);
        },
        [&](int64_t pair) {
            for (int k = 0; k < n; ++k) weights[pair * n + k] = 0;
        });
}

}  // namespace cotton::COTTON_ISA
