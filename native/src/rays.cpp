// SPDX-License-Identifier: Apache-2.0
#include "rays.h"

#include <numeric>

namespace cotton {

template <class Real>
RayWeights<Real> ray_weights(const Frame<Real>& frame, const int64_t* pixels, int64_t rays) {
    // The rays in the order of their tiles.
    std::vector<int64_t> begin(size_t(frame.tiles()) + 1, 0), order(size_t(rays), 0);
    const auto tile_of = [&](int64_t ray) {
        return pixels[2 * ray + 1] / kTile * frame.view.tiles_x() + pixels[2 * ray] / kTile;
    };
    for (int64_t ray = 0; ray < rays; ++ray) ++begin[size_t(tile_of(ray)) + 1];
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    std::vector<int64_t> next(begin.begin(), begin.end() - 1);
    for (int64_t ray = 0; ray < rays; ++ray) order[size_t(next[size_t(tile_of(ray))]++)] = ray;

    struct TileRays {
        std::vector<int32_t> rows;
        std::vector<Real> weights;
    };
    std::vector<TileRays> found(size_t(frame.tiles()));
    RayWeights<Real> result;
    result.starts.assign(size_t(rays) + 1, 0);
    parallel_for(frame.tiles(), frame.threads, [&](int64_t t) {
        const int64_t* chosen = order.data() + begin[size_t(t)];
        const auto n = size_t(begin[size_t(t) + 1] - begin[size_t(t)]);
        const Tile tile = frame.tile(t);
        if (n == 0 || tile.count == 0) return;
        std::vector<uint8_t> at(n);
        for (size_t k = 0; k < n; ++k) {
            at[k] = uint8_t(pixel_index(int(pixels[2 * chosen[k]] % kTile), int(pixels[2 * chosen[k] + 1] % kTile)));
        }
        std::vector<Real> weights(size_t(tile.count) * n);
        kernels<Real>().ray_weights(tile, frame.records.data(), frame.stride(), at.data(), int(n), weights.data());
        TileRays& own = found[size_t(t)];
        for (size_t k = 0; k < n; ++k) {
            const size_t before = own.rows.size();
            for (int64_t pair = 0; pair < tile.count; ++pair) {
                const Real weight = weights[size_t(pair) * n + k];
                if (!(weight > 0)) continue;
                own.rows.push_back(int32_t(tile.pairs[pair].row));
                own.weights.push_back(weight);
            }
            result.starts[size_t(chosen[k]) + 1] = int64_t(own.rows.size() - before);
        }
    });
    std::partial_sum(result.starts.begin(), result.starts.end(), result.starts.begin());
    result.rows.resize(size_t(result.starts.back()));
    result.weights.resize(result.rows.size());
    parallel_for(frame.tiles(), frame.threads, [&](int64_t t) {
        int64_t from = 0;
        for (int64_t k = begin[size_t(t)]; k < begin[size_t(t) + 1]; ++k) {
            const auto ray = size_t(order[size_t(k)]);
            const int64_t to = result.starts[ray], n = result.starts[ray + 1] - to;
            std::copy_n(found[size_t(t)].rows.begin() + from, n, result.rows.begin() + to);
            std::copy_n(found[size_t(t)].weights.begin() + from, n, result.weights.begin() + to);
            from += n;
        }
    });
    return result;
}

template RayWeights<float> ray_weights(const Frame<float>&, const int64_t*, int64_t);
template RayWeights<double> ray_weights(const Frame<double>&, const int64_t*, int64_t);

}  // namespace cotton
