// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/media.hpp"

#include <dlfcn.h>

#include <stdexcept>

namespace holdfast::sim {

const Media& media() {
  // Never closed: what it made may live until the process ends.
  static const Media& loaded = []() -> const Media& {
    // The loader puts the program's folder for $ORIGIN (ld.so(8)).
    void* const module = ::dlopen("$ORIGIN/libholdfast_media.so", RTLD_NOW | RTLD_LOCAL);
    void* const entry = module != nullptr ? ::dlsym(module, "holdfast_media") : nullptr;
    if (entry == nullptr) {
      const char* const why = ::dlerror();
      throw std::runtime_error(std::string("pictures and videos cannot be read: ") +
                               (why != nullptr ? why : "no reason given") +
                               "; copy libholdfast_media.so beside the program, or install the packages of "
                               "toolchain/packages.sh and build again");
    }
    return reinterpret_cast<const Media& (*)()>(entry)();
  }();
  return loaded;
}

}  // namespace holdfast::sim
