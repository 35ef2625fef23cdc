// SPDX-License-Identifier: Apache-2.0
// The console: text commands on the port `host` (115200 8N1, or a pty), for people and for programs.
//
// A line is a command; its answer ends with `OK` or `ERR <number> <name>: ...`, so that no program has to guess how
// long to wait. Read commands take the word `json`: one line, stable keys. What changes the device needs `unlock` with
// the device's code first. Lines that begin with `*` are the device's own and may stand between answers. `watch on`
// puts status, evidence and marker frames (LINK.md) between the lines, and prompts no more.
//
// Authority: a command frame needs the unlock, too, unless Place::host_commands says otherwise. The lock closes by
// `lock`, ten minutes after the last command, with a wrong code, and when whoever was at the other end has gone; what
// he left on the way opens nothing.
//
// Beside the pipeline and below it: each poll() reads and writes a bounded number of bytes, makes a bounded number of
// lines, and waits for nobody. A reader that is slow slows its own answers down; one that has gone costs nothing.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "app/daemon.hpp"
#include "console/errors.hpp"
#include "console/line_editor.hpp"
#include "console/loading.hpp"
#include "console/output.hpp"
#include "console/page.hpp"
#include "console/text.hpp"
#include "hal/clock.hpp"
#include "hal/faults.hpp"
#include "hal/notes.hpp"
#include "hal/serial.hpp"
#include "hal/store.hpp"
#include "hal/verifier.hpp"
#include "params/params.hpp"
#include "slip/evidence.hpp"
#include "store/models.hpp"
#include "store/settings.hpp"
#include "store/slot_store.hpp"

namespace holdfast::console {

// What a board tells about itself.
struct Place {
  std::string_view board{};              // sim, rpi4, virt
  std::string_view code{};               // that unlocks; empty: nothing does
  hal::Store* settings = nullptr;        // null: nothing can be saved
  hal::Store* models = nullptr;          // null: no model can be loaded
  const hal::Verifier* owner = nullptr;  // null: development mode, where nothing has to be signed
  hal::Notes* notes = nullptr;           // null: nobody leaves any
  hal::Faults* faults = nullptr;         // simulated boards only
  bool prompts = true;                   // somebody can type here
  bool host_commands = false;            // command frames are obeyed while it is locked
};

class Console;

// A command makes its answer in steps, each of at most kStepBytes, so that a long one waits for a slow reader without
// holding anything up.
struct Answer {
  enum class Kind : std::uint8_t { kMore, kDone, kError } kind = Kind::kDone;
  Error error = Error::kNone;
};

struct Words {
  static constexpr std::size_t kMost = 8;
  std::array<std::string_view, kMost> word{};
  std::size_t count = 0;
  bool json = false;  // the last word was that; it is not counted
  [[nodiscard]] std::string_view operator[](std::size_t k) const { return k < count ? word[k] : std::string_view{}; }
};

struct CommandInfo {
  std::string_view name;
  std::string_view arguments;  // for people; words in it that stand alone are completed
  std::string_view help;
  bool changes = false;  // locked until unlock
  Answer (*run)(Console&, const Words&, std::int32_t step) = nullptr;
};
[[nodiscard]] std::span<const CommandInfo> commands();

class Console {
 public:
  Console(hal::Serial& port, Daemon& daemon, const hal::Clock& clock, const Place& place)
      : port_(port),
        daemon_(daemon),
        clock_(clock),
        place_(place),
        settings_(sealed::Kind::kSettings, settings::good, place.settings, place.owner),
        models_(sealed::Kind::kModel, models::good, place.models, place.owner),
        model_sequence_(models_.counts() ? models_.sequence() : 0),
        model_damaged_(models_.damaged()) {}

  // After Daemon::start().
  void start(const Params& params);
  // Instead of start().
  void cannot_start(Reason why);
  // What was said goes out, as far as the port takes it.
  void end();
  // Once around. Range: any input.
  void poll();
  [[nodiscard]] bool asked_to_restart() const { return restart_; }

