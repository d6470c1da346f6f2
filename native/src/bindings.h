// SPDX-License-Identifier: Apache-2.0
// Checked access to numpy arrays. Nothing is converted: a wrong dtype, shape or memory order is an error.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <string>
#include <vector>

#include "frame.h"

namespace cotton {

namespace py = pybind11;
using namespace py::literals;

template <class T>
using Array = py::array_t<T, py::array::c_style>;

std::string shape_text(const std::vector<int64_t>& shape);

// The array itself; -1 in `shape` stands for any length.
template <class T>
Array<T> checked(const py::object& object, const char* name, const std::vector<int64_t>& shape) {
    const std::string wanted = std::string(py::str(py::dtype::of<T>())) + " " + shape_text(shape);
    if (!py::isinstance<Array<T>>(object)) {
        throw py::type_error(std::string(name) + " must be a C-contiguous array " + wanted);
    }
    auto array = py::reinterpret_borrow<Array<T>>(object);
    bool fits = array.ndim() == int64_t(shape.size());
    for (size_t k = 0; fits && k < shape.size(); ++k) fits = shape[k] == -1 || array.shape(int64_t(k)) == shape[k];
    if (!fits) throw py::value_error(std::string(name) + " must have the shape " + shape_text(shape));
    return array;
}

template <class T>
Array<T> zeros(const std::vector<int64_t>& shape) {
    Array<T> array(shape);
    std::fill(array.mutable_data(), array.mutable_data() + array.size(), T(0));
    return array;
}

// Five arrays in the layout of core.scene.Gaussians: the parameters, or their moments or gradients.
template <class Real>
struct GaussianArrays {
    Array<Real> means, quats, log_scales, opacity_logits, sh;

    explicit GaussianArrays(const py::tuple& arrays) {
        if (arrays.size() != 5)
            throw py::value_error("five arrays are needed: means, quats, log_scales, opacity_logits, sh");
        means = checked<Real>(arrays[0], "means", {-1, 3});
        const int64_t n = means.shape(0);
        if (n >= int64_t(1) << 31) throw py::value_error("too many Gaussians");
        quats = checked<Real>(arrays[1], "quats", {n, 4});
        log_scales = checked<Real>(arrays[2], "log_scales", {n, 3});
        opacity_logits = checked<Real>(arrays[3], "opacity_logits", {n});
        sh = checked<Real>(arrays[4], "sh", {n, -1, 3});
        const int64_t k = sh.shape(1);
        if (k != 1 && k != 4 && k != 9 && k != 16) throw py::value_error("sh must have 1, 4, 9 or 16 coefficients");
    }

    int64_t count() const { return means.shape(0); }

    Scene<Real> scene() const {
        return {count(), means.data(), quats.data(), log_scales.data(), opacity_logits.data(), nullptr, 0, 0, nullptr,
                0,       false};
    }

    Scene<Real> scene_with_sh(int degree) const {
        if (degree < 0 || (degree + 1) * (degree + 1) > sh.shape(1)) {
            throw py::value_error("sh_degree must be between 0 and what sh has coefficients for");
        }
        Scene<Real> result = scene();
        result.sh = sh.data();
        result.sh_stored = int(sh.shape(1));
        result.sh_degree = degree;
        result.channels = 3;
        return result;
    }
};

// Calls body(Real()) with the precision of the first array.
template <class Body>
auto with_precision(const py::tuple& arrays, const Body& body) {
    if (arrays.size() > 0 && py::isinstance<Array<double>>(arrays[0])) return body(double());
    return body(float());
}

template <class Real>
py::dict counts(const Frame<Real>& frame) {
    return py::dict("n_pairs"_a = frame.pair_count, "n_visible"_a = frame.visible_count,
                    "culled"_a = py::dict("non_finite"_a = frame.culled[kNonFinite], "behind"_a = frame.culled[kBehind],
                                          "degenerate"_a = frame.culled[kDegenerate], "faint"_a = frame.culled[kFaint],
                                          "outside"_a = frame.culled[kOutside]));
}

void bind_training(py::module_& m);
void bind_matching(py::module_& m);
void bind_lines(py::module_& m);
void bind_for_tests(py::module_& m);

}  // namespace cotton
