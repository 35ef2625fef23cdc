// SPDX-License-Identifier: Apache-2.0
// The commands: one table at the end, one function each.
//
// A function is called with step 0, 1, 2, ... until it says that it is done; each step makes one line, or a few.
#include <algorithm>
#include <array>
#include <charconv>
#include <optional>

#include "base/crc32.hpp"
#include "base/math.hpp"
#include "console/console.hpp"
#include "hal/notes.hpp"
#include "link/command_frame.hpp"
#include "params/mode_prices.gen.hpp"
#include "params/modes.hpp"
#include "slip/classifier.hpp"
#include "slip/evidence.hpp"

#ifndef HOLDFAST_VERSION
#error "the build defines HOLDFAST_VERSION"
#endif

namespace holdfast::console {
namespace {

constexpr Answer kDone{};
constexpr Answer kMore{Answer::Kind::kMore, Error::kNone};

constexpr Answer error(Error what) {
  return {Answer::Kind::kError, what};
}

// Row `step` of a list with `count` rows, with what belongs before and behind it; `row(k)` writes the cells.
template <typename Row>
Answer list_step(Page& page, std::string_view key, std::span<const Column> columns, std::int32_t step,
                 std::int32_t count, Row row) {
  if (step == 0) page.list(key, columns);
  if (step < count) {
    page.row();
    row(step);
    page.end_row();
  }
  if (step + 1 < count) return kMore;
  page.end_list();
  page.close();
  return kDone;
}

bool is_hand(Console& console) {
  return console.daemon().app().fingers() > 1;
}

// What is a finger's own stands, of a hand, behind its name.
template <typename Fields>
void of_finger(Console& console, int finger, Fields fields) {
  if (is_hand(console)) console.page().part(fingers::kNames[idx(finger)]);
  fields(console, finger);
  if (is_hand(console)) console.page().end_part();
}

// Lists of a hand have a column before the others: whose the row is.
template <std::size_t N>
struct FingerColumns {
  std::array<Column, N + 1> all{{{"finger", 8}}};

