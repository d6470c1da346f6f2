// SPDX-License-Identifier: Apache-2.0
// The kernels of one instruction set: this file is compiled once for each, with COTTON_ISA as the namespace.
#include "kernels.h"

#include "../vision/match.h"
#include "adam.h"
#include "list_pairs.h"
#include "project.h"
#include "project_backward.h"
#include "rasterize.h"
#include "rasterize_rays.h"
#include "rasterize_values.h"
#include "self_test.h"
#include "ssim.h"

namespace cotton::COTTON_ISA {
namespace {

// Constant-initialised: nothing of a foreign instruction set may run while the module is loaded.
template <class Real>
constexpr Kernels<Real> table() {
    Kernels<Real> t{project<Real>,
                    list_pairs<Real>,
                    forward<Real>,
                    values_backward<Real>,
                    ray_weights<Real>,
                    backward<Real>,
                    project_backward<Real>,
                    loss_forward<Real>,
                    loss_backward<Real>,
                    nullptr,
                    nullptr,
                    self_test};
    if constexpr (sizeof(Real) == 4) t.adam = adam, t.match = match;
    return t;
}

}  // namespace

extern const Kernels<float> float_kernels;
extern const Kernels<double> double_kernels;
constinit const Kernels<float> float_kernels = table<float>();
constinit const Kernels<double> double_kernels = table<double>();

}  // namespace cotton::COTTON_ISA
