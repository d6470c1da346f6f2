// SPDX-License-Identifier: Apache-2.0
#include "threads.h"

#include <unistd.h>
#if defined(__linux__)
#include <sched.h>
#endif

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <vector>

namespace cotton {
namespace {

constexpr int kMaxThreads = 256;

class Pool {
  public:
    Pool() : owner_(getpid()) {}

    bool usable() const { return owner_ == getpid(); }

    // One job at a time; a caller that finds the pool busy works alone.
    void run(int64_t count, int threads, Task task, const void* body) {
        std::unique_lock<std::mutex> job(job_mutex_, std::try_to_lock);
        if (threads <= 1 || count <= 1 || !job.owns_lock()) {
            for (int64_t i = 0; i < count; ++i) task(body, i);
            return;
        }
        grow(threads - 1);
        {
            std::lock_guard<std::mutex> lock(mutex_);
            task_ = task;
            body_ = body;
            count_ = count;
            next_ = 0;
            failure_ = nullptr;
            helpers_ = busy_ = std::min(threads - 1, int(workers_.size()));
            ++generation_;
        }
        wake_.notify_all();
        take();
        std::unique_lock<std::mutex> lock(mutex_);
        done_.wait(lock, [this] { return busy_ == 0; });
        if (failure_) std::rethrow_exception(failure_);
    }

  private:
    // There are fewer threads than wanted if the system allows a process no more, or has no memory for their stacks.
    void grow(int helpers) {
        try {
            while (int(workers_.size()) < helpers)
                workers_.emplace_back([this, id = int(workers_.size())] { work(id); });
        } catch (const std::system_error&) {
        } catch (const std::bad_alloc&) {
        }
    }

    // A task that fails, most likely from lack of memory, ends the job; the caller gets its exception once all end.
    void take() {
        try {
            for (int64_t i; (i = next_.fetch_add(1, std::memory_order_relaxed)) < count_;) task_(body_, i);
        } catch (...) {
            next_ = count_;
            std::lock_guard<std::mutex> lock(mutex_);
            if (!failure_) failure_ = std::current_exception();
        }
    }

    void work(int id) {
        uint64_t seen = 0;
        for (;;) {
            {
                std::unique_lock<std::mutex> lock(mutex_);
                wake_.wait(lock, [&] { return generation_ != seen; });
                seen = generation_;
                if (id >= helpers_) continue;
            }
            take();
            std::lock_guard<std::mutex> lock(mutex_);
            if (--busy_ == 0) done_.notify_one();
        }
    }

    const pid_t owner_;
    std::mutex job_mutex_, mutex_;
    std::condition_variable wake_, done_;
    std::vector<std::thread> workers_;
    std::atomic<int64_t> next_{0};
    Task task_ = nullptr;
    const void* body_ = nullptr;
    int64_t count_ = 0;
    int helpers_ = 0, busy_ = 0;
    std::exception_ptr failure_;
    uint64_t generation_ = 0;
};

// Never destroyed: its threads sleep until the process ends. A forked child has no threads and starts a pool of its
// own.
Pool& pool() {
    static std::mutex mutex;
    static Pool* current = nullptr;
    std::lock_guard<std::mutex> lock(mutex);
    if (!current || !current->usable()) current = new Pool;
    return *current;
}

// The standard library counts all cores of the machine, including those that a cluster's scheduler gave to others.
int usable_cores() {
#if defined(__linux__)
    cpu_set_t usable;
    if (sched_getaffinity(0, sizeof usable, &usable) == 0) return CPU_COUNT(&usable);
#endif
    return int(std::thread::hardware_concurrency());
}

}  // namespace

int thread_count(int threads) {
    if (threads <= 0) threads = usable_cores();
    return threads < 1 ? 1 : threads > kMaxThreads ? kMaxThreads : threads;
}

void run_tasks(int64_t count, int threads, Task task, const void* body) {
    pool().run(count, thread_count(threads), task, body);
}

}  // namespace cotton
