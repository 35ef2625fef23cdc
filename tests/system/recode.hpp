// SPDX-License-Identifier: Apache-2.0
// JPEG pictures written anew from their coefficients, by libjpeg.
#pragma once

#include <cstdint>
#include <vector>

namespace holdfast::test {

// With Huffman codes made for the picture, and, where `grain` is not 0, with noise: one luma block in 32, drawn by
// `grain`, is one step of its quantization lighter or darker. Sensors show no picture twice, and the firmware refuses
// one that was shown before (app/freshness.hpp); a film that goes round needs new noise in each round.
// libjpeg ends the program when the picture cannot be read: it is one of ours.
[[nodiscard]] std::vector<std::uint8_t> recoded(const std::vector<std::uint8_t>& jpeg, std::uint64_t grain);

}  // namespace holdfast::test
