// SPDX-License-Identifier: Apache-2.0
// Nearest neighbours among descriptors by all products: for each row of one image the best two of the other, and the
// reverse. All numbers are whole, so the result is exact, and the same on every processor.
#pragma once

#include "../src/simd.h"
#include "descriptors.h"

namespace cotton::COTTON_ISA {
namespace {

using Ints = Vec<int32_t>;
constexpr int kIntLanes = kLanes<int32_t>;
constexpr int kBlockVectors = kMatchBlock / kIntLanes;
// Number of rows whose products with a block are summed at a time: as many as the registers hold.
constexpr int kMatchRows = kIntLanes == 16 ? 8 : kIntLanes == 8 ? 2 : 1;

// a0 b0 + a1 b1 of the two 16-bit numbers in each lane.
COTTON_INLINE Ints multiply_pairs(Ints a, Ints b) {
#if defined(__AVX512BW__)
    return (Ints)_mm512_madd_epi16((__m512i)a, (__m512i)b);
#elif defined(__AVX2__)
    return (Ints)_mm256_madd_epi16((__m256i)a, (__m256i)b);
#elif defined(__SSE2__)
    return (Ints)_mm_madd_epi16((__m128i)a, (__m128i)b);
#else
    return (a & 0xffff) * (b & 0xffff) + (a >> 16) * (b >> 16);  // none is negative
#endif
}

// The best two so far, lane by lane; the first of equal ones.
struct BestTwo {
    Ints best, second, index;
};

COTTON_INLINE void take(BestTwo& so_far, Ints value, Ints index) {
    const Ints better = value > so_far.best;
    const Ints other = better ? so_far.best : value;
    so_far.second = other > so_far.second ? other : so_far.second;
    so_far.best = better ? value : so_far.best;
    so_far.index = better ? index : so_far.index;
}

COTTON_INLINE void write_best_of_lanes(const BestTwo& lanes, const Neighbours& to, int64_t row) {
    int32_t best = -1, second = -1, index = -1;
    for (int l = 0; l < kIntLanes; ++l) {
        const int32_t value = lanes.best[l], at = lanes.index[l];
        const bool better = value > best || (value == best && at < index);
        const int32_t other = better ? best : value, next = lanes.second[l] > other ? lanes.second[l] : other;
        second = next > second ? next : second;
        best = better ? value : best, index = better ? at : index;
    }
    to.best[row] = best, to.second[row] = second, to.index[row] = index;
}

void match(const Descriptors& a, const Descriptors& b, const Neighbours& of_a, const Neighbours& of_b) {
    Ints lane{};
    for (int l = 0; l < kIntLanes; ++l) lane[l] = l;
    const Ints none = Ints{} - 1;
    for (int64_t first = 0; first < a.count; first += kMatchRows) {
        const int64_t left = a.count - first;
        const int n = left < kMatchRows ? int(left) : kMatchRows;
        const int32_t* rows[kMatchRows];
        for (int r = 0; r < kMatchRows; ++r) rows[r] = a.pairs + (first + (r < n ? r : 0)) * a.length;
        BestTwo found[kMatchRows];
        for (BestTwo& row : found) row = {none, none, none};
        for (int64_t column = 0; column < b.count; column += kMatchBlock) {
            const int32_t* from = b.blocks + column * b.length;
            Ints products[kMatchRows][kBlockVectors] = {};
            for (int k = 0; k < a.length; ++k) {
                for (int v = 0; v < kBlockVectors; ++v) {
                    const Ints factors = load(from + k * kMatchBlock + v * kIntLanes);
                    for (int r = 0; r < kMatchRows; ++r) {
                        products[r][v] += multiply_pairs(broadcast(rows[r][k]), factors);
                    }
                }
            }
            for (int v = 0; v < kBlockVectors; ++v) {
                const int64_t at = column + v * kIntLanes;
                const Ints index = lane + int32_t(at), missing = index >= int32_t(b.count);
                BestTwo below = {load(of_b.best + at), load(of_b.second + at), load(of_b.index + at)};
                for (int r = 0; r < n; ++r) {
                    take(found[r], missing ? none : products[r][v], index);
                    take(below, products[r][v], broadcast(int32_t(first + r)));
                }
                store(of_b.best + at, below.best), store(of_b.second + at, below.second);
                store(of_b.index + at, below.index);
            }
        }
        for (int r = 0; r < n; ++r) write_best_of_lanes(found[r], of_a, first + r);
    }
}

}  // namespace
}  // namespace cotton::COTTON_ISA
