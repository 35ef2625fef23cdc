// SPDX-License-Identifier: Apache-2.0
// holdfast-mqtt: tells an MQTT broker what boards say on their serial links. A process of its own, beside the firmware.
#include <mosquitto.h>
#include <poll.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/common/trouble.hpp"
#include "toolchain/console/board_port.hpp"
#include "toolchain/console/signals.hpp"
#include "toolchain/mqtt/client.hpp"
#include "toolchain/mqtt/telemetry.hpp"
#include "toolchain/support/cli.hpp"

namespace holdfast {
namespace {

using fleet::Client;
using fleet::Now;

constexpr int kTurnMs = 20;
constexpr std::uint64_t kGoodbyeMs = 2000;

struct Options {
  std::vector<std::string> boards;
  Client::Config broker{.host = "localhost", .port = 0, .ca = {}, .certificate = {}, .key = {}, .queue = 1000};
  bool plain = false, console = false;
  double every_s = 10;
  std::string firmware;
};

Now now() {
  using std::chrono::duration_cast, std::chrono::milliseconds;
  return {static_cast<std::uint64_t>(
              duration_cast<milliseconds>(std::chrono::steady_clock::now().time_since_epoch()).count()),
          duration_cast<milliseconds>(std::chrono::system_clock::now().time_since_epoch()).count()};
}

class Board {
 public:
  Board(const Options& options, const std::string& serial, std::string path)
      : options_(options),
        port_(std::move(path), options.console),
        client_(options.broker, serial),
        telemetry_([this](std::string json) { client_.queue("state", std::move(json)); }) {}

  [[nodiscard]] Client& client() { return client_; }
  [[nodiscard]] pollfd link() const { return {port_.fd(), POLLIN, 0}; }
  [[nodiscard]] pollfd broker() const { return {client_.fd(), client_.events(), 0}; }

  void turn(short link, short broker, Now at) {
    const console_tool::BoardPort::Came came = port_.turn(link != 0, at.steady_ms);
    if (!came.bytes.empty()) telemetry_.hear(came.bytes, at, came.old);
    telemetry_.tick(at);
    if (client_.turn(broker, at.steady_ms)) {
      (void)client_.publish("online", fleet::kOnline);
      (void)client_.publish("version", version());
      if (!client_.waits()) client_.queue("state", telemetry_.state(at));  // otherwise the queue ends with it
      next_counters_ms_ = 0;
    }
    if (at.steady_ms >= next_counters_ms_ &&
        client_.publish("counters", telemetry_.counters(at, client_.dropped(), client_.connects()))) {
      next_counters_ms_ = at.steady_ms + static_cast<std::uint64_t>(options_.every_s * 1000);
    }
  }

 private:
  [[nodiscard]] std::string version() const {
    return nlohmann::ordered_json{
        {"firmware", options_.firmware}, {"link", HOLDFAST_LINK_VERSION}, {"publisher", HOLDFAST_VERSION}}
        .dump();
  }

