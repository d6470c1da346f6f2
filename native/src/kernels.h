// SPDX-License-Identifier: Apache-2.0
// The kernels of one instruction set, as a table of functions.
#pragma once

#include "projection.h"

namespace cotton {

struct AdamRows;
struct Descriptors;
struct LossSums;
struct Neighbours;
template <class Real>
struct LossBand;

template <class Real>
struct Kernels {
    using Forward = void (*)(const Tile&, const Real* records, const Real* background, const Plane<Real>* planes,
                             Real* transmittance);
    using ValuesBackward = void (*)(const Tile&, const Real* records, int record_stride, const Real* v_tile, Real* rows,
                                    int row_stride);

    // Project rows [begin, end) of the scene.
    void (*project)(const Scene<Real>&, const View&, int64_t begin, int64_t end, const Projection<Real>&,
                    ProjectionCount&);
    // List the pairs of each of `n` visible Gaussians; returns their number.
    int64_t (*list_pairs)(const View&, const Projection<Real>&, const uint32_t* visible, int64_t n, GaussianPair* pairs,
                          PairRange* ranges);
    // Blend one tile with this many channels; null if the build has no kernel for that number.
    Forward (*forward)(int channels);
    // Sums over pixels of weight * v_tile (channels planes of kTilePixels), one row per pair.
    ValuesBackward (*values_backward)(int channels);
    // Weights of every pair at `n` pixels of the tile: row i of `weights` (pairs x n) is that of pair i.
    void (*ray_weights)(const Tile&, const Real* records, int record_stride, const uint8_t* pixels, int n,
                        Real* weights);
    // Gradient by all components of a projected Gaussian with three channels, one pair_gradient row per pair.
    void (*backward)(const Tile&, const Real* records, const Plane<const Real>* image, const Plane<const Real>* v_image,
                     Real* rows);
    // Fold the pair gradients of `n` visible Gaussians and carry them on to the parameters: one row_gradient row each.
    // Returns how many are not finite; those rows have a weight of 0, so that no update uses them.
    int64_t (*project_backward)(const Scene<Real>&, const View&, const uint32_t* visible, int64_t n,
                                const Real* records, int record_stride, const PairRange* ranges, const Real* pair_rows,
                                Real* rows);
    // Row band of one channel: sums of |x - y| and SSIM; writes the three derivative maps.
    LossSums (*loss_forward)(const LossBand<Real>&);
    // The same band: gradient of the loss by the image from the derivative maps.
    void (*loss_backward)(const LossBand<Real>&);
    // Adam update of `n` visible rows (float only, null otherwise).
    void (*adam)(const AdamRows&, const uint32_t* visible, int64_t n, const float* rows);
    // Nearest neighbours of each descriptor of `a` among those of `b` and the other way round (float only, null
    // otherwise). All of `of_b` is -1 before.
    void (*match)(const Descriptors& a, const Descriptors& b, const Neighbours& of_a, const Neighbours& of_b);
    // Whether NaN and Inf are still recognised in this build.
    bool (*self_test)();
};

// The table of the instruction set in use.
template <class Real>
const Kernels<Real>& kernels();

}  // namespace cotton
