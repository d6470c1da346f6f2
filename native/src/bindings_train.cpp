// The Python module cotton3dg._native: loss, gradients and the optimiser step.
#include <cmath>

#include "bindings.h"
#include "threads.h"
#include "train.h"

namespace cotton {
namespace {

struct TargetArrays {
    Array<uint8_t> rgb;
    Array<float> weight;
    Target target;

    TargetArrays(const py::object& image, const py::object& pixel_weight, double dssim, int width, int height) {
        if (!(dssim >= 0 && dssim <= 1)) throw py::value_error("dssim must be between 0 and 1");
        rgb = checked<uint8_t>(image, "target", {height, width, 3});
        if (!pixel_weight.is_none()) {
            weight = checked<float>(pixel_weight, "weight", {height, width});
            double sum = 0;
            for (int64_t i = 0; i < weight.size(); ++i) sum = weight.data()[i] >= 0 ? sum + weight.data()[i] : NAN;
            if (!(sum > 0 && sum < INFINITY))
                throw py::value_error("weight must be finite, >= 0 and not zero everywhere");
        }
        target = {rgb.data(), pixel_weight.is_none() ? nullptr : weight.data(), dssim};
    }
};

py::dict report_of(const LossReport& report) {
    return py::dict("loss"_a = report.loss, "l1"_a = report.l1, "ssim"_a = report.ssim);
}

py::tuple image_loss_of(const py::object& image, const py::object& target, const py::object& weight, double dssim,
                        int threads) {
    const auto body = [&](auto real) -> py::tuple {
        using Real = decltype(real);
        const auto pixels = checked<Real>(image, "image", {-1, -1, 3});
        const int height = int(pixels.shape(0)), width = int(pixels.shape(1));
        if (height < 1 || width < 1) throw py::value_error("image must not be empty");
        const TargetArrays arrays(target, weight, dssim, width, height);
        const int64_t n = int64_t(width) * height;
        Buffer<Real> planar, v_planar;
        planar.reserve(3 * n), v_planar.reserve(3 * n);
        Array<Real> v_image({int64_t(height), int64_t(width), int64_t(3)});
        for (int64_t i = 0; i < 3 * n; ++i) planar[i % 3 * n + i / 3] = pixels.data()[i];
        const LossReport report =
            image_loss<Real>(planar.data(), arrays.target, width, height, thread_count(threads), v_planar.data());
        for (int64_t i = 0; i < 3 * n; ++i) v_image.mutable_data()[i] = v_planar[i % 3 * n + i / 3];
        return py::make_tuple(report_of(report), v_image);
    };
    return py::isinstance<Array<double>>(image) ? body(double()) : body(float());
}

template <class Real>
py::dict gradient_arrays(const Frame<Real>& frame, const ViewGradient<Real>& gradient, int sh_stored) {
    const int64_t n = frame.scene.count;
    auto means = zeros<Real>({n, 3}), quats = zeros<Real>({n, 4}), log_scales = zeros<Real>({n, 3}),
         logits = zeros<Real>({n}), sh = zeros<Real>({n, sh_stored, 3}), grad_px = zeros<Real>({n}),
         abs_grad_px = zeros<Real>({n}), weight = zeros<Real>({n});
    for (int64_t i = 0; i < frame.visible_count; ++i) {
        const int64_t row = frame.visible[i];
        const Real* from = gradient.rows + i * row_gradient::size;
        for (int k = 0; k < 3; ++k) means.mutable_at(row, k) = from[row_gradient::mean + k];
        for (int k = 0; k < 4; ++k) quats.mutable_at(row, k) = from[row_gradient::quat + k];
        for (int k = 0; k < 3; ++k) log_scales.mutable_at(row, k) = from[row_gradient::log_scale + k];
        logits.mutable_at(row) = from[row_gradient::logit];
        grad_px.mutable_at(row) = from[row_gradient::grad_px];
        abs_grad_px.mutable_at(row) = from[row_gradient::abs_grad_px];
        weight.mutable_at(row) = from[row_gradient::weight];
    }
    kernels<Real>().sh_gradient(frame.scene, frame.visible.data(), frame.visible_count, gradient.rows,
                                sh.mutable_data());
    return py::dict("v_means"_a = means, "v_quats"_a = quats, "v_log_scales"_a = log_scales,
                    "v_opacity_logits"_a = logits, "v_sh"_a = sh, "grad_px"_a = grad_px, "abs_grad_px"_a = abs_grad_px,
                    "weight"_a = weight);
}

py::tuple gradients(const py::tuple& gaussians, const View& view, int sh_degree, const py::object& background,
                    const py::object& target, const py::object& weight, double dssim, int threads) {
    return with_precision(gaussians, [&](auto real) {
        using Real = decltype(real);
        const GaussianArrays<Real> arrays(gaussians);
        const auto backdrop = checked<Real>(background, "background", {3});
        const TargetArrays photograph(target, weight, dssim, view.width, view.height);
        const Scene<Real> scene = arrays.scene_with_sh(sh_degree);
        const Real* behind = backdrop.data();
        Frame<Real>& frame = scratch_frame<Real>();
        ViewGradient<Real> gradient;
        {
            py::gil_scoped_release release;
            gradient = view_gradient(frame, scene, view, photograph.target, behind, threads);
        }
        py::dict report = report_of(gradient.report);
        report["finite"] = gradient.finite;
        return py::make_tuple(report, gradient_arrays(frame, gradient, scene.sh_stored), counts(frame));
    });
}

py::tuple image_gradient(const py::tuple& gaussians, const View& view, int sh_degree, const py::object& background,
                         const py::object& v_image, int threads) {
    return with_precision(gaussians, [&](auto real) {
        using Real = decltype(real);
        const GaussianArrays<Real> arrays(gaussians);
        const auto backdrop = checked<Real>(background, "background", {3});
        const auto v = checked<Real>(v_image, "v_image", {view.height, view.width, 3});
        const Scene<Real> scene = arrays.scene_with_sh(sh_degree);
        const Real *behind = backdrop.data(), *pixels = v.data();
        Frame<Real>& frame = scratch_frame<Real>();
        ViewGradient<Real> gradient;
        {
            py::gil_scoped_release release;
            gradient = view_gradient(frame, scene, view, pixels, behind, threads);
        }
        return py::make_tuple(py::bool_(gradient.finite), gradient_arrays(frame, gradient, scene.sh_stored),
                              counts(frame));
    });
}

Moments moments(GaussianArrays<float>& arrays) {
    return {arrays.means.mutable_data(), arrays.quats.mutable_data(), arrays.log_scales.mutable_data(),
            arrays.opacity_logits.mutable_data(), arrays.sh.mutable_data()};
}

py::dict train_step(const py::tuple& gaussians, const py::tuple& first, const py::tuple& second,
                    const py::object& steps, const py::tuple& statistics, const View& view, int sh_degree,
                    const py::object& background, const py::object& target, const py::object& weight, double dssim,
                    const py::object& rates, int threads) {
    GaussianArrays<float> arrays(gaussians), first_arrays(first), second_arrays(second);
    const int64_t n = arrays.count();
    if (first_arrays.count() != n || second_arrays.count() != n || first_arrays.sh.shape(1) != arrays.sh.shape(1) ||
        second_arrays.sh.shape(1) != arrays.sh.shape(1)) {
        throw py::value_error("the moments must have the shapes of the Gaussians");
    }
    auto step_counts = checked<int32_t>(steps, "steps", {n});
    if (statistics.size() != 5) throw py::value_error("five statistics arrays are needed");
    auto grad_px = checked<float>(statistics[0], "grad_px", {n}),
         abs_grad = checked<float>(statistics[1], "abs_grad_px", {n}),
         radius = checked<float>(statistics[2], "max_radius_px", {n}),
         weights = checked<float>(statistics[3], "weight", {n});
    auto seen = checked<int32_t>(statistics[4], "count", {n});
    const auto r = checked<float>(rates, "rates", {16});
    const auto backdrop = checked<float>(background, "background", {3});
    const TargetArrays photograph(target, weight, dssim, view.width, view.height);
    const Scene<float> scene = arrays.scene_with_sh(sh_degree);
    AdamRows adam_rows = {};
    adam_rows.means = arrays.means.mutable_data();
    adam_rows.quats = arrays.quats.mutable_data();
    adam_rows.log_scales = arrays.log_scales.mutable_data();
    adam_rows.opacity_logits = arrays.opacity_logits.mutable_data();
    adam_rows.sh = arrays.sh.mutable_data();
    adam_rows.sh_stored = scene.sh_stored;
    adam_rows.sh_degree = sh_degree;
    adam_rows.first = moments(first_arrays);
    adam_rows.second = moments(second_arrays);
    adam_rows.steps = step_counts.mutable_data();
    adam_rows.rates = {r.at(0), r.at(1), r.at(2), r.at(3), r.at(4), r.at(5), r.at(6), r.at(7), r.at(8)};
    adam_rows.surroundings = {{r.at(9), r.at(10), r.at(11)}, r.at(12), r.at(13), r.at(14), r.at(15)};
    adam_rows.statistics = {grad_px.mutable_data(), abs_grad.mutable_data(), radius.mutable_data(),
                            weights.mutable_data(), seen.mutable_data()};
    const float* behind = backdrop.data();
    Frame<float>& frame = scratch_frame<float>();
    ViewGradient<float> gradient;
    {
        py::gil_scoped_release release;
        gradient = view_gradient(frame, scene, view, photograph.target, behind, threads);
        if (gradient.finite) adam_step(frame, gradient, adam_rows);
    }
    py::dict report = report_of(gradient.report);
    report["finite"] = gradient.finite;
    const py::dict all_counts = counts(frame);
    for (const auto& item : all_counts) report[item.first] = item.second;
    return report;
}

}  // namespace

void bind_training(py::module_& m) {
    m.def("image_loss", image_loss_of, "image"_a, "target"_a, "weight"_a, "dssim"_a, "threads"_a);
    m.def("gradients", gradients, "gaussians"_a, "view"_a, "sh_degree"_a, "background"_a, "target"_a, "weight"_a,
          "dssim"_a, "threads"_a);
    m.def("image_gradient", image_gradient, "gaussians"_a, "view"_a, "sh_degree"_a, "background"_a, "v_image"_a,
          "threads"_a);
    m.def("train_step", train_step, "gaussians"_a, "first"_a, "second"_a, "steps"_a, "statistics"_a, "view"_a,
          "sh_degree"_a, "background"_a, "target"_a, "weight"_a, "dssim"_a, "rates"_a, "threads"_a);
}

}  // namespace cotton
