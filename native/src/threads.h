// SPDX-License-Identifier: Apache-2.0
// A separate pool of threads (torch brings an OpenMP runtime that must not be shared). Any thread may run any task, so
// tasks must not share sums.
#pragma once

#include <cstdint>

namespace cotton {

using Task = void (*)(const void* body, int64_t index);

// Runs task(body, 0 .. count - 1) on up to `threads` threads (0: all cores), the caller's included. If tasks throw, it
// throws the first exception once no task runs any more, and skips the tasks that have not begun.
void run_tasks(int64_t count, int threads, Task task, const void* body);

// The number of threads that `threads` means.
int thread_count(int threads);

template <class Body>
void parallel_for(int64_t count, int threads, const Body& body) {
    run_tasks(count, threads, [](const void* b, int64_t index) { (*static_cast<const Body*>(b))(index); }, &body);
}

}  // namespace cotton
