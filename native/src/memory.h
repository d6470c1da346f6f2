// SPDX-License-Identifier: Apache-2.0
// The available memory: a process that takes more ends without an exception that it could catch.
#pragma once

#include <cstdint>
#include <string>

namespace cotton {

// Bytes that a process can take before the kernel runs out of them, from the machine's memory and the limits of the
// control groups (a container, a job of a scheduler); the largest number if the system does not say. `root` is the root
// of the file system, or another folder in tests.
int64_t read_available_memory(const std::string& root = "");

// Throws std::bad_alloc if `bytes` more would not leave a tenth of the available memory.
void check_memory(int64_t bytes);

// For tests: sets the available memory; a negative number ends that.
void pretend_available_memory(int64_t bytes);

}  // namespace cotton
