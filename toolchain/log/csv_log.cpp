// SPDX-License-Identifier: Apache-2.0
#include "toolchain/log/csv_log.hpp"

#include <fmt/format.h>

#include <concepts>

namespace holdfast::log {
namespace {

// Six places keep apart what the firmware's units keep apart (base/units.hpp: the finest is nat/65536).
std::string cell(double value) {
  return fmt::format("{:.6f}", value);
}
std::string cell(bool value) {
  return value ? "1" : "0";
}
std::string cell(std::integral auto value) {
  return std::to_string(value);
}
template <typename Enum>
requires std::is_enum_v<Enum> std::string cell(Enum value) {
  return std::to_string(static_cast<unsigned>(value));
}

}  // namespace

std::string csv_header() {
  std::string out = "t_s";
  for_each_field<FrameRecord>([&]<typename M>(const Field<FrameRecord, M>& f) {
    if constexpr (IsNumber<M>) {
      out += fmt::format(",{}", f.name);
    } else if constexpr (IsArray<M>) {
      for (std::size_t i = 0; i < std::tuple_size_v<M>; ++i) out += fmt::format(",{}_{:02}", f.name, i);
    }
  });
  return out + "\n";
}

std::string csv_row(const FrameRecord& state) {
  const Time& stamp = state.header.stamp;
  std::string out = fmt::format("{}.{:06}", stamp.sec, stamp.nanosec / 1000);
  for_each_field<FrameRecord>([&]<typename M>(const Field<FrameRecord, M>& f) {
    if constexpr (IsNumber<M>) {
      out += "," + cell(state.*f.member);
    } else if constexpr (IsArray<M>) {
      for (const auto element : state.*f.member) out += "," + cell(element);
    }
  });
  return out + "\n";
}

}  // namespace holdfast::log
