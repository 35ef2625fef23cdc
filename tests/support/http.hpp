// SPDX-License-Identifier: Apache-2.0
// The page of `holdfast live` as a browser asks for it, in bytes: also what no browser sends.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

namespace holdfast::test {

// One request to an address as `holdfast live` prints it, http://127.0.0.1:PORT/#TOKEN.
class Http {
 public:
  Http(const std::string& address, std::string_view what, std::string_view headers = {}, std::string_view body = {})
      : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const std::size_t colon = address.rfind(':');
    const std::size_t hash = address.find('#');
    sockaddr_in there{};
    there.sin_family = AF_INET;
    there.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    there.sin_port = htons(static_cast<std::uint16_t>(std::atoi(address.c_str() + colon + 1)));
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&there), sizeof there) != 0) return;
    std::string request(what);
    request += " HTTP/1.1\r\nHost: 127.0.0.1" + address.substr(colon, hash - 1 - colon);
    request += "\r\nAuthorization: Bearer " + address.substr(hash + 1) + "\r\n";
    request += headers;
    if (!body.empty()) request += "Content-Length: " + std::to_string(body.size()) + "\r\n";
    request += "\r\n";
    request += body;
    (void)send(request);
  }
  ~Http() {
    if (socket_ >= 0) ::close(socket_);
  }
  Http(const Http&) = delete;
  Http& operator=(const Http&) = delete;

  // False: the other side takes no more.
  [[nodiscard]] bool send(std::string_view bytes) const {
    while (!bytes.empty()) {
      const ssize_t count = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (count <= 0) return false;
      bytes.remove_prefix(static_cast<std::size_t>(count));
    }
    return true;
  }
  // Reads until `text` was said. False: the end, or the deadline, came before.
  [[nodiscard]] bool says(std::string_view text) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (said.find(text) == std::string::npos && std::chrono::steady_clock::now() < until) {
      pollfd entry{socket_, POLLIN, 0};
      if (::poll(&entry, 1, 100) <= 0) continue;
      std::array<char, 4096> bytes;
      const ssize_t count = ::recv(socket_, bytes.data(), bytes.size(), 0);
      if (count <= 0) break;
      said.append(bytes.data(), static_cast<std::size_t>(count));
    }
    return said.find(text) != std::string::npos;
  }

  std::string said;  // so far

 private:
  int socket_;
};

}  // namespace holdfast::test
