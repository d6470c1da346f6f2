// SPDX-License-Identifier: Apache-2.0
#include "lines.h"

#include <algorithm>
#include <cmath>

namespace cotton {
namespace {

struct Pixel {
    double colour[3];
};

// Interpolates between the centres of pixels, which are at whole numbers; false where the photo shows nothing.
bool look(const Photo& photo, double x, double y, Pixel& seen) {
    const int width = photo.view.width, height = photo.view.height;
    if (!(x >= 0 && y >= 0 && x <= width - 1 && y <= height - 1)) return false;
    const int left = int(x), top = int(y), right = std::min(left + 1, width - 1), low = std::min(top + 1, height - 1);
    const auto at = [&](int column, int row) { return photo.pixels + 4 * (int64_t(row) * width + column); };
    const uint8_t *a = at(left, top), *b = at(right, top), *c = at(left, low), *d = at(right, low);
    if (a[3] | b[3] | c[3] | d[3]) return false;
    const double right_share = x - left, low_share = y - top;
    for (int k = 0; k < 3; ++k) {
        const double upper = a[k] + right_share * (b[k] - a[k]), lower = c[k] + right_share * (d[k] - c[k]);
        seen.colour[k] = upper + low_share * (lower - upper);
    }
    return true;
}

void turned(const double* rotation, const double* vector, double* result) {
    for (int i = 0; i < 3; ++i) {
        const double* row = rotation + 3 * i;
        result[i] = row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2];
    }
}

}  // namespace

void line_evidence(const Photo& photo, const LineModel& model, const double* places, const double* directions,
                   int64_t count, double* above, double* below) {
    const View& view = photo.view;
    std::vector<Pixel> sides(2 * model.aside_px.size());
    for (int64_t n = 0; n < count; ++n) {
        above[n] = below[n] = 0;
        double point[3], along[3];
        turned(view.rotation, places + 3 * n, point);
        turned(view.rotation, directions + 3 * n, along);
        for (int i = 0; i < 3; ++i) point[i] += view.translation[i];
        if (!(point[2] > view.near_plane)) continue;
        const double x = point[0] / point[2], y = point[1] / point[2];
        const double u = view.fx * x + view.cx - 0.5, v = view.fy * y + view.cy - 0.5;
        const double du = (along[0] - x * along[2]) * view.fx, dv = (along[1] - y * along[2]) * view.fy;
        const double length = std::max(std::sqrt(du * du + dv * dv), 1e-12);
        const double across_u = -dv / length, across_v = du / length;
        Pixel middle;
        bool clear = look(photo, u, v, middle);
        size_t taken = 0;
        for (const double sign : {1.0, -1.0}) {
            for (const double aside : model.aside_px) {
                clear = clear && look(photo, u + sign * aside * across_u, v + sign * aside * across_v, sides[taken++]);
            }
        }
        if (!clear) continue;
        double texture = 0, product = 0, power = 0;
        for (int k = 0; k < 3; ++k) {
            double behind = 0, rough = 0;
            for (const Pixel& side : sides) behind += side.colour[k];
            behind /= double(sides.size());
            for (const Pixel& side : sides) rough += std::abs(side.colour[k] - behind);
            texture += rough / double(3 * sides.size());
            const double contrast = photo.colour[k] - behind;
            product += (middle.colour[k] - behind) * contrast;
            power += contrast * contrast;
        }
        const double variance =
            model.noise * model.noise + texture * texture + model.colour_share * model.colour_share * power / 3;
        above[n] = product / variance;
        below[n] = power / variance;
    }
}

}  // namespace cotton
