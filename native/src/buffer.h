// Memory that grows and is kept: 64-byte aligned, never initialised, contents lost when it grows.
#pragma once

#include <cstddef>
#include <cstdint>
#include <new>

namespace cotton {

template <class T>
class Buffer {
  public:
    Buffer() = default;
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    ~Buffer() { release(); }

    // Room for at least `count` elements, and one vector beyond them.
    T* reserve(int64_t count) {
        if (count > capacity_) {
            release();
            data_ = static_cast<T*>(::operator new(std::size_t(count) * sizeof(T) + 64, std::align_val_t(64)));
            capacity_ = count;
        }
        return data_;
    }

    T* data() { return data_; }
    const T* data() const { return data_; }
    T& operator[](int64_t i) { return data_[i]; }
    const T& operator[](int64_t i) const { return data_[i]; }

  private:
    void release() {
        ::operator delete(data_, std::align_val_t(64));
        data_ = nullptr;
        capacity_ = 0;
    }

    T* data_ = nullptr;
    int64_t capacity_ = 0;
};

}  // namespace cotton
