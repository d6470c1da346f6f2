// SPDX-License-Identifier: Apache-2.0
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

}  // namespace cotton
