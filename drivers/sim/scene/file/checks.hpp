// SPDX-License-Identifier: Apache-2.0
// What no single value of a scene tells: contradictions, and what is allowed but changes nothing.
#pragma once

#include "drivers/sim/scene/file/schema.hpp"

namespace holdfast::scene::file {

void check(const Scene& scene, const Reading& read, json::Problems& problems, json::Problems& warnings);

}  // namespace holdfast::scene::file
