// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/media.hpp"

#include <dlfcn.h>

#include <array>
#include <string>
#include <system_error>

namespace holdfast::sim {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void refuse(const std::string& cause, const std::string& next) {
  throw MediaMissing("pictures and videos can be neither read nor written: " + cause + "; " + next);
}

const Media& load() {
  constexpr const char* kName = "libholdfast_media.so";
  std::error_code ec;
  const fs::path folder = fs::read_symlink("/proc/self/exe", ec).parent_path();
  const std::array<fs::path, 2> places{folder / kName, folder.parent_path() / "lib/holdfast/modules" / kName};
  for (const fs::path& place : places) {
    if (!fs::exists(place, ec)) continue;
    // Never closed: what it made may live until the process ends.
    void* const module = ::dlopen(place.c_str(), RTLD_NOW | RTLD_LOCAL);
    void* const entry = module != nullptr ? ::dlsym(module, "holdfast_media") : nullptr;
    if (entry != nullptr) return reinterpret_cast<const Media& (*)()>(entry)();
    const char* const why = ::dlerror();
    refuse(why != nullptr ? why : place.string() + " has no holdfast_media",
           "install the packages that toolchain/packages.sh lists, and build again");
  }
  refuse("no " + places[0].string() + " and no " + places[1].string(), "copy it beside the program, or build again");
}

}  // namespace

const Media& media() {
  static const Media& loaded = load();
  return loaded;
}

}  // namespace holdfast::sim
