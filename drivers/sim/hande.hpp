// SPDX-License-Identifier: Apache-2.0
// A Robotiq Hand-E in virtual time, as the other end of a serial line: what is written to it are requests, what is read
// from it are its replies, byte by byte as 115200 baud bring them. It shares no code with the firmware's master.
//
// Modelled, after the instruction manual, chapter 4: functions 3, 4 and 16; the registers, renewed every 10 ms;
// silence instead of exceptions; activation; stroke and speed; contact and grip force; thin objects that are never
// reported; losing the object; every gFLT that is set; the watchdog of the line; power cycles.
// Assumed, the manual is silent: position 13 to 230 over the stroke of 50 mm, linear; speed 20 to 150 mm/s and force
// 20 to 185 N linear in rSP and rFR; the force follows rFR at once, in both directions; an object yields linearly;
// motor current falls to 0 when the fingers have stood for 300 ms; gFLT 9 goes away with the next write.
// Not modelled: acceleration, friction, the gripper's own re-grasp, other baud rates, requests cut in two.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "drivers/sim/ring.hpp"
#include "hal/clock.hpp"
#include "hal/serial.hpp"

namespace holdfast::sim {

// What goes wrong with a request or its reply.
enum class LineTrouble : std::uint8_t {
  kNone,
  kDeaf,           // the request is not heard
  kMute,           // it is carried out, and no reply comes
  kWrongCrc,       //
  kWrongSlave,     //
  kWrongFunction,  //
  kTruncated,      // the reply ends early
  kGarbage,        // noise in place of the reply
  kNoiseBefore,    // a byte of noise in front of it
  kException,      // a right exception reply, which no Hand-E sends
  kLate,           // by `delay`
};

class HandE final : public hal::Serial {
 public:
  struct Config {
    std::uint8_t slave = 9;
    std::chrono::microseconds turnaround{1'000};  // from the end of a request to its reply
    std::chrono::microseconds renewal{10'000};    // of the status registers
    std::chrono::microseconds activation{1'500'000};
    std::chrono::microseconds watchdog{1'000'000};
    std::chrono::microseconds spacing{5'000};  // a request that comes sooner is not heard
    double thin_mm = 3;                        // objects below this are held, and reported as gOBJ 3
  };
  struct Object {
    double width_mm = 20;
    double stiffness_n_mm = 0;  // 0: rigid
  };
  struct Request {
    std::chrono::microseconds time{};
    std::uint8_t function = 0;
    std::uint16_t address = 0;  // of what is written, or else read
    std::uint16_t count = 0;
  };

  explicit HandE(const hal::Clock& clock) : HandE(clock, Config()) {}
  HandE(const hal::Clock& clock, const Config& config);

  // ---- The world
  void put_object(const Object& object);  // between the fingers, which touch it when they come to it
  void remove_object();
  [[nodiscard]] double force_n();
  [[nodiscard]] double width_mm();  // between the fingers
  [[nodiscard]] bool object_held();

  // ---- The gripper
  void set_fault(std::uint8_t fault);  // gFLT, from now on; 0xA and above stop the fingers until the next activation
  void fail_activation(bool fails) { activation_fails_ = fails; }
  void power(bool on);  // off: the brake holds the fingers; on: not activated
  void power_cycle() {
    power(false);
    power(true);
  }
  // As it is when another master has left it: active, gripping with these outputs.
  void start_active(std::uint8_t position, std::uint8_t speed, std::uint8_t force);

  // ---- The line
  void trouble(LineTrouble kind, std::uint32_t one_in = 1, std::chrono::microseconds delay = {});
  void unplug(bool out = true);
  void noise(std::span<const std::uint8_t> bytes);  // comes in now, unasked

  // ---- What it was told
  [[nodiscard]] const Ring<Request>& requests() const { return requests_; }  // those heard, the newest kept
  [[nodiscard]] std::uint64_t writes() const { return writes_; }
  [[nodiscard]] std::uint64_t activations() const { return activations_; }
  [[nodiscard]] std::uint64_t drops() const { return drops_; }      // objects that fell out of opening fingers
  [[nodiscard]] std::uint64_t damaged() const { return damaged_; }  // requests that were none
  // Between two requests, whether heard or not.
  [[nodiscard]] std::chrono::microseconds shortest_gap() const { return shortest_gap_; }
  [[nodiscard]] std::chrono::microseconds longest_gap() const { return longest_gap_; }
  [[nodiscard]] std::uint8_t output(std::size_t byte) const { return outputs_[byte]; }
  [[nodiscard]] std::uint8_t fault();

 private:
  static constexpr std::size_t kBytes = 16;  // of outputs, and of status
  using Frame = std::array<std::uint8_t, 64>;
  struct OnTheWay {
    std::chrono::microseconds time{};
    std::uint8_t byte = 0;
  };

  [[nodiscard]] bool do_write(std::span<const std::uint8_t> bytes) override;
  [[nodiscard]] std::size_t do_read(std::span<std::uint8_t> bytes) override;

  void run();  // the world, up to the clock's present
  void move(double dt);
  void open_to(double width_mm);
  void go_on(double dt);
  void activate_on(double dt);
  void stop_at_fault(std::uint8_t fault);
  void renew();
  void outputs_changed(std::uint8_t before);
  [[nodiscard]] bool told(std::uint8_t bit) const { return (outputs_[0] & bit) != 0; }
  [[nodiscard]] double speed_mm_s() const;
  [[nodiscard]] double grip_n() const;
  [[nodiscard]] double blocked_mm() const;  // the object lets the fingers close so far
  [[nodiscard]] std::size_t answer(std::span<const std::uint8_t> request, Frame& reply);
  [[nodiscard]] bool write_outputs(std::uint32_t address, std::span<const std::uint8_t> values);
  [[nodiscard]] std::size_t read_status(std::span<const std::uint8_t> request, Frame& reply) const;
  void send(std::span<const std::uint8_t> bytes, std::chrono::microseconds from);

  const hal::Clock& clock_;
  Config config_;
  std::chrono::microseconds now_{};  // the world has come so far
  std::array<std::uint8_t, kBytes> outputs_{};
  std::array<std::uint8_t, kBytes> status_{};  // as renewed last
  bool powered_ = true;
  std::uint8_t sta_ = 0;  // gSTA
  std::uint8_t obj_ = 0;  // gOBJ
  std::uint8_t fault_ = 0;
  bool stopped_by_fault_ = false;
  bool activation_fails_ = false;
  std::chrono::microseconds activated_at_{};
  double width_mm_ = 50;
  double force_n_ = 0;
  std::chrono::microseconds moved_at_{};  // the fingers, the last time
  std::optional<Object> object_;

  LineTrouble trouble_ = LineTrouble::kNone;
  std::uint32_t one_in_ = 1;
  std::chrono::microseconds delay_{};
  std::uint32_t random_ = 1;
  bool unplugged_ = false;
  std::array<OnTheWay, 1024> line_{};  // replies under way: a ring
  std::size_t line_first_ = 0;
  std::size_t line_count_ = 0;
  std::chrono::microseconds line_free_{};  // when the last of them has come

  bool asked_ = false;                   // it was sent something,
  std::chrono::microseconds sent_at_{};  // the last time then
  std::chrono::microseconds heard_at_{};
  std::chrono::microseconds shortest_gap_ = std::chrono::hours(1);
  std::chrono::microseconds longest_gap_{};
  Ring<Request> requests_{1024};
  std::uint64_t writes_ = 0;
  std::uint64_t activations_ = 0;
  std::uint64_t drops_ = 0;
  std::uint64_t damaged_ = 0;
};

}  // namespace holdfast::sim
