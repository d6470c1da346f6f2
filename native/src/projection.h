// SPDX-License-Identifier: Apache-2.0
// What passes from the projection to the blending and back: projected Gaussians, their pairs with tiles, and gradients.
#pragma once

#include "scene.h"

namespace cotton {

// A projected Gaussian is a row of Reals, 64-byte aligned. alpha = 2^(log2_opacity - u² - v²) with
// u = p dx + q dy and v = r dy: the Cholesky factor of the scaled conic. Unlike a dx² + 2b dx dy + c dy² it never
// cancels to a negative number, so needles stay exact.
namespace field {
enum : int { x, y, p, q, r, log2_opacity, cut_radius2, depth, values };
}

COTTON_SHARED constexpr int record_stride(int channels) { return (field::values + channels + 15) / 16 * 16; }

enum Cull : int { kNonFinite, kBehind, kDegenerate, kFaint, kOutside, kCullReasons };

struct TileRect {
    uint16_t x0, y0, x1, y1;  // in tiles, end exclusive
    COTTON_SHARED int64_t area() const { return int64_t(x1 - x0) * (y1 - y0); }
};

// Projected Gaussians, indexed by their row in the scene; rows that are not visible are left as they were.
template <class Real>
struct Projection {
    Real* records;
    int stride;
    TileRect* rects;
    uint32_t* visible;  // chunk [begin, end) writes its visible rows, ascending, from visible[begin] on
};

struct ProjectionCount {
    int64_t visible;
    int64_t most_pairs;  // upper bound of the number of pairs
    int64_t culled[kCullReasons];
};

// A pair is a tile and a Gaussian that reaches it. Pairs are numbered by Gaussian, and those of a Gaussian by tile.
// Bit b of `blocks` is set when the Gaussian reaches block b of the tile.
struct GaussianPair {  // in the list of a Gaussian
    uint32_t tile, blocks;
};
struct TilePair {  // in the list of a tile
    uint32_t row, blocks;
};
struct PairRange {  // numbers of the pairs of a Gaussian
    uint32_t begin, count;
};

// One tile and its pairs, front to back. Gradients of pairs[i] go to row numbers[i] of a table with a row per pair.
struct Tile {
    const TilePair* pairs;
    const uint32_t* numbers;
    int64_t count;
    int x0, y0, width, height;  // px; width and height are those of the image
};

// One channel of an image: pixel (x, y) is at data[(y * image width + x) * stride].
template <class Real>
struct Plane {
    Real* data;
    int64_t stride;
};

// Row of the gradient table that training uses. With e = (u, v) and G = d loss / d ln alpha, per pixel:
// sums of G, G e, G e eᵀ, of the colour gradient, of the absolute gradient of the mean (AbsGS) and of the weight.
namespace pair_gradient {
enum : int { g, gu, gv, guu, guv, gvv, value0, value1, value2, abs_x, abs_y, weight, size = 16 };
}

// Row of the gradient by the parameters of one visible Gaussian; `colour` is the gradient by the colour where that is
// positive. abs_grad_px is the length of the sum of the pixels' absolute gradients by the projected mean in the units
// of Kerbl et al.: pixels times half the image size. `unit` is the direction in which the camera sees the mean.
namespace row_gradient {
enum : int { mean = 0, quat = 3, log_scale = 7, logit = 10, colour = 11, weight = 14, abs_grad_px, unit, size = 20 };
}

}  // namespace cotton
