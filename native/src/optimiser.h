// SPDX-License-Identifier: Apache-2.0
// What a step of Adam reads and changes.
#pragma once

#include "scene.h"

namespace cotton {

// Sums over views for density control, (N,) each. Weights count as shares of the image, so that the weights of a coarse
// and a fine image can be compared.
struct Statistics {
    float *abs_grad_px, *weight;
    int32_t* count;
    float pixel;  // its share of the image
};

struct LearningRates {
    float means, quats, log_scales, opacity_logits, sh0, sh_rest, beta1, beta2, epsilon;
};

// Values for the parameters, or for moments of their gradient.
struct GaussianPointers {
    float *means, *quats, *log_scales, *opacity_logits, *sh;
};

// 1 / (1 - beta^t) for both moments.
struct BiasCorrection {
    float first, second;
};

struct AdamRows {
    GaussianPointers parameters, first, second;
    int sh_stored, sh_degree;
    int32_t* steps;  // (N, kBands) updates so far of each band of the colour; the first is the geometry's, too
    LearningRates rates;
    const float* rate_factors;   // (N, 2) by which the rates of means and of log scales are multiplied
    const BiasCorrection* bias;  // of step t at bias[min(t, bias_count - 1)]
    int32_t bias_count;
    Statistics statistics;
};

}  // namespace cotton
