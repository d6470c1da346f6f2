// SPDX-License-Identifier: Apache-2.0
// Which instruction set the kernels use.
#pragma once

#include <string>
#include <vector>

namespace cotton {

// The instruction sets that this build contains and this processor runs, slowest first.
std::vector<std::string> instruction_sets();

std::string instruction_set();

// The one that the environment variable COTTON3DG_ISA names, else the fastest.
std::string preferred_instruction_set();

// Throws std::invalid_argument for one that is not listed.
void use_instruction_set(const std::string& name);

}  // namespace cotton
