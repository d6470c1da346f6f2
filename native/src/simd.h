// SPDX-License-Identifier: Apache-2.0
// Vectors of the instruction set that the including file is compiled for, by the GCC/Clang vector extensions.
// Comparisons give integer vectors of 0 and -1; `mask ? a : b` selects.
#pragma once

#include <cstdint>
#include <cstring>
#include <utility>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#include "scene.h"

namespace cotton::COTTON_ISA {

#if defined(__AVX512F__)
inline constexpr int kVectorBytes = 64;
#elif defined(__AVX2__)
inline constexpr int kVectorBytes = 32;
#else
inline constexpr int kVectorBytes = 16;
#endif

template <class Real>
struct VectorOf {
    typedef Real type __attribute__((vector_size(kVectorBytes)));
};
template <class Real>
using Vec = typename VectorOf<Real>::type;
template <class Real>
using Mask = decltype(Vec<Real>{} < Vec<Real>{});
template <class Real>
inline constexpr int kLanes = kVectorBytes / int(sizeof(Real));

#define COTTON_INLINE static inline __attribute__((always_inline))
#define COTTON_INLINE_BODY __attribute__((always_inline))  // of a lambda

template <class Real>
COTTON_INLINE Vec<Real> broadcast(Real value) {
    return value - Vec<Real>{};  // x - 0 is x, also for -0, so this costs nothing
}

template <class Real>
COTTON_INLINE Vec<Real> load(const Real* from) {
    Vec<Real> result;
    std::memcpy(&result, from, sizeof result);
    return result;
}

template <class Real>
COTTON_INLINE void store(Real* to, Vec<Real> value) {
    std::memcpy(to, &value, sizeof value);
}

// The first n lanes, the others zero.
template <class T>
COTTON_INLINE Vec<T> load_part(const T* from, int n) {
    Vec<T> result{};
    if (n == kLanes<T>) return load(from);
    for (int i = 0; i < n; ++i) result[i] = from[i];
    return result;
}

template <class T>
COTTON_INLINE void store_part(T* to, Vec<T> value, int n) {
    if (n == kLanes<T>) return store(to, value);
    for (int i = 0; i < n; ++i) to[i] = value[i];
}

// fma: a b + c and fnma: c - a b, rounded once where the instruction set can. minimum, maximum: the second operand when
// either is NaN. lane_bits: one bit per true lane.
#if defined(__AVX512F__)
COTTON_INLINE Vec<float> fma(Vec<float> a, Vec<float> b, Vec<float> c) { return _mm512_fmadd_ps(a, b, c); }
COTTON_INLINE Vec<float> fnma(Vec<float> a, Vec<float> b, Vec<float> c) { return _mm512_fnmadd_ps(a, b, c); }
COTTON_INLINE Vec<float> minimum(Vec<float> a, Vec<float> b) { return _mm512_maskz_min_ps(0xffff, a, b); }
COTTON_INLINE Vec<float> maximum(Vec<float> a, Vec<float> b) { return _mm512_maskz_max_ps(0xffff, a, b); }
COTTON_INLINE Vec<double> fma(Vec<double> a, Vec<double> b, Vec<double> c) { return _mm512_fmadd_pd(a, b, c); }
COTTON_INLINE Vec<double> fnma(Vec<double> a, Vec<double> b, Vec<double> c) { return _mm512_fnmadd_pd(a, b, c); }
COTTON_INLINE Vec<double> minimum(Vec<double> a, Vec<double> b) { return _mm512_maskz_min_pd(0xff, a, b); }
COTTON_INLINE Vec<double> maximum(Vec<double> a, Vec<double> b) { return _mm512_maskz_max_pd(0xff, a, b); }
COTTON_INLINE unsigned lane_bits(Mask<float> m) { return _mm512_movepi32_mask((__m512i)m); }
COTTON_INLINE unsigned lane_bits(Mask<double> m) { return _mm512_movepi64_mask((__m512i)m); }
COTTON_INLINE Vec<float> sqrt(Vec<float> a) { return _mm512_maskz_sqrt_ps(0xffff, a); }
COTTON_INLINE Vec<double> sqrt(Vec<double> a) { return _mm512_maskz_sqrt_pd(0xff, a); }
#elif defined(__AVX2__)
COTTON_INLINE Vec<float> fma(Vec<float> a, Vec<float> b, Vec<float> c) { return _mm256_fmadd_ps(a, b, c); }
COTTON_INLINE Vec<float> fnma(Vec<float> a, Vec<float> b, Vec<float> c) { return _mm256_fnmadd_ps(a, b, c); }
COTTON_INLINE Vec<float> minimum(Vec<float> a, Vec<float> b) { return _mm256_min_ps(a, b); }
COTTON_INLINE Vec<float> maximum(Vec<float> a, Vec<float> b) { return _mm256_max_ps(a, b); }
COTTON_INLINE Vec<double> fma(Vec<double> a, Vec<double> b, Vec<double> c) { return _mm256_fmadd_pd(a, b, c); }
COTTON_INLINE Vec<double> fnma(Vec<double> a, Vec<double> b, Vec<double> c) { return _mm256_fnmadd_pd(a, b, c); }
COTTON_INLINE Vec<double> minimum(Vec<double> a, Vec<double> b) { return _mm256_min_pd(a, b); }
COTTON_INLINE Vec<double> maximum(Vec<double> a, Vec<double> b) { return _mm256_max_pd(a, b); }
COTTON_INLINE unsigned lane_bits(Mask<float> m) { return unsigned(_mm256_movemask_ps((__m256)m)); }
COTTON_INLINE unsigned lane_bits(Mask<double> m) { return unsigned(_mm256_movemask_pd((__m256d)m)); }
COTTON_INLINE Vec<float> sqrt(Vec<float> a) { return _mm256_sqrt_ps(a); }
COTTON_INLINE Vec<double> sqrt(Vec<double> a) { return _mm256_sqrt_pd(a); }
#else
#if defined(__aarch64__)
COTTON_INLINE Vec<float> fma(Vec<float> a, Vec<float> b, Vec<float> c) { return vfmaq_f32(c, a, b); }
COTTON_INLINE Vec<float> fnma(Vec<float> a, Vec<float> b, Vec<float> c) { return vfmsq_f32(c, a, b); }
COTTON_INLINE Vec<double> fma(Vec<double> a, Vec<double> b, Vec<double> c) { return vfmaq_f64(c, a, b); }
COTTON_INLINE Vec<double> fnma(Vec<double> a, Vec<double> b, Vec<double> c) { return vfmsq_f64(c, a, b); }
#else
template <class V>
COTTON_INLINE V fma(V a, V b, V c) {
    return a * b + c;
}
template <class V>
COTTON_INLINE V fnma(V a, V b, V c) {
    return c - a * b;
}
#endif
#if defined(__SSE4_1__)
COTTON_INLINE Vec<float> minimum(Vec<float> a, Vec<float> b) { return _mm_min_ps(a, b); }
COTTON_INLINE Vec<float> maximum(Vec<float> a, Vec<float> b) { return _mm_max_ps(a, b); }
COTTON_INLINE Vec<double> minimum(Vec<double> a, Vec<double> b) { return _mm_min_pd(a, b); }
COTTON_INLINE Vec<double> maximum(Vec<double> a, Vec<double> b) { return _mm_max_pd(a, b); }
COTTON_INLINE unsigned lane_bits(Mask<float> m) { return unsigned(_mm_movemask_ps((__m128)m)); }
COTTON_INLINE unsigned lane_bits(Mask<double> m) { return unsigned(_mm_movemask_pd((__m128d)m)); }
COTTON_INLINE Vec<float> sqrt(Vec<float> a) { return _mm_sqrt_ps(a); }
COTTON_INLINE Vec<double> sqrt(Vec<double> a) { return _mm_sqrt_pd(a); }
#else
template <class V>
COTTON_INLINE V minimum(V a, V b) {
    return a < b ? a : b;
}
template <class V>
COTTON_INLINE V maximum(V a, V b) {
    return a > b ? a : b;
}
template <class M>
COTTON_INLINE unsigned lane_bits(M m) {
    unsigned bits = 0;
    for (int i = 0; i < int(sizeof(M) / sizeof(m[0])); ++i) bits |= unsigned(m[i] != 0) << i;
    return bits;
}
template <class V>
COTTON_INLINE V sqrt(V a) {
    for (int i = 0; i < int(sizeof(V) / sizeof(a[0])); ++i) a[i] = decltype(a[0] + 0)(__builtin_sqrt(a[i]));
    return a;
}
#endif
#endif

template <class M>
COTTON_INLINE bool any(M m) {
    return lane_bits(m) != 0;
}

COTTON_INLINE Vec<float> absolute(Vec<float> a) { return (Vec<float>)((Mask<float>)a & 0x7fffffff); }
COTTON_INLINE Vec<double> absolute(Vec<double> a) { return (Vec<double>)((Mask<double>)a & 0x7fffffffffffffff); }

// Adds the halves of every `segment` lanes of a and of b, and puts the results of a before those of b. In one operand
// every lane keeps its place, which saves a shuffle.
template <int segment, class Real, int... lane>
COTTON_INLINE Vec<Real> add_halves(Vec<Real> a, Vec<Real> b, std::integer_sequence<int, lane...>) {
    constexpr int half = segment / 2, lanes = kLanes<Real>;
    return __builtin_shufflevector(a, b, (lane + lane / half % 2 * lanes)...) +
           __builtin_shufflevector(a, b, (lane / half % 2 == 0 ? lane + half : lane - half + lanes)...);
}

// Lane i of the result is the sum of the lanes of v[i], pairwise in a fixed order.
template <class Real, int segment = 2>
COTTON_INLINE Vec<Real> sums_of_lanes(const Vec<Real>* v) {
    if constexpr (segment > kLanes<Real>) {
        return v[0];
    } else {
        return add_halves<segment, Real>(sums_of_lanes<Real, segment * 2>(v),
                                         sums_of_lanes<Real, segment * 2>(v + segment / 2),
                                         std::make_integer_sequence<int, kLanes<Real>>());
    }
}

// Sum of the lanes, pairwise in a fixed order.
template <class Real>
COTTON_INLINE Real sum(Vec<Real> value) {
    Real lanes[kLanes<Real>];
    std::memcpy(lanes, &value, sizeof value);
    for (int half = kLanes<Real> / 2; half > 0; half /= 2) {
        for (int i = 0; i < half; ++i) lanes[i] += lanes[i + half];
    }
    return lanes[0];
}

template <class Real>
struct Exp2;

// Minimax polynomial of 2^f on [-0.5, 0.5], relative error 2e-7 with rounding.
template <>
struct Exp2<float> {
    typedef uint32_t Bits __attribute__((vector_size(kVectorBytes)));  // unsigned: allowed to overflow beyond ±126
    static constexpr float magic = 12582912.0f;                        // 1.5 * 2^23: adding it rounds to an integer
    static constexpr int shift = 23;
    static constexpr float coefficients[] = {1.00000007f,   0.693146967f,   0.240221197f,
                                             0.0555071331f, 0.00967554152f, 0.00132764602f};
};

// Taylor series of 2^f on [-0.5, 0.5], relative error below 1e-16.
template <>
struct Exp2<double> {
    typedef uint64_t Bits __attribute__((vector_size(kVectorBytes)));
    static constexpr double magic = 6755399441055744.0;  // 1.5 * 2^52
    static constexpr int shift = 52;
    static constexpr double coefficients[] = {1.0,
                                              0.69314718055994529,
                                              0.24022650695910069,
                                              0.055504108664821576,
                                              0.0096181291076284769,
                                              0.0013333558146428441,
                                              0.00015403530393381606,
                                              1.5252733804059838e-05,
                                              1.3215486790144305e-06,
                                              1.0178086009239696e-07,
                                              7.0549116208011209e-09,
                                              4.4455382718708101e-10,
                                              2.5678435993488196e-11,
                                              1.3691488853904124e-12};
};

// 2^x for |x| below 126 (float) or 1022 (double).
template <class Real>
COTTON_INLINE Vec<Real> exp2(Vec<Real> x) {
    using E = Exp2<Real>;
    constexpr int n = int(sizeof E::coefficients / sizeof(Real));
    const Vec<Real> shifted = x + E::magic;
    const Vec<Real> f = x - (shifted - E::magic);
    Vec<Real> result = broadcast(E::coefficients[n - 1]);
    for (int k = n - 2; k >= 0; --k) result = fma(result, f, broadcast(E::coefficients[k]));
    const typename E::Bits exponent = (typename E::Bits)shifted << E::shift;
    return (Vec<Real>)((typename E::Bits)result + exponent);
}

// log2 of positive normal doubles: the series of atanh around 1, relative error about 1e-16.
COTTON_INLINE Vec<double> log2(Vec<double> x) {
    const Mask<double> bits = (Mask<double>)x;
    constexpr int64_t sqrt_half = 0x3fe6a09e667f3bcd;
    const Mask<double> exponent = (bits - sqrt_half) >> 52;
    const Vec<double> mantissa = (Vec<double>)(bits - (exponent << 52));
    const Vec<double> t = (mantissa - 1) / (mantissa + 1), t2 = t * t;
    Vec<double> series = broadcast(1.0 / 21.0);
    for (int k = 19; k >= 1; k -= 2) series = fma(series, t2, broadcast(1.0 / k));
    return __builtin_convertvector(exponent, Vec<double>) + t * series * 2.8853900817779268;
}

}  // namespace cotton::COTTON_ISA
