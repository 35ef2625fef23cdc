// SPDX-License-Identifier: Apache-2.0
#include "console/console.hpp"

#include <algorithm>

#include "base/math.hpp"
#include "link/evidence_frame.hpp"
#include "link/load_frame.hpp"
#include "link/marker_frame.hpp"

namespace holdfast::console {
namespace {

constexpr std::string_view kLockedPrompt = "holdfast> ";
constexpr std::string_view kUnlockedPrompt = "holdfast# ";
constexpr std::string_view kUnlock = "unlock";  // the command
constexpr Micros kScreenEvery{200'000};         // 5 Hz: as fast as figures can be read
constexpr std::size_t kMostWaiting = 128;       // what a fast typist, or a robot's frames, may have under way
constexpr std::uint8_t kLost = 0x1A;            // no key of text: the line that it stands in is damaged

// Equal time whatever they hold: how long a wrong code takes tells nothing about the right one. Range: codes up to 64.
bool equal_codes(std::string_view a, std::string_view b) {
  constexpr std::size_t kMost = 64;
  unsigned difference = a.size() == b.size() && b.size() <= kMost ? 0 : 1;
  for (std::size_t k = 0; k < kMost; ++k) {
    const unsigned x = k < a.size() ? static_cast<unsigned char>(a[k]) : 0U;
    const unsigned y = k < b.size() ? static_cast<unsigned char>(b[k]) : 0U;
    difference |= x ^ y;
  }
  return difference == 0;
}

// Edits that lead from one word to the other: insertions, deletions, replacements, neighbours swapped.
// Range: words up to kLongest; longer ones are far from everything.
constexpr std::size_t kLongest = 24;
int distance(std::string_view a, std::string_view b) {
  if (a.size() > kLongest || b.size() > kLongest) return kLongest;
  std::array<std::array<std::uint8_t, kLongest + 1>, kLongest + 1> d{};
  for (std::size_t i = 0; i <= a.size(); ++i) d[i][0] = static_cast<std::uint8_t>(i);
  for (std::size_t j = 0; j <= b.size(); ++j) d[0][j] = static_cast<std::uint8_t>(j);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    for (std::size_t j = 1; j <= b.size(); ++j) {
      int least = d[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      least = std::min({least, d[i - 1][j] + 1, d[i][j - 1] + 1});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) least = std::min(least, d[i - 2][j - 2] + 1);
      d[i][j] = static_cast<std::uint8_t>(least);
    }
  }
  return d[a.size()][b.size()];
}

const CommandInfo* find(std::string_view name) {
  for (const CommandInfo& row : commands()) {
    if (row.name == name) return &row;
  }
  return nullptr;
}

// One edit for every three letters, and at least one.
std::string_view nearest(std::string_view name) {
  std::string_view best;
  int least = std::max(1, static_cast<int>(name.size() / 3)) + 1;
  for (const CommandInfo& row : commands()) {
    const int far = distance(name, row.name);
    if (far >= least) continue;
    least = far;
    best = row.name;
  }
  return best;
}

bool is_word(char c) {
  return c >= 'a' && c <= 'z';
}

// Calls `take` with every word that may stand at place `index` of a line that begins with `first`.
template <typename Take>
void candidates(std::size_t index, std::string_view first, Take take) {
  if (index == 0) {
    for (const CommandInfo& row : commands()) take(row.name);
    return;
  }
  const CommandInfo* const command = find(first);
  if (command == nullptr) return;
  std::string_view rest = command->arguments;
  while (!rest.empty()) {
    std::size_t size = 0;
    while (size < rest.size() && is_word(rest[size])) ++size;
    // Words that stand for something else are written in capitals.
    if (size > 0) take(rest.substr(0, size));
    rest.remove_prefix(std::min(rest.size(), size + 1));
  }
  if (index != 1) return;
  if (command->arguments.find("PARAMETER") != std::string_view::npos) {
    for (const ParamInfo& row : kParams) take(row.name);
  }
  if (command->arguments.find("COMMAND") != std::string_view::npos) {
    for (const CommandInfo& row : commands()) take(row.name);
  }
}

}  // namespace

void Console::start(const Params& params) {
  params_ = params;
  started_ = last_command_ = clock_.now();
  hang_ups_ = port_.hang_ups();
  editor_.set_echo(place_.prompts);
  // Whoever types here begins in the middle of text: the first key is not held back as what may begin a frame.
  for (int k = 0; k < 2; ++k) (void)frames_.push('\n');
  Params ignored;  // the board has taken them
  found_ = settings::take(settings_, ignored);
  settings_held_ = settings::lost(found_);
  model_held_ = model_damaged_;
  if (settings_.has_place()) daemon_.recorder().note(EventKind::kSettings, started_, static_cast<std::int32_t>(found_));
  if (model_held_) daemon_.recorder().note(EventKind::kModel, started_);
  hold(supervisor::Source::kSettings, settings_held_);
  hold(supervisor::Source::kModel, model_held_);
  say_state();
}

void Console::cannot_start(Reason why) {
  out_.put("* ");
  out_.put(holdfast::info(DeviceState::kFault).name);
  out_.put(" ");
  out_.put(holdfast::info(why).name);
  out_.put("\r\n");
  end();
}

void Console::end() {
  out_.flush(port_, Output::kBytes);
}

void Console::poll() {
  const Micros begun = clock_.now();
  // No wait of hours behind a clock that was set back, as in Daemon::mind_the_clock().
  last_command_ = std::min(last_command_, begun);
  heard_at_ = std::min(heard_at_, begun);
  screen_at_ = std::min(screen_at_, begun);
  try_at_ = std::min(try_at_, begun + kLongestWait);
  if (unlocked_ && begun - last_command_ > kStaysUnlocked) lock();
  read();
  run();
  say_state();
  telemetry();
  out_.flush(port_, kMostOut);
  daemon_.app().stopwatch().add(Task::kConsole, clock_.now() - begun);
}

// What comes while a command is running waits for its end. Ctrl-C goes before all of it, also when there is no more
// room for anything else; the same byte in a command frame is none: each RELEASE has one.
void Console::read() {
  std::array<std::uint8_t, kMostIn> bytes;
  const std::size_t count = port_.read(bytes);
  if (port_.hang_ups() != hang_ups_) hang_up();
  if (count > 0) heard_at_ = clock_.now();
  for (const std::uint8_t byte : std::span(bytes).first(count)) {
    const bool framed = since_zero_ >= 2 && since_zero_ < command_frame::kCommandBytes;
    const bool text = since_zero_ == 1 && byte > link::kLastVersion;  // 00, any, version: link.hpp
    since_zero_ = byte == 0 ? 0 : text ? kNoFrame : std::min(since_zero_ + 1, kNoFrame);
    if (byte == 0x03 && !framed && (!idle() || in_size_ > kMostWaiting)) {
      in_begin_ = 0;
      in_size_ = 0;
      overrun_ = false;
      if (stale_ > 0) end_of_stale();
      if (!idle()) {
        finish({Answer::Kind::kError, Error::kInterrupted});
      } else {
        in_[in_size_++] = byte;
      }
    } else if (in_size_ == in_.size()) {
      overrun_ = true;
    } else {
      in_[(in_begin_ + in_size_) % in_.size()] = byte;
      ++in_size_;
    }
  }
}

// The authority went with whoever had it. What he left in the queue is answered - programs end with `echo on` - but
// does not open the lock, and no frame of it is obeyed.
void Console::hang_up() {
  hang_ups_ = port_.hang_ups();
  lock();
  refusals_noted_ = 0;
  stale_ = in_size_;
  if (stale_ == 0) end_of_stale();
}

// Half a line, or half a frame, is completed by nobody else.
void Console::end_of_stale() {
  stale_ = 0;
  if (!editor_.line().empty()) at_prompt_ = false;
  editor_.forget_line();
  (void)frames_.give_up();
}

void Console::lock() {
  unlocked_ = false;
  loading_.end();
  // Read, and not begun: an output that nobody takes may hold it up for hours.
  const bool acts = running_ != nullptr && (running_->changes || words_[0] == kUnlock);
  if (acts && step_ == 0) finish({Answer::Kind::kError, Error::kInterrupted});
}

void Console::run() {
  for (int step = 0; step < kMostSteps && !idle() && out_.room() >= kStepBytes; ++step) {
    const Answer answer = running_->run(*this, words_, step_++);
    if (answer.kind != Answer::Kind::kMore) finish(answer);
  }
  for (std::size_t k = 0; k < kMostIn && in_size_ > 0 && idle() && out_.room() >= kStepBytes; ++k) {
    const std::uint8_t byte = in_[in_begin_];
    in_begin_ = (in_begin_ + 1) % in_.size();
    --in_size_;
    take(byte);
    if (stale_ > 0 && --stale_ == 0) end_of_stale();
    if (in_size_ > 0 || !overrun_) continue;
    overrun_ = false;
    take(kLost);
  }
  if (in_size_ == 0 && idle() && frames_.in_frame() && clock_.now() - heard_at_ > kFrameGap &&
      frames_.give_up() == link::Event::kText) {
    take_text();
  }
  if (idle() && !at_prompt_ && out_.room() >= kStepBytes) prompt();
}

// A frame among the text is a command of the robot's; the text is somebody's line.
void Console::take(std::uint8_t byte) {
  const link::Event event = frames_.push(byte);
  if (event == link::Event::kFrame) {
    const auto frame = command_frame::read_command(frames_.payload());
    if (!frame) return;
    const command_frame::AnswerFrame answer =
        once_.answer(*frame, clock_.now(), [this](const command_frame::CommandFrame& f) { return obey(f); });
    std::array<std::uint8_t, command_frame::kAnswerBytes> wire;
    (void)command_frame::encode(answer, wire);
    send_frame(wire);
    return;
  }
  if (event == link::Event::kText) take_text();
}

// A refusal is counted each time and noted once for each command, until the lock or whoever is there changes: a sender
// without authority must not push out of the log what happened before.
command_frame::Outcome Console::obey(const command_frame::CommandFrame& frame) {
  if (stale_ == 0 && (unlocked_ || place_.host_commands)) return daemon_.obey(frame);
  count_up(refused_);
  const std::uint32_t bit = std::uint32_t{1} << static_cast<unsigned>(frame.command);
  if ((refusals_noted_ & bit) == 0) {
    daemon_.recorder().note(EventKind::kCommand, clock_.now(), static_cast<std::int32_t>(frame.command),
                            static_cast<std::int32_t>(command_frame::Outcome::kLocked));
  }
  refusals_noted_ |= bit;
  return command_frame::Outcome::kLocked;
}

void Console::take_text() {
  std::array<std::uint8_t, link::kMaxWireBytes> text;
  const std::size_t count = frames_.text().size();
  std::copy_n(frames_.text().begin(), count, text.begin());
  for (const std::uint8_t letter : std::span(text).first(count)) {
    const LineEditor::Event what = editor_.push(letter, out_);
    switch (what) {
      case LineEditor::Event::kNone:
        break;
      case LineEditor::Event::kTab:
        complete();
        break;
      case LineEditor::Event::kInterrupt:
        stream_ = Stream::kNone;
        at_prompt_ = false;
        break;
      default:
        end_line(what);
        break;
    }
  }
}

void Console::end_line(LineEditor::Event event) {
  at_prompt_ = false;
  detail_.clear();
  why_ = {};
  if (event == LineEditor::Event::kTooLong) return fail(Error::kTooLong);
  if (event == LineEditor::Event::kDamaged) return fail(Error::kDamaged);
  begin(editor_.line());
}

void Console::begin(std::string_view line) {
  words_ = {};
  detail_.clear();
  line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
  const bool sets = line.starts_with("set");
  while (true) {
    while (!line.empty() && (line.front() == ' ' || line.front() == '\t' || (sets && line.front() == '='))) {
      line.remove_prefix(1);
    }
    if (line.empty()) break;
    if (words_.count == Words::kMost) return fail(Error::kArguments);
    std::size_t size = 0;
    while (size < line.size() && line[size] != ' ' && line[size] != '\t' && !(sets && line[size] == '=')) ++size;
    words_.word[words_.count++] = line.substr(0, size);
    line.remove_prefix(size);
  }
  if (words_.count == 0 || words_[0].front() == '#') return;  // a comment of a pasted file
  const CommandInfo* const command = find(words_[0]);
  // Not a code, nor what may be one behind a mistyped word.
  if (command != nullptr && words_[0] != kUnlock && words_[0] != "load") editor_.remember_line();
  if (command == nullptr) {
    detail_ << words_[0].substr(0, kLongest);
    if (const std::string_view near = nearest(words_[0]); !near.empty()) detail_ << " (" << near << "?)";
    return fail(Error::kUnknownCommand);
  }
  if (words_.count > 1 && words_[words_.count - 1] == "json") {
    if (command->arguments.find("json") == std::string_view::npos) return fail(Error::kArguments);
    words_.json = true;
    --words_.count;
  }
  if (command->changes && !unlocked_) return fail(Error::kLocked);
  if (words_[0] == kUnlock && stale_ > 0) return fail(Error::kInterrupted);
  last_command_ = clock_.now();
  running_ = command;
  step_ = 0;
}

void Console::finish(Answer answer) {
  const bool in_a_line = !out_.at_line_start();
  running_ = nullptr;
  if (in_a_line) out_.put("\r\n");
  if (answer.kind == Answer::Kind::kError) return fail(answer.error);
  out_.put("OK\r\n");
}

void Console::fail(Error error) {
  const ErrorInfo& row = info(error);
  const Why why = why_.what.empty() ? Why{row.what, row.cause, row.next} : why_;
  out_.put("ERR ");
  out_.integer(static_cast<std::int64_t>(error));
  out_.put(" ");
  out_.put(row.name);
  out_.put(": ");
  if (!detail_.view().empty()) {
    out_.put(detail_.view());
    out_.put(": ");
  }
  out_.put(why.what);
  out_.put(". Likely cause: ");
  out_.put(why.cause);
  out_.put(". Next: ");
  out_.put(why.next);
  out_.put("\r\n");
}

void Console::prompt() {
  at_prompt_ = true;
  if (stream_ != Stream::kNone || !editor_.echo()) return;
  editor_.prompt(unlocked_ ? kUnlockedPrompt : kLockedPrompt, out_);
}

// The part that all candidates share; when that is nothing new, all of them.
void Console::complete() {
  const std::string_view before = editor_.line().substr(0, editor_.cursor());
  std::size_t begin = before.size();
  while (begin > 0 && before[begin - 1] != ' ') --begin;
  const std::string_view typed = before.substr(begin);
  std::size_t index = 0;
  std::string_view first;
  for (std::size_t k = 0; k < begin;) {
    while (k < begin && before[k] == ' ') ++k;
    const std::size_t word = k;
    while (k < begin && before[k] != ' ') ++k;
    if (k == word) break;
    if (index == 0) first = before.substr(word, k - word);
    ++index;
  }
  std::string_view common;
  std::size_t matches = 0;
  candidates(index, first, [&](std::string_view candidate) {
    if (!candidate.starts_with(typed) || candidate.size() > kLongest) return;
    if (matches++ == 0) {
      common = candidate;
    } else {
      std::size_t same = 0;
      while (same < common.size() && same < candidate.size() && common[same] == candidate[same]) ++same;
      common = common.substr(0, same);
    }
  });
  if (matches == 0) return;
  if (matches == 1) {
    Text<kLongest + 1> rest;
    rest << common.substr(typed.size()) << " ";
    return editor_.insert(rest.view(), out_);
  }
  if (common.size() > typed.size()) return editor_.insert(common.substr(typed.size()), out_);
  if (!editor_.echo()) return;
  out_.put("\r\n");
  candidates(index, first, [&](std::string_view candidate) {
    if (!candidate.starts_with(typed)) return;
    out_.put(candidate);
    out_.put(out_.column() > LineEditor::kColumns - kLongest ? "\r\n" : "  ");
  });
  out_.put("\r\n");
  editor_.prompt(unlocked_ ? kUnlockedPrompt : kLockedPrompt, out_);
}

// One line per change of state, where no line is being written; the prompt comes again behind it.
void Console::say_state() {
  const supervisor::Outputs& outputs = daemon_.app().outputs();
  if (state_shown_ && outputs.state == shown_) return;
  if (!idle() || out_.room() < kStepBytes) return;
  state_shown_ = true;
  shown_ = outputs.state;
  if (!out_.at_line_start()) out_.put("\r\x1B[K");
  out_.put("* ");
  out_.put(holdfast::info(outputs.state).name);
  out_.put(" ");
  out_.put(holdfast::info(outputs.reason).name);
  out_.put("\r\n");
  if (at_prompt_) prompt();
}

void Console::stream(Stream stream) {
  stream_ = stream;
  seen_ = daemon_.app().last_status().sequence;
  rest_known_ = false;
  pictures_ = 0;
  screen_at_ = clock_.now();
}

void Console::telemetry() {
  if (stream_ == Stream::kNone || !idle() || !out_.at_line_start()) return;
  const status_frame::StatusFrame& told = daemon_.app().last_status();
  if (told.sequence == seen_) return;
  if (stream_ == Stream::kScreen && clock_.now() - screen_at_ < kScreenEvery) return;
  seen_ = told.sequence;
  if (stream_ != Stream::kFrames) {
    screen_at_ = clock_.now();
    return trace_line();
  }
  std::array<std::uint8_t, status_frame::kMostWireBytes> wire{};
  send_frame(std::span(wire).first(status_frame::encode(told, wire)));
  const int finger = daemon_.app().latest();
  const pipeline::Result& result = daemon_.app().result(finger);
  if (!result.quality.ok() || !result.referenced) return;
  send_evidence(told.reason, finger);
  send_load(finger);
  if (finger == 0) send_markers();
}

evidence::Shown Console::shown(Reason reason, int finger) const {
  const App& app = daemon_.app();
  const pipeline::Result& result = app.result(finger);
  return evidence::show({app.tree()}, result.features, result.evidence, reason == Reason::kContactLost);
}

void Console::send_evidence(Reason reason, int finger) {
  const pipeline::Result& result = daemon_.app().result(finger);
  evidence_frame::EvidenceFrame frame =
      evidence_frame::frame_of(seen_, shown(reason, finger), result.contact, result.features.imprint, result.run);
  frame.finger = static_cast<std::uint8_t>(finger);
  std::array<std::uint8_t, evidence_frame::kWireBytes> wire{};
  evidence_frame::encode(frame, wire);
  send_frame(wire);
}

void Console::send_load(int finger) {
  std::array<std::uint8_t, load_frame::kWireBytes> wire{};
  load_frame::encode(load_frame::frame_of(seen_, static_cast<std::uint8_t>(finger), daemon_.app().result(finger).load),
                     wire);
  send_frame(wire);
}

void Console::send_markers() {
  const pipeline::State& state = daemon_.app().state();
  const bool rest = !rest_known_ || pictures_ % marker_frame::kRestEvery == 0;
  const bool now = pictures_ % marker_frame::kEvery == 0;
  pictures_ = static_cast<std::uint16_t>((pictures_ + 1) % marker_frame::kRestEvery);
  const std::int32_t pieces = marker_frame::frames_of(state.displacement.grid);
  std::array<std::uint8_t, marker_frame::kWireBytes> wire{};
  if (rest && out_.room() >= idx(pieces) * (wire.size() + 1)) {
    rest_known_ = true;
    for (std::int32_t k = 0; k < pieces; ++k) {
      marker_frame::encode(
          link::Kind::kRest,
          marker_frame::rest_piece(state.reference.rest, state.reference.pitch, params_.pitch_um, seen_, k), wire);
      send_frame(wire);
    }
  }
  if (!now) return;
  for (std::int32_t k = 0; k < pieces; ++k) {
    marker_frame::encode(link::Kind::kDisplacement, marker_frame::displacement_piece(state.displacement, seen_, k),
                         wire);
    send_frame(wire);
  }
}

// A reader that is slower than the frames misses some, whole ones.
void Console::send_frame(std::span<const std::uint8_t> wire) {
  if (!out_.put_frame(wire)) count_up(frames_lost_);
}

void Console::trace_line() {
  if (out_.room() < kStepBytes) return count_up(frames_lost_);
  const status_frame::StatusFrame& told = daemon_.app().last_status();
  out_.decimal((clock_.now() - started_).count(), 1'000'000, 3);
  out_.put(" s  ");
  out_.put(holdfast::info(told.state).name);
  out_.put(" ");
  out_.put(holdfast::info(told.reason).name);
  if (told.features_valid) {
    out_.put("  markers ");
    out_.integer(told.markers);
    out_.put("  v ");
    out_.decimal(told.vx_um_s, 1000, 2);
    out_.put(" ");
    out_.decimal(told.vy_um_s, 1000, 2);
    out_.put(" mm/s  E ");
    out_.decimal(told.entropy_nat_q16, 65536, 3);
    out_.put(" nat  dE/dt ");
    out_.decimal(told.entropy_rate_nat_s_q8, 256, 2);
  }
  out_.put(told.slip ? "  SLIP" : "");
  out_.put(told.grip_ok ? "  GRIP_OK" : "");
  out_.put("\r\n");
}

Error Console::change(const Params& params) {
  if (ParamProblem problem; !validate(params, &problem).ok()) {
    detail_.clear();
    detail_ << problem.row->name << " is " << problem.rule;
    return Error::kContradiction;
  }
  const auto* const owners = std::ranges::find_if(kParams, [&](const ParamInfo& row) {
    return row.kind == ParamClass::kSafety && params.*row.member != params_.*row.member;
  });
  if (owners != kParams.end() && !settings_.development()) {
    detail_ << owners->name;
    return Error::kOwnersAlone;
  }
  for (const ParamInfo& row : kParams) {
    if (params.*row.member == params_.*row.member) continue;
    daemon_.recorder().note(EventKind::kSetting, clock_.now(), static_cast<std::int32_t>(&row - kParams.data()),
                            params.*row.member);
  }
  daemon_.reconfigure(params);
  params_ = params;
  return Error::kNone;
}

// A record of the device's own; its payload of so many bytes stands in its place already.
Error Console::store_own(SlotStore& slots, std::span<std::uint8_t> record, std::size_t payload) {
  if (!slots.has_place()) return Error::kNotStored;
  if (!slots.development()) return Error::kNotSigned;
  if (slots.settle() == hal::Store::State::kBusy) return Error::kStillWriting;  // and then its number is the next
  const std::size_t bytes =
      sealed::write(slots.kind(), slots.next_sequence(), record.subspan(sealed::kPayloadAt, payload), record);
  return begun(slots, slots.put(record.first(bytes), [](auto) { return true; }));
}

void Console::hold(supervisor::Source source, bool lost) {
  daemon_.app().report(source, lost ? Reason::kConfig : Reason::kNone);
}

void Console::go_on_with_settings() {
  if (!settings_held_) return;
  settings_held_ = false;
  daemon_.recorder().note(EventKind::kSettings, clock_.now(), static_cast<std::int32_t>(found_), 1);
  hold(supervisor::Source::kSettings, false);
}

// Without what its owner signed such a device goes by values, or a model, that nobody signed.
Error Console::accept() {
  if ((settings_held_ || model_held_) && !settings_.development()) return Error::kOwnersAlone;
  go_on_with_settings();
  if (model_held_) daemon_.recorder().note(EventKind::kModel, clock_.now(), 0, 1);
  model_held_ = false;
  hold(supervisor::Source::kModel, false);
  return Error::kNone;
}

Error Console::save() {
  std::array<std::uint8_t, settings::kMostBytes> record;
  const Error result =
      store_own(settings_, record, settings::write(params_, std::span(record).subspan(sealed::kPayloadAt)));
  saving_ = result == Error::kNone;
  return result;
}

Error Console::store_default_model() {
  std::array<std::uint8_t, sealed::kAround> record;
  return store_own(models_, record, 0);
}

Error Console::store_loaded() {
  const std::span<const std::uint8_t> record = loading_.bytes();
  if (loading_.kind() == sealed::Kind::kSettings) return begun(settings_, settings_.put(record, settings::fits));
  const SlotStore::Put put = models_.put(record, models::good);
  if (put != SlotStore::Put::kNotGood) return begun(models_, put);
  const model_file::RefusalInfo& why =
      model_file::info(models::refusal_of(record.subspan(sealed::kPayloadAt, record.size() - sealed::kAround)));
  explain({why.what, why.cause, why.next});
  return Error::kNotThisModel;
}

Error Console::begun(SlotStore& slots, SlotStore::Put put) {
  switch (put) {
    case SlotStore::Put::kBegun:
      storing_ = &slots;
      saving_ = false;
      return Error::kNone;
    case SlotStore::Put::kNoPlace:
      return Error::kNotStored;
    case SlotStore::Put::kStillBusy:
      return Error::kStillWriting;
    case SlotStore::Put::kOld:
      detail_ << "the newest one here has number " << slots.newest();
      return Error::kTooOld;
    case SlotStore::Put::kNotGood:
      return Error::kNotUsable;
    case SlotStore::Put::kRefused:
      break;
  }
  switch (slots.refusal()) {
    case sealed::Refusal::kDamaged:
      return Error::kBroken;
    case sealed::Refusal::kUnsigned:
      return Error::kNotSigned;
    case sealed::Refusal::kSignature:
      return Error::kWrongSignature;
    default:
      return Error::kWrongRecord;
  }
}

std::optional<Error> Console::stored() {
  switch (storing_->settle()) {
    case hal::Store::State::kBusy:
      return std::nullopt;
    case hal::Store::State::kFailed:
      detail_ << "error " << storing_->error() << " of the system";
      return Error::kWriteFailed;
    default:
      if (saving_) {
        go_on_with_settings();
        found_ = settings::Found::kWhole;
      }
      return Error::kNone;
  }
}

// The first wrong code costs a second, each one after it twice as long, up to a minute.
Error Console::unlock(std::string_view code) {
  const Micros now = clock_.now();
  if (place_.code.empty()) return Error::kNoCode;
  if (now < try_at_) {
    detail_ << (try_at_ - now).count() / 1'000'000 + 1 << " s to wait";
    return Error::kTooSoon;
  }
  if (!equal_codes(code, place_.code)) {
    wrong_codes_ = std::min(wrong_codes_ + 1, 7);
    try_at_ = now + std::min(Micros{(std::int64_t{1} << (wrong_codes_ - 1)) * 1'000'000}, kLongestWait);
    daemon_.recorder().note(EventKind::kWrongCode, now, wrong_codes_);
    lock();  // somebody is there who does not have it
    return Error::kWrongCode;
  }
  wrong_codes_ = 0;
  unlocked_ = true;
  refusals_noted_ = 0;
  daemon_.recorder().note(EventKind::kUnlocked, now);
  return Error::kNone;
}

}  // namespace holdfast::console
