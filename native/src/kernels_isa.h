// The kernels as each instruction set defines them; kernels.cpp makes the table of them.
#pragma once

#include "kernels.h"

namespace cotton::COTTON_ISA {

template <class Real>
void project(const Scene<Real>&, const View&, int64_t begin, int64_t end, const Projection<Real>&, ProjectionCount&);

template <class Real>
int64_t hit_tiles(const View&, const Projection<Real>&, const uint32_t* visible, int64_t n, Hit* hits,
                  HitRange* ranges);

template <class Real>
typename Kernels<Real>::Forward forward(int channels);

template <class Real>
typename Kernels<Real>::ValuesBackward values_backward(int channels);

template <class Real>
void ray_weights(const Tile&, const Real* records, int record_stride, const uint8_t* pixels, int n, Real* weights);

template <class Real>
void backward(const Tile&, const Real* records, const Plane<const Real>* image, const Plane<const Real>* v_image,
              Real* rows);

template <class Real>
bool project_backward(const Scene<Real>&, const View&, const uint32_t* visible, int64_t n, const Real* records,
                      int record_stride, const HitRange* ranges, const Real* pair_rows, Real* rows);

template <class Real>
void sh_gradient(const Scene<Real>&, const uint32_t* visible, int64_t n, const Real* rows, Real* v_sh);

template <class Real>
LossSums loss_forward(const LossBand<Real>&);

template <class Real>
void loss_backward(const LossBand<Real>&);

void adam(const AdamRows&, const uint32_t* visible, int64_t n, const float* rows);

bool self_test();

}  // namespace cotton::COTTON_ISA
