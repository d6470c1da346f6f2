#include "kernels_isa.h"

#include "simd.h"

namespace cotton::COTTON_ISA {

bool self_test() {
    volatile float zero = 0.0f;
    const float nan = zero / zero, infinity = 1.0f / zero;
    const bool scalar = nan != nan && !(nan <= 0.0f) && !(nan > 0.0f) && infinity - infinity != 0.0f;
    return scalar && !any(broadcast(nan) == broadcast(nan)) && !any(broadcast(nan) > broadcast(zero + 0.0f));
}

// Constant-initialised: nothing of a foreign instruction set may run while the module is loaded.
template <class Real>
constexpr Kernels<Real> table() {
    Kernels<Real> t{project<Real>,          hit_tiles<Real>,   forward<Real>,
                    values_backward<Real>,  ray_weights<Real>, backward<Real>,
                    project_backward<Real>, sh_gradient<Real>, loss_forward<Real>,
                    loss_backward<Real>,    nullptr,           self_test};
    if constexpr (sizeof(Real) == 4) t.adam = adam;
    return t;
}

extern const Kernels<float> float_kernels;
extern const Kernels<double> double_kernels;
constinit const Kernels<float> float_kernels = table<float>();
constinit const Kernels<double> double_kernels = table<double>();

}  // namespace cotton::COTTON_ISA
