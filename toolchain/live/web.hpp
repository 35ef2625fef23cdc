// SPDX-License-Identifier: Apache-2.0
// The live page and what feeds it, over HTTP on this computer alone.
//
//   GET  /          the page
//   GET  /stream    what the console's port says from now on, as it comes; ends with the device. Of twelve at most
//   POST /send      one line to the console; needs the token that controls
//   GET  /picture   the newest picture (JPEG) that is newer than ?after=NUMBER, or 204 after a second without one
//
// Bound to 127.0.0.1. All but the page want "Authorization: Bearer TOKEN", of which there are two: one that controls
// and one that only looks. Requests for another host's name are refused: a page from elsewhere whose name was bent to
// this computer must not reach the device. What is said to the device is checked by its console, as ever.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <thread>

#include "toolchain/live/hub.hpp"

namespace holdfast::live {

// 128 random bits in hexadecimal.
[[nodiscard]] std::string new_token();

// Whether a request for `host`, from a page of `origin` if any, is for this computer's `port`. Where that is 80, it is
// left out by whoever asks.
[[nodiscard]] bool own_address(std::string_view host, std::string_view origin, int port);

class Web {
 public:
  // `unlock`: said to the console when somebody comes who controls, and after somebody gave another code; empty: his
  // own business. The hub outlives it.
  Web(Hub& hub, std::string page, std::string unlock);
  ~Web();
  Web(const Web&) = delete;
  Web& operator=(const Web&) = delete;

  // `port` 0: any that is free. Empty, or an error line.
  [[nodiscard]] std::string start(int port);
  // Where to look; with the right to change the device, or without.
  [[nodiscard]] std::string address(bool controls) const;

 private:
  struct Server;
  std::unique_ptr<Server> server_;
};

}  // namespace holdfast::live
