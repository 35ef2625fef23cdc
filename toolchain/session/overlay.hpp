// SPDX-License-Identifier: Apache-2.0
// A frame with the displacement of its markers drawn on it: yellow arrows, as in the paper's figure.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <span>
#include <string>

#include "toolchain/log/messages.hpp"

namespace holdfast::tool {

using log::Arrow;

inline constexpr int kOverlayWidth = 960;  // pixels at least: smaller pictures are magnified by a whole number

// Writes a PNG: each arrow from the marker's rest position, `factor` times its displacement; a dot on the
// marker as it is now; a red cross where a marker is lost. `picture`: 8-bit grey or BGR, arrows in its
// pixels. Atomic; returns empty, or one line that says what is wrong.
[[nodiscard]] std::string write_overlay(const std::filesystem::path& path, const cv::Mat& picture,
                                        std::span<const Arrow> arrows, double factor,
                                        const std::filesystem::path& input = {});

}  // namespace holdfast::tool
