// SPDX-License-Identifier: Apache-2.0
// Evidence along thin lines in photos: the share of each piece that an object of known colour covers. Its purpose and
// the equation are in cotton3dg/plant_map/photo_lines.py.
#pragma once

#include <vector>

#include "../src/scene.h"

namespace cotton {

// (H, W, 4), rows first: colour, and a value above 0 where nothing is visible.
struct Photo {
    const uint8_t* pixels;
    View view;
    double colour[3];  // of the wood
};

struct LineModel {
    std::vector<double> aside_px;  // at either side of a line, where the photo shows what is behind
    double noise;                  // of a pixel, grey levels
    double colour_share;           // of its contrast by which the colour of what covers may differ
};

// Sums over colours of (I - B)(W - B) and of (W - B)², weighted by their variance, of each of `count` pieces of lines;
// both are 0 where the photo does not show the piece. Places and directions are (N, 3).
void line_evidence(const Photo& photo, const LineModel& model, const double* places, const double* directions,
                   int64_t count, double* above, double* below);

}  // namespace cotton
