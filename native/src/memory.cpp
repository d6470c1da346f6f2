// SPDX-License-Identifier: Apache-2.0
#include "memory.h"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <new>
#include <optional>
#include <sstream>

namespace cotton {
namespace {

constexpr int64_t kUnlimited = std::numeric_limits<int64_t>::max();

std::atomic<int64_t> pretended{-1};

// The number at the start of a text, after spaces. It does not use a stream: if this module links libstdc++ and another
// library brings its own, the stream's locale is a different one, and reading a number from it crashed.
std::optional<int64_t> leading_number(const std::string& text) {
    char* end = nullptr;
    const int64_t number = std::strtoll(text.c_str(), &end, 10);
    return end == text.c_str() ? std::nullopt : std::optional(number);
}

// The number after `name` in a file of lines "name number"; -1 without one.
int64_t named_number(const std::string& path, const std::string& name) {
    std::ifstream file(path);
    for (std::string line; std::getline(file, line);) {
        if (line.compare(0, name.size(), name) != 0) continue;
        if (const auto number = leading_number(line.substr(name.size()))) return *number;
    }
    return -1;
}

// The number in a file; -1 if there is no file, or if it holds a word such as "max".
int64_t only_number(const std::string& path) {
    std::ifstream file(path);
    std::string line;
    return std::getline(file, line) ? leading_number(line).value_or(-1) : -1;
}

// The file names of one version.
struct Group {
    const char *folder, *limit, *used, *cache;
};
constexpr Group kVersion2 = {"/sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"};
constexpr Group kVersion1 = {"/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes",
                             "total_inactive_file"};

// The memory that a control group and all groups above it leave. Pages of files count as used, but the kernel frees
// them on demand.
int64_t room_of_group(const std::string& root, const Group& names, std::string path) {
    int64_t room = kUnlimited;
    for (;;) {
        const std::string folder = root + names.folder + path + "/";
        const int64_t limit = only_number(folder + names.limit), used = only_number(folder + names.used);
        if (limit >= 0 && used >= 0) {
            const int64_t cache = std::max<int64_t>(0, named_number(folder + "memory.stat", names.cache));
            room = std::min(room, std::max<int64_t>(0, limit - std::max<int64_t>(0, used - cache)));
        }
        if (path.empty()) return room;
        path.resize(path.rfind('/'));
    }
}

}  // namespace

int64_t read_available_memory(const std::string& root) {
    const int64_t free_kib = named_number(root + "/proc/meminfo", "MemAvailable:");
    int64_t room = free_kib < 0 ? kUnlimited : 1024 * free_kib;
    std::ifstream groups(root + "/proc/self/cgroup");
    for (std::string line; std::getline(groups, line);) {  // "number:controllers:/path"
        const std::size_t first = line.find(':'), second = line.find(':', first + 1);
        if (second == std::string::npos || line.compare(second + 1, 1, "/") != 0) continue;
        std::istringstream controllers(line.substr(first + 1, second - first - 1));
        std::string path = line.substr(second + 1);
        if (path == "/") path.clear();
        if (controllers.str().empty()) room = std::min(room, room_of_group(root, kVersion2, path));
        for (std::string name; std::getline(controllers, name, ',');) {
            if (name == "memory") room = std::min(room, room_of_group(root, kVersion1, path));
        }
    }
    return room;
}

void check_memory(int64_t bytes) {
    const int64_t available = pretended >= 0 ? pretended.load() : read_available_memory();
    if (bytes > available - available / 10) throw std::bad_alloc();
}

void pretend_available_memory(int64_t bytes) { pretended = bytes; }

}  // namespace cotton
