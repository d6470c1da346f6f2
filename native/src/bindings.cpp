// SPDX-License-Identifier: Apache-2.0
// The Python module cotton3dg._native: rendering. Its checked interface is cotton3dg/gaussians/rasterizer.py; those for
// matching descriptors and for thin lines in photos are cotton3dg/sfm/matching.py and plant_map/photo_lines.py.
#include "bindings.h"

#include "dispatch.h"
#include "rays.h"
#include "values.h"

#include <pybind11/stl.h>

#include <array>
#include <optional>

namespace cotton {

std::string shape_text(const std::vector<int64_t>& shape) {
    std::string text = "(";
    for (size_t k = 0; k < shape.size(); ++k) {
        text += (k > 0 ? ", " : "") + (shape[k] == -1 ? std::string("N") : std::to_string(shape[k]));
    }
    return text + ")";
}

namespace {

// `window`: left, top, width and height in the image, or none for the whole image.
View make_view(int width, int height, double fx, double fy, double cx, double cy, const py::object& cam_from_scene,
               double near_plane, const std::optional<std::array<int, 4>>& window) {
    const auto pose = checked<double>(cam_from_scene, "cam_from_scene", {3, 4});
    if (width < 1 || height < 1 || width > 32768 || height > 32768)
        throw py::value_error("image size must be 1..32768");
    if (!(fx > 0) || !(fy > 0) || !(near_plane > 0)) throw py::value_error("fx, fy and near_plane must be positive");
    View view = {width, height, fx, fy, cx, cy, {}, {}, near_plane, width, height, 0, 0};
    if (window) {
        const auto [left, top, window_width, window_height] = *window;
        if (left < 0 || top < 0 || window_width < 1 || window_height < 1 || window_width > width - left ||
            window_height > height - top)
            throw py::value_error("the window must lie in the image");
        view.left = left, view.top = top, view.width = window_width, view.height = window_height;
        view.cx -= left, view.cy -= top;
    }
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) view.rotation[3 * i + j] = pose.at(i, j);
        view.translation[i] = pose.at(i, 3);
    }
    double total = fx + fy + cx + cy;
    for (double number : view.rotation) total += number;
    for (double number : view.translation) total += number;
    if (!(total - total == 0)) throw py::value_error("the camera has NaN or infinite numbers");
    return view;
}

// Renders the channels of `scene` with depth; returns image, transmittance, depth and counts.
template <class Real>
py::tuple render_scene(Scene<Real> scene, const View& view, const Real* background, int threads) {
    const int channels = scene.channels;
    scene.with_depth = true;
    Array<Real> image({int64_t(view.height), int64_t(view.width), int64_t(channels)});
    Array<Real> transmittance({view.height, view.width}), depth({view.height, view.width});
    std::vector<Plane<Real>> planes;
    for (int c = 0; c < channels; ++c) planes.push_back({image.mutable_data() + c, channels});
    Real *depths = depth.mutable_data(), *through = transmittance.mutable_data();
    planes.push_back({depths, 1});
    std::vector<Real> backdrop(background, background + channels);
    backdrop.push_back(0);
    Frame<Real>& frame = scratch_frame<Real>();
    {
        py::gil_scoped_release release;
        frame.prepare(scene, view, threads);
        frame.blend(backdrop.data(), planes.data(), through);
        for (int64_t i = 0; i < view.pixels(); ++i) depths[i] = through[i] < 1 ? depths[i] / (1 - through[i]) : 0;
    }
    return py::make_tuple(image, transmittance, depth, counts(frame));
}

py::tuple render(const py::tuple& gaussians, const View& view, int sh_degree, const py::object& background,
                 int threads) {
    return with_precision(gaussians, [&](auto real) {
        using Real = decltype(real);
        const GaussianArrays<Real> arrays(gaussians);
        const auto backdrop = checked<Real>(background, "background", {3});
        return render_scene(arrays.scene_with_sh(sh_degree), view, backdrop.data(), threads);
    });
}

