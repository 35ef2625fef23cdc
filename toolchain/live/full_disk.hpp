// SPDX-License-Identifier: Apache-2.0
// The end of a recording whose disk takes no more: what fits stays, as a file that is whole.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "toolchain/log/frame_log.hpp"
#include "toolchain/support/atomic_file.hpp"

namespace holdfast::live {

// After a write that failed, of a frame or of the end. Puts the file in its place if it keeps a frame. The error line,
// which says how many were kept.
[[nodiscard]] std::string keep_what_fits(tool::AtomicFile& file, log::FrameLog& log, std::string_view path);
// The same for a table of which the disk took so many rows below the header, which end there.
[[nodiscard]] std::string keep_what_fits(tool::AtomicFile& file, std::uint64_t end, std::uint64_t rows,
                                         std::string_view path);

}  // namespace holdfast::live
