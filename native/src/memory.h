// How much memory there is: what is taken beyond it ends the process without a word that could be caught.
#pragma once

#include <cstdint>
#include <string>

namespace cotton {

// Bytes that can be taken before the kernel runs out of them, by the machine's memory and by the limits of the control
// groups (a container, a job of a scheduler); the largest number where the system does not say. `root` is that of the
// file system, another one in tests.
int64_t read_available_memory(const std::string& root = "");

// Throws std::bad_alloc when `bytes` more would not leave a tenth of what is available.
void check_memory(int64_t bytes);

// For tests: takes this to be available; a negative number ends that.
void pretend_available_memory(int64_t bytes);

}  // namespace cotton
