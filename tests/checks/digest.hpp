// SPDX-License-Identifier: Apache-2.0
// What the firmware makes of a recording, as one line: its name, its frames, how many of them were accepted and how
// many said slip, and four hashes (FNV-1a, 64 bits) over all frames:
//   input      what was shown: luma, JPEG bytes, markers or features
//   markers    every marker's place, and its displacement
//   features   all that the tactile stages make
//   signals    verdict, request, state, reason, both lines with their times, and the bytes on the link
// The first hash that differs from a table's says which stage parted.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <optional>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "app/app.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/clock.hpp"
#include "slip/tree_io.hpp"
#include "vision/jpeg_decoder.hpp"

namespace holdfast::test {

inline constexpr Micros kPeriod{40'000};
inline constexpr Micros kLatency{40'000};

class Hash {
 public:
  void byte(std::uint8_t value) { hash_ = (hash_ ^ value) * 0x100000001b3u; }
  void bytes(std::span<const std::uint8_t> values) {
    for (const std::uint8_t value : values) byte(value);
  }
  // By value, not by memory: the order of bytes in memory is the processor's.
  template <typename... Integers>
  void add(Integers... values) {
    (number(static_cast<std::uint64_t>(values)), ...);
  }
  [[nodiscard]] std::uint64_t value() const { return hash_; }

 private:
  void number(std::uint64_t value) {
    for (unsigned shift = 0; shift < 64; shift += 8) byte(static_cast<std::uint8_t>(value >> shift));
  }
  std::uint64_t hash_ = 0xcbf29ce484222325u;
};

class Film final : public hal::Camera {
 public:
  explicit Film(sim::Clock& clock) : clock_(clock) {}
  hal::Frame next;  // timestamp and sequence are set here; of another age: `late`
  Micros late{};

 private:
  [[nodiscard]] bool do_start() override { return true; }
  [[nodiscard]] hal::Capture do_next(hal::Frame& frame, Micros) override {
    frame = next;
    frame.timestamp = exposure_;
    frame.sequence = ++shown_;
    clock_.advance_to(exposure_ + kLatency + late);
    exposure_ += kPeriod;
    return hal::Capture::kFrame;
  }
  void do_release(const hal::Frame& /*frame*/) override {}
  void do_stop() override {}
  [[nodiscard]] std::string_view do_identity() const override { return "digest"; }
  // Short films go round, and recordings repeat pictures.
  [[nodiscard]] bool do_live() const override { return false; }

  sim::Clock& clock_;
  Micros exposure_{};
  std::uint32_t shown_ = 0;
};

class Lines final : public hal::Gpio {
 public:
  Lines(const hal::Clock& clock, Hash& hash) : clock_(clock), hash_(hash) {}

 private:
  [[nodiscard]] bool do_set(hal::Line line, hal::Level level) override {
    hash_.add(clock_.now().count(), static_cast<int>(line), static_cast<int>(level));
    return true;
  }
  [[nodiscard]] std::optional<hal::Level> do_read(hal::Input /*input*/) override { return std::nullopt; }

  const hal::Clock& clock_;
  Hash& hash_;
};

class Link final : public hal::Serial {
 public:
  explicit Link(Hash& hash) : hash_(hash) {}

 private:
  [[nodiscard]] bool do_write(std::span<const std::uint8_t> bytes) override {
    hash_.bytes(bytes);
    return true;
  }
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> /*bytes*/) override { return 0; }

  Hash& hash_;
};

class Recorder {
 public:
  explicit Recorder(const Params& params) : params_(params) {
    if (!app_->start(params).ok()) {
      std::fputs("error: digest: the firmware does not start (a parameter left its range). Next: see params.hpp\n",
                 stderr);
      std::exit(1);
    }
  }

  void show(const hal::Frame& frame, Micros late = {}) {
    input_.bytes(frame.bytes);
    input_.add(late.count());
    film_.next = frame;
    film_.late = late;
    (void)app_->step();
    take_down();
  }
  void show(const MarkerField& field) {
    hash(input_, field);
    app_->step_markers(field, advance(), frames_);
    take_down();
  }
  void show(const Features& features, GridSize grid) {
    hash(input_, features);
    app_->step_features(features, grid, advance(), frames_);
    take_down();
  }
  void tare() { app_->tare(); }
  // The picture of the empty gel.
  [[nodiscard]] bool learn(const hal::Frame& frame) { return app_->learn(params_, frame).ok(); }

  [[nodiscard]] std::string line(std::string_view name) const {
    std::array<char, 200> text{};
    (void)std::snprintf(
        text.data(), text.size(), "%-18s %5u %5u %5u  %016llx %016llx %016llx %016llx", std::string(name).c_str(),
        frames_, accepted_, slips_, static_cast<unsigned long long>(input_.value()),
        static_cast<unsigned long long>(markers_.value()), static_cast<unsigned long long>(features_.value()),
        static_cast<unsigned long long>(signals_.value()));
    return text.data();
  }

 private:
  // For what enters behind the camera.
  Micros advance() {
    clock_.advance(kPeriod);
    return clock_.now();
  }

  static void hash(Hash& hash, const MarkerField& field) {
    hash.add(field.grid.rows, field.grid.cols);
    for (std::size_t i = 0; i < static_cast<std::size_t>(field.grid.count()); ++i) {
      const Marker& marker = field.markers[i];
      hash.add(marker.x.raw(), marker.y.raw(), marker.valid);
    }
  }
  static void hash(Hash& hash, const Features& features) {
    for (const FeatureInfo& feature : kFeatures) hash.add(feature.read(features));
    hash.add(features.markers, features.rates_valid, features.gap);
    hash.bytes(features.histogram);
  }

  void take_down() {
    const pipeline::Result& result = app_->result();
    const pipeline::State& state = app_->state();
    ++frames_;
    accepted_ += result.quality.ok() ? 1U : 0U;
    slips_ += app_->outputs().slip ? 1U : 0U;
    hash(markers_, state.tracker.field);
    markers_.add(state.tracker.searches, state.tracker.names_sure, state.tracker.pitch.raw(), result.markers);
    for (const MarkerDisplacement& d : state.displacement.markers) markers_.add(d.dx.raw(), d.dy.raw(), d.valid);
    hash(features_, result.features);
    features_.add(state.saturations.count, result.referenced, result.empty, result.contact.judged,
                  result.contact.touching, static_cast<int>(result.contact.event));
    const supervisor::Outputs& outputs = app_->outputs();
    signals_.add(result.timestamp.count(), result.sequence, static_cast<int>(result.quality.reason),
                 static_cast<int>(result.verdict), static_cast<int>(result.request), static_cast<int>(outputs.state),
                 static_cast<int>(outputs.reason), outputs.slip, outputs.grip_ok, outputs.accepted);
  }

  Params params_;
  Hash input_, markers_, features_, signals_;
  std::uint32_t frames_ = 0, accepted_ = 0, slips_ = 0;
  sim::Clock clock_;
  Film film_{clock_};
  Lines lines_{clock_, signals_};
  Link link_{signals_};
  drivers::TurboJpegDecoder other_scales_;
  std::unique_ptr<jpeg_fast::Worker> worker_ = std::make_unique<jpeg_fast::Worker>();
  hal::Alone alone_;
  std::unique_ptr<EighthDecoder> jpeg_ =
      std::make_unique<EighthDecoder>(jpeg_config(params_), other_scales_, std::span(worker_.get(), 1), alone_);
  std::unique_ptr<App> app_ = std::make_unique<App>(Devices{film_, lines_, link_, clock_, *jpeg_});
};

// The committed lines. A comment or two come first.
class Table {
 public:
  // Null: nothing to compare with.
  explicit Table(const char* path) : path_(path) {
    if (path == nullptr) return;
    std::ifstream file(path);
    readable_ = file.is_open();
    for (std::string line; std::getline(file, line);) lines_.push_back(line);
  }
  [[nodiscard]] bool readable() const { return readable_; }

  // Empty: there is none.
  [[nodiscard]] std::string line_of(std::string_view name) const {
    const auto found = std::find_if(lines_.begin(), lines_.end(), [&](const std::string& line) {
      return line.starts_with(name) && line.substr(name.size()).starts_with(' ');
    });
    return found == lines_.end() ? std::string{} : *found;
  }

  // Prints the line, and what is wrong with it.
  [[nodiscard]] bool agrees(std::string_view name, const std::string& line) const {
    std::puts(line.c_str());
    (void)std::fflush(stdout);
    const std::string was = line_of(name);
    if (path_ == nullptr || line == was) return true;
    std::printf("%s   in %s\n", was.empty() ? "no line" : was.c_str(), path_);
    std::printf(
        "error: %s differs from the table, first in its %s (an algorithm changed; or, where another compiler agrees "
        "with the table, undefined behaviour). Next: undo it; if it is meant, write the table anew with this program's "
        "output and say in the commit why\n",
        std::string(name).c_str(), std::string(parted(line, was)).c_str());
    return false;
  }

  // A recording that is read otherwise says nothing about the firmware.
  [[nodiscard]] bool same_input(std::string_view name, const std::string& line) const {
    const std::string was = line_of(name);
    return was.empty() || parted(line, was) != kColumns[kInput];
  }

 private:
  static constexpr std::size_t kInput = 4;
  static constexpr std::array<std::string_view, 8> kColumns{"name",
                                                            "frames",
                                                            "accepted",
                                                            "slips",
                                                            "input (the recording itself)",
                                                            "markers (vision, or displacement)",
                                                            "features (tactile)",
                                                            "signals (slip, or app)"};

  // The counts follow from the hashes, which tell more.
  [[nodiscard]] static std::string_view parted(const std::string& line, const std::string& was) {
    std::istringstream words(line);
    std::istringstream others(was);
    std::string_view counts = "line";
    for (std::size_t column = 0; column < kColumns.size(); ++column) {
      std::string word;
      std::string other;
      words >> word;
      others >> other;
      if (word == other) continue;
      if (column >= kInput) return kColumns[column];
      counts = kColumns[column];
    }
    return counts;
  }

  const char* path_;
  bool readable_ = true;
  std::vector<std::string> lines_;
};

}  // namespace holdfast::test
