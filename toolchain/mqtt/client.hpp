// SPDX-License-Identifier: Apache-2.0
// One board's connection to the broker, by libmosquitto: driven by its owner's poll(), never waits but for a name's
// look-up, connects again by itself, and keeps a bounded queue while it is not connected.
#pragma once

#include <cstdint>
#include <deque>
#include <string>

struct mosquitto;

namespace holdfast::fleet {

// Of the topic `online`; the second is also the will.
inline constexpr const char *kOnline = R"({"online":1})", *kOffline = R"({"online":0})";

class Client {
 public:
  struct Config {
    std::string host;
    int port = 0;
    std::string ca, certificate, key;  // `ca` empty: without TLS
    std::size_t queue = 0;             // messages
  };

  Client(Config config, std::string serial);
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // What is wrong with the configuration, in one line; empty: nothing.
  [[nodiscard]] const std::string& problem() const { return problem_; }

  [[nodiscard]] int fd() const;  // -1: none now
  [[nodiscard]] short events() const;
  // After every poll(). True: a connection has begun, and what is retained has to be published again, for a broker that
  // forgot it.
  [[nodiscard]] bool turn(short revents, std::uint64_t now_ms);

  // Retained, at least once, now or never: false where it is not connected.
  bool publish(const std::string& topic, const std::string& payload);
  // The same, in order; while it is not connected it waits in the queue, whose oldest go first.
  void queue(std::string topic, std::string payload);

  [[nodiscard]] bool up() const { return up_; }
  [[nodiscard]] bool waits() const { return !queue_.empty(); }
  [[nodiscard]] bool idle() const { return in_flight_ == 0 && queue_.empty(); }  // all that was given is at the broker
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }
  [[nodiscard]] std::uint64_t connects() const { return connects_; }
  // In order: the broker does not publish the will.
  void end();

 private:
  struct Item {
    std::string topic, payload;
  };
  void connect(std::uint64_t now_ms);
  void lost(int why, std::uint64_t now_ms);
  void drain();

  Config config_;
  std::string serial_, problem_, said_;
  ::mosquitto* mosquitto_ = nullptr;
  bool open_ = false;      // connecting or connected
  bool writable_ = false;  // since then
  bool greeted_ = false;   // the broker has accepted; not yet seen by turn()
  bool up_ = false;
  int refused_ = 0;  // the broker's reason
  std::uint64_t tried_ms_ = 0, next_try_ms_ = 0, looked_after_ms_ = 0;
  unsigned failures_ = 0;
  std::size_t in_flight_ = 0;
  std::deque<Item> queue_;
  std::uint64_t dropped_ = 0, connects_ = 0;
};

}  // namespace holdfast::fleet
