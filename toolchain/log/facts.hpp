// SPDX-License-Identifier: Apache-2.0
// The last frame of a running App as the host shows and keeps it.
#pragma once

#include <vector>

#include "app/app.hpp"
#include "toolchain/log/messages.hpp"

namespace holdfast::log {

// `alive`: level of the line ALIVE.
[[nodiscard]] FrameRecord facts_of(const App& app, long frame, double t_s, bool alive);

// Row by row; nothing of a frame that was rejected. `scale`: pixels of the camera's picture per pixel of the working
// image.
void arrows_of(const App& app, double scale, std::vector<Arrow>& arrows);

}  // namespace holdfast::log
