// SPDX-License-Identifier: Apache-2.0
#include "toolchain/live/http_server.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <functional>
#include <string>

namespace holdfast::live {
namespace {

using Clock = std::chrono::steady_clock;

bool ready(socket_t socket, short events, std::chrono::milliseconds at_most) {
  pollfd entry{socket, events, 0};
  return ::poll(&entry, 1, static_cast<int>(std::max<std::chrono::milliseconds::rep>(at_most.count(), 0))) > 0;
}

class Connection final : public httplib::Stream {
 public:
  explicit Connection(socket_t socket) : socket_(socket) {}

  // False: no request has begun in time.
  bool next_request() {
    left_ = HttpServer::kLongestRequest;
    until_ = Clock::now() + HttpServer::kPatience;
    return from_ < to_ || fill();
  }

  [[nodiscard]] bool is_readable() const override { return from_ < to_ || ready(socket_, POLLIN, {}); }
  // A peer that has gone can be written to for a while.
  [[nodiscard]] bool is_writable() const override {
    char byte = 0;
    return ready(socket_, POLLOUT, HttpServer::kPatience) && ::recv(socket_, &byte, 1, MSG_PEEK | MSG_DONTWAIT) != 0;
  }
  ssize_t read(char* bytes, std::size_t size) override {
    if (from_ == to_ && !fill()) return -1;
    const std::size_t count = std::min({size, to_ - from_, left_});
    if (count == 0) return -1;
    std::copy_n(buffer_.data() + from_, count, bytes);
    from_ += count;
    left_ -= count;
    return static_cast<ssize_t>(count);
  }
  ssize_t write(const char* bytes, std::size_t size) override {
    return is_writable() ? ::send(socket_, bytes, size, MSG_NOSIGNAL) : -1;
  }
  void get_remote_ip_and_port(std::string& ip, int& port) const override { name(::getpeername, ip, port); }
  void get_local_ip_and_port(std::string& ip, int& port) const override { name(::getsockname, ip, port); }
  [[nodiscard]] socket_t socket() const override { return socket_; }

 private:
  bool fill() {
    const auto wait = std::chrono::duration_cast<std::chrono::milliseconds>(until_ - Clock::now());
    if (wait.count() <= 0 || !ready(socket_, POLLIN, wait)) return false;
    const ssize_t count = ::recv(socket_, buffer_.data(), buffer_.size(), 0);
    from_ = 0;
    to_ = static_cast<std::size_t>(std::max<ssize_t>(count, 0));
    return count > 0;
  }
  template <typename Ask>
  void name(Ask ask, std::string& ip, int& port) const {
    sockaddr_in address{};
    socklen_t size = sizeof address;
    if (ask(socket_, reinterpret_cast<sockaddr*>(&address), &size) != 0) return;
    std::array<char, INET_ADDRSTRLEN> text{};
    ip = ::inet_ntop(AF_INET, &address.sin_addr, text.data(), text.size());
    port = ntohs(address.sin_port);
  }

  socket_t socket_;
  std::array<char, 4096> buffer_;
  std::size_t from_ = 0, to_ = 0;  // of the buffer: read, and not yet asked for
  std::size_t left_ = 0;           // bytes that the request may still have
  Clock::time_point until_;
};

using Setup = std::function<void(httplib::Request&)>;

// As version 0.11 of the library has it, and as 0.18.
[[maybe_unused]] bool answer(bool (HttpServer::*process)(httplib::Stream&, bool, bool&, const Setup&),
                             HttpServer& server, Connection& connection, bool last, bool& closed) {
  return (server.*process)(connection, last, closed, nullptr);
}
[[maybe_unused]] bool answer(bool (HttpServer::*process)(httplib::Stream&, const std::string&, int, const std::string&,
                                                         int, bool, bool&, const Setup&),
                             HttpServer& server, Connection& connection, bool last, bool& closed) {
  std::string from, to;
  int from_port = 0, to_port = 0;
  connection.get_remote_ip_and_port(from, from_port);
  connection.get_local_ip_and_port(to, to_port);
  return (server.*process)(connection, from, from_port, to, to_port, last, closed, nullptr);
}

}  // namespace

// A connection for as long as it lasts.
class HttpServer::Open {
 public:
  Open(HttpServer& server, socket_t socket) : server_(server), socket_(socket) {
    const std::lock_guard lock(server_.mutex_);
    server_.open_.insert(socket_);
    if (server_.stopped_) (void)::shutdown(socket_, SHUT_RDWR);
  }
  ~Open() {
    const std::lock_guard lock(server_.mutex_);
    server_.open_.erase(socket_);
    (void)::shutdown(socket_, SHUT_RDWR);
    (void)::close(socket_);
  }
  Open(const Open&) = delete;
  Open& operator=(const Open&) = delete;

 private:
  HttpServer& server_;
  socket_t socket_;
};

bool HttpServer::process_and_close_socket(socket_t socket) {
  const Open open(*this, socket);
  Connection connection(socket);
  bool goes_on = true, closed = false;
  for (std::size_t left = keep_alive_max_count_; goes_on && !closed && left > 0; --left) {
    goes_on = connection.next_request() && answer(&HttpServer::process_request, *this, connection, left == 1, closed);
  }
  return goes_on;
}

void HttpServer::stop_now() {
  stop();
  const std::lock_guard lock(mutex_);
  stopped_ = true;
  for (const socket_t socket : open_) (void)::shutdown(socket, SHUT_RDWR);
}

}  // namespace holdfast::live
