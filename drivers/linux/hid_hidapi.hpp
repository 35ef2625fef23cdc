// SPDX-License-Identifier: Apache-2.0
// A HID device by hidapi, on its hidraw device file. Tried on Linux 6.1 with a virtual MCP2221A (uhid): opening by
// serial number, answers, two threads, and the device's end, which the next call tells within 30 us. Calls from two
// threads have to take turns (Mcp2221Gpio does).
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>

#include "drivers/linux/bridge_mcp2221.hpp"

struct hid_device_;  // hidapi's own

namespace holdfast::drivers {

class HidapiPort final : public HidPort {
 public:
  // `serial`: as the device tells it; empty: whichever there is, if it is the only one. Empty: open. Otherwise one
  // line: what, likely cause, next step. One process at a time: hidraw hands every answer to all who read. Uses the
  // heap. A transfer that fails costs hidapi a heap call for its message (0.13); whoever gets kGone does not ask again.
  [[nodiscard]] std::string open(std::uint16_t vendor, std::uint16_t product, std::string_view serial);

 private:
  struct Close {
    void operator()(hid_device_* device) const;
    void operator()(std::FILE* file) const { (void)std::fclose(file); }
  };

  [[nodiscard]] bool do_send(const Report& report) override;
  [[nodiscard]] Got do_receive(Report& report, std::chrono::milliseconds at_most) override;

  std::unique_ptr<hid_device_, Close> device_;
  std::unique_ptr<std::FILE, Close> lock_;  // the same file once more: hidapi keeps its own to itself
};

}  // namespace holdfast::drivers
