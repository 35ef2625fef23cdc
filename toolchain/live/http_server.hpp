// SPDX-License-Identifier: Apache-2.0
// cpp-httplib's server, whose connections have an end. The library reads a request for as long as bytes of it come, and
// however many, before anybody can ask who sends them; and it waits for such a connection when it stops.
#pragma once

#include <httplib.h>

#include <chrono>
#include <cstddef>
#include <mutex>
#include <set>

namespace holdfast::live {

class HttpServer final : public httplib::Server {
 public:
  // Of a request, head and body. Browsers send about 600 bytes of head.
  static constexpr std::size_t kLongestRequest = 32 << 10;
  // For a request to come whole: from the connection, or from the end of the request before.
  static constexpr std::chrono::milliseconds kPatience{5000};

  // Also ends every connection, whatever it waits for.
  void stop_now();

 private:
  class Open;

  bool process_and_close_socket(socket_t socket) override;

  std::mutex mutex_;
  std::set<socket_t> open_;
  bool stopped_ = false;
};

}  // namespace holdfast::live