py::tuple render_values(const py::tuple& gaussians, const py::object& values, const View& view,
                        const py::object& background, int threads) {
    return with_precision(gaussians, [&](auto real) {
        using Real = decltype(real);
        const GaussianArrays<Real> arrays(gaussians);
        const auto rows = checked<Real>(values, "values", {arrays.count(), -1});
        const auto backdrop = checked<Real>(background, "background", {rows.shape(1)});
        Scene<Real> scene = arrays.scene();
        scene.values = rows.data();
        scene.channels = int(rows.shape(1));
        if (!kernels<Real>().forward(scene.channels + 1))
            throw py::value_error("values must have 1, 3, 4, 16 or 32 channels");
        return render_scene(scene, view, backdrop.data(), threads);
    });
}

py::tuple accumulate_weights(const py::tuple& gaussians, const View& view, const py::object& mask_ids, int threads) {
    const GaussianArrays<float> arrays(gaussians);
    const auto ids = checked<uint16_t>(mask_ids, "mask_ids", {view.height, view.width});
    auto total = zeros<float>({arrays.count()});
    float* to = total.mutable_data();
    const uint16_t* from = ids.data();
    std::vector<MaskWeight> weights;
    {
        Frame<float>& frame = scratch_frame<float>();
        py::gil_scoped_release release;
        frame.prepare(arrays.scene(), view, threads);
        weights = mask_weights(frame, from, to);
    }
    const auto n = int64_t(weights.size());
    Array<int64_t> rows(n);
    Array<uint16_t> found_ids(n);
    Array<float> values(n);
    for (int64_t i = 0; i < n; ++i) {
        rows.mutable_at(i) = weights[size_t(i)].row;
        found_ids.mutable_at(i) = weights[size_t(i)].id;
        values.mutable_at(i) = weights[size_t(i)].weight;
    }
    return py::make_tuple(total, rows, found_ids, values);
}

py::tuple ray_weights_of(const py::tuple& gaussians, const View& view, const py::object& pixels, int threads) {
    return with_precision(gaussians, [&](auto real) -> py::tuple {
        using Real = decltype(real);
        const GaussianArrays<Real> arrays(gaussians);
        const auto rays = checked<int64_t>(pixels, "pixels", {-1, 2});
        const int64_t *at = rays.data(), n = rays.shape(0);
        for (int64_t k = 0; k < n; ++k) {
            if (at[2 * k] < 0 || at[2 * k] >= view.width || at[2 * k + 1] < 0 || at[2 * k + 1] >= view.height)
                throw py::value_error("pixels must lie in the image");
        }
        RayWeights<Real> found;
        {
            Frame<Real>& frame = scratch_frame<Real>();
            py::gil_scoped_release release;
            frame.prepare(arrays.scene(), view, threads);
            found = ray_weights(frame, at, n);
        }
        return py::make_tuple(Array<int64_t>(int64_t(found.starts.size()), found.starts.data()),
                              Array<int32_t>(int64_t(found.rows.size()), found.rows.data()),
                              Array<Real>(int64_t(found.weights.size()), found.weights.data()));
    });
}

}  // namespace
}  // namespace cotton

PYBIND11_MODULE(_native, m) {
    using namespace cotton;
    m.doc() = "C++ core of cotton3dg; use cotton3dg.gaussians.rasterizer instead.";
    for (const std::string& name : instruction_sets()) {
        use_instruction_set(name);
        if (!kernels<float>().self_test() || !kernels<double>().self_test()) {
            throw py::import_error("this build does not recognise NaN (-ffast-math?)");
        }
    }
    use_instruction_set(preferred_instruction_set());
    m.def("instruction_sets", instruction_sets);
    m.def("instruction_set", instruction_set);
    m.def("use_instruction_set", use_instruction_set, "name"_a);
    py::class_<View>(m, "View").def(py::init(&make_view), "width"_a, "height"_a, "fx"_a, "fy"_a, "cx"_a, "cy"_a,
                                    "cam_from_scene"_a, "near_plane"_a, "window"_a = py::none());
    m.def("render", render, "gaussians"_a, "view"_a, "sh_degree"_a, "background"_a, "threads"_a);
    m.def("render_values", render_values, "gaussians"_a, "values"_a, "view"_a, "background"_a, "threads"_a);
    m.def("accumulate_weights", accumulate_weights, "gaussians"_a, "view"_a, "mask_ids"_a, "threads"_a);
    m.def("ray_weights", ray_weights_of, "gaussians"_a, "view"_a, "pixels"_a, "threads"_a);
    bind_training(m);
    bind_matching(m);
    bind_lines(m);
    bind_for_tests(m);
}