  // Per poll(): 115200 baud bring 58 bytes in Daemon::kSlice; four times that gets rid of a driver's 4 kB of noise in
  // 80 ms.
  static constexpr std::size_t kMostIn = 256;
  static constexpr std::size_t kMostOut = 1024;
  static constexpr int kMostSteps = 4;
  static constexpr std::size_t kStepBytes = 1280;
  static constexpr Micros kFrameGap{200'000};                     // a frame takes 3 ms at 115200 baud
  static constexpr Micros kStaysUnlocked{10 * 60 * 1'000'000LL};  // after the last command; noise is none
  static constexpr Micros kLongestWait{60'000'000};               // for the next code, after wrong ones

  // ---- For the commands
  [[nodiscard]] Daemon& daemon() { return daemon_; }
  [[nodiscard]] Page& page() { return page_; }
  [[nodiscard]] Output& out() { return out_; }
  [[nodiscard]] const Place& place() const { return place_; }
  [[nodiscard]] Micros now() const { return clock_.now(); }
  [[nodiscard]] Micros started() const { return started_; }
  // More about the error that the command returns.
  [[nodiscard]] Text<200>& detail() { return detail_; }
  // In place of an error's own words.
  struct Why {
    std::string_view what, cause, next;
  };
  void explain(const Why& why) { why_ = why; }
  [[nodiscard]] const Params& params() const { return params_; }
  [[nodiscard]] Error change(const Params& params);
  // The parameters, what `load` put together, and that the compiled-in tree is to decide: kNone when the writing has
  // begun. stored() tells of its end: nothing yet, or how it went.
  [[nodiscard]] Error save();
  [[nodiscard]] Error store_loaded();
  [[nodiscard]] Error store_default_model();
  [[nodiscard]] std::optional<Error> stored();
  // Goes on with the settings and the model in force though others were stored: until the next start, or what is saved.
  [[nodiscard]] Error accept();
  // What this start found of its settings, or has saved since.
  [[nodiscard]] settings::Found found() const { return found_; }
  [[nodiscard]] Loading& loading() { return loading_; }
  [[nodiscard]] const SlotStore& settings() const { return settings_; }
  [[nodiscard]] const SlotStore& models() const { return models_; }
  // Of the record by which the model that decides was chosen; 0: none was.
  [[nodiscard]] std::uint32_t model_sequence() const { return model_sequence_; }
  // Whether this start found a damaged one.
  [[nodiscard]] bool model_damaged() const { return model_damaged_; }
  [[nodiscard]] Error unlock(std::string_view code);
  void lock();
  [[nodiscard]] bool unlocked() const { return unlocked_; }
  void set_echo(bool echo) { editor_.set_echo(echo); }
  enum class Stream : std::uint8_t { kNone, kFrames, kScreen, kTrace };
  void stream(Stream stream);
  void ask_to_restart() { restart_ = true; }
  [[nodiscard]] std::uint32_t frames_lost() const { return frames_lost_; }
  // Of the last picture; `reason`: of the device's state.
  [[nodiscard]] evidence::Shown shown(Reason reason, int finger = 0) const;
  // Command frames, for want of authority.
  [[nodiscard]] std::uint32_t refused() const { return refused_; }

 private:
  void read();
  void hang_up();
  void end_of_stale();
  void run();
  void take(std::uint8_t byte);
  [[nodiscard]] command_frame::Outcome obey(const command_frame::CommandFrame& frame);
  void take_text();
  void end_line(LineEditor::Event event);
  void begin(std::string_view line);
  void finish(Answer answer);
  void fail(Error error);
  void complete();
  void prompt();
  void say_state();
  void telemetry();
  void send_frame(std::span<const std::uint8_t> wire);
  void send_evidence(Reason reason, int finger);
  void send_load(int finger);
  void send_markers();
  void trace_line();
  void go_on_with_settings();
  void hold(supervisor::Source source, bool lost);
  [[nodiscard]] Error store_own(SlotStore& slots, std::span<std::uint8_t> record, std::size_t payload);
  [[nodiscard]] Error begun(SlotStore& slots, SlotStore::Put put);
  [[nodiscard]] bool idle() const { return running_ == nullptr; }

  hal::Serial& port_;
  Daemon& daemon_;
  const hal::Clock& clock_;
  Place place_;

  Output out_;
  Page page_{out_};
  LineEditor editor_;
  link::Receiver frames_;
  Micros heard_at_{};
  command_frame::Once once_;
  std::array<std::uint8_t, 4096> in_{};  // read and not yet looked at: a pasted `dump` four times over
  std::size_t in_begin_ = 0, in_size_ = 0;
  static constexpr std::size_t kNoFrame = command_frame::kCommandBytes;
  std::size_t since_zero_ = kNoFrame;  // bytes read since the last 0x00 that may have begun a command frame
  bool overrun_ = false;               // what came behind it is lost, so the line that it cut is none
  std::size_t stale_ = 0;              // of in_size_: from before the last hang-up
  std::uint32_t hang_ups_ = 0;

  const CommandInfo* running_ = nullptr;
  Words words_;
  std::int32_t step_ = 0;
  Text<200> detail_;
  Why why_;  // empty: the error's own words

  Params params_{};
  SlotStore settings_;
  SlotStore models_;
  std::uint32_t model_sequence_;
  bool model_damaged_;
  SlotStore* storing_ = &settings_;  // which of them is asked for stored()
  bool saving_ = false;              // what is stored there are the parameters in force
  settings::Found found_ = settings::Found::kNoPlace;
  bool settings_held_ = false, model_held_ = false;  // in FAULT for that
  Loading loading_;
  bool unlocked_ = false;
  int wrong_codes_ = 0;
  Micros try_at_{};
  Micros last_command_{};
  Micros started_{};
  bool restart_ = false;
  bool at_prompt_ = false;

  Stream stream_ = Stream::kNone;
  std::uint16_t seen_ = 0;  // sequence of the last report that was streamed
  std::uint16_t pictures_ = 0;
  bool rest_known_ = false;
  Micros screen_at_{};
  std::uint32_t frames_lost_ = 0;
  std::uint32_t refused_ = 0;
  std::uint32_t refusals_noted_ = 0;  // bit: command
  DeviceState shown_ = DeviceState::kBoot;
  bool state_shown_ = false;
};

}  // namespace holdfast::console
