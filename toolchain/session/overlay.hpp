// SPDX-License-Identifier: Apache-2.0
// A frame with the displacement of its markers drawn on it: yellow arrows, as in the paper's figure.
#pragma once

#include <opencv2/core/mat.hpp>
#include <ostream>
#include <span>
#include <string>

#include "toolchain/log/messages.hpp"

namespace holdfast::tool {

using log::Arrow;

inline constexpr int kOverlayWidth = 960;  // pixels at least: smaller pictures are magnified by a whole number

// Writes a PNG: each arrow from the marker's rest position, `factor` times its displacement; a dot on the
// marker as it is now; a red cross where a marker is lost. `picture`: 8-bit grey or BGR, arrows in its
// pixels. Returns empty, or what is wrong.
[[nodiscard]] std::string write_overlay(std::ostream& out, const cv::Mat& picture, std::span<const Arrow> arrows,
                                        double factor);

}  // namespace holdfast::tool
