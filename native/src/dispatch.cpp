// SPDX-License-Identifier: Apache-2.0
#include "dispatch.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

#include <cstdlib>
#include <stdexcept>

#include "kernels.h"

namespace cotton {

#define COTTON_DECLARE(isa)                      \
    namespace isa {                              \
    extern const Kernels<float> float_kernels;   \
    extern const Kernels<double> double_kernels; \
    }
COTTON_DECLARE(baseline)
#if defined(COTTON_HAS_avx2)
COTTON_DECLARE(avx2)
#endif
#if defined(COTTON_HAS_avx512)
COTTON_DECLARE(avx512)
#endif

namespace {

struct Choice {
    const char* name;
    const Kernels<float>* floats;
    const Kernels<double>* doubles;
};

struct Features {
    bool avx2 = false;    // and FMA
    bool avx512 = false;  // F, DQ, BW and VL
};

// The instruction sets that the processor has and whose registers the system saves (XCR0), from CPUID and XGETBV: with
// some compilers, such as zig's, which builds the wheels, __builtin_cpu_supports() reports none.
Features features() {
    Features found;
#if defined(__x86_64__)
    unsigned a, b, c, d, kept, unused;
    if (!__get_cpuid(1, &a, &b, &c, &d)) return found;
    const auto has = [](unsigned bits, unsigned wanted) { return (bits & wanted) == wanted; };
    if (!has(c, 1u << 27)) return found;  // no XCR0
    const bool fma = has(c, 1u << 12);
    __asm__("xgetbv" : "=a"(kept), "=d"(unused) : "c"(0));
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return found;
    found.avx2 = fma && has(b, 1u << 5) && has(kept, 0x06);
    found.avx512 = found.avx2 && has(b, 1u << 16 | 1u << 17 | 1u << 30 | 1u << 31) && has(kept, 0xe6);
#endif
    return found;
}

std::vector<Choice> choices() {
    std::vector<Choice> found = {{"baseline", &baseline::float_kernels, &baseline::double_kernels}};
    [[maybe_unused]] const Features here = features();
#if defined(COTTON_HAS_avx2)
    if (here.avx2) found.push_back({"avx2", &avx2::float_kernels, &avx2::double_kernels});
#endif
#if defined(COTTON_HAS_avx512)
    if (here.avx512) found.push_back({"avx512", &avx512::float_kernels, &avx512::double_kernels});
#endif
    return found;
}

Choice& chosen() {
    static Choice choice = choices().back();
    return choice;
}

}  // namespace

std::vector<std::string> instruction_sets() {
    std::vector<std::string> names;
    for (const Choice& choice : choices()) names.emplace_back(choice.name);
    return names;
}

std::string instruction_set() { return chosen().name; }

std::string preferred_instruction_set() {
    const char* wanted = std::getenv("COTTON3DG_ISA");
    return wanted && *wanted ? wanted : choices().back().name;
}

void use_instruction_set(const std::string& name) {
    for (const Choice& choice : choices()) {
        if (choice.name == name) {
            chosen() = choice;
            return;
        }
    }
    std::string all;
    for (const Choice& choice : choices()) all += std::string(all.empty() ? "" : ", ") + choice.name;
    throw std::invalid_argument("no instruction set '" + name + "' on this processor; it has " + all);
}

template <>
const Kernels<float>& kernels() {
    return *chosen().floats;
}

template <>
const Kernels<double>& kernels() {
    return *chosen().doubles;
}

}  // namespace cotton
