// SPDX-License-Identifier: Apache-2.0
// What no single value of a scene tells: contradictions, capabilities, and what is allowed but changes nothing.
#pragma once

#include "drivers/sim/scene/file/schema.hpp"

namespace holdfast::scene::file {

void check(const Scene& scene, const Reading& read, json::Problems& problems, json::Problems& warnings);

[[nodiscard]] bool pressed(const Scene& scene);
[[nodiscard]] bool pulled(const Scene& scene);
[[nodiscard]] bool moves(const Scene& scene);  // along the gel or about the normal, by its script

}  // namespace holdfast::scene::file
