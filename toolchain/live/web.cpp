// SPDX-License-Identifier: Apache-2.0
#include "toolchain/live/web.hpp"

#include <fmt/format.h>
#include <sodium.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <string_view>
#include <utility>

#include "drivers/common/trouble.hpp"
#include "toolchain/live/http_server.hpp"

namespace holdfast::live {
namespace {

constexpr Hub::Millis kPatience{500};
constexpr Hub::Millis kForAPicture{1000};
constexpr std::size_t kLongestLine = 4096;
// A page holds two for as long as it is open; the rest is for those who come.
constexpr std::size_t kThreads = 32;
constexpr int kMostPages = 12;
constexpr std::chrono::seconds kLongestWait{60};  // of a console, after wrong codes
constexpr const char* kPageRules =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src blob:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

bool same(const std::string& a, const std::string& b) {
  return a.size() == b.size() && sodium_memcmp(a.data(), b.data(), a.size()) == 0;
}

void refuse(httplib::Response& response, int status, const char* why) {
  response.status = status;
  response.set_content(why, "text/plain");
}

// And hangs up: the body, which nobody reads, would be taken for the next request.
void refuse_unread(httplib::Response& response, int status, std::string_view why) {
  response.status = status;
  response.set_content_provider(why.size(), "text/plain", [why](std::size_t, std::size_t, httplib::DataSink& sink) {
    (void)sink.write(why.data(), why.size());
    return false;
  });
}

}  // namespace

bool own_address(std::string_view host, std::string_view origin, int port) {
  const std::string text = port == 80 ? "" : fmt::format(":{}", port);
  if (port == 80 && host.ends_with(":80")) host.remove_suffix(3);
  if (port == 80 && origin.ends_with(":80")) origin.remove_suffix(3);
  return (host == "127.0.0.1" + text || host == "localhost" + text) &&
         (origin.empty() || origin == fmt::format("http://{}", host));
}

std::string new_token() {
  if (sodium_init() < 0) std::abort();  // no random numbers on this machine
  std::array<unsigned char, 16> bytes;
  randombytes_buf(bytes.data(), bytes.size());
  std::string text;
  for (const unsigned char byte : bytes) text += fmt::format("{:02x}", byte);
  return text;
}

struct Web::Server {
  Server(Hub& the_hub, std::string the_page, std::string to_unlock)
      : hub(the_hub), page(std::move(the_page)), unlock(std::move(to_unlock)) {
    http.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
    http.set_payload_max_length(kLongestLine);
    // By default another process may bind the same port and take what is meant for this one.
    http.set_socket_options([](socket_t socket) {
      const int yes = 1;
      (void)::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
    });
    http.set_tcp_nodelay(true);
    http.set_default_headers({{"Cache-Control", "no-store"}, {"X-Content-Type-Options", "nosniff"}});
    http.set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
      // Parts of an answer are not served, and need not be: one request of 8 kB for the whole page 2700 times, refused
      // or not, made 300 MB. The request is the server's own and no constant.
      const_cast<httplib::Request&>(request).ranges.clear();
      if (!ours(request)) {
        refuse_unread(response, 403, "this address is not the desk's own");
      } else if (request.path != "/" && !may_look(request)) {
        refuse_unread(response, 401, "no token, or a wrong one: open the address that holdfast live printed");
      } else if (request.has_header("Transfer-Encoding")) {
        refuse_unread(response, 411, "a body without a Content-Length");
      } else {
        return httplib::Server::HandlerResponse::Unhandled;
      }
      return httplib::Server::HandlerResponse::Handled;
    });
    http.Get("/", [this](const httplib::Request&, httplib::Response& response) {
      response.set_header("Content-Security-Policy", kPageRules);
      response.set_header("Referrer-Policy", "no-referrer");
      response.set_content(page, "text/html; charset=utf-8");
    });
    http.Get("/stream", [this](const httplib::Request& request, httplib::Response& response) {
      stream(may_control(request), response);
    });
    http.Get("/picture",
             [this](const httplib::Request& request, httplib::Response& response) { picture(request, response); });
    http.Post("/send", [this](const httplib::Request& request, httplib::Response& response) {
      if (!may_control(request)) return refuse(response, 403, "this page may look and not change anything");
      const bool printable =
          std::all_of(request.body.begin(), request.body.end(), [](char c) { return c >= ' ' && c <= '~'; });
      if (!printable || request.body.empty()) return refuse(response, 400, "one line of printable ASCII");
      unlock_again(request.body);
      if (!hub.say(request.body + "\r\n")) return refuse(response, 503, "the device does not take it");
      response.status = 204;
    });
  }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;
  ~Server() {
    hub.end();
    http.stop_now();
    if (thread.joinable()) thread.join();
  }

  [[nodiscard]] bool ours(const httplib::Request& request) const {
    return own_address(request.get_header_value("Host"), request.get_header_value("Origin"), port);
  }
  [[nodiscard]] bool may_control(const httplib::Request& request) const {
    return same(request.get_header_value("Authorization"), "Bearer " + control);
  }
  [[nodiscard]] bool may_look(const httplib::Request& request) const {
    return may_control(request) || same(request.get_header_value("Authorization"), "Bearer " + view);
  }
  // A wrong code has locked the console for all who control, and for a time it refuses every other: from then on the
  // right one goes before each line.
  void unlock_again(std::string_view line) {
    if (unlock.empty()) return;
    const auto now = std::chrono::steady_clock::now();
    const std::lock_guard lock(doubt_mutex);
    if (doubt) (void)hub.say(unlock + "\r\n");
    if (Hub::unlocks(line)) {
      doubt = now;
    } else if (doubt && now - *doubt > kLongestWait) {
      doubt.reset();
    }
  }
  void stream(bool controls, httplib::Response& response) {
    if (++pages > kMostPages) {
      --pages;
      return refuse(response, 503, "too many pages are open: close one");
    }
    auto listener = hub.listen(controls);
    if (controls && !unlock.empty()) (void)hub.say(unlock + "\r\n");
    // Said again, it has the rest positions sent to whoever has just come.
    (void)hub.say("watch on\r\n");
    response.set_header("X-Holdfast-Controls", controls ? "yes" : "no");
    response.set_chunked_content_provider(
        "application/octet-stream",
        [this, listener](std::size_t, httplib::DataSink& sink) {
          std::string bytes;
          const bool goes_on = hub.hear(*listener, bytes, kPatience);
          if (!bytes.empty() && !sink.write(bytes.data(), bytes.size())) return false;
          if (!goes_on) sink.done();
          // Nothing to send says nothing of whoever has closed the page meanwhile.
          return !bytes.empty() || !goes_on || sink.is_writable();
        },
        [this, listener](bool) {
          hub.leave(listener);
          --pages;
        });
  }
  void picture(const httplib::Request& request, httplib::Response& response) const {
    const std::string text = request.get_param_value("after");
    std::uint64_t after = 0;
    (void)std::from_chars(text.data(), text.data() + text.size(), after);
    const auto found = hub.picture(after, kForAPicture);
    if (!found) {
      response.status = 204;
      return;
    }
    response.set_header("X-Holdfast-Sequence", std::to_string(found->sequence));
    response.set_header("X-Holdfast-Number", std::to_string(found->number));
    response.set_content(std::string(found->jpeg.begin(), found->jpeg.end()), "image/jpeg");
  }

  Hub& hub;
  std::string page, unlock;
  std::string control = new_token(), view = new_token();
  HttpServer http;
  std::atomic<int> pages = 0;  // that listen
  std::mutex doubt_mutex;
  std::optional<std::chrono::steady_clock::time_point> doubt;  // when a page gave a code of its own
  int port = 0;
  std::atomic<bool> ended = false;
  std::thread thread;
};

Web::Web(Hub& hub, std::string page, std::string unlock)
    : server_(std::make_unique<Server>(hub, std::move(page), std::move(unlock))) {}
Web::~Web() = default;

std::string Web::start(int port) {
  constexpr const char* kHere = "127.0.0.1";
  if (port == 0) {
    server_->port = server_->http.bind_to_any_port(kHere);
    if (server_->port <= 0) return trouble("no port is free on 127.0.0.1", "no network loopback", "look at `ip addr`");
  } else {
    if (!server_->http.bind_to_port(kHere, port)) {
      return trouble(fmt::format("port {} of 127.0.0.1 cannot be had", port), "another program has it",
                     "give another with --port, or --port 0 for any that is free");
    }
    server_->port = port;
  }
  server_->thread = std::thread([server = server_.get()] {
    (void)server->http.listen_after_bind();
    server->ended = true;
  });
  // The library forgets a stop() that comes before it listens.
  while (!server_->http.is_running() && !server_->ended) std::this_thread::yield();
  return {};
}

std::string Web::address(bool controls) const {
  return fmt::format("http://127.0.0.1:{}/#{}", server_->port, controls ? server_->control : server_->view);
}

}  // namespace holdfast::live