  explicit constexpr FingerColumns(const std::array<Column, N>& one) { std::ranges::copy(one, all.begin() + 1); }
  [[nodiscard]] std::span<const Column> of(Console& console) const {
    return std::span(all).subspan(is_hand(console) ? 0 : 1);
  }
};
void finger_cell(Console& console, int finger) {
  if (is_hand(console)) console.page().cell(fingers::kNames[idx(finger)]);
}

// ---- About the console itself

// On a screen of 80x24 there is no room for the arguments of all.
constexpr std::array<Column, 3> kHelpColumns{{{"name", 11}, {"", 8}, {"help", 0}}};
constexpr std::array<Column, 4> kHelpJsonColumns{{{"name", 0}, {"arguments", 0}, {"locked", 0}, {"help", 0}}};

Answer help_one(Console& console, std::string_view name) {
  Page& page = console.page();
  for (const CommandInfo& command : commands()) {
    if (command.name != name) continue;
    page.text("name", command.name);
    page.text("arguments", command.arguments);
    page.text("help", command.help);
    page.yes_no("locked", command.changes);
    page.close();
    return kDone;
  }
  if (const ParamInfo* const row = find_param(name); row != nullptr) {
    page.text("name", row->name);
    page.integer("value", console.params().*row->member, row->unit);
    page.integer("min", row->min, row->unit);
    page.integer("max", row->max, row->unit);
    page.integer("default", row->default_value, row->unit);
    page.text("help", row->help);
    page.text("price", row->price);
    page.text("applies", kAppliesNames[static_cast<std::size_t>(row->applies)]);
    page.text("class", kParamClassNames[static_cast<std::size_t>(row->kind)]);
    page.text("why", row->why);
    page.close();
    return kDone;
  }
  console.detail() << name.substr(0, 24) << " is no command and no parameter";
  return error(Error::kArguments);
}

Answer help(Console& console, const Words& words, std::int32_t step) {
  if (words.count > 2) return error(Error::kArguments);
  if (words.count == 2) {
    const std::string_view name = words[1];
    const bool known = find_param(name) != nullptr || std::any_of(commands().begin(), commands().end(),
                                                                  [&](const auto& row) { return row.name == name; });
    if (known) console.page().open(words.json);
    return help_one(console, name);
  }
  if (step == 0) console.page().open(words.json);
  const auto count = static_cast<std::int32_t>(commands().size());
  const std::span<const Column> columns =
      words.json ? std::span<const Column>(kHelpJsonColumns) : std::span<const Column>(kHelpColumns);
  return list_step(console.page(), "commands", columns, step, count, [&](std::int32_t k) {
    const CommandInfo& command = commands()[idx(k)];
    console.page().cell(command.name);
    if (words.json) console.page().cell(command.arguments);
    console.page().cell(command.changes ? "locked" : "");
    console.page().cell(command.help);
  });
}

// What decides slip: a model that was loaded, or the one that is compiled in.
struct Decider {
  std::string_view name = slip_tree::kName;
  std::string_view feature_set = slip_tree::kFeatureSet;
  std::int32_t features = classifier::kCompiledSet.size();
  std::int32_t nodes = slip_tree::kNodes;
  std::int32_t depth = slip_tree::kDepth;
  std::uint32_t text_crc32 = slip_tree::kModelCrc32;
  std::string_view from = "compiled in";
};

Decider decider(Console& console) {
  const model::Tree* const tree = console.daemon().app().tree();
  const bool damaged = console.model_damaged();
  if (tree == nullptr) {
    Decider compiled;
    if (damaged) compiled.from = "compiled in: what was stored is lost or damaged";
    return compiled;
  }
  return {model::name_of(*tree),
          tree->set->name,
          tree->set->size(),
          tree->count,
          model::depth_of(*tree),
          tree->text_crc32,
          damaged ? "loaded: the other record, maybe the newer one, is damaged" : "loaded"};
}

// Records begin at 1.
void sequence(Page& page, std::string_view name, std::uint32_t number) {
  if (number != 0) {
    page.integer(name, number);
  } else {
    page.nothing(name);
  }
}

// A line that another program of the board left; a byte that is not text is shown as a question mark.
void note(Console& console, std::string_view name, hal::Notes::Of of) {
  Page& page = console.page();
  std::array<char, hal::Notes::kMostBytes> room{};
  const std::size_t size = console.place().notes == nullptr ? 0 : console.place().notes->read(of, room).size();
  if (size == 0) return page.nothing(name);
  const std::span<char> text = std::span(room).first(size);
  std::ranges::replace_if(
      text, [](char c) { return c < ' ' || c > '~'; }, '?');
  page.text(name, {text.data(), text.size()});
}

// In two steps: each note may double in JSON.
Answer version(Console& console, const Words& words, std::int32_t step) {
  if (words.count != 1) return error(Error::kArguments);
  Page& page = console.page();
  if (step == 0) {
    page.open(words.json);
    page.text("firmware", "holdfastd " HOLDFAST_VERSION);
    page.text("board", console.place().board);
    note(console, "release", hal::Notes::Of::kRelease);
    note(console, "slot", hal::Notes::Of::kSlot);
    return kMore;
  }
  note(console, "last_update", hal::Notes::Of::kUpdate);
  page.integer("link_version", link::kVersion);
  const Decider model = decider(console);
  page.text("model", model.name);
  page.integer("model_crc32", model.text_crc32);
  page.text("model_from", model.from);
  sequence(page, "model_sequence", console.model_sequence());
  page.text("settings_from", settings::info(console.found()).from);
  page.text("takes", console.settings().development() ? "anything: development mode" : "what its owner signed");
  sequence(page, "settings_sequence", console.settings().sequence());
  page.close();
  return kDone;
}

Answer echo(Console& console, const Words& words, std::int32_t /*step*/) {
  if (words.count != 2 || (words[1] != "on" && words[1] != "off")) return error(Error::kArguments);
  console.set_echo(words[1] == "on");
  return kDone;
}

Answer unlock(Console& console, const Words& words, std::int32_t /*step*/) {
  if (words.count != 2) return error(Error::kArguments);
  const Error result = console.unlock(words[1]);
  return result == Error::kNone ? kDone : error(result);
}

Answer lock(Console& console, const Words& words, std::int32_t /*step*/) {
  if (words.count != 1) return error(Error::kArguments);
  console.lock();
  return kDone;
}

Answer reboot(Console& console, const Words& words, std::int32_t /*step*/) {
  if (words.count != 1) return error(Error::kArguments);
  console.ask_to_restart();
  return kDone;
}

// ---- How the device is

// Milliframes per second over the last stamps, by the sensor's numbers. 0: too few.
std::int64_t measured_fps_milli(const health::State& health) {
  if (health.stamp_count < 2) return 0;
  const auto newest = idx(health.newest);
  const auto oldest = idx((health.newest + health::kRateFrames - health.stamp_count + 1) % health::kRateFrames);
  const std::int64_t time_us = (health.stamps[newest].at - health.stamps[oldest].at).count();
  const std::int64_t frames = health.stamps[newest].sequence - health.stamps[oldest].sequence;
  return time_us <= 0 ? 0 : div_round(frames * 1'000'000'000, time_us);
}

// When something slipped last, of those frames that are remembered.
std::optional<Micros> last_slip(const Recorder::Frames& frames) {
  for (std::size_t k = frames.size(); k > 0; --k) {
    if (frames[k - 1].slip) return frames[k - 1].at;
  }
  return std::nullopt;
}

// Whether something touches the gel, and what the verdict stands on.
void evidence_of(Console& console, Page& page, int finger) {
  const App& app = console.daemon().app();
  const pipeline::Result& result = app.result(finger);
  const bool known = result.quality.ok() && result.referenced;
  if (known && result.contact.judged) {
    page.text("contact", contact::kPhaseNames[static_cast<std::size_t>(
                             contact::phase_of(result.contact, result.features.imprint.growth))]);
  } else {
    page.nothing("contact");
  }
  const evidence::Shown shown = console.shown(app.outputs().reason, finger);
  if (!known || shown.evidence == Evidence::kNone) {
    page.nothing("evidence");
    return;
  }
  const std::string_view name = kEvidenceNames[static_cast<std::size_t>(shown.evidence)];
  if (page.json()) {
    page.text("evidence", name);
    page.decimal("evidence_value", shown.value_milli, 1000, 1);
    page.decimal("evidence_threshold", shown.threshold_milli, 1000, 1);
    page.text("evidence_unit", shown.unit);
    page.integer("evidence_frames", result.run);
    return;
  }
  Text<60> line;
  line << name << ' ' << div_round(shown.value_milli, 1000) << " of " << div_round(shown.threshold_milli, 1000) << ' '
       << shown.unit << ", " << result.run << " frames in a row";
  page.text("evidence", line.view());
}

// The forces on the gel, and how much of the friction they use.
void load_of(const pipeline::Result& result, Page& page) {
  const load::Load& load = result.load;
  const std::string_view basis = load::kBasisNames[static_cast<std::size_t>(load.basis)];
  const std::int64_t shear_mn = load::shear_mn(load);
  if (!result.quality.ok() || load.basis == load::Basis::kNone) return page.nothing("load");
  if (page.json()) {
    page.text("load", basis);
    page.yes_no("load_within", load.within);
    page.decimal("shear_n", shear_mn, 1000, 3);
    page.decimal("normal_n", load.normal.raw(), 1000, 3);
    page.decimal("friction_use", load.friction_use.raw(), 1000, 3);
    return;
  }
  Text<72> line;
  line << "shear " << shear_mn << " mN, normal " << load.normal.raw() << " mN, use " << load.friction_use.raw()
       << "/1000, " << basis;
  page.text("load", line.view());
}

void finger_status(Console& console, int finger) {
  const App& app = console.daemon().app();
  const pipeline::Result& result = app.result(finger);
  Page& page = console.page();
  if (is_hand(console)) {
    const supervisor::State& its = app.supervisor(finger);
    page.text("state", info(its.device).name);
    page.text("reason", info(its.reason).name);
  }
  evidence_of(console, page, finger);
  load_of(result, page);
  page.decimal("age_ms", std::clamp<std::int64_t>((console.now() - result.timestamp).count(), 0, 1'000'000'000), 1000,
               1);
  page.decimal("fps", measured_fps_milli(app.health(finger)), 1000, 2);
  page.integer("markers", result.markers);
  if (page.json()) {  // a screen has no line left; the state says it, too
    page.integer("markers_expected", result.grid.count());
    page.yes_no("referenced", result.referenced);
  }
  page.decimal("entropy_nat", result.features.entropy.raw(), 65536, 3);
  page.decimal("entropy_rate_nat_s", result.features.entropy_rate.raw(), 256, 2);
  page.decimal("vx_mm_s", result.features.vx.raw(), 1000, 2);
  page.decimal("vy_mm_s", result.features.vy.raw(), 1000, 2);
}

void status_of_lines(Console& console) {
  const supervisor::Outputs& outputs = console.daemon().app().outputs();
  const ReasonInfo& why = info(outputs.reason);
  Page& page = console.page();
  page.text("state", info(outputs.state).name);
  page.text("reason", why.name);
  page.text("what", why.what);
  page.text("cause", why.cause);
  page.text("next", why.next);
  page.yes_no("grip_ok", outputs.grip_ok);
  page.yes_no("slip", outputs.slip);
}

// The lines, each finger, the rest: a step each, because two fingers are more than one may make.
Answer status(Console& console, const Words& words, std::int32_t step) {
  if (words.count != 1) return error(Error::kArguments);
  const App& app = console.daemon().app();
  Page& page = console.page();
  if (step == 0) {
    page.open(words.json);
    status_of_lines(console);
    return kMore;
  }
  if (step <= app.fingers()) {
    of_finger(console, step - 1, finger_status);
    return kMore;
  }
  if (const auto slipped = last_slip(console.daemon().recorder().frames()); slipped) {
    page.decimal("last_slip_s_ago", (console.now() - *slipped).count(), 1'000'000, 1);
  } else {
    page.nothing("last_slip_s_ago");
  }
  page.integer("grip_force_counts", console.daemon().grip().force);
  std::int64_t faults = 0;
  for (int finger = 0; finger < app.fingers(); ++finger) faults += app.supervisor(finger).faults;
  page.integer("faults_since_start", faults);
  if (words.json) page.decimal("uptime_s", (console.now() - console.started()).count(), 1'000'000, 0);
  page.text("supply", hal::Supply::kNames[static_cast<std::size_t>(console.daemon().supply())]);
  if (words.json) {  // a screen has no line left, and its prompt says the first
    page.yes_no("unlocked", console.unlocked());
    page.yes_no("development", console.settings().development());
  }
  page.close();
  return kDone;
}

constexpr FingerColumns kTaskColumns{std::array<Column, 8>{{{"task", 9},
                                                            {"count", 10},
                                                            {"p50_us", 9},
                                                            {"p99_9_us", 10},
                                                            {"max_us", 9},
                                                            {"late", 7},
                                                            {"budget_us", 11},
                                                            {"what", 0}}}};

Answer tasks(Console& console, const Words& words, std::int32_t step) {
  App& app = console.daemon().app();
  if (words.count == 2 && words[1] == "clear") {
    for (int finger = 0; finger < app.fingers(); ++finger) app.stopwatch(finger).clear();
    return kDone;
  }
  if (words.count != 1) return error(Error::kArguments);
  Page& page = console.page();
  if (step == 0) {
    page.open(words.json);
    if (const auto first = app.first_confirmed(); first) {
      page.integer("first_frame_ms", *first / Micros{1000}, "after the kernel started");
    } else {
      page.nothing("first_frame_ms");
    }
  }
  // The last ones are not done for a finger; they stand with the first.
  constexpr auto kAll = static_cast<std::int32_t>(kTasks.size());
  constexpr auto kOfFinger = static_cast<std::int32_t>(Task::kServe);
  const std::int32_t count = kAll + (app.fingers() - 1) * kOfFinger;
  return list_step(page, "tasks", kTaskColumns.of(console), step, count, [&](std::int32_t k) {
    const int finger = k < kAll ? 0 : 1;
    const TaskInfo& task = kTasks[idx(k - finger * kAll)];
    const timing::Stopwatch& stopwatch = app.stopwatch(finger);
    const timing::Histogram& histogram = stopwatch.of(task.task);
    if (task.task < Task::kServe) {
      finger_cell(console, finger);
    } else if (is_hand(console)) {
      page.no_cell();
    }
    page.cell(task.name);
    page.cell(histogram.count());
    page.cell(histogram.quantile(500).count());
    page.cell(histogram.quantile(999).count());
    page.cell(histogram.most().count());
    page.cell(stopwatch.late(task.task));
    page.cell(task.budget.count());
    page.cell(task.what);
  });
}

constexpr std::array<Column, 4> kDeviceColumns{{{"device", 10}, {"is", 22}, {"well", 7}, {"more", 0}}};

struct DeviceRow {
  std::string_view name;
  void (*write)(Console&, Page&);
};

// A sensor's number is what left_sensor and right_sensor store.
void camera_row(Console& console, Page& page, int finger) {
  const Daemon& daemon = console.daemon();
  const Devices& devices = daemon.devices();
  const hal::Camera& camera = finger == 0 ? devices.camera : devices.right->camera;
  const std::string_view identity = camera.identity();
  const bool well = daemon.streaming(finger) && camera.problem().empty();
  page.cell(devices.right == nullptr ? "camera" : fingers::kNames[idx(finger)]);
  page.cell(identity.empty() ? "unnamed" : identity);
  page.cell(well ? "yes" : "no");
  Text<200> more;
  const std::int32_t number = camera_keeper::number_of(identity);
  const std::int32_t expected = daemon.app().expected(finger);
  if (!camera.problem().empty()) {
    more << camera.problem();
  } else if (daemon.app().camera(finger).why == Reason::kCameraWrong && expected != 0 && number != expected) {
    const bool swapped = devices.right != nullptr && number == daemon.app().expected(1 - finger);
    more << "this is "
         << (swapped ? "the other finger's sensor: plug each into its own place" : "not the stored sensor");
    more << ", or store number " << number << " for it";
  } else {
    more << "started " << daemon.camera_starts(finger) << " times";
    if (devices.right != nullptr) {
      const supervisor::State& state = daemon.app().supervisor(finger);
      more << ", " << info(state.device).name << ' ' << info(state.reason).name << ", "
           << div_round(measured_fps_milli(daemon.app().health(finger)), 1000) << " fps, "
           << (console.now() - daemon.app().result(finger).timestamp).count() / 1000 << " ms old, number " << number;
    }
  }
  page.cell(more.view());
}

constexpr std::array<DeviceRow, 4> kDevices{{
    {"lines",
     [](Console& console, Page& page) {
       const bool failed = console.daemon().app().outputs().reason == Reason::kGpioFailed;
       page.cell("GRIP_OK, ALIVE");
       page.cell(failed ? "no" : "yes");
       Text<80> more;
       more << "GRIP_OK " << (console.daemon().app().outputs().grip_ok ? "HIGH" : "LOW") << ", ALIVE "
            << (console.daemon().app().last_status().alive ? "HIGH" : "LOW");
       for (const auto& [input, name] :
            std::array<std::pair<hal::Input, std::string_view>, 4>{{{hal::Input::kTare, "TARE"},
                                                                    {hal::Input::kOpening, "OPENING"},
                                                                    {hal::Input::kRelease, "RELEASE"},
                                                                    {hal::Input::kArm, "ARM"}}}) {
         if (console.daemon().devices().gpio.read(input) == hal::Level::kHigh) more << ", " << name << " HIGH";
       }
       page.cell(more.view());
     }},
    {"link",
     [](Console& console, Page& page) {
       const link::Receiver& frames = console.daemon().commands();
       page.cell("status and commands");
       page.cell(console.daemon().app().link_refused() == 0 ? "yes" : "no");
       Text<100> more;
       more << frames.frames() << " frames came, " << frames.damaged() << " damaged, "
            << console.daemon().app().link_refused() << " status frames not taken";
       page.cell(more.view());
     }},
    {"gripper",
     [](Console& console, Page& page) {
       constexpr std::array<std::string_view, 3> kNames{"none", "Robotiq Hand-E", "step lines"};
       const std::int32_t kind = console.daemon().params().gripper;
       const hande::Feedback& seen = console.daemon().gripper();
       page.cell(kNames[idx(kind)]);
       page.cell(kind != 1 || (seen.fresh && seen.fault_reason == Reason::kNone) ? "yes" : "no");
       Text<100> more;
       if (kind == 1) {
         more << (seen.activated ? "activated" : "not activated") << ", position " << seen.position << ", "
              << info(seen.fault_reason).what;
       }
       page.cell(more.view());
     }},
    {"console",
     [](Console& console, Page& page) {
       page.cell("this port");
       page.cell(console.out().lost() == 0 ? "yes" : "no");
       Text<100> more;
       more << console.frames_lost() << " frames and " << console.out().lost() << " texts not taken in time, "
            << console.refused() << " commands refused";
       page.cell(more.view());
     }},
}};

Answer devices(Console& console, const Words& words, std::int32_t step) {
  if (words.count != 1) return error(Error::kArguments);
  Page& page = console.page();
  if (step == 0) page.open(words.json);
  const std::int32_t cameras = console.daemon().app().fingers();
  const std::int32_t count = cameras + static_cast<std::int32_t>(kDevices.size());
  return list_step(page, "devices", kDeviceColumns, step, count, [&](std::int32_t k) {
    if (k < cameras) return camera_row(console, page, k);
    page.cell(kDevices[idx(k - cameras)].name);
    kDevices[idx(k - cameras)].write(console, page);
  });
}

constexpr std::array<Column, 9> kModeColumns{{{"mode", 10},
                                              {"now", 5},
                                              {"us", 8},
                                              {"million_instructions", 22},
                                              {"memory_kb", 11},
                                              {"marker_error_px", 17},
                                              {"entropy_error_nat", 19},
                                              {"onsets_pct", 12},
                                              {"alarms_per_hour", 0}}};

Answer modes(Console& console, const Words& words, std::int32_t step) {
  if (words.count != 1) return error(Error::kArguments);
  Page& page = console.page();
  if (step == 0) page.open(words.json);
  return list_step(page, "modes", kModeColumns, step, static_cast<std::int32_t>(kModes.size()), [&](std::int32_t k) {
    const ModePrice& price = kModePrices[idx(k)];
    page.cell(kModes[idx(k)].name);
    page.cell(console.params().mode == k ? "yes" : "");
    page.cell(price.us);
    page.cell(price.kilo_instructions, 1000, 1);
    page.cell(price.memory_bytes / 1000);
    page.cell(price.marker_error_upx, 1'000'000, 4);
    page.cell(price.entropy_error_unat, 1'000'000, 4);
    page.cell(price.onsets_milli_pct, 1000, 1);
    page.cell(price.alarms_milli_per_hour, 1000, 1);
  });
}

// ---- Settings

constexpr std::array<Column, 8> kParamColumns{
    {{"name", 22}, {"value", 7}, {"unit", 8}, {"min", 6}, {"max", 7}, {"default", 9}, {"class", 9}, {"applies", 0}}};
constexpr std::array<Column, 11> kParamJsonColumns{{{"name", 0},
                                                    {"value", 0},
                                                    {"unit", 0},
                                                    {"min", 0},
                                                    {"max", 0},
                                                    {"default", 0},
                                                    {"applies", 0},
                                                    {"help", 0},
                                                    {"price", 0},
                                                    {"class", 0},
                                                    {"why", 0}}};

const ParamInfo* nth_match(std::string_view part, std::int32_t n) {
  for (const ParamInfo& row : kParams) {
    if (row.name.find(part) != std::string_view::npos && n-- == 0) return &row;
  }
  return nullptr;
}

Error unknown(Console& console, std::string_view name) {
  console.detail() << name.substr(0, 32);
  return Error::kUnknownParameter;
}

Answer get(Console& console, const Words& words, std::int32_t step) {
  if (words.count > 2) return error(Error::kArguments);
  const std::string_view part = words[1];
  if (nth_match(part, 0) == nullptr) return error(unknown(console, part));
  std::int32_t count = 0;
  while (nth_match(part, count) != nullptr) ++count;
  Page& page = console.page();
  if (step == 0) page.open(words.json);
  const std::span<const Column> columns =
      words.json ? std::span<const Column>(kParamJsonColumns) : std::span<const Column>(kParamColumns);
  return list_step(page, "parameters", columns, step, count, [&](std::int32_t k) {
    const ParamInfo& row = *nth_match(part, k);
    page.cell(row.name);
    page.cell(console.params().*row.member);
    page.cell(row.unit);
    page.cell(row.min);
    page.cell(row.max);
    page.cell(row.default_value);
    const std::string_view kind = kParamClassNames[static_cast<std::size_t>(row.kind)];
    if (!words.json) page.cell(kind);
    page.cell(kAppliesNames[static_cast<std::size_t>(row.applies)]);
    if (!words.json) return;
    page.cell(row.help);
    page.cell(row.price);
    page.cell(kind);
    page.cell(row.why);
  });
}

void say_range(Console& console, const ParamInfo& row, std::string_view given) {
  console.detail() << row.name << " = " << given.substr(0, 24) << " (range " << row.min << " to " << row.max;
  if (!row.unit.empty()) console.detail() << " " << row.unit;
  console.detail() << ")";
}

Answer set(Console& console, const Words& words, std::int32_t /*step*/) {
  if (words.count < 3 || words.count % 2 == 0) return error(Error::kArguments);
  Params params = console.params();
  for (std::size_t k = 1; k < words.count; k += 2) {
    const ParamInfo* const row = find_param(words[k]);
    if (row == nullptr) return error(unknown(console, words[k]));
    ParamProblem problem;
    if (!parse(words[k], words[k + 1], params, &problem).ok()) {
      say_range(console, *row, words[k + 1]);
      return error(problem.rule == "not an integer" ? Error::kNotANumber : Error::kRange);
    }
  }
  const Error result = console.change(params);
  return result == Error::kNone ? kDone : error(result);
}

enum class What : std::uint8_t { kParameters, kLoaded, kDefaultModel };
Error begin_to_store(Console& console, What what) {
  if (what == What::kLoaded) return console.store_loaded();
  return what == What::kDefaultModel ? console.store_default_model() : console.save();
}
// Until the bytes are durable; a card may take seconds.
Answer begun_or_stored(Console& console, std::int32_t step, What what) {
  if (step == 0) {
    const Error result = begin_to_store(console, what);
    return result == Error::kNone ? kMore : error(result);
  }
  const std::optional<Error> result = console.stored();
  if (!result) return kMore;
  return *result == Error::kNone ? kDone : error(*result);
}

Answer save(Console& console, const Words& words, std::int32_t step) {
  if (words.count != 1) return error(Error::kArguments);
  return begun_or_stored(console, step, What::kParameters);
}

constexpr std::array<Column, 4> kSlotColumns{{{"record", 10}, {"slot", 6}, {"number", 12}, {"is", 0}}};

// What lies in the slots of both places; and the word by which the device goes on with what is left.
Answer stored(Console& console, const Words& words, std::int32_t step) {
  if (words.count == 2 && words[1] == "accept" && !words.json) {
    if (!console.unlocked()) return error(Error::kLocked);
    const Error result = console.accept();
    return result == Error::kNone ? kDone : error(result);
  }
  if (words.count != 1) return error(Error::kArguments);
  Page& page = console.page();
  if (step == 0) page.open(words.json);
  constexpr auto kSlots = static_cast<std::int32_t>(hal::Store::kSlots);
  return list_step(page, "slots", kSlotColumns, step, 2 * kSlots, [&](std::int32_t k) {
    const SlotStore& slots = k < kSlots ? console.settings() : console.models();
    const SlotStore::Slot& slot = slots.slot(idx(k % kSlots));
    page.cell(k < kSlots ? "settings" : "model");
    page.cell(k % kSlots + 1);
    if (slot.sequence != 0) {
      page.cell(slot.sequence);
    } else {
      page.no_cell();
    }
    page.cell(slots.has_place() ? holdfast::words(slot) : "no place to store any");
  });
}

// The same for what does not count yet; whoever stored it is told.
Answer for_next_start(Console& console, std::int32_t step, What what) {
  const Answer answer = begun_or_stored(console, step, what);
  if (answer.kind == Answer::Kind::kDone) console.out().put("counts from the next start: reboot\r\n");
  return answer;
}

// All of `text` is a number that `value` can hold.
template <typename Integer>
bool is_number(std::string_view text, Integer& value, int base = 10) {
  const auto [end, wrong] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return wrong == std::errc{} && end == text.data() + text.size();
}

// A record, as lines: `load settings` or `load model`, then `load AT HEX` with the bytes from AT on, two digits each,
// and `load end CRC32` with the check sum of all of them. Nothing is stored before that, and nothing but a whole
// record.
Answer load(Console& console, const Words& words, std::int32_t step) {
  Loading& loading = console.loading();
  if (words.count == 2 && (words[1] == "settings" || words[1] == "model")) {
    loading.begin(words[1] == "model" ? sealed::Kind::kModel : sealed::Kind::kSettings);
    return kDone;
  }
  if (words.count == 2 && words[1] == "off") {
    loading.end();
    return kDone;
  }
  if (words.count != 3) return error(Error::kArguments);
  if (words[1] == "end") {
    if (step == 0) {
      std::uint32_t sum = 0;
      if (!is_number(words[2], sum, 16)) return error(Error::kArguments);
      const bool whole = loading.under_way() && crc32(loading.bytes()) == sum;
      loading.end();
      if (!whole) return error(Error::kBroken);
    }
    return for_next_start(console, step, What::kLoaded);
  }
  std::size_t at = 0;
  if (!is_number(words[1], at)) return error(Error::kArguments);
  if (loading.add(at, words[2])) return kDone;
  console.detail() << static_cast<std::int64_t>(loading.bytes().size()) << " bytes are here";
  return error(Error::kBroken);
}

Answer defaults(Console& console, const Words& words, std::int32_t /*step*/) {
  if (words.count > 2) return error(Error::kArguments);
  Params params = console.params();
  if (words.count == 1) {
    for (const ParamInfo& row : kParams) {
      const bool owners = row.kind == ParamClass::kSafety && !console.settings().development();
      if (!owners) params.*row.member = row.default_value;
    }
    // A default may contradict what the owner signed: then what is paired with that stays, too.
    for (const ParamPair& pair : kParamPairs) {
      if (validate(params).ok()) continue;
      params.*pair.first = console.params().*pair.first;
      params.*pair.second = console.params().*pair.second;
    }
    if (params != Params{}) console.out().put("what the owner signed stays\r\n");
  } else {
    const ParamInfo* const row = find_param(words[1]);
    if (row == nullptr) return error(unknown(console, words[1]));
    params.*row->member = row->default_value;
  }
  const Error result = console.change(params);
  return result == Error::kNone ? kDone : error(result);
}

// The other one of its pair. nullptr: it has none.
const ParamInfo* other_of(const ParamInfo& row) {
  for (const ParamPair& pair : kParamPairs) {
    if (row.member != pair.first && row.member != pair.second) continue;
    const auto other = row.member == pair.first ? pair.second : pair.first;
    return std::ranges::find(kParams, other, &ParamInfo::member);
  }
  return nullptr;
}

// As lines that can be pasted back: after a restart of another device, for instance. A pair is one line, with the first
// of the two, so that each line is obeyed whatever the other device has.
Answer settings_lines(Console& console, const Words& words, std::int32_t step, bool all) {
  if (words.count != 1) return error(Error::kArguments);
  const ParamInfo& row = kParams[idx(step)];
  const auto value_of = [&](const ParamInfo& of) { return console.params().*of.member; };
  const auto differs = [&](const ParamInfo& of) { return all || value_of(of) != of.default_value; };
  const bool last = idx(step) + 1 == kParams.size();
  const ParamInfo* const other = other_of(row);
  Output& out = console.out();
  const auto put = [&](const ParamInfo& of) {
    out.put(" ");
    out.put(of.name);
    out.put(" ");
    out.integer(value_of(of));
  };
  if (words.json) {
    if (step == 0) console.page().open(true);
    if (differs(row)) console.page().integer(row.name, value_of(row));
    if (last) console.page().close();
  } else if (other == nullptr ? differs(row) : other > &row && (differs(row) || differs(*other))) {
    out.put("set");
    put(row);
    if (other != nullptr) put(*other);
    out.put("\r\n");
  }
  return last ? kDone : kMore;
}
Answer dump(Console& console, const Words& words, std::int32_t step) {
  return settings_lines(console, words, step, true);
}
Answer diff(Console& console, const Words& words, std::int32_t step) {
  return settings_lines(console, words, step, false);
}

// ---- What it judges by, and what it sees

Answer model(Console& console, const Words& words, std::int32_t step) {
  if (words.count == 2 && words[1] == "default" && !words.json) {
    if (step == 0 && !console.unlocked()) return error(Error::kLocked);
    return for_next_start(console, step, What::kDefaultModel);
  }
  if (words.count != 1) return error(Error::kArguments);
  const Decider model = decider(console);
  Page& page = console.page();
  page.open(words.json);
  page.text("name", model.name);
  page.text("feature_set", model.feature_set);
  page.integer("features", model.features);
  page.integer("nodes", model.nodes);
  page.integer("depth", model.depth);
  page.integer("crc32", model.text_crc32);
  page.text("from", model.from);
  sequence(page, "sequence", console.model_sequence());
  const SlotStore& slots = console.models();
  const bool stays = (slots.counts() ? slots.sequence() : 0) == console.model_sequence();
  page.text("next_start", stays ? "the same" : "what was stored since: reboot");
  page.close();
  return kDone;
}

void finger_reference(Console& console, int finger) {
  const pipeline::State& its = console.daemon().app().state(finger);
  const reference::State& state = its.reference;
  std::int32_t known = 0;
  for (std::int32_t i = 0; state.known && i < state.rest.grid.count(); ++i) {
    if (state.rest.markers[idx(i)].valid) ++known;
  }
  Page& page = console.page();
  page.yes_no("known", state.known);
  page.integer("rows", state.rest.grid.rows);
  page.integer("cols", state.rest.grid.cols);
  page.integer("lines_cut", its.tracker.cut.lines());
  page.integer("markers", known);
  page.decimal("pitch_px", state.pitch.raw(), 256, 2);
  page.integer("pitch_printed_um", console.params().pitch_um);
  // For whoever draws markers over the working picture: LINK.md counts rest positions from the middle.
  const auto middle = state.known ? marker_frame::middle_of(state.rest) : std::nullopt;
  if (middle) {
    page.decimal("middle_x_px", middle->x.raw(), 256, 2);
    page.decimal("middle_y_px", middle->y.raw(), 256, 2);
  } else {
    page.nothing("middle_x_px");
    page.nothing("middle_y_px");
  }
  page.integer("width_px", its.luma.width);
  page.integer("height_px", its.luma.height);
  page.yes_no("resumed", console.daemon().resumed(finger));
}

Answer reference(Console& console, const Words& words, std::int32_t /*step*/) {
  if (words.count == 2 && words[1] == "learn") {
    if (!console.unlocked()) return error(Error::kLocked);
    const auto result = console.daemon().obey({.command = command_frame::Command::kTare});
    return result == command_frame::Outcome::kDone ? kDone : error(Error::kRefused);
  }
  if (words.count != 1) return error(Error::kArguments);
  console.page().open(words.json);
  for (int finger = 0; finger < console.daemon().app().fingers(); ++finger) {
    of_finger(console, finger, finger_reference);
  }
  console.page().close();
  return kDone;
}

constexpr FingerColumns kMarkerColumns{std::array<Column, 7>{
    {{"row", 5}, {"col", 5}, {"valid", 7}, {"x_px", 10}, {"y_px", 10}, {"dx_um", 8}, {"dy_um", 0}}}};

void finger_frame(Console& console, int finger) {
  const pipeline::Result& result = console.daemon().app().result(finger);
  console.page().integer("sequence", result.sequence);
  console.page().text("quality", info(result.quality.reason).name);
}

Answer frame(Console& console, const Words& words, std::int32_t step) {
  if (words.count != 1) return error(Error::kArguments);
  const App& app = console.daemon().app();
  std::array<std::int32_t, kMaxFingers> markers{};  // none before the finger's first frame
  for (int finger = 0; finger < app.fingers(); ++finger) {
    if (!app.supervisor(finger).any_accepted) continue;
    markers[idx(finger)] = app.state(finger).tracker.field.grid.count();
  }
  const std::int32_t count = markers[0] + markers[1];
  if (count == 0) return error(Error::kNothingYet);
  Page& page = console.page();
  if (step == 0) {
    page.open(words.json);
    for (int finger = 0; finger < app.fingers(); ++finger) of_finger(console, finger, finger_frame);
  }
  return list_step(page, "markers", kMarkerColumns.of(console), step, count, [&](std::int32_t k) {
    const int finger = k < markers[0] ? 0 : 1;
    if (finger == 1) k -= markers[0];
    const pipeline::State& state = app.state(finger);
    const pipeline::Result& result = app.result(finger);
    const GridSize grid = state.tracker.field.grid;
    const Marker& marker = state.tracker.field.markers[idx(k)];
    const MarkerDisplacement& d = state.displacement.markers[idx(k)];
    finger_cell(console, finger);
    page.cell(k / grid.cols);
    page.cell(k % grid.cols);
    page.cell(marker.valid ? 1 : 0);
    page.cell(marker.x.raw(), 256, 3);
    page.cell(marker.y.raw(), 256, 3);
    if (d.valid && result.referenced) {
      page.cell(d.dx.raw());
      page.cell(d.dy.raw());
    } else {
      page.no_cell();
      page.no_cell();
    }
  });
}

Answer watch(Console& console, const Words& words, std::int32_t /*step*/) {
  using Stream = Console::Stream;
  if (words.count > 2) return error(Error::kArguments);
  const std::string_view how = words.count == 1 ? "screen" : words[1];
  if (how == "on") {
    console.stream(Stream::kFrames);
  } else if (how == "screen") {
    console.stream(Stream::kScreen);
  } else if (how == "off") {
    console.stream(Stream::kNone);
  } else {
    return error(Error::kArguments);
  }
  return kDone;
}

Answer trace(Console& console, const Words& words, std::int32_t /*step*/) {
  if (words.count != 2 || (words[1] != "on" && words[1] != "off")) return error(Error::kArguments);
  console.stream(words[1] == "on" ? Console::Stream::kTrace : Console::Stream::kNone);
  return kDone;
}

// ---- What happened

constexpr std::array<Column, 4> kEventColumns{{{"ago_s", 10}, {"event", 16}, {"what", 24}, {"value", 0}}};

void event_cells(Console& console, const FlightEvent& event) {
  Page& page = console.page();
  Text<40> value;
  std::string_view what;
  const bool of_camera = event.kind == EventKind::kCameraStarted || event.kind == EventKind::kCameraGone;
  if (of_camera && is_hand(console)) what = fingers::kNames[idx(event.b)];
  switch (event.kind) {
    case EventKind::kState:
      what = info(static_cast<DeviceState>(event.a)).name;
      value << info(static_cast<Reason>(event.b)).name;
      break;
    case EventKind::kCameraStarted:
    case EventKind::kWrongCode:
    case EventKind::kFault:
      value << event.a;
      break;
    case EventKind::kCameraGone:
      value << info(static_cast<Reason>(event.a)).name;
      break;
    case EventKind::kCommand: {
      const auto* const command = command_frame::info(static_cast<command_frame::Command>(event.a));
      what = command == nullptr ? "unknown" : command->name;
      value << command_frame::kResults[idx(event.b)].name;
      break;
    }
    case EventKind::kSetting:
      what = kParams[idx(event.a)].name;
      value << event.b;
      break;
    case EventKind::kSettings:
      what = settings::kFound[idx(event.a)].name;
      if (event.b != 0) value << "accepted";
      break;
    case EventKind::kModel:
      what = "damaged";
      if (event.b != 0) value << "accepted";
      break;
    case EventKind::kSupply:
      what = hal::Supply::kNames[idx(event.a)];
      break;
    case EventKind::kUnlocked:
      break;
  }
  page.cell(what);
  page.cell(value.view());
}

constexpr FingerColumns kFrameColumns{std::array<Column, 16>{{{"ago_s", 8},
                                                              {"sequence", 10},
                                                              {"age_ms", 8},
                                                              {"quality", 15},
                                                              {"state", 11},
                                                              {"reason", 15},
                                                              {"accepted", 10},
                                                              {"slip", 6},
                                                              {"grip_ok", 9},
                                                              {"markers", 9},
                                                              {"vx_um_s", 9},
                                                              {"vy_um_s", 9},
                                                              {"entropy_nat", 13},
                                                              {"entropy_rate_nat_s", 20},
                                                              {"cols", 6},
                                                              {"displacement_um", 0}}}};

void frame_cells(Console& console, const FlightFrame& frame, bool markers) {
  Page& page = console.page();
  finger_cell(console, frame.finger);
  page.cell((console.now() - frame.at).count(), 1'000'000, 3);
  page.cell(frame.sequence);
  page.cell(frame.age_us, 1000, 1);
  page.cell(info(frame.quality).name);
  page.cell(info(frame.state).name);
  page.cell(info(frame.reason).name);
  page.cell(frame.accepted ? 1 : 0);
  page.cell(frame.slip ? 1 : 0);
  page.cell(frame.grip_ok ? 1 : 0);
  page.cell(frame.markers);
  page.cell(frame.vx_um_s);
  page.cell(frame.vy_um_s);
  page.cell(frame.entropy_nat_q16, 65536, 4);
  page.cell(frame.entropy_rate_nat_s_q8, 256, 2);
  page.cell(frame.grid.cols);
  if (!markers) return page.no_cell();
  Text<kMaxMarkers * 14> list;  // x:y in um, one by one; no comma, so that the line can be a row of CSV
  for (std::int32_t i = 0; i < frame.grid.count(); ++i) {
    const marker_frame::Point& d = frame.displacement[idx(i)];
    list << (i > 0 ? " " : "") << d.x_um << ":" << d.y_um;
  }
  page.cell(list.view());
}

Answer log(Console& console, const Words& words, std::int32_t step) {
  const Recorder& recorder = console.daemon().recorder();
  const std::string_view what = words.count == 1 ? "events" : words[1];
  const bool markers = words[2] == "markers";
  if (words.count > 3 || (words.count == 3 && (!markers || what == "events"))) return error(Error::kArguments);
  Page& page = console.page();
  if (what == "events") {
    const auto count = static_cast<std::int32_t>(recorder.events().size());
    if (count == 0) return error(Error::kNothingYet);
    if (step == 0) page.open(words.json);
    return list_step(page, "events", kEventColumns, step, count, [&](std::int32_t k) {
      // An event that came meanwhile has pushed the others on by one: none is shown twice then, one is left out.
      const FlightEvent& event = recorder.events()[idx(k)];
      page.cell((console.now() - event.at).count(), 1'000'000, 3);
      page.cell(kEvents[static_cast<std::size_t>(event.kind)].name);
      event_cells(console, event);
    });
  }
  if (what != "frames" && what != "fault") return error(Error::kArguments);
  const Recorder::Frames& frames = what == "fault" ? recorder.before_fault() : recorder.frames();
  const auto count = static_cast<std::int32_t>(frames.size());
  if (count == 0) return error(Error::kNothingYet);
  if (step == 0) page.open(words.json);
  return list_step(page, "frames", kFrameColumns.of(console), step, count,
                   [&](std::int32_t k) { frame_cells(console, frames[idx(k)], markers); });
}

// ---- What a robot may say as well

Answer tell(Console& console, const Words& words, std::int32_t /*step*/) {
  if (words.count < 2 || words.count > 3) return error(Error::kArguments);
  for (const command_frame::CommandInfo& row : command_frame::kCommands) {
    const bool same = std::equal(row.name.begin(), row.name.end(), words[1].begin(), words[1].end(),
                                 [](char a, char b) { return a == b || a - 'A' == b - 'a'; });
    if (!same) continue;
    std::uint8_t argument = 0;
    if (words.count == 3 && !is_number(words[2], argument)) return error(Error::kArguments);
    const auto result = console.daemon().obey({.command = row.command, .argument = argument});
    if (result == command_frame::Outcome::kDone) return kDone;
    const command_frame::ResultInfo& why = command_frame::kResults[static_cast<std::size_t>(result)];
    if (result == command_frame::Outcome::kArgument) {
      console.detail() << why.meaning;
      return error(Error::kArguments);
    }
    console.explain({why.meaning, why.cause, why.next});
    return error(Error::kRefused);
  }
  return error(Error::kArguments);
}

constexpr std::array<Column, 3> kFaultColumns{{{"component", 12}, {"type", 14}, {"what", 0}}};

Answer fault(Console& console, const Words& words, std::int32_t step) {
  hal::Faults* const faults = console.place().faults;
  if (faults == nullptr) return error(Error::kNotHere);
  const auto rows = faults->rows();
  if (words.count == 1) {
    if (step == 0) console.page().open(words.json);
    return list_step(console.page(), "faults", kFaultColumns, step, static_cast<std::int32_t>(rows.size()),
                     [&](std::int32_t k) {
                       console.page().cell(rows[idx(k)].component);
                       console.page().cell(rows[idx(k)].type);
                       console.page().cell(rows[idx(k)].what);
                     });
  }
  if (!console.unlocked()) return error(Error::kLocked);
  if (words.count == 2 && words[1] == "off") {
    faults->end_all();
    return kDone;
  }
  for (std::size_t k = 0; words.count == 3 && k < rows.size(); ++k) {
    if (rows[k].component != words[1] || rows[k].type != words[2]) continue;
    console.daemon().recorder().note(EventKind::kFault, console.now(), static_cast<std::int32_t>(k));
    faults->begin(k);
    return kDone;
  }
  return error(Error::kArguments);
}

constexpr std::array<CommandInfo, 26> kCommands{{
    {"help", "[COMMAND|PARAMETER] [json]", "lists the commands, or shows one thing in detail", false, help},
    {"version", "[json]", "firmware, release, last update, board, model", false, version},
    {"status", "[json]", "state, reason, age, rate, markers, last slip", false, status},
    {"tasks", "[clear] [json]", "start, and each stage: p50, p99.9, longest, late", false, tasks},
    {"devices", "[json]", "camera, lines, link, gripper: what is there and how it is", false, devices},
    {"get", "[PARAMETER] [json]", "parameters, all or those whose name holds the word", false, get},
    {"set", "PARAMETER VALUE [PARAMETER VALUE]", "change one or more at once, until the next start or save", true, set},
    {"diff", "[json]", "what differs from the defaults, as lines to paste back", false, diff},
    {"dump", "[json]", "all parameters, as lines to paste back", false, dump},
    {"save", "", "store the parameters for the next start", true, save},
    {"stored", "[accept] [json]", "each stored record; accept: go on without what is lost", false, stored},
    {"load", "settings|model|end|off|AT [HEX|CRC32]", "store a signed record for the next start (console --load)", true,
     load},
    {"defaults", "[PARAMETER]", "back to the default, all or one", true, defaults},
    {"model", "[default] [json]", "what decides slip; default: store that the built-in one does", false, model},
    {"reference", "[learn] [json]", "rest position of the markers; learn it anew", false, reference},
    {"watch", "[screen|on|off]", "a line five times a second; on: frames for programs", false, watch},
    {"log", "[events|frames|fault] [markers] [json]", "what happened: events, last frames, those before a fault", false,
     log},
    {"trace", "on|off", "a line for every frame", false, trace},
    {"frame", "[json]", "the markers of the last frame", false, frame},
    {"modes", "[json]", "speed settings with their measured prices", false, modes},
    {"tell", "tare|opening|release|arm|grip [NUMBER]", "what the robot may say on the link", true, tell},
    {"fault", "[off|camera|right|gripper|link] [TYPE] [json]", "make something fail (simulated boards)", false, fault},
    {"echo", "on|off", "off: no prompt and no echo, for programs", false, echo},
    {"unlock", "CODE", "allow changes, with the code of this device", false, unlock},
    {"lock", "", "allow no changes", false, lock},
    {"reboot", "", "end in order and start anew", true, reboot},
}};

}  // namespace

std::span<const CommandInfo> commands() {
  return kCommands;
}

}  // namespace holdfast::console
