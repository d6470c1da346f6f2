// SPDX-License-Identifier: Apache-2.0
// Real spherical harmonics of degree 0 to 3 with the signs and constants of Kerbl et al. 2023 (INRIA) and gsplat.
#pragma once

#include "geometry.h"

namespace cotton::COTTON_ISA {

inline constexpr int kMostCoefficients = 16;

// The (degree + 1)² basis functions at the unit vectors of a pack.
template <int degree, class Real>
COTTON_INLINE void sh_basis(const PackOf<Real> unit[3], PackOf<Real>* b) {
    const PackOf<Real> x = unit[0], y = unit[1], z = unit[2];
    b[0] = PackOf<Real>{} + Real(0.28209479177387814);
    if constexpr (degree >= 1) {
        constexpr Real c1 = Real(0.4886025119029199);
        b[1] = -c1 * y, b[2] = c1 * z, b[3] = -c1 * x;
    }
    const PackOf<Real> xx = x * x, yy = y * y, zz = z * z;
    if constexpr (degree >= 2) {
        constexpr Real c = Real(1.0925484305920792), c20 = Real(0.31539156525252005), c22 = Real(0.5462742152960396);
        b[4] = c * x * y, b[5] = -c * y * z, b[6] = c20 * (2 * zz - xx - yy), b[7] = -c * x * z, b[8] = c22 * (xx - yy);
    }
    if constexpr (degree >= 3) {
        constexpr Real c0 = Real(0.5900435899266435), c1 = Real(2.890611442640554), c2 = Real(0.4570457994644658),
                       c3 = Real(0.3731763325901154), c5 = Real(1.445305721320277);
        b[9] = -c0 * y * (3 * xx - yy), b[10] = c1 * x * y * z, b[11] = -c2 * y * (4 * zz - xx - yy);
        b[12] = c3 * z * (2 * zz - 3 * xx - 3 * yy), b[13] = -c2 * x * (4 * zz - xx - yy);
        b[14] = c5 * z * (xx - yy), b[15] = -c0 * x * (xx - 3 * yy);
    }
}

// Gradient by (x, y, z) of sum_k weights[k] * basis_k(x, y, z), the three taken as independent.
template <int degree, class Real>
COTTON_INLINE void sh_direction_gradient(const PackOf<Real> unit[3], const PackOf<Real>* w, PackOf<Real> v[3]) {
    const PackOf<Real> x = unit[0], y = unit[1], z = unit[2];
    v[0] = v[1] = v[2] = PackOf<Real>{};
    if constexpr (degree >= 1) {
        constexpr Real c1 = Real(0.4886025119029199);
        v[0] -= c1 * w[3], v[1] -= c1 * w[1], v[2] += c1 * w[2];
    }
    if constexpr (degree >= 2) {
        constexpr Real c = Real(1.0925484305920792), c20 = Real(0.31539156525252005), c22 = Real(0.5462742152960396);
        v[0] += c * (y * w[4] - z * w[7]) - 2 * c20 * x * w[6] + 2 * c22 * x * w[8];
        v[1] += c * (x * w[4] - z * w[5]) - 2 * c20 * y * w[6] - 2 * c22 * y * w[8];
        v[2] += -c * (y * w[5] + x * w[7]) + 4 * c20 * z * w[6];
    }
    if constexpr (degree >= 3) {
        constexpr Real c0 = Real(0.5900435899266435), c1 = Real(2.890611442640554), c2 = Real(0.4570457994644658),
                       c3 = Real(0.3731763325901154), c5 = Real(1.445305721320277);
        const PackOf<Real> xx = x * x, yy = y * y, zz = z * z;
        v[0] += -6 * c0 * x * y * w[9] + c1 * y * z * w[10] + 2 * c2 * x * y * w[11] - 6 * c3 * x * z * w[12] -
                c2 * (4 * zz - 3 * xx - yy) * w[13] + 2 * c5 * x * z * w[14] - 3 * c0 * (xx - yy) * w[15];
        v[1] += -3 * c0 * (xx - yy) * w[9] + c1 * x * z * w[10] - c2 * (4 * zz - xx - 3 * yy) * w[11] -
                6 * c3 * y * z * w[12] + 2 * c2 * x * y * w[13] - 2 * c5 * y * z * w[14] + 6 * c0 * x * y * w[15];
        v[2] += c1 * x * y * w[10] - 8 * c2 * y * z * w[11] + 3 * c3 * (2 * zz - xx - yy) * w[12] -
                8 * c2 * x * z * w[13] + c5 * (xx - yy) * w[14];
    }
}

// Unit vectors from the camera to the means of a pack; not finite where they coincide, which the near plane excludes.
template <class Real>
struct Directions {
    PackOf<Real> unit[3], inv_length;

    Directions(const Pack position[3], const double centre[3]) {
        Pack d[3];
        for (int k = 0; k < 3; ++k) d[k] = position[k] - centre[k];
        const Pack inverse = 1 / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        for (int k = 0; k < 3; ++k) unit[k] = __builtin_convertvector(d[k] * inverse, PackOf<Real>);
        inv_length = __builtin_convertvector(inverse, PackOf<Real>);
    }
};

COTTON_INLINE void camera_centre(const View& view, double centre[3]) {
    const double *r = view.rotation, *t = view.translation;
    for (int k = 0; k < 3; ++k) centre[k] = -(r[k] * t[0] + r[3 + k] * t[1] + r[6 + k] * t[2]);
}

template <int degree, class Real>
COTTON_INLINE void sh_colour(const Real* sh, const PackOf<Real>* basis, int lane, Real colour[3]) {
    typedef Real Four __attribute__((vector_size(4 * sizeof(Real))));
    constexpr int n = (degree + 1) * (degree + 1);
    // Four numbers at a time. The fourth belongs to the next coefficient and is dropped; the last has no next.
    Four sums[2] = {};
    for (int k = 0; k < n - 1; ++k) {
        Four coefficients;
        std::memcpy(&coefficients, sh + 3 * k, sizeof coefficients);
        sums[k % 2] += basis[k][lane] * coefficients;
    }
    const Four sum = sums[0] + sums[1];
    for (int c = 0; c < 3; ++c) colour[c] = Real(0.5) + (sum[c] + basis[n - 1][lane] * sh[3 * (n - 1) + c]);
}

// Calls `body.template operator()<degree>()` with the degree as a compile-time constant.
template <class Body>
COTTON_INLINE void with_degree(int degree, const Body& body) {
    if (degree == 0) return body.template operator()<0>();
    if (degree == 1) return body.template operator()<1>();
    if (degree == 2) return body.template operator()<2>();
    return body.template operator()<3>();
}

}  // namespace cotton::COTTON_ISA
