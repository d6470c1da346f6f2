#include "dispatch.h"

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

std::vector<Choice> choices() {
    std::vector<Choice> found = {{"baseline", &baseline::float_kernels, &baseline::double_kernels}};
#if defined(__x86_64__)
    __builtin_cpu_init();
#endif
#if defined(COTTON_HAS_avx2)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        found.push_back({"avx2", &avx2::float_kernels, &avx2::double_kernels});
    }
#endif
#if defined(COTTON_HAS_avx512)
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl")) {
        found.push_back({"avx512", &avx512::float_kernels, &avx512::double_kernels});
    }
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
