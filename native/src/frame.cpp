// SPDX-License-Identifier: Apache-2.0
#include "frame.h"

#include <atomic>
#include <bit>
#include <cstring>
#include <new>
#include <utility>

namespace cotton {
namespace {

// Bits of a positive number; they have the same order as the numbers.
uint64_t depth_key(float depth) { return std::bit_cast<uint32_t>(depth); }
uint64_t depth_key(double depth) { return std::bit_cast<uint64_t>(depth); }

// Turns the counts of a stable counting sort, by part of the input and bucket, into the first place of each. Returns
// their sum.
int64_t counts_to_positions(std::vector<int64_t>& counts, int64_t parts) {
    const int64_t buckets = int64_t(counts.size()) / parts;
    int64_t sum = 0;
    for (int64_t b = 0; b < buckets; ++b) {
        for (int64_t part = 0; part < parts; ++part) sum += std::exchange(counts[size_t(part * buckets + b)], sum);
    }
    return sum;
}

}  // namespace

template <class Real>
void Frame<Real>::prepare(const Scene<Real>& new_scene, const View& new_view, int new_threads) {
    scene = new_scene;
    view = new_view;
    threads = thread_count(new_threads);
    project();
    bin();
}

template <class Real>
void Frame<Real>::project() {
    const auto& k = kernels<Real>();
    const int64_t n = scene.count, chunks = (n + kChunk - 1) / kChunk;
    const Projection<Real> out = {records.reserve(n * stride()), stride(), rects_.reserve(n),
                                  chunk_visible_.reserve(n)};
    chunks_.assign(size_t(chunks), {});
    parallel_for(chunks, threads, [&](int64_t c) {
        k.project(scene, view, c * kChunk, std::min(n, (c + 1) * kChunk), out, chunks_[size_t(c)]);
    });

    std::fill(culled, culled + kCullReasons, 0);
    chunk_begin_.assign(size_t(chunks) + 1, 0);
    pair_offset_.assign(size_t(chunks), 0);
    int64_t most_pairs = 0;
    for (int64_t c = 0; c < chunks; ++c) {
        const ProjectionCount& count = chunks_[size_t(c)];
        chunk_begin_[size_t(c) + 1] = chunk_begin_[size_t(c)] + count.visible;
        pair_offset_[size_t(c)] = most_pairs;
        most_pairs += count.most_pairs;
        for (int r = 0; r < kCullReasons; ++r) culled[r] += count.culled[r];
    }
    visible_count = chunk_begin_.back();
    if (most_pairs > kMaxPairs) throw std::bad_alloc();

    // List the pairs of each chunk's Gaussians in its own part of `pairs_`, then number them through.
    pairs_.reserve(most_pairs);
    ranges.reserve(n);
    visible.reserve(visible_count);
    std::vector<int64_t> chunk_pairs(size_t(chunks), 0), first_pair(size_t(chunks), 0);
    parallel_for(chunks, threads, [&](int64_t c) {
        const uint32_t* rows = out.visible + c * kChunk;
        const int64_t count = chunks_[size_t(c)].visible;
        std::copy(rows, rows + count, visible.data() + chunk_begin_[size_t(c)]);
        chunk_pairs[size_t(c)] =
            k.list_pairs(view, out, rows, count, pairs_.data() + pair_offset_[size_t(c)], ranges.data());
    });
    pair_count = 0;
    for (int64_t c = 0; c < chunks; ++c) {
        first_pair[size_t(c)] = pair_count;
        pair_offset_[size_t(c)] -= pair_count;
        pair_count += chunk_pairs[size_t(c)];
    }
    parallel_for(chunks, threads, [&](int64_t c) {
        for (int64_t i = chunk_begin_[size_t(c)]; i < chunk_begin_[size_t(c) + 1]; ++i) {
            ranges[visible[i]].begin += uint32_t(first_pair[size_t(c)]);
        }
    });
}

// Stable radix sort of the visible rows, 11 bits a pass; passes whose digit is the same everywhere are left out.
template <class Real>
void Frame<Real>::sort_by_depth() {
    constexpr int bits = 11, buckets = 1 << bits;
    const int64_t n = visible_count, parts = threads;
    uint64_t *keys = keys_.reserve(n), *keys_to = keys_other_.reserve(n);
    uint32_t *rows = order_.reserve(n), *rows_to = order_other_.reserve(n);
    const auto each_part = [&](const auto& body) {
        parallel_for(parts, threads, [&](int64_t part) { body(part, n * part / parts, n * (part + 1) / parts); });
    };
    std::atomic<uint64_t> some{0}, every{~uint64_t(0)};
    each_part([&](int64_t, int64_t begin, int64_t end) {
        uint64_t own_some = 0, own_every = ~uint64_t(0);
        for (int64_t i = begin; i < end; ++i) {
            rows[i] = visible[i];
            keys[i] = depth_key(records[int64_t(rows[i]) * stride() + field::depth]);
            own_some |= keys[i];
            own_every &= keys[i];
        }
        some |= own_some, every &= own_every;
    });
    const uint64_t varying = n > 0 ? some ^ every : 0;
    for (int shift = 0; shift < 64; shift += bits) {
        if ((varying >> shift & (buckets - 1)) == 0) continue;
        std::vector<int64_t> positions(size_t(parts * buckets), 0);
        each_part([&](int64_t part, int64_t begin, int64_t end) {
            int64_t* count = positions.data() + part * buckets;
            for (int64_t i = begin; i < end; ++i) ++count[keys[i] >> shift & (buckets - 1)];
        });
        counts_to_positions(positions, parts);
        each_part([&](int64_t part, int64_t begin, int64_t end) {
            int64_t* position = positions.data() + part * buckets;
            for (int64_t i = begin; i < end; ++i) {
                const int64_t to = position[keys[i] >> shift & (buckets - 1)]++;
                keys_to[to] = keys[i];
                rows_to[to] = rows[i];
            }
        });
        std::swap(keys, keys_to);
        std::swap(rows, rows_to);
    }
    if (rows != order_.data()) std::memcpy(order_.data(), rows, size_t(n) * sizeof(uint32_t));
}

// Stable scatter of the pairs into their tiles, in depth order.
template <class Real>
void Frame<Real>::bin() {
    sort_by_depth();
    const int64_t tile_count = tiles(), parts = threads;
    std::vector<int64_t> positions(size_t(parts * tile_count), 0);
    const auto part_begin = [&](int64_t part) { return visible_count * part / parts; };
    const auto pairs_of = [&](uint32_t row) {
        return pairs_.data() + pair_offset_[size_t(row / kChunk)] + ranges[row].begin;
    };
    const auto each_pair = [&](int64_t part, const auto& body) {
        constexpr int64_t ahead = 16;
        for (int64_t i = part_begin(part); i < part_begin(part + 1); ++i) {
            if (i + 2 * ahead < visible_count) __builtin_prefetch(&ranges[order_[i + 2 * ahead]]);
            if (i + ahead < visible_count) __builtin_prefetch(pairs_of(order_[i + ahead]));
            const uint32_t row = order_[i];
            const PairRange range = ranges[row];
            const GaussianPair* pairs = pairs_of(row);
            for (uint32_t j = 0; j < range.count; ++j) body(row, range.begin + j, pairs[j]);
        }
    };
    parallel_for(parts, threads, [&](int64_t part) {
        int64_t* count = positions.data() + part * tile_count;
        each_pair(part, [&](uint32_t, uint32_t, GaussianPair pair) { ++count[pair.tile]; });
    });
    const int64_t total = counts_to_positions(positions, parts);
    tile_begin_.reserve(tile_count + 1);
    std::copy_n(positions.begin(), tile_count, tile_begin_.data());
    tile_begin_[tile_count] = total;
    tile_pairs_.reserve(total);
    numbers_.reserve(total);
    parallel_for(parts, threads, [&](int64_t part) {
        int64_t* position = positions.data() + part * tile_count;
        each_pair(part, [&](uint32_t row, uint32_t number, GaussianPair pair) {
            const int64_t to = position[pair.tile]++;
            tile_pairs_[to] = {row, pair.blocks};
            numbers_[to] = number;
        });
    });
}

template <class Real>
Tile Frame<Real>::tile(int64_t index) const {
    const int64_t begin = tile_begin_[index];
    return {tile_pairs_.data() + begin,
            numbers_.data() + begin,
            tile_begin_[index + 1] - begin,
            int(index % view.tiles_x()) * kTile,
            int(index / view.tiles_x()) * kTile,
            view.width,
            view.height};
}

template <class Real>
void Frame<Real>::blend(const Real* background, const Plane<Real>* planes, Real* transmittance) const {
    const auto forward = kernels<Real>().forward(scene.channels + scene.with_depth);
    parallel_for(tiles(), threads,
                 [&](int64_t t) { forward(tile(t), records.data(), background, planes, transmittance); });
}

template <class Real>
Frame<Real>& scratch_frame() {
    thread_local Frame<Real> frame;
    return frame;
}

template class Frame<float>;
template class Frame<double>;
template Frame<float>& scratch_frame();
template Frame<double>& scratch_frame();

}  // namespace cotton
