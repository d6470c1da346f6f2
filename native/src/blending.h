// What the forward and the backward rasterizers share, so that they agree to the last bit: the alpha of a Gaussian at
// a vector of pixels, and the rule that says which pixels take it.
#pragma once

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

template <class Real>
struct Splat {
    Vec<Real> x, y, p, q, r, log2_opacity;

    COTTON_INLINE Splat from(const Real* record, const Tile& tile) {
        return {broadcast(record[field::x] - Real(tile.x0)),
                broadcast(record[field::y] - Real(tile.y0)),
                broadcast(record[field::p]),
                broadcast(record[field::q]),
                broadcast(record[field::r]),
                broadcast(record[field::log2_opacity])};
    }
};

template <class Real>
struct Blend {
    Vec<Real> u, v;
    Vec<Real> raw;    // alpha before the cap, where taken
    Vec<Real> alpha;  // 0 where the pixel does not take the Gaussian
};

// Returns false when no pixel of the vector at `i` takes the Gaussian.
template <class Real>
COTTON_INLINE bool blend(const Splat<Real>& g, int i, Vec<Real> transmittance, Blend<Real>& b) {
    constexpr Real cut = Real(-7.994353436858858);  // log2(kAlphaCut)
    const Vec<Real> dx = load(pixel_centres<Real>.x + i) - g.x, dy = load(pixel_centres<Real>.y + i) - g.y;
    b.u = fma(g.p, dx, g.q * dy);
    b.v = g.r * dy;
    const Vec<Real> power = fnma(b.u, b.u, fnma(b.v, b.v, g.log2_opacity));
    const Mask<Real> taken = (power >= cut) & (transmittance > Real(kStop));
    if (!any(taken)) return false;
    b.raw = exp2<Real>(power);  // of no meaning, but harmless, where not taken
    b.alpha = taken ? minimum(b.raw, broadcast(Real(kAlphaCap))) : Vec<Real>{};
    return true;
}

// Transmittance before the first Gaussian: 1 in the image, 0 (nothing is taken) beyond its edges.
// Returns the blocks that have a pixel in the image.
template <class Real>
COTTON_INLINE uint32_t start(const Tile& tile, Real* transmittance) {
    uint32_t blocks = 0;
    for (int i = 0; i < kTilePixels; ++i) {
        const bool inside = tile.x0 + pixel_x(i) < tile.width && tile.y0 + pixel_y(i) < tile.height;
        transmittance[i] = inside ? Real(1) : Real(0);
        blocks |= uint32_t(inside) << (i / kBlockPixels);
    }
    return blocks;
}

template <class Real>
COTTON_INLINE bool block_done(const Real* transmittance, int block) {
    Mask<Real> open{};
    for (int i = block * kBlockPixels; i < (block + 1) * kBlockPixels; i += kLanes<Real>) {
        open |= load(transmittance + i) > Real(kStop);
    }
    return !any(open);
}

// The walk of all rasterizers: every entry front to back, and in it every block that it reaches and that still has an
// open pixel. `begin` and `finish` enclose an entry, `skip` stands for both when it reaches no open block; `visit(i)`
// blends the vector of pixels at i and returns whether any pixel took the Gaussian. `rows` is the table that `finish`
// and `skip` write to, or null.
template <class Real, class Begin, class Visit, class Finish, class Skip>
COTTON_INLINE void walk(const Tile& tile, const Real* records, int stride, uint32_t open_blocks,
                        const Real* transmittance, const Real* rows, int row_stride, const Begin& begin,
                        const Visit& visit, const Finish& finish, const Skip& skip) {
    constexpr int64_t ahead = 4;  // records and rows are scattered over more memory than the caches hold
    for (int64_t e = 0; e < tile.count; ++e) {
        if (e + ahead < tile.count) {
            __builtin_prefetch(records + int64_t(tile.entries[e + ahead].row) * stride);
            if (rows) __builtin_prefetch(rows + int64_t(tile.slots[e + ahead]) * row_stride, 1);
        }
        uint32_t blocks = tile.entries[e].blocks & open_blocks;
        if (blocks == 0) {
            skip(e);
            continue;
        }
        begin(records + int64_t(tile.entries[e].row) * stride);
        while (blocks != 0) {
            const int block = __builtin_ctz(blocks);
            blocks &= blocks - 1;
            bool taken = false;
            for (int i = block * kBlockPixels; i < (block + 1) * kBlockPixels; i += kLanes<Real>) taken |= visit(i);
            if (!taken && block_done(transmittance, block)) open_blocks &= ~(1u << block);
        }
        finish(e);
    }
}

}  // namespace cotton::COTTON_ISA
