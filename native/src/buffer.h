// SPDX-License-Identifier: Apache-2.0
// Memory that grows and is reused: aligned for vectors, never initialised; its contents are lost when it grows.
#pragma once

#if defined(__linux__)
#include <sys/mman.h>
#endif

#include <cstddef>
#include <cstdint>
#include <new>

#include "memory.h"

namespace cotton {

template <class T>
class Buffer {
  public:
    Buffer() = default;
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    ~Buffer() { release(); }

    // Reserves room for at least `count` elements and one vector beyond them. Throws std::bad_alloc if the system would
    // promise memory that it does not have.
    T* reserve(int64_t count) {
        if (count > capacity_) {
            release();
            const int64_t capacity = count + count / 4;  // the next view may need a little more
            const std::size_t bytes = size(capacity);
            if (bytes >= kPage) check_memory(int64_t(size(count)));  // the rest is never touched
            data_ = static_cast<T*>(::operator new(bytes, alignment(bytes)));
            capacity_ = capacity;
#if defined(__linux__)
            // Large pages: reads of these tables are random, and most of the misses would be those of the page table.
            if (bytes >= kPage) madvise(data_, bytes / kPage * kPage, MADV_HUGEPAGE);
#endif
        }
        return data_;
    }

    T* data() { return data_; }
    const T* data() const { return data_; }
    T& operator[](int64_t i) { return data_[i]; }
    const T& operator[](int64_t i) const { return data_[i]; }

  private:
    static constexpr std::size_t kPage = std::size_t(2) << 20;

    static std::size_t size(int64_t count) { return std::size_t(count) * sizeof(T) + 64; }
    static std::align_val_t alignment(std::size_t bytes) { return std::align_val_t(bytes >= kPage ? kPage : 64); }

    void release() {
        ::operator delete(data_, alignment(size(capacity_)));
        data_ = nullptr;
        capacity_ = 0;
    }

    T* data_ = nullptr;
    int64_t capacity_ = 0;
};

}  // namespace cotton