  const Options& options_;
  console_tool::BoardPort port_;
  Client client_;
  fleet::Telemetry telemetry_;
  std::uint64_t next_counters_ms_ = 0;
};

// A serial becomes a level of a topic and a part of a client's name.
bool is_serial(std::string_view text) {
  return !text.empty() && text.size() <= 64 && std::ranges::all_of(text, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
           c == '.';
  });
}

// One turn of all boards; waits `wait_ms` at most.
void turn(std::vector<std::unique_ptr<Board>>& boards, int signals, int wait_ms) {
  std::vector<pollfd> waits{{signals, POLLIN, 0}};
  for (const auto& board : boards) {
    waits.push_back(board->link());
    waits.push_back(board->broker());
  }
  (void)::poll(waits.data(), waits.size(), wait_ms);
  const Now at = now();
  for (std::size_t k = 0; k < boards.size(); ++k) {
    boards[k]->turn(waits[1 + 2 * k].revents, waits[2 + 2 * k].revents, at);
  }
}

int run(const Options& options) {
  console_tool::Signals signals;
  std::vector<std::unique_ptr<Board>> boards;
  std::set<std::string> serials;
  for (const std::string& one : options.boards) {
    const std::size_t equals = one.find('=');
    const std::string serial = one.substr(0, equals);
    if (equals == std::string::npos || equals + 1 == one.size() || !is_serial(serial)) {
      return tool::fail(trouble("'" + one + "' is no board",
                                "a typing error, or a serial with other signs than A-Z a-z 0-9 - _ .",
                                "give SERIAL=PORT, as HF0012=/dev/ttyUSB0"));
    }
    if (!serials.insert(serial).second) {  // the broker would end each of two clients of one name for the other
      return tool::fail(trouble("'" + serial + "' is there twice", "a typing error: each board has a serial of its own",
                                "give each serial once"));
    }
    boards.push_back(std::make_unique<Board>(options, serial, one.substr(equals + 1)));
    if (!boards.back()->client().problem().empty()) return tool::fail(boards.back()->client().problem());
  }
  while (!signals.over()) {
    turn(boards, signals.fd(), kTurnMs);
  }
  for (const auto& board : boards) (void)board->client().publish("online", fleet::kOffline);
  const std::uint64_t until = now().steady_ms + kGoodbyeMs;
  const auto busy = [](const auto& board) { return board->client().up() && !board->client().idle(); };
  while (std::ranges::any_of(boards, busy) && now().steady_ms < until) turn(boards, -1, kTurnMs);
  for (const auto& board : boards) board->client().end();
  return 0;
}

// What is published is JSON, which is UTF-8.
bool is_utf8(const std::string& text) {
  try {
    (void)nlohmann::json(text).dump();
    return true;
  } catch (const nlohmann::json::type_error&) {
    return false;
  }
}

int start(int argc, char** argv) {
  try {
    Options options;
    CLI::App app{"Tells an MQTT broker what boards say on their serial links: state, reason, counters, versions",
                 "holdfast-mqtt"};
    app.add_option("BOARD", options.boards, "SERIAL=PORT; the topics are holdfast/SERIAL/...")->required();
    app.add_option("--broker", options.broker.host, "the broker's name or address")->capture_default_str();
    app.add_option("--broker-port", options.broker.port, "its port; without it 8883, or 1883 with --plain")
        ->check(CLI::Range(1, 65535));
    auto* ca =
        app.add_option("--ca", options.broker.ca, "TLS: who signed the broker's certificate")->check(CLI::ExistingFile);
    auto* cert =
        app.add_option("--cert", options.broker.certificate, "this client's certificate")->check(CLI::ExistingFile);
    auto* key = app.add_option("--key", options.broker.key, "its key")->check(CLI::ExistingFile);
    cert->needs(ca)->needs(key);
    key->needs(cert);
    app.add_flag("--plain", options.plain, "without TLS: anybody on the network can read and forge")->excludes(ca);
    app.add_option("--queue", options.broker.queue,
                   "changes of state that wait while the broker is away; the oldest go first")
        ->check(CLI::Range(1, 1'000'000))
        ->capture_default_str();
    app.add_option("--every", options.every_s, "seconds between the counters")
        ->check(number_from_to(0.1, 86400.0))
        ->capture_default_str();
    app.add_flag("--console", options.console,
                 "PORT is the console's: say `watch on`, which makes it send status frames");
    app.add_option("--firmware", options.firmware, "what to tell as the firmware's version; the link does not say it");
    app.footer(
        "Example:\n  holdfast-mqtt --ca ca.pem --cert board.pem --key board.key --broker mqtt.lan HF0012=/dev/ttyUSB0");
    if (const std::optional<int> status = tool::parse_command_line(app, argc, argv)) return *status;
    if (options.broker.ca.empty() && !options.plain) {
      return tool::fail(trouble("no --ca", "the broker's certificate cannot be checked without",
                                "give --ca, --cert and --key, or --plain on a network of your own"));
    }
    if (!is_utf8(options.firmware)) {
      return tool::fail(trouble("--firmware: the text is no UTF-8",
                                "it comes from a file of another encoding, or of no text",
                                "give the version in plain letters and digits"));
    }
    if (options.broker.port == 0) options.broker.port = options.plain ? 1883 : 8883;
    std::signal(SIGPIPE, SIG_IGN);  // a broker that has gone is no reason to end
    ::mosquitto_lib_init();
    const int status = run(options);
    ::mosquitto_lib_cleanup();
    return status;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "holdfast-mqtt: %s\n", error.what());
    return 1;
  }
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) {
  return holdfast::start(argc, argv);
}
