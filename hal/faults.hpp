// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace holdfast::hal {

// What can be made to fail on purpose. Simulated boards have it; a board with real devices has none.
class Faults {
 public:
  struct Row {
    std::string_view component;  // camera, gripper, ...
    std::string_view type;       // off, stuck, ...
    std::string_view what;
  };
  virtual ~Faults() = default;
  [[nodiscard]] std::span<const Row> rows() const { return do_rows(); }
  // Row `index` holds from now on; of each component one at a time.
  void begin(std::size_t index) { do_begin(index); }
  void end_all() { do_end_all(); }

 private:
  [[nodiscard]] virtual std::span<const Row> do_rows() const = 0;
  virtual void do_begin(std::size_t index) = 0;
  virtual void do_end_all() = 0;
};

}  // namespace holdfast::hal
