// SPDX-License-Identifier: Apache-2.0
// Which tiles, and which of their blocks, a projected Gaussian reaches: the exact test of its alpha-cut ellipse.
#pragma once

#include "projection.h"
#include "simd.h"

namespace cotton::COTTON_ISA {
namespace {

template <class Real>
COTTON_INLINE Vec<Real> clamp(Vec<Real> value, Vec<Real> low, Vec<Real> high) {
    return maximum(minimum(value, high), low);
}

// First and last pixel centre of every block along x and y, relative to the tile.
template <class Real>
struct BlockCorners {
    alignas(64) Real x0[16], y0[16];

    BlockCorners() {
        for (int b = 0; b < 16; ++b) x0[b] = Real(b % 4 * kBlock + 0.5), y0[b] = Real(b / 4 * kBlock + 0.5);
    }
};

}  // namespace

template <class Real>
int64_t list_pairs(const View& view, const Projection<Real>& projection, const uint32_t* visible, int64_t n,
                   GaussianPair* pairs, PairRange* ranges) {
    using V = Vec<Real>;
    const BlockCorners<Real> corners;
    const int tiles_x = view.tiles_x();
    int64_t total = 0;
    for (int64_t i = 0; i < n; ++i) {
        const uint32_t row = visible[i];
        const Real* g = projection.records + int64_t(row) * projection.stride;
        const double dp = g[field::p], dq = g[field::q], dr = g[field::r];
        // The nearest point of an edge, in the ellipse's metric: dx = x_per_y dy on a horizontal, dy = y_per_x dx on
        // a vertical edge. The block's nearest point lies on one of the two edges that face the mean.
        const V x_per_y = broadcast(Real(-dq / dp)), y_per_x = broadcast(Real(-dp * dq / (dq * dq + dr * dr)));
        const V p = broadcast(g[field::p]), q = broadcast(g[field::q]), r = broadcast(g[field::r]);
        const V cut2 = broadcast(g[field::cut_radius2]);
        const TileRect rect = projection.rects[row];
        const int64_t begin = total;
        for (int ty = rect.y0; ty < rect.y1; ++ty) {
            for (int tx = rect.x0; tx < rect.x1; ++tx) {
                const V mean_x = broadcast(g[field::x] - Real(tx * kTile));
                const V mean_y = broadcast(g[field::y] - Real(ty * kTile));
                uint32_t blocks = 0;
                for (int b = 0; b < 16; b += kLanes<Real>) {
                    const V x0 = load(corners.x0 + b) - mean_x, x1 = x0 + Real(kBlock - 1);
                    const V y0 = load(corners.y0 + b) - mean_y, y1 = y0 + Real(kBlock - 1);
                    const V zero{};
                    const V near_x = clamp<Real>(zero, x0, x1), near_y = clamp<Real>(zero, y0, y1);
                    const V edge_x = clamp<Real>(x_per_y * near_y, x0, x1);
                    const V edge_y = clamp<Real>(y_per_x * near_x, y0, y1);
                    const V u1 = fma(p, edge_x, q * near_y), v1 = r * near_y;
                    const V u2 = fma(p, near_x, q * edge_y), v2 = r * edge_y;
                    const V distance2 = minimum(fma(u1, u1, v1 * v1), fma(u2, u2, v2 * v2));
                    blocks |= lane_bits(distance2 <= cut2) << b;
                }
                if (blocks != 0) pairs[total++] = {uint32_t(ty * tiles_x + tx), blocks};
            }
        }
        ranges[row] = {uint32_t(begin), uint32_t(total - begin)};
    }
    return total;
}

}  // namespace cotton::COTTON_ISA
