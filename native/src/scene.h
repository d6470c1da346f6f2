// The plain structs that the kernels and their callers share. `Real` is float in production and double in the tests.
#pragma once

#include <cstdint>

// The functions here are always inlined: the linker keeps one copy of an inline function from all units that have it,
// and that copy might use instructions that the processor lacks.
#define COTTON_SHARED inline __attribute__((always_inline))

namespace cotton {

inline constexpr int kTile = 16;  // px, side of a tile
inline constexpr int kTilePixels = 256;
inline constexpr int kBlock = 4;  // px, side of a block; a tile has 4 x 4 blocks of 4 x 4 pixels
inline constexpr int kBlockPixels = 16;
inline constexpr double kAlphaCap = 0.99;  // largest alpha; beyond it the gradient is zero
inline constexpr double kAlphaCut = 1.0 / 255.0;
inline constexpr double kLog2AlphaCut = -7.994353436858858;  // its logarithm, which is not constexpr before C++26
inline constexpr double kStop = 1e-4;      // a pixel takes no further Gaussian once its transmittance is at most this
inline constexpr double kDilation = 0.3;   // px², added to both variances of every projected Gaussian
inline constexpr double kMaxColour = 1e6;  // a colour beyond it (1 is white) would overflow in the loss: culled
inline constexpr int kBands = 4;           // of spherical harmonics: degrees 0 to 3
inline constexpr double kMaxLogScale = 30.0;  // log scales are clamped to ± this

// Pixel i of a tile lies in block i / 16 (row by row), there at (i % 4, i / 4 % 4).
COTTON_SHARED constexpr int pixel_x(int i) { return i / kBlockPixels % 4 * kBlock + i % 4; }
COTTON_SHARED constexpr int pixel_y(int i) { return i / kBlockPixels / 4 * kBlock + i / 4 % 4; }
COTTON_SHARED constexpr int pixel_index(int x, int y) {
    return (y / kBlock * 4 + x / kBlock) * kBlockPixels + y % kBlock * kBlock + x % kBlock;
}

// A pinhole camera, OpenCV axes, pixel centres at +0.5. Nothing nearer than `near_plane` (su) is drawn. The view may be
// a window of the camera's image: sizes and principal point are the window's, `image_` the whole image's.
struct View {
    int width, height;
    double fx, fy, cx, cy;
    double rotation[9], translation[3];  // cam_from_scene, row major
    double near_plane;
    int image_width, image_height, left, top;  // of the window in the image

    COTTON_SHARED int tiles_x() const { return (width + kTile - 1) / kTile; }
    COTTON_SHARED int tiles_y() const { return (height + kTile - 1) / kTile; }
    COTTON_SHARED int64_t pixels() const { return int64_t(width) * height; }
    COTTON_SHARED int64_t image_pixels() const { return int64_t(image_width) * image_height; }
};

// The content to draw: the colours of the spherical harmonics, or rows of `values`, or (both null) only weights.
template <class Real>
struct Scene {
    int64_t count;
    const Real *means, *quats, *log_scales, *opacity_logits;  // (N,3) (N,4) (N,3) (N,)
    const Real* sh;                                           // (N, sh_stored, 3) or null
    int sh_stored, sh_degree;
    const Real* values;  // (N, channels) or null
    int channels;        // 3 with spherical harmonics, 0 with neither
    bool with_depth;     // the view-space depth is one more channel, after the others
};

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
    int64_t rect_tiles;  // upper bound of the number of (tile, Gaussian) pairs
    int64_t culled[kCullReasons];
};

// A tile that a Gaussian reaches; bit b of `blocks` is set when it reaches block b.
struct Hit {
    uint32_t tile, blocks;
};
struct HitRange {
    uint32_t begin, count;
};

struct TileEntry {
    uint32_t row, blocks;
};

// One tile's Gaussians, front to back. Gradients of entry e go to row slots[e] of a table with a row per pair.
struct Tile {
    const TileEntry* entries;
    const uint32_t* slots;
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

// Sums over views for density control, (N,) each. Weights count as shares of the image, so that the weights of a coarse
// and a fine image can be compared.
struct Statistics {
    float *abs_grad_px, *weight;
    int32_t* count;
    float pixel;  // its share of the image
};

struct LossSums {
    double l1, ssim;
};

template <class Real>
struct LossBand {
    const Real *image, *target;  // one channel, H x W
    int width, height, row_begin, row_end;
    Real *d_mean, *d_square, *d_product;  // H x loss_row(W): derivatives of the SSIM by the local moments
    Real* v_image;
    Real* scratch;  // loss_scratch_size(width)
    Real l1_factor, ssim_factor;
};

COTTON_SHARED constexpr int64_t loss_row(int width) { return (int64_t(width) + 10 + 31) / 16 * 16; }
COTTON_SHARED constexpr int64_t loss_scratch_size(int width) { return loss_row(width) * 12 * 4; }

struct LearningRates {
    float means, quats, log_scales, opacity_logits, sh0, sh_rest, beta1, beta2, epsilon;
};

// Gaussians more than a radius from `centre` take longer steps: `growth` times as long for each further radius, up to
// the given factors.
struct Surroundings {
    float centre[3], radius, growth, most_means, most_log_scales;
};

// Values for the parameters, or for moments of their gradient.
struct GaussianPointers {
    float *means, *quats, *log_scales, *opacity_logits, *sh;
};

// 1 / (1 - beta^t) for both moments.
struct BiasCorrection {
    float first, second;
};

struct AdamRows {
    GaussianPointers parameters, first, second;
    int sh_stored, sh_degree;
    int32_t* steps;  // (N, kBands) updates so far of each band of the colour; the first is the geometry's, too
    LearningRates rates;
    Surroundings surroundings;
    const BiasCorrection* bias;  // of step t at bias[min(t, bias_count - 1)]
    int32_t bias_count;
    Statistics statistics;
};

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
