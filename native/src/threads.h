// A pool of threads of our own (torch brings an OpenMP runtime that must not be shared). Which thread runs which task
// is left open, so tasks must not share sums.
#pragma once

#include <cstdint>

namespace cotton {

using Task = void (*)(const void* body, int64_t index);

// Runs task(body, 0 .. count - 1) on up to `threads` threads (0: all cores), the caller's included. Of the exceptions
// that tasks throw the first is thrown here, once none runs any more; tasks not yet begun are left out.
void run_tasks(int64_t count, int threads, Task task, const void* body);

// The number of threads that `threads` stands for.
int thread_count(int threads);

template <class Body>
void parallel_for(int64_t count, int threads, const Body& body) {
    run_tasks(count, threads, [](const void* b, int64_t index) { (*static_cast<const Body*>(b))(index); }, &body);
}

}  // namespace cotton
