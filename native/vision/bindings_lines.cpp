// SPDX-License-Identifier: Apache-2.0
// Thin lines in photos. The Python interface is cotton3dg/plant_map/photo_lines.py.
#include <pybind11/stl.h>

#include "../src/bindings.h"
#include "lines.h"

namespace cotton {
namespace {

py::tuple line_evidence_of(const py::list& pictures, const py::list& views, const py::object& places,
                           const py::object& directions, const py::object& colours, std::vector<double> aside_px,
                           double noise, double colour_share, int threads) {
    const auto count = int64_t(views.size());
    const auto wood = checked<double>(colours, "colours", {count, 3});
    const auto from = checked<double>(places, "places", {-1, 3});
    const auto along = checked<double>(directions, "directions", {from.shape(0), 3});
    if (int64_t(pictures.size()) != count) throw py::value_error("each picture needs its view");
    if (aside_px.empty() || !(noise > 0)) throw py::value_error("aside_px and noise must be positive");
    std::vector<Array<uint8_t>> held;  // keeps the pixels alive during the reading
    std::vector<Photo> photos;
    for (int64_t n = 0; n < count; ++n) {
        const View& view = views[size_t(n)].cast<const View&>();
        held.push_back(checked<uint8_t>(pictures[size_t(n)], "picture", {view.height, view.width, 4}));
        photos.push_back({held.back().data(), view, {wood.at(n, 0), wood.at(n, 1), wood.at(n, 2)}});
    }
    const LineModel model = {std::move(aside_px), noise, colour_share};
    const int64_t pieces = from.shape(0);
    Array<double> above({count, pieces}), below({count, pieces});
    const double *starts = from.data(), *headings = along.data();
    double *first = above.mutable_data(), *second = below.mutable_data();
    {
        const py::gil_scoped_release release;
        parallel_for(count, threads, [&](int64_t n) {
            line_evidence(photos[size_t(n)], model, starts, headings, pieces, first + n * pieces, second + n * pieces);
        });
    }
    return py::make_tuple(above, below);
}

}  // namespace

void bind_lines(py::module_& m) {
    m.def("line_evidence", line_evidence_of, "pictures"_a, "views"_a, "places"_a, "directions"_a, "colours"_a,
          "aside_px"_a, "noise"_a, "colour_share"_a, "threads"_a);
}

}  // namespace cotton
