// SPDX-License-Identifier: Apache-2.0
// The Python module cotton3dg._native: the optimiser step.
#include "bindings_train.h"

namespace cotton {
namespace {

GaussianPointers pointers(GaussianArrays<float>& arrays) {
    return {arrays.means.mutable_data(), arrays.quats.mutable_data(), arrays.log_scales.mutable_data(),
            arrays.opacity_logits.mutable_data(), arrays.sh.mutable_data()};
}

// The state that a step changes: the parameters, Adam's two moments, and the number of steps of each band of each row.
struct OptimiserState {
    GaussianArrays<float> parameters, first, second;
    Array<int32_t> steps;

    OptimiserState(const py::tuple& gaussians, const py::tuple& first_moments, const py::tuple& second_moments,
                   const py::object& step_counts)
        : parameters(gaussians), first(first_moments), second(second_moments) {
        const int64_t n = parameters.count();
        if (first.count() != n || second.count() != n || first.sh.shape(1) != parameters.sh.shape(1) ||
            second.sh.shape(1) != parameters.sh.shape(1)) {
            throw py::value_error("the moments must have the shapes of the Gaussians");
        }
        steps = checked<int32_t>(step_counts, "steps", {n, kBands});
    }
};

// Sums for density control; each step adds to them.
struct StatisticsArrays {
    Array<float> abs_grad_px, weight;
    Array<int32_t> count;

    StatisticsArrays(const py::object& gradients, const py::object& weights, const py::object& counts) {
        abs_grad_px = checked<float>(gradients, "abs_grad_px", {-1});
        weight = checked<float>(weights, "weight", {abs_grad_px.shape(0)});
        count = checked<int32_t>(counts, "count", {abs_grad_px.shape(0)});
    }
};

py::dict train_step(OptimiserState& state, StatisticsArrays& statistics, const View& view, int sh_degree,
                    const py::object& background, const py::object& target, double dssim, const LearningRates& rates,
                    const py::object& rate_factors, int threads) {
    if (statistics.count.shape(0) != state.parameters.count())
        throw py::value_error("the statistics must have as many rows as there are Gaussians");
    const auto backdrop = checked<float>(background, "background", {3});
    const auto factors = checked<float>(rate_factors, "rate_factors", {state.parameters.count(), 2});
    const Target photograph = checked_target(target, dssim, view);
    const Scene<float> scene = state.parameters.scene_with_sh(sh_degree);
    const Statistics sums = {statistics.abs_grad_px.mutable_data(), statistics.weight.mutable_data(),
                             statistics.count.mutable_data(), float(1 / double(view.image_pixels()))};
    const AdamRows rows = {pointers(state.parameters),
                           pointers(state.first),
                           pointers(state.second),
                           scene.sh_stored,
                           sh_degree,
                           state.steps.mutable_data(),
                           rates,
                           factors.data(),
                           nullptr,
                           0,
                           sums};
    const float* behind = backdrop.data();
    Frame<float>& frame = scratch_frame<float>();
    ViewGradient<float> gradient;
    {
        py::gil_scoped_release release;
        gradient = view_gradient(frame, scene, view, behind, threads, loss_against<float>(photograph, view, threads));
        if (gradient.finite) adam_step(frame, gradient, rows);
    }
    py::dict report = report_of(gradient.report);
    report["finite"] = gradient.finite;
    report["n_skipped"] = gradient.spoilt;
    const py::dict all_counts = counts(frame);
    for (const auto& item : all_counts) report[item.first] = item.second;
    return report;
}

}  // namespace

void bind_training(py::module_& m) {
    py::class_<LearningRates>(m, "LearningRates")
        .def(py::init([](float means, float quats, float log_scales, float opacity_logits, float sh0, float sh_rest,
                         float beta1, float beta2, float epsilon) {
                 return LearningRates{means, quats, log_scales, opacity_logits, sh0, sh_rest, beta1, beta2, epsilon};
             }),
             py::kw_only(), "means"_a, "quats"_a, "log_scales"_a, "opacity_logits"_a, "sh0"_a, "sh_rest"_a, "beta1"_a,
             "beta2"_a, "epsilon"_a);
    py::class_<OptimiserState>(m, "OptimiserState")
        .def(py::init<const py::tuple&, const py::tuple&, const py::tuple&, const py::object&>(), py::kw_only(),
             "gaussians"_a, "first"_a, "second"_a, "steps"_a);
    py::class_<StatisticsArrays>(m, "Statistics")
        .def(py::init<const py::object&, const py::object&, const py::object&>(), py::kw_only(), "abs_grad_px"_a,
             "weight"_a, "count"_a);
    m.def("train_step", train_step, py::kw_only(), "state"_a, "statistics"_a, "view"_a, "sh_degree"_a, "background"_a,
          "target"_a, "dssim"_a, "rates"_a, "rate_factors"_a, "threads"_a);
}

}  // namespace cotton
