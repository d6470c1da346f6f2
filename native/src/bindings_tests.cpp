// SPDX-License-Identifier: Apache-2.0
// cotton3dg._native.for_tests: loss and gradients one by one; the package itself only uses them together in train_step.
#include "bindings_train.h"
#include "memory.h"
#include "threads.h"

namespace cotton {
namespace {

py::tuple image_loss_of(const py::object& image, const py::object& target, double dssim, int threads) {
    const auto body = [&](auto real) -> py::tuple {
        using Real = decltype(real);
        const auto pixels = checked<Real>(image, "image", {-1, -1, 3});
        const int height = int(pixels.shape(0)), width = int(pixels.shape(1));
        if (height < 1 || width < 1) throw py::value_error("image must not be empty");
        View view = {};
        view.width = view.image_width = width, view.height = view.image_height = height;
        const Target photograph = checked_target(target, dssim, view);
        const int64_t n = view.pixels();
        Buffer<Real> planar, v_planar;
        planar.reserve(3 * n), v_planar.reserve(3 * n);
        Array<Real> v_image({int64_t(height), int64_t(width), int64_t(3)});
        for (int64_t i = 0; i < 3 * n; ++i) planar[i % 3 * n + i / 3] = pixels.data()[i];
        const LossReport report =
            image_loss<Real>(planar.data(), photograph, width, height, thread_count(threads), v_planar.data());
        for (int64_t i = 0; i < 3 * n; ++i) v_image.mutable_data()[i] = v_planar[i % 3 * n + i / 3];
        return py::make_tuple(report_of(report), v_image);
    };
    return py::isinstance<Array<double>>(image) ? body(double()) : body(float());
}

template <class Real>
py::dict gradient_arrays(const Frame<Real>& frame, const ViewGradient<Real>& gradient) {
    const int64_t n = frame.scene.count;
    auto means = zeros<Real>({n, 3}), quats = zeros<Real>({n, 4}), log_scales = zeros<Real>({n, 3}),
         logits = zeros<Real>({n}), colours = zeros<Real>({n, 3}), directions = zeros<Real>({n, 3}),
         abs_grad_px = zeros<Real>({n}), weight = zeros<Real>({n});
    for (int64_t i = 0; i < frame.visible_count; ++i) {
        const int64_t row = frame.visible[i];
        const Real* from = gradient.rows + i * row_gradient::size;
        for (int k = 0; k < 3; ++k) {
            means.mutable_at(row, k) = from[row_gradient::mean + k];
            colours.mutable_at(row, k) = from[row_gradient::colour + k];
            directions.mutable_at(row, k) = from[row_gradient::unit + k];
        }
        for (int k = 0; k < 4; ++k) quats.mutable_at(row, k) = from[row_gradient::quat + k];
        for (int k = 0; k < 3; ++k) log_scales.mutable_at(row, k) = from[row_gradient::log_scale + k];
        logits.mutable_at(row) = from[row_gradient::logit];
        abs_grad_px.mutable_at(row) = from[row_gradient::abs_grad_px];
        weight.mutable_at(row) = from[row_gradient::weight];
    }
    return py::dict("v_means"_a = means, "v_quats"_a = quats, "v_log_scales"_a = log_scales,
                    "v_opacity_logits"_a = logits, "v_colours"_a = colours, "directions"_a = directions,
                    "abs_grad_px"_a = abs_grad_px, "weight"_a = weight);
}

// Gradients of a view, of which `loss_of(view, threads)` gives the loss in the precision of its argument.
template <class LossOf>
py::tuple gradients_by(const py::tuple& gaussians, const View& view, int sh_degree, const py::object& background,
                       int threads, const LossOf& loss_of) {
    return with_precision(gaussians, [&](auto real) {
        using Real = decltype(real);
        const GaussianArrays<Real> arrays(gaussians);
        const auto backdrop = checked<Real>(background, "background", {3});
        const Real* behind = backdrop.data();
        const Scene<Real> scene = arrays.scene_with_sh(sh_degree);
        const ImageLoss<Real> loss = loss_of(real);
        Frame<Real>& frame = scratch_frame<Real>();
        ViewGradient<Real> gradient;
        {
            py::gil_scoped_release release;
            gradient = view_gradient(frame, scene, view, behind, threads, loss);
        }
        py::dict report = report_of(gradient.report);
        report["finite"] = gradient.finite && gradient.spoilt == 0;
        return py::make_tuple(report, gradient_arrays(frame, gradient), counts(frame));
    });
}

py::tuple gradients(const py::tuple& gaussians, const View& view, int sh_degree, const py::object& background,
                    const py::object& target, double dssim, int threads) {
    const Target photograph = checked_target(target, dssim, view);
    return gradients_by(gaussians, view, sh_degree, background, threads,
                        [&](auto real) { return loss_against<decltype(real)>(photograph, view, threads); });
}

py::tuple image_gradient(const py::tuple& gaussians, const View& view, int sh_degree, const py::object& background,
                         const py::object& v_image, int threads) {
    return gradients_by(gaussians, view, sh_degree, background, threads, [&](auto real) {
        using Real = decltype(real);
        const Real* pixels = checked<Real>(v_image, "v_image", {view.height, view.width, 3}).data();
        return ImageLoss<Real>([pixels, &view](const Real*, Real* planar) {
            for (int64_t i = 0; i < 3 * view.pixels(); ++i) planar[i % 3 * view.pixels() + i / 3] = pixels[i];
            return LossReport{0, 0, 0};
        });
    });
}

}  // namespace

void bind_for_tests(py::module_& m) {
    py::module_ tests = m.def_submodule("for_tests", "What only tests call.");
    tests.def("available_memory", read_available_memory, "root"_a);
    tests.def("pretend_available_memory", pretend_available_memory, "bytes"_a);
    tests.def("image_loss", image_loss_of, "image"_a, "target"_a, "dssim"_a, "threads"_a);
    tests.def("gradients", gradients, "gaussians"_a, "view"_a, "sh_degree"_a, "background"_a, "target"_a, "dssim"_a,
              "threads"_a);
    tests.def("image_gradient", image_gradient, "gaussians"_a, "view"_a, "sh_degree"_a, "background"_a, "v_image"_a,
              "threads"_a);
}

}  // namespace cotton
