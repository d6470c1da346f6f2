// SPDX-License-Identifier: Apache-2.0
// Descriptors of image features, and their nearest neighbours in another image.
#pragma once

#include <cstdint>

namespace cotton {

inline constexpr int kMatchBlock = 32;

// Descriptors of one image: rows of `length` pairs of whole numbers from 0 to 255, each pair in one number (the second
// times 2^16); once row by row, and once in blocks of kMatchBlock rows, those of a block pair by pair.
struct Descriptors {
    int64_t count;
    int length;
    const int32_t *pairs, *blocks;
};

// The largest product of each row with one of the other image's, the next one, and where the largest is; -1 = none.
// There is room for whole blocks.
struct Neighbours {
    int32_t *best, *second, *index;
};

}  // namespace cotton
