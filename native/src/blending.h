// SPDX-License-Identifier: Apache-2.0
// Code that the forward and the backward rasterizers share, so that they agree to the last bit: the alpha of a Gaussian
// at a vector of pixels, and the rule for which pixels take it.
#pragma once

#include "projection.h"
#include "simd.h"

namespace cotton::COTTON_ISA {

template <class Real>
struct PixelCentres {
    alignas(64) Real x[kTilePixels], y[kTilePixels];  // relative to the tile
    constexpr PixelCentres() : x(), y() {
        for (int i = 0; i < kTilePixels; ++i) {
            x[i] = Real(pixel_x(i)) + Real(0.5);
            y[i] = Real(pixel_y(i)) + Real(0.5);
        }
    }
};
template <class Real>
inline constexpr PixelCentres<Real> pixel_centres{};

// The vectors that make up a block.
template <class Real>
inline constexpr int kVectors = kBlockPixels / kLanes<Real>;

// u = p x + q y + u0 and v = r y + v0 at the pixel (x, y) of the tile.
template <class Real>
struct Splat {
    Vec<Real> p, q, r, u0, v0, log2_opacity;

    COTTON_INLINE Splat from(const Real* record, const Tile& tile) {
        const Real x = record[field::x] - Real(tile.x0), y = record[field::y] - Real(tile.y0);
        const Real p = record[field::p], q = record[field::q], r = record[field::r];
        return {broadcast(p),        broadcast(q),
                broadcast(r),        broadcast(-(p * x + q * y)),
                broadcast(-(r * y)), broadcast(record[field::log2_opacity])};
    }
};

// The effect of a Gaussian on the pixels of a block.
template <class Real>
struct Blend {
    Vec<Real> u[kVectors<Real>], v[kVectors<Real>];
    Vec<Real> alpha[kVectors<Real>];   // 0 where the pixel does not take the Gaussian
    Vec<Real> weight[kVectors<Real>];  // alpha times the transmittance in front of it
};

// Blends into the block that begins at pixel i; returns whether the block still has an open pixel.
template <class Real>
COTTON_INLINE bool blend(const Splat<Real>& g, int i, Real* transmittance, Blend<Real>& b) {
    constexpr Real cut = Real(kLog2AlphaCut);
    Mask<Real> open{};
    for (int j = 0; j < kVectors<Real>; ++j) {
        const int at = i + j * kLanes<Real>;
        const Vec<Real> y = load(pixel_centres<Real>.y + at), before = load(transmittance + at);
        b.u[j] = fma(g.p, load(pixel_centres<Real>.x + at), fma(g.q, y, g.u0));
        b.v[j] = fma(g.r, y, g.v0);
        const Vec<Real> power = fnma(b.u[j], b.u[j], fnma(b.v[j], b.v[j], g.log2_opacity));
        const Mask<Real> taken = (power >= cut) & (before > Real(kStop));
        const Vec<Real> raised = exp2<Real>(power);  // meaningless but harmless where not taken
        b.alpha[j] = taken ? minimum(raised, broadcast(Real(kAlphaCap))) : Vec<Real>{};
        b.weight[j] = before * b.alpha[j];
        const Vec<Real> after = fnma(before, b.alpha[j], before);
        store(transmittance + at, after);
        open |= after > Real(kStop);
    }
    return any(open);
}

// Calls body(i, pixel, n) for all quadruples of neighbours i .. i + 3 in a tile that begin in the image: there they are
// the n pixels from `pixel` on.
template <class Body>
COTTON_INLINE void each_quad(const Tile& tile, const Body& body) {
    for (int i = 0; i < kTilePixels; i += 4) {
        const int x = tile.x0 + pixel_x(i), y = tile.y0 + pixel_y(i), n = tile.width - x < 4 ? tile.width - x : 4;
        if (n > 0 && y < tile.height) body(i, int64_t(y) * tile.width + x, n);
    }
}

// Prefetches one tile of a plane, because its rows lie too far apart for the processor's own prefetching.
template <class Real>
COTTON_INLINE void prefetch_tile(const Tile& tile, Plane<const Real> plane) {
    for (int y = tile.y0; y < tile.y0 + kTile && y < tile.height; ++y) {
        __builtin_prefetch(plane.data + (int64_t(y) * tile.width + tile.x0) * plane.stride);
    }
}

// One tile of a plane; pixels beyond the image are left as they are.
template <class Real>
COTTON_INLINE void copy_tile(const Tile& tile, Plane<const Real> from, Real* to) {
    each_quad(tile, [&](int i, int64_t pixel, int n) {
        const Real* quad = from.data + pixel * from.stride;
        if (n == 4 && from.stride == 1) {
            std::memcpy(to + i, quad, 4 * sizeof(Real));
        } else {
            for (int k = 0; k < n; ++k) to[i + k] = quad[k * from.stride];
        }
    });
}

template <class Real>
COTTON_INLINE void copy_tile(const Tile& tile, const Real* from, Plane<Real> to) {
    each_quad(tile, [&](int i, int64_t pixel, int n) {
        Real* quad = to.data + pixel * to.stride;
        if (n == 4 && to.stride == 1) {
            std::memcpy(quad, from + i, 4 * sizeof(Real));
        } else {
            for (int k = 0; k < n; ++k) quad[k * to.stride] = from[i + k];
        }
    });
}

// Transmittance before the first Gaussian: 1 in the image, 0 (nothing is taken) beyond its edges.
// Returns the blocks that have a pixel in the image.
template <class Real>
COTTON_INLINE uint32_t start(const Tile& tile, Real* transmittance) {
    uint32_t blocks = 0;
    std::memset(transmittance, 0, kTilePixels * sizeof(Real));
    each_quad(tile, [&](int i, int64_t, int n) {
        for (int k = 0; k < n; ++k) transmittance[i + k] = 1;
        blocks |= 1u << (i / kBlockPixels);
    });
    return blocks;
}

template <class Body>
COTTON_INLINE void each_block(uint32_t blocks, const Body& body) {
    for (; blocks != 0; blocks &= blocks - 1) body(__builtin_ctz(blocks));
}

// The loop of all rasterizers: every pair front to back, and for each pair every block that it reaches and that still
// has an open pixel. `visit(i)` blends the block of pixels from i on and returns whether it still has an open pixel.
// `begin` and `finish` enclose the visits of a pair; `skip` replaces them if there are no visits. `rows` is the table
// to which `finish` and `skip` write, or null.
template <class Real, class Begin, class Visit, class Finish, class Skip>
COTTON_INLINE void walk(const Tile& tile, const Real* records, int stride, uint32_t open_blocks, const Real* rows,
                        int row_stride, const Begin& begin, const Visit& visit, const Finish& finish,
                        const Skip& skip) {
    constexpr int64_t ahead = 4;  // records and rows are scattered over more memory than the caches hold
    for (int64_t pair = 0; pair < tile.count; ++pair) {
        if (pair + ahead < tile.count) {
            __builtin_prefetch(records + int64_t(tile.pairs[pair + ahead].row) * stride);
            if (rows) __builtin_prefetch(rows + int64_t(tile.numbers[pair + ahead]) * row_stride, 1);
        }
        const uint32_t blocks = tile.pairs[pair].blocks & open_blocks;
        if (blocks == 0) {
            skip(pair);
            continue;
        }
        begin(records + int64_t(tile.pairs[pair].row) * stride);
        each_block(blocks, [&](int block) COTTON_INLINE_BODY {
            if (!visit(block * kBlockPixels)) open_blocks &= ~(1u << block);
        });
        finish(pair, blocks);
    }
}

}  // namespace cotton::COTTON_ISA
