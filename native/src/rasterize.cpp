// Front-to-back blending of one tile and its full gradient (the seeds' Eq. 1-3 are this one sum).
#include "blending.h"
#include "kernels_isa.h"

namespace cotton::COTTON_ISA {
namespace {

template <class Real, int channels>
void forward_tile(const Tile& tile, const Real* records, const Real* background, const Plane<Real>* planes,
                  Real* transmittance_out) {
    using V = Vec<Real>;
    alignas(64) Real transmittance[kTilePixels], sums[channels][kTilePixels] = {};
    const uint32_t open = start(tile, transmittance);
    Splat<Real> splat;
    const Real* values = nullptr;
    walk(
        tile, records, record_stride(channels), open, transmittance, static_cast<const Real*>(nullptr), 0,
        [&](const Real* record) {
            splat = Splat<Real>::from(record, tile);
            values = record + field::values;
        },
        [&](int i) {
            const V before = load(transmittance + i);
            Blend<Real> b;
            if (!blend(splat, i, before, b)) return false;
            const V weight = before * b.alpha;
            for (int c = 0; c < channels; ++c) {
                store(sums[c] + i, fma(weight, broadcast(values[c]), load(sums[c] + i)));
            }
            store(transmittance + i, before * (1 - b.alpha));
            return true;
        },
        [](int64_t) {}, [](int64_t) {});

    for (int i = 0; i < kTilePixels; ++i) {
        const int x = tile.x0 + pixel_x(i), y = tile.y0 + pixel_y(i);
        if (x >= tile.width || y >= tile.height) continue;
        const int64_t pixel = int64_t(y) * tile.width + x;
        for (int c = 0; c < channels; ++c) {
            planes[c].data[pixel * planes[c].stride] = sums[c][i] + transmittance[i] * background[c];
        }
        if (transmittance_out) transmittance_out[pixel] = transmittance[i];
    }
}

}  // namespace

template <class Real>
typename Kernels<Real>::Forward forward(int channels) {
    switch (channels) {
        case 2:
            return forward_tile<Real, 2>;
        case 3:
            return forward_tile<Real, 3>;
        case 4:
            return forward_tile<Real, 4>;
        case 5:
            return forward_tile<Real, 5>;
        case 17:
            return forward_tile<Real, 17>;
        case 33:
            return forward_tile<Real, 33>;
        default:
            return nullptr;
    }
}

// Front to back again: only the transmittance and one scalar per pixel are kept, the gradient-weighted colour that is
// still to come. With c·g the Gaussian's colour times the image gradient,
//   d loss / d alpha_i = T_i (c_i·g) - (sum_{j>i} w_j (c_j·g) + T_end (background·g)) / (1 - alpha_i).
template <class Real>
void backward(const Tile& tile, const Real* records, const Plane<const Real>* image, const Plane<const Real>* v_image,
              Real* rows) {
    using V = Vec<Real>;
    constexpr int channels = 3;
    alignas(64) Real transmittance[kTilePixels], to_come[kTilePixels] = {}, v_tile[channels][kTilePixels] = {};
    const uint32_t open = start(tile, transmittance);
    for (int i = 0; i < kTilePixels; ++i) {
        const int x = tile.x0 + pixel_x(i), y = tile.y0 + pixel_y(i);
        if (x >= tile.width || y >= tile.height) continue;
        const int64_t pixel = int64_t(y) * tile.width + x;
        for (int c = 0; c < channels; ++c) {
            v_tile[c][i] = v_image[c].data[pixel * v_image[c].stride];
            to_come[i] += v_tile[c][i] * image[c].data[pixel * image[c].stride];
        }
    }

    Splat<Real> splat;
    const Real* values = nullptr;
    V sums[pair_gradient::size] = {};
    walk(
        tile, records, record_stride(channels), open, transmittance, rows, pair_gradient::size,
        [&](const Real* record) {
            splat = Splat<Real>::from(record, tile);
            values = record + field::values;
            for (int k = 0; k <= pair_gradient::weight; ++k) sums[k] = V{};
        },
        [&](int i) {
            using namespace pair_gradient;
            const V before = load(transmittance + i);
            Blend<Real> b;
            if (!blend(splat, i, before, b)) return false;
            const V w = before * b.alpha, through = 1 - b.alpha;
            V cg{};
            for (int c = 0; c < channels; ++c) {
                const V v = load(v_tile[c] + i);
                cg = fma(v, broadcast(values[c]), cg);
                sums[value0 + c] = fma(w, v, sums[value0 + c]);
            }
            const V rest = fnma(w, cg, load(to_come + i));
            store(to_come + i, rest);
            store(transmittance + i, before * through);
            const V v_alpha = before * cg - rest / through;
            const V v_power = v_alpha * (b.raw <= Real(kAlphaCap) ? b.alpha : V{});
            const V gu_i = v_power * b.u, gv_i = v_power * b.v;
            sums[g] += v_power;
            sums[gu] += gu_i;
            sums[gv] += gv_i;
            sums[guu] = fma(gu_i, b.u, sums[guu]);
            sums[guv] = fma(gu_i, b.v, sums[guv]);
            sums[gvv] = fma(gv_i, b.v, sums[gvv]);
            sums[abs_x] += absolute(gu_i);
            sums[abs_y] += absolute(fma(splat.q, gu_i, splat.r * gv_i));
            sums[weight] += w;
            return true;
        },
        [&](int64_t e) {
            Real* row = rows + int64_t(tile.slots[e]) * pair_gradient::size;
            sums[pair_gradient::abs_x] *= splat.p;
            for (int k = 0; k < pair_gradient::size; k += kLanes<Real>) store(row + k, sums_of_lanes<Real>(sums + k));
        },
        [&](int64_t e) {
            Real* row = rows + int64_t(tile.slots[e]) * pair_gradient::size;
            for (int k = 0; k < pair_gradient::size; ++k) row[k] = 0;
        });
}

template Kernels<float>::Forward forward<float>(int);
template Kernels<double>::Forward forward<double>(int);
template void backward(const Tile&, const float*, const Plane<const float>*, const Plane<const float>*, float*);
template void backward(const Tile&, const double*, const Plane<const double>*, const Plane<const double>*, double*);

}  // namespace cotton::COTTON_ISA
