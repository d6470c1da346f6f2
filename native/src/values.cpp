// SPDX-License-Identifier: Apache-2.0
#include "values.h"

#include <numeric>

namespace cotton {
namespace {

template <class Body>
void each_pixel(const Tile& tile, const Body& body) {
    for (int i = 0; i < kTilePixels; ++i) {
        const int x = tile.x0 + pixel_x(i), y = tile.y0 + pixel_y(i);
        if (x < tile.width && y < tile.height) body(i, int64_t(y) * tile.width + x);
    }
}

// The mask ids of one tile except 0, ascending.
std::vector<uint16_t> ids_in(const Tile& tile, const uint16_t* mask_ids) {
    std::vector<uint16_t> ids;
    each_pixel(tile, [&](int, int64_t pixel) {
        if (mask_ids[pixel] != 0) ids.push_back(mask_ids[pixel]);
    });
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    return ids;
}

}  // namespace

std::vector<MaskWeight> mask_weights(Frame<float>& frame, const uint16_t* mask_ids, float* total) {
    // In each tile the sums over an indicator plane are the weights inside a mask; plane 0 is 1 everywhere.
    constexpr int planes = 4;
    const auto total_kernel = kernels<float>().values_backward(1);
    const auto masks_kernel = kernels<float>().values_backward(planes);
    struct PairWeight {
        uint32_t number;
        uint16_t id;
        float weight;
    };
    thread_local Buffer<float> kept;
    Buffer<float>& totals = kept;  // the calling thread's, used in all threads
    totals.reserve(frame.pair_count);
    std::vector<std::vector<PairWeight>> found(size_t(frame.tiles()));
    parallel_for(frame.tiles(), frame.threads, [&](int64_t t) {
        Tile tile = frame.tile(t);
        const std::vector<uint16_t> ids = ids_in(tile, mask_ids);
        std::vector<float> indicators(planes * kTilePixels, 1.0f);
        if (ids.empty()) {
            total_kernel(tile, frame.records.data(), frame.stride(), indicators.data(), totals.data(), 1);
            return;
        }
        const uint32_t* numbers = tile.numbers;
        std::vector<uint32_t> places(size_t(tile.count));
        std::iota(places.begin(), places.end(), 0u);
        tile.numbers = places.data();
        std::vector<float> sums(size_t(tile.count * planes));
        for (size_t first = 0; first < ids.size(); first += planes - 1) {
            const size_t n = std::min(ids.size() - first, size_t(planes - 1));
            std::fill(indicators.begin() + kTilePixels, indicators.end(), 0.0f);
            each_pixel(tile, [&](int i, int64_t pixel) {
                for (size_t k = 0; k < n; ++k) {
                    if (mask_ids[pixel] == ids[first + k]) indicators[(k + 1) * kTilePixels + size_t(i)] = 1.0f;
                }
            });
            masks_kernel(tile, frame.records.data(), frame.stride(), indicators.data(), sums.data(), planes);
            for (int64_t pair = 0; pair < tile.count; ++pair) {
                totals[numbers[pair]] = sums[size_t(pair * planes)];
                for (size_t k = 0; k < n; ++k) {
                    const float weight = sums[size_t(pair * planes) + k + 1];
                    if (weight > 0) found[size_t(t)].push_back({numbers[pair], ids[first + k], weight});
                }
            }
        }
    });
    frame.each_visible_chunk([&](int64_t first, int64_t n) {
        for (int64_t i = first; i < first + n; ++i) {
            const PairRange range = frame.ranges[frame.visible[i]];
            const float* begin = totals.data() + range.begin;
            total[frame.visible[i]] = std::accumulate(begin, begin + range.count, 0.0f);
        }
    });

    // Numbers ascend with the rows: a counting sort of the finds by number puts them in the order of the rows.
    std::vector<int64_t> begin(size_t(frame.pair_count) + 1, 0);
    for (const auto& tile : found) {
        for (const PairWeight& f : tile) ++begin[f.number + 1];
    }
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    std::vector<PairWeight> by_number(size_t(begin.back()));
    std::vector<int64_t> position(begin.begin(), begin.end() - 1);
    for (const auto& tile : found) {
        for (const PairWeight& f : tile) by_number[size_t(position[f.number]++)] = f;
    }
    std::vector<MaskWeight> weights;
    for (int64_t i = 0; i < frame.visible_count; ++i) {
        const PairRange range = frame.ranges[frame.visible[i]];
        const auto first = by_number.begin() + begin[range.begin],
                   last = by_number.begin() + begin[range.begin + range.count];
        std::stable_sort(first, last, [](const PairWeight& a, const PairWeight& b) { return a.id < b.id; });
        for (auto f = first; f != last; ++f) {
            if (f != first && f->id == (f - 1)->id) {
                weights.back().weight += f->weight;
            } else {
                weights.push_back({frame.visible[i], f->id, f->weight});
            }
        }
    }
    return weights;
}

}  // namespace cotton
