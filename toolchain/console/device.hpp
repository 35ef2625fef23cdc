// SPDX-License-Identifier: Apache-2.0
// The device's console as a program talks to it: a line out, its answer back, and between answers whatever the device
// says by itself: `* STATE reason`, lines of `trace` and `watch`, telemetry frames (LINK.md).
//
// Speaks `echo off`, so that nothing but answers comes, and leaves the console as a person expects it.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "link/link.hpp"
#include "link/marker_frame.hpp"
#include "link/status_frame.hpp"
#include "toolchain/console/port.hpp"
#include "toolchain/console/signals.hpp"

namespace holdfast::console_tool {

using Millis = std::chrono::milliseconds;

struct Answer {
  enum class Kind : std::uint8_t {
    kOk,
    kError,   // error: the device's line
    kSilent,  // nothing came for as long as there was patience; error says so
    kGone,    // the port was unplugged; error says so
  } kind = Kind::kSilent;
  std::vector<std::string> lines;
  std::string error;
  [[nodiscard]] bool ok() const { return kind == Kind::kOk; }
  // The number behind ERR; 0: none.
  [[nodiscard]] int number() const;
};

// A line that the device answers with nothing: blank, or a comment.
[[nodiscard]] bool says_nothing(std::string_view line);

class Device {
 public:
  // What comes while nothing was asked, and what stands between answers. They are called from say() and listen().
  struct Heard {
    std::function<void(std::string_view line)> line;
    std::function<void(const status_frame::StatusFrame&)> status;
    std::function<void(link::Kind, const marker_frame::MarkerFrame&)> markers;
  };

  Device(Port& port, Signals& signals, Millis patience) : port_(port), signals_(signals), patience_(patience) {}
  ~Device() { detach(); }
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  Heard heard;

  // Ends whatever runs there, and finds out that it is a Holdfast. The port is open. False: no such answer in time.
  [[nodiscard]] bool attach(Millis deadline);
  // Locks what was unlocked from here, ends streams, and gives the echo back to people.
  void detach();
  // Others unlock it, through the port: detach() locks it all the same.
  void lock_at_end() { lock_again_ = true; }

  // The answer; its lines go to `on_line` as they come, or into the answer when there is none. Ctrl-C goes on to the
  // device. Range: one line of text that says something; tabs become blanks, as a Tab would complete.
  [[nodiscard]] Answer say(std::string_view line, const std::function<void(std::string_view)>& on_line = {});
  // Whether Ctrl-C came while an answer was waited for; once.
  [[nodiscard]] bool was_interrupted() { return std::exchange(interrupted_, false); }
  // Ends what the device streams.
  [[nodiscard]] bool interrupt() { return port_.write("\x03"); }

  // Takes what has come. False: the port was unplugged.
  [[nodiscard]] bool listen();

  [[nodiscard]] Port& port() { return port_; }
  // As it was named first: what is there under that name after it was unplugged.
  [[nodiscard]] const std::string& port_name() const { return port_.path(); }
  [[nodiscard]] bool reopen() { return port_.open(std::string(port_.path())) == Port::Opened::kYes; }
  [[nodiscard]] Signals& signals() { return signals_; }
  [[nodiscard]] bool unlocked() const { return unlocked_; }
  [[nodiscard]] const std::string& version() const { return version_; }  // JSON, of attach()
  // Bytes that were no sound frame, since it was made.
  [[nodiscard]] std::uint32_t damaged() const { return frames_.damaged(); }

 private:
  void take(std::uint8_t byte);
  void take_line();
  [[nodiscard]] bool answer_in(Millis deadline);
  void note_lock(std::string_view line, const Answer& answer);

  Port& port_;
  Signals& signals_;
  Millis patience_;
  link::Receiver frames_;
  std::string text_;  // of the line that is coming
  Answer* asked_ = nullptr;
  const std::function<void(std::string_view)>* on_line_ = nullptr;
  bool answered_ = false;
  std::string complaint_;       // that attach() waits for; empty: it does not
  bool wants_version_ = false;  // the next line is it
  bool attached_ = false;
  bool out_of_step_ = false;
  bool interrupted_ = false;
  bool unlocked_ = false;
  bool lock_again_ = false;    // it was unlocked from here
  std::uint64_t letters_ = 0;  // of text, that came
  std::string version_;
};

}  // namespace holdfast::console_tool
