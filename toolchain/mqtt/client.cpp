// SPDX-License-Identifier: Apache-2.0
#include "toolchain/mqtt/client.hpp"

#include <mosquitto.h>
#include <poll.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <utility>

#include "drivers/common/trouble.hpp"
#include "toolchain/support/cli.hpp"

namespace holdfast::fleet {
namespace {

constexpr int kAtLeastOnce = 1;
constexpr int kKeepAliveS =
    10;  // a board that has gone without a word is offline for all after one and a half times this
constexpr std::size_t kMostInFlight = 10;
constexpr std::uint64_t kPatienceMs = 10'000;  // for a connection
constexpr std::uint64_t kLookAfterMs = 1000;   // keep-alives
constexpr unsigned kLongestPause = 4;          // 2^4 s

}  // namespace

Client::Client(Config config, std::string serial)
    : config_(std::move(config)),
      serial_(std::move(serial)),
      mosquitto_(::mosquitto_new(("holdfast-" + serial_).c_str(), true, this)) {
  if (mosquitto_ == nullptr) {
    problem_ = trouble("no client for " + serial_, "memory is short", "end what else runs");
    return;
  }
  ::mosquitto_connect_callback_set(mosquitto_, [](::mosquitto*, void* self, int code) {
    static_cast<Client*>(self)->greeted_ = code == 0;
    static_cast<Client*>(self)->refused_ = code;
  });
  ::mosquitto_publish_callback_set(mosquitto_, [](::mosquitto*, void* self, int) {
    auto& in_flight = static_cast<Client*>(self)->in_flight_;
    in_flight -= in_flight > 0 ? 1U : 0U;
  });
  const std::string will = "holdfast/" + serial_ + "/online";
  int code = ::mosquitto_will_set(mosquitto_, will.c_str(), static_cast<int>(std::strlen(kOffline)), kOffline,
                                  kAtLeastOnce, true);
  if (code == MOSQ_ERR_SUCCESS && !config_.ca.empty()) {
    const auto file = [](const std::string& name) { return name.empty() ? nullptr : name.c_str(); };
    code = ::mosquitto_tls_set(mosquitto_, config_.ca.c_str(), nullptr, file(config_.certificate), file(config_.key),
                               nullptr);
  }
  if (code != MOSQ_ERR_SUCCESS) {
    problem_ = trouble(std::string("the broker's settings are refused: ") + ::mosquitto_strerror(code),
                       "a file of --ca, --cert or --key is not there, or --cert came without --key",
                       "look at the names, and at who may read them");
  }
}

Client::~Client() {
  ::mosquitto_destroy(mosquitto_);
}

int Client::fd() const {
  return open_ ? ::mosquitto_socket(mosquitto_) : -1;
}

short Client::events() const {
  return static_cast<short>(POLLIN | (!writable_ || ::mosquitto_want_write(mosquitto_) ? POLLOUT : 0));
}

void Client::connect(std::uint64_t now_ms) {
  tried_ms_ = looked_after_ms_ = now_ms;
  open_ = true;
  writable_ = greeted_ = false;
  const int code = ::mosquitto_connect_async(mosquitto_, config_.host.c_str(), config_.port, kKeepAliveS);
  if (code != MOSQ_ERR_SUCCESS) lost(code, now_ms);
}

// Pauses of 1, 2, 4 ... 16 s, each by another part of itself longer, so that a fleet does not knock all at once.
void Client::lost(int why, std::uint64_t now_ms) {
  open_ = up_ = false;
  const std::uint64_t pause = 1000U << std::min(failures_++, kLongestPause);
  next_try_ms_ = now_ms + pause + (std::hash<std::string>{}(serial_) ^ now_ms) % (pause / 2);
  const std::string reason =
      refused_ != 0 ? ::mosquitto_connack_string(std::exchange(refused_, 0)) : ::mosquitto_strerror(why);
  if (reason == said_) return;
  said_ = reason;
  tool::note(
      trouble(serial_ + ": not connected to " + config_.host + ":" + std::to_string(config_.port) + ": " + reason,
              "the broker or the network is down, another client has this serial, or the certificates do not fit",
              "it is tried again; what changes meanwhile waits in the queue"));
}

bool Client::turn(short revents, std::uint64_t now_ms) {
  if (!open_) {
    if (now_ms >= next_try_ms_) connect(now_ms);
    return false;
  }
  int code = MOSQ_ERR_SUCCESS;
  if (revents != 0) {
    writable_ = writable_ || (revents & POLLOUT) != 0;
    code = ::mosquitto_loop_read(mosquitto_, 1);
    if (code == MOSQ_ERR_SUCCESS && ::mosquitto_want_write(mosquitto_)) code = ::mosquitto_loop_write(mosquitto_, 1);
  }
  if (code == MOSQ_ERR_SUCCESS && now_ms - looked_after_ms_ >= kLookAfterMs) {
    looked_after_ms_ = now_ms;
    code = ::mosquitto_loop_misc(mosquitto_);
  }
  // The library repeats what was in flight before this returns: newer states come behind it.
  const bool begins = std::exchange(greeted_, false) && code == MOSQ_ERR_SUCCESS;
  if (begins) {
    up_ = true;
    failures_ = 0;
    ++connects_;
    if (!said_.empty()) tool::note(serial_ + ": connected");
    said_.clear();
  }
  if (code == MOSQ_ERR_SUCCESS && !up_ && now_ms - tried_ms_ >= kPatienceMs) code = MOSQ_ERR_CONN_LOST;
  if (code == MOSQ_ERR_SUCCESS && ::mosquitto_socket(mosquitto_) < 0) code = MOSQ_ERR_CONN_LOST;
  if (code != MOSQ_ERR_SUCCESS) lost(code, now_ms);
  if (up_ && !begins) drain();
  return begins && up_;
}

bool Client::publish(const std::string& topic, const std::string& payload) {
  if (!up_) return false;
  const int code = ::mosquitto_publish(mosquitto_, nullptr, ("holdfast/" + serial_ + "/" + topic).c_str(),
                                       static_cast<int>(payload.size()), payload.data(), kAtLeastOnce, true);
  // Without a connection the library keeps it, and sends it with the next one.
  if (code == MOSQ_ERR_SUCCESS || code == MOSQ_ERR_NO_CONN) ++in_flight_;
  return code == MOSQ_ERR_SUCCESS || code == MOSQ_ERR_NO_CONN;
}

void Client::queue(std::string topic, std::string payload) {
  if (queue_.size() >= config_.queue) {
    queue_.pop_front();
    ++dropped_;
  }
  queue_.push_back({std::move(topic), std::move(payload)});
  if (up_) drain();
}

void Client::drain() {
  while (up_ && in_flight_ < kMostInFlight && !queue_.empty() &&
         publish(queue_.front().topic, queue_.front().payload)) {
    queue_.pop_front();
  }
}

void Client::end() {
  up_ = false;
  (void)::mosquitto_disconnect(mosquitto_);
  (void)::mosquitto_loop_write(mosquitto_, 1);
}

}  // namespace holdfast::fleet
