// The Python module cotton3dg._native: the optimiser step.
#include "bindings_train.h"

namespace cotton {
namespace {

Moments moments(GaussianArrays<float>& arrays) {
    return {arrays.means.mutable_data(), arrays.quats.mutable_data(), arrays.log_scales.mutable_data(),
            arrays.opacity_logits.mutable_data(), arrays.sh.mutable_data()};
}

py::dict train_step(const py::tuple& gaussians, const py::tuple& first, const py::tuple& second,
                    const py::object& steps, const py::tuple& statistics, const View& view, int sh_degree,
                    const py::object& background, const py::object& target, double dssim, const py::object& rates,
                    int threads) {
    GaussianArrays<float> arrays(gaussians), first_arrays(first), second_arrays(second);
    const int64_t n = arrays.count();
    if (first_arrays.count() != n || second_arrays.count() != n || first_arrays.sh.shape(1) != arrays.sh.shape(1) ||
        second_arrays.sh.shape(1) != arrays.sh.shape(1)) {
        throw py::value_error("the moments must have the shapes of the Gaussians");
    }
    auto step_counts = checked<int32_t>(steps, "steps", {n});
    if (statistics.size() != 3) throw py::value_error("three statistics arrays are needed");
    auto abs_grad = checked<float>(statistics[0], "abs_grad_px", {n}),
         weights = checked<float>(statistics[1], "weight", {n});
    auto seen = checked<int32_t>(statistics[2], "count", {n});
    const auto r = checked<float>(rates, "rates", {16});
    const auto backdrop = checked<float>(background, "background", {3});
    const Target photograph = checked_target(target, dssim, view.width, view.height);
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
    adam_rows.statistics = {abs_grad.mutable_data(), weights.mutable_data(), seen.mutable_data()};
    const float* behind = backdrop.data();
    Frame<float>& frame = scratch_frame<float>();
    ViewGradient<float> gradient;
    {
        py::gil_scoped_release release;
        gradient = loss_gradient(frame, scene, view, photograph, behind, threads);
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
    m.def("train_step", train_step, "gaussians"_a, "first"_a, "second"_a, "steps"_a, "statistics"_a, "view"_a,
          "sh_degree"_a, "background"_a, "target"_a, "dssim"_a, "rates"_a, "threads"_a);
}

}  // namespace cotton
