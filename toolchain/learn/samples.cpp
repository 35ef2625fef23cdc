// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

std::string_view name_of(Source source) {
  return source == Source::kSimulated ? "simulated" : "recorded";
}

std::string_view name_of(Label label) {
  return label == Label::kHold ? "hold" : label == Label::kSlip ? "slip" : "open";
}

}  // namespace holdfast::learn
