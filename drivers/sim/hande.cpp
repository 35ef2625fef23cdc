// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/hande.hpp"

#include <algorithm>
#include <cmath>

namespace holdfast::sim {
namespace {

using std::chrono::microseconds;

constexpr double kStroke_mm = 50;
constexpr double kOpenCounts = 13;
constexpr double kClosedCounts = 230;
constexpr double kCountsPerMm = (kClosedCounts - kOpenCounts) / kStroke_mm;
constexpr double kActivationMmPerS = 100;
constexpr microseconds kByteTime{87};  // ten bits at 115200 baud
constexpr microseconds kStillPressing{300'000};
constexpr microseconds kUntilItFails{500'000};  // of an activation that does

constexpr std::uint8_t kAct = 0x01;
constexpr std::uint8_t kGto = 0x08;

constexpr std::uint8_t kObjMoving = 0;
constexpr std::uint8_t kObjClosing = 2;
constexpr std::uint8_t kObjThere = 3;

// The definition, a bit at a time.
std::uint32_t crc_of(std::span<const std::uint8_t> bytes) {
  std::uint32_t crc = 0xFFFF;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) {
      const bool one = (crc & 1) != 0;
      crc >>= 1;
      if (one) crc ^= 0xA001;
    }
  }
  return crc;
}

bool sound(std::span<const std::uint8_t> frame) {
  if (frame.size() < 4) return false;
  const std::uint32_t crc = crc_of(frame.first(frame.size() - 2));
  return frame[frame.size() - 2] == (crc & 0xFF) && frame[frame.size() - 1] == crc >> 8;
}

std::uint32_t word(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint32_t>(bytes[at] << 8 | bytes[at + 1]);
}

double seconds(microseconds time) {
  return static_cast<double>(time.count()) * 1e-6;
}

double width_at(double counts) {
  return (kClosedCounts - std::clamp(counts, kOpenCounts, kClosedCounts)) / kCountsPerMm;
}

std::uint8_t counts_at(double width_mm) {
  return static_cast<std::uint8_t>(std::lround(kClosedCounts - width_mm * kCountsPerMm));
}

}  // namespace

HandE::HandE(const hal::Clock& clock, const Config& config) : clock_(clock), config_(config), now_(clock.now()) {
  renew();
}

// ---- The world

void HandE::put_object(const Object& object) {
  run();
  object_ = object;
  object_->width_mm = std::min(object.width_mm, width_mm_);
}

void HandE::remove_object() {
  run();
  object_.reset();
  force_n_ = 0;
}

double HandE::force_n() {
  run();
  return force_n_;
}

double HandE::width_mm() {
  run();
  return width_mm_;
}

bool HandE::object_held() {
  return force_n() > 0;
}

double HandE::speed_mm_s() const {
  return 20 + 130.0 * outputs_[4] / 255;
}

double HandE::grip_n() const {
  return 20 + 165.0 * outputs_[5] / 255;
}

double HandE::blocked_mm() const {
  if (!object_) return 0;
  if (object_->stiffness_n_mm <= 0) return object_->width_mm;
  return std::max(0.0, object_->width_mm - grip_n() / object_->stiffness_n_mm);
}

void HandE::open_to(double width_mm) {
  if (width_mm > width_mm_) moved_at_ = now_;
  width_mm_ = std::max(width_mm_, width_mm);
  if (object_ && force_n_ > 0 && width_mm_ > object_->width_mm) {
    object_.reset();
    ++drops_;
  }
  if (!object_) force_n_ = 0;
}

// Towards the position wanted, as far as the object lets them.
void HandE::go_on(double dt) {
  const double wanted = width_at(outputs_[3]);
  const double blocked = blocked_mm();
  const bool meets_object = object_ && wanted < blocked;
  const double end = meets_object ? blocked : wanted;
  const double way = speed_mm_s() * dt;
  const double before = width_mm_;
  if (end > width_mm_) {
    open_to(std::min(end, width_mm_ + way));
  } else {
    width_mm_ = std::max(end, width_mm_ - way);
    if (width_mm_ < before) moved_at_ = now_;
  }
  const bool there = std::abs(width_mm_ - end) < 1e-9;
  const bool thin = object_ && object_->width_mm < config_.thin_mm;
  obj_ = !there ? kObjMoving : meets_object && !thin ? kObjClosing : kObjThere;
  if (!object_) return;
  const double pressed_mm = std::max(0.0, object_->width_mm - width_mm_);
  force_n_ = object_->stiffness_n_mm > 0 ? pressed_mm * object_->stiffness_n_mm : there && meets_object ? grip_n() : 0;
}

void HandE::stop_at_fault(std::uint8_t fault) {
  fault_ = fault;
  stopped_by_fault_ = true;
}

void HandE::activate_on(double dt) {
  open_to(std::min(kStroke_mm, width_mm_ + kActivationMmPerS * dt));
  const microseconds since = now_ - activated_at_;
  if (activation_fails_ && since >= kUntilItFails) {
    stop_at_fault(0xD);
  } else if (since >= config_.activation) {
    sta_ = 3;
    if (fault_ < 8) fault_ = 0;
  }
}

void HandE::move(double dt) {
  if (!powered_ || stopped_by_fault_ || !told(kAct)) return;
  if (sta_ == 1) {
    activate_on(dt);
  } else if (sta_ == 3 && told(kGto)) {
    go_on(dt);
  }
}

void HandE::renew() {
  status_ = {};
  if (!powered_) return;
  const bool moving = now_ == moved_at_ && now_ > microseconds{0};
  const bool presses = force_n_ > 0 && now_ - moved_at_ < kStillPressing;
  status_[0] = static_cast<std::uint8_t>((outputs_[0] & (kAct | kGto)) | sta_ << 4 | obj_ << 6);
  status_[2] = fault_;
  status_[3] = outputs_[3];
  status_[4] = counts_at(width_mm_);
  status_[5] = static_cast<std::uint8_t>(moving ? 10 : presses ? 2 + outputs_[5] / 4 : 0);
}

// From renewal to renewal: a status shows the world of at most that long ago.
void HandE::run() {
  const microseconds present = clock_.now();
  while (now_ < present) {
    const microseconds next = (now_ / config_.renewal + 1) * config_.renewal;
    const microseconds to = std::min(present, next);
    const microseconds dt = to - now_;
    now_ = to;
    move(seconds(dt));
    if (asked_ && powered_ && told(kAct) && fault_ == 0 && now_ - heard_at_ >= config_.watchdog) fault_ = 9;
    if (to == next) renew();
  }
}

// ---- The gripper

void HandE::set_fault(std::uint8_t fault) {
  run();
  fault_ = fault;
  stopped_by_fault_ = fault >= 0xA;
}

std::uint8_t HandE::fault() {
  run();
  return fault_;
}

void HandE::power(bool on) {
  run();
  powered_ = on;
  outputs_ = {};
  sta_ = obj_ = fault_ = 0;
  stopped_by_fault_ = asked_ = false;
  line_count_ = 0;
  renew();
}

void HandE::start_active(std::uint8_t position, std::uint8_t speed, std::uint8_t force) {
  run();
  outputs_ = {kAct | kGto, 0, 0, position, speed, force};
  sta_ = 3;
  fault_ = 0;
  go_on(1e3);
  moved_at_ = now_ - kStillPressing;
  go_on(0);
  renew();
}

void HandE::outputs_changed(std::uint8_t before) {
  const bool was_active = (before & kAct) != 0;
  if (fault_ == 9) fault_ = 0;
  if (!told(kAct)) {
    sta_ = 0;
    if (told(kGto) && fault_ == 0) fault_ = 7;
    return;
  }
  if (!was_active) {
    ++activations_;
    sta_ = 1;
    obj_ = kObjMoving;
    fault_ = 0;
    stopped_by_fault_ = false;
    activated_at_ = now_;
  }
  if (told(kGto) && sta_ == 1 && fault_ == 0) fault_ = 5;
  move(0);
}

// ---- The line

void HandE::trouble(LineTrouble kind, std::uint32_t one_in, microseconds delay) {
  trouble_ = kind;
  one_in_ = std::max(one_in, 1U);
  delay_ = delay;
}

void HandE::unplug(bool out) {
  run();
  unplugged_ = out;
  line_count_ = 0;
}

void HandE::noise(std::span<const std::uint8_t> bytes) {
  run();
  send(bytes, now_);
}

void HandE::send(std::span<const std::uint8_t> bytes, microseconds from) {
  line_free_ = std::max(line_free_, from);
  for (const std::uint8_t byte : bytes) {
    if (line_count_ == line_.size()) return;
    line_free_ += kByteTime;
    line_[(line_first_ + line_count_++) % line_.size()] = {line_free_, byte};
  }
}

std::size_t HandE::do_read(std::span<std::uint8_t> bytes) {
  run();
  std::size_t count = 0;
  while (count < bytes.size() && line_count_ > 0 && line_[line_first_].time <= now_) {
    bytes[count++] = line_[line_first_].byte;
    line_first_ = (line_first_ + 1) % line_.size();
    --line_count_;
  }
  return count;
}

bool HandE::write_outputs(std::uint32_t address, std::span<const std::uint8_t> values) {
  if (values.empty() || address < 0x3E8 || 2 * (address - 0x3E8) + values.size() > kBytes) return false;
  const std::uint8_t before = outputs_[0];
  std::copy(values.begin(), values.end(), outputs_.begin() + 2 * (address - 0x3E8));
  ++writes_;
  outputs_changed(before);
  return true;
}

std::size_t HandE::read_status(std::span<const std::uint8_t> request, Frame& reply) const {
  const std::uint32_t address = word(request, 2);
  const std::uint32_t bytes = 2 * word(request, 4);
  if (bytes == 0 || address < 0x7D0 || 2 * (address - 0x7D0) + bytes > kBytes) return 0;
  reply[2] = static_cast<std::uint8_t>(bytes);
  std::copy_n(status_.begin() + 2 * (address - 0x7D0), bytes, reply.begin() + 3);
  return 3 + bytes;
}

// Bytes of the reply without its CRC; 0: silence, as for everything that it does not like.
std::size_t HandE::answer(std::span<const std::uint8_t> request, Frame& reply) {
  const std::uint8_t function = request[1];
  std::copy_n(request.begin(), 2, reply.begin());
  const auto record = [&] {
    requests_.push(
        {now_, function, static_cast<std::uint16_t>(word(request, 2)), static_cast<std::uint16_t>(word(request, 4))});
  };
  if ((function == 3 || function == 4) && request.size() == 8) {
    record();
    return read_status(request, reply);
  }
  if (function == 16 && request.size() >= 9 && request.size() == 9U + request[6] &&
      request[6] == 2 * word(request, 4)) {
    record();
    if (!write_outputs(word(request, 2), request.subspan(7, request[6]))) return 0;
    std::copy_n(request.begin() + 2, 4, reply.begin() + 2);
    return 6;
  }
  return 0;
}

bool HandE::do_write(std::span<const std::uint8_t> bytes) {
  run();
  if (unplugged_) return false;
  if (!powered_) return true;
  const microseconds gap = now_ - sent_at_;
  if (asked_) {
    shortest_gap_ = std::min(shortest_gap_, gap);
    longest_gap_ = std::max(longest_gap_, gap);
  }
  const bool too_soon = asked_ && gap < config_.spacing;
  if (!asked_) heard_at_ = now_;
  asked_ = true;
  sent_at_ = now_;
  random_ = random_ * 1664525U + 1013904223U;
  const LineTrouble trouble = (random_ >> 8) % one_in_ == 0 ? trouble_ : LineTrouble::kNone;
  if (too_soon || trouble == LineTrouble::kDeaf) return true;
  if (!sound(bytes)) {
    ++damaged_;
    return true;
  }
  if (bytes[0] != config_.slave) return true;
  heard_at_ = now_;

  Frame reply{};
  std::size_t size = answer(bytes, reply);
  if (size == 0 || trouble == LineTrouble::kMute) return true;
  if (trouble == LineTrouble::kWrongSlave) ++reply[0];
  if (trouble == LineTrouble::kWrongFunction) ++reply[1];
  if (trouble == LineTrouble::kException) {
    reply[1] |= 0x80;
    reply[2] = 4;  // device failure
    size = 3;
  }
  const std::uint32_t crc = crc_of(std::span(reply).first(size));
  reply[size++] = static_cast<std::uint8_t>(crc);
  reply[size++] = static_cast<std::uint8_t>(crc >> 8);
  if (trouble == LineTrouble::kWrongCrc) reply[size - 1] ^= 0x10;
  if (trouble == LineTrouble::kTruncated) size -= 1 + random_ % (size - 1);
  if (trouble == LineTrouble::kGarbage) {
    for (std::size_t i = 0; i < size; ++i) reply[i] = static_cast<std::uint8_t>(random_ >> (i % 24));
  }
  microseconds from = now_ + kByteTime * bytes.size() + config_.turnaround;
  if (trouble == LineTrouble::kLate) from += delay_;
  if (trouble == LineTrouble::kNoiseBefore) send(std::array<std::uint8_t, 1>{0x00}, from);
  send(std::span(reply).first(size), from);
  return true;
}

}  // namespace holdfast::sim
