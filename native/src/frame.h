// SPDX-License-Identifier: Apache-2.0
// One view of a scene: projected, binned into tiles, ready to be blended.
#pragma once

#include <algorithm>
#include <vector>

#include "buffer.h"
#include "kernels.h"
#include "threads.h"

namespace cotton {

inline constexpr int64_t kChunk = 2048;                       // Gaussians per task
inline constexpr int64_t kMaxPairs = (int64_t(1) << 32) - 1;  // their numbers have 32 bits

template <class Real>
class Frame {
  public:
    // Project and bin. Throws std::bad_alloc when there are more than kMaxPairs pairs, or too many for the memory.
    void prepare(const Scene<Real>& scene, const View& view, int threads);

    // Blend all tiles into `planes`, as many as the scene has channels (depth included).
    void blend(const Real* background, const Plane<Real>* planes, Real* transmittance) const;

    Tile tile(int64_t index) const;

    // Runs body(first, n) for chunks of the visible rows, in parallel: those of `visible` from `first` on.
    template <class Body>
    void each_visible_chunk(const Body& body) const {
        parallel_for((visible_count + kChunk - 1) / kChunk, threads,
                     [&](int64_t c) { body(c * kChunk, std::min(kChunk, visible_count - c * kChunk)); });
    }

    int64_t tiles() const { return int64_t(view.tiles_x()) * view.tiles_y(); }

    Scene<Real> scene;
    View view;
    int threads = 1;
    int64_t visible_count = 0, pair_count = 0;
    int64_t culled[kCullReasons] = {};
    Buffer<Real> records;
    Buffer<uint32_t> visible;  // the visible rows, ascending
    Buffer<PairRange> ranges;  // of the pairs of each visible row

    int stride() const { return record_stride(scene.channels + scene.with_depth); }

  private:
    void project();
    void bin();
    void sort_by_depth();

    Buffer<TileRect> rects_;
    Buffer<uint32_t> chunk_visible_;
    std::vector<ProjectionCount> chunks_;
    std::vector<int64_t> chunk_begin_;  // of the visible rows
    std::vector<int64_t> pair_offset_;  // of a chunk's pairs in `pairs_`, minus the number of the first
    Buffer<GaussianPair> pairs_;
    Buffer<uint64_t> keys_, keys_other_;
    Buffer<uint32_t> order_, order_other_;  // the visible rows, by (depth, row)
    Buffer<int64_t> tile_begin_;            // tiles() + 1
    Buffer<TilePair> tile_pairs_;
    Buffer<uint32_t> numbers_;
};

// Each calling thread keeps one frame and reuses its memory. Its contents depend only on the last prepare().
template <class Real>
Frame<Real>& scratch_frame();

extern template class Frame<float>;
extern template class Frame<double>;

}  // namespace cotton
