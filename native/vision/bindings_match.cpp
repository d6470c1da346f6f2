// SPDX-License-Identifier: Apache-2.0
// Matching of descriptors. The Python interface is cotton3dg/sfm/matching.py.
#include "../src/bindings.h"
#include "descriptors.h"

namespace cotton {
namespace {

// The descriptors of an image in both orders that the kernel reads.
class Interleaved {
  public:
    Interleaved(const uint8_t* values, int64_t count, int64_t numbers) : count_(count), length_(int(numbers + 1) / 2) {
        pairs_.resize(size_t(count_) * size_t(length_));
        blocks_.resize(size_t(padded()) * size_t(length_));
        for (int64_t row = 0; row < count_; ++row) {
            int32_t* pair = pairs_.data() + row * length_;
            for (int64_t k = 0; k < numbers; ++k) pair[k / 2] |= int32_t(*values++) << (k % 2 * 16);
            int32_t* block = blocks_.data() + row / kMatchBlock * kMatchBlock * length_ + row % kMatchBlock;
            for (int k = 0; k < length_; ++k) block[k * kMatchBlock] = pair[k];
        }
    }

    Descriptors view() const { return {count_, length_, pairs_.data(), blocks_.data()}; }
    int64_t padded() const { return (count_ + kMatchBlock - 1) / kMatchBlock * kMatchBlock; }

  private:
    int64_t count_;
    int length_;
    std::vector<int32_t> pairs_, blocks_;
};

// Best, second best and index of the best, one row each.
class Found {
  public:
    explicit Found(const Interleaved& rows) : stride_(rows.padded()), values_(size_t(3 * stride_), -1) {}

    Neighbours view() { return {values_.data(), values_.data() + stride_, values_.data() + 2 * stride_}; }

    Array<int32_t> array(int64_t count) const {
        Array<int32_t> result({int64_t(3), count});
        for (int k = 0; k < 3; ++k) std::copy_n(values_.data() + k * stride_, count, result.mutable_data(k));
        return result;
    }

  private:
    int64_t stride_;
    std::vector<int32_t> values_;
};

py::tuple match_descriptors(const py::object& a, const py::object& b) {
    const auto rows_of_a = checked<uint8_t>(a, "a", {-1, -1});
    const auto rows_of_b = checked<uint8_t>(b, "b", {-1, rows_of_a.shape(1)});
    // A product is a sum of this many products of bytes and must fit into 31 bits.
    if (rows_of_a.shape(1) > 32768) throw py::value_error("descriptors must have at most 32768 numbers");
    if (rows_of_a.shape(0) >= int64_t(1) << 30 || rows_of_b.shape(0) >= int64_t(1) << 30)
        throw py::value_error("too many descriptors");
    const int64_t numbers = rows_of_a.shape(1), count_a = rows_of_a.shape(0), count_b = rows_of_b.shape(0);
    const uint8_t *values_a = rows_of_a.data(), *values_b = rows_of_b.data();
    const auto matched = [&] {
        const py::gil_scoped_release release;
        const Interleaved from(values_a, count_a, numbers), to(values_b, count_b, numbers);
        std::pair<Found, Found> found(from, to);
        kernels<float>().match(from.view(), to.view(), found.first.view(), found.second.view());
        return found;
    }();
    return py::make_tuple(matched.first.array(count_a), matched.second.array(count_b));
}

}  // namespace

void bind_matching(py::module_& m) { m.def("match_descriptors", match_descriptors, "a"_a, "b"_a); }

}  // namespace cotton
