// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry for every parser but JPEG's: aborts when the judge of the parser that FUZZ_TARGET names has
// something to say. Where hardly an input would get past a check sum, or hold a sound frame, it judges a second time
// with that put right. Run by run.sh, which also tells how to replay what was found.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>
#include <string_view>

#include "tests/fuzz/console_check.hpp"
#include "tests/fuzz/link_check.hpp"
#include "tests/fuzz/mcap_check.hpp"
#include "tests/fuzz/modbus_check.hpp"
#include "tests/fuzz/model_check.hpp"
#include "tests/fuzz/scene_check.hpp"
#include "toolchain/treec/tree_model.hpp"

using namespace holdfast;

namespace {

using Bytes = std::span<const std::uint8_t>;

std::string_view text_of(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// A refused tree names a line that is there; of one that is taken the text, and the file that a device loads, give the
// same tree again.
std::string check_tree_text(std::string_view text) {
  treec::Model read;
  auto problem = treec::parse(text, read);
  if (!problem) problem = treec::check(read);
  if (problem) {
    if (problem->line < 1 || problem->line > 1 + std::ranges::count(text, '\n')) return "no line of the text";
    return problem->what.empty() || problem->next.empty() ? "no words" : "";
  }
  if (treec::emit(read).empty()) return "no header";
  treec::Model again;
  if (treec::parse(treec::to_text(read), again) || treec::check(again) || !(again == read)) return "another text";
  model::Tree loaded;
  if (model_file::read(treec::to_binary(read), loaded) != model_file::Refusal::kNone) return "its file is refused";
  return loaded.nodes == treec::to_table(read).nodes ? "" : "its file holds another tree";
}

std::string check_any_model(Bytes bytes) {
  const std::string finding = test::check_model_bytes(bytes);
  if (!finding.empty()) return finding;
  test::ModelBytes whole(bytes.begin(), bytes.end());
  whole.resize(test::kModelBytes);
  test::put_name(whole, 0, std::string_view("\x89HFT\r\n\x1a\n\x02\0", 10));
  std::fill(whole.begin() + 5228, whole.end(), std::uint8_t{0});
  return test::check_model_bytes(test::repaired(whole));
}

// The first byte says which of the stored records.
std::string check_stored(Bytes bytes) {
  if (bytes.empty()) return "";
  return bytes[0] >= 0xF0 ? test::check_settings_bytes(bytes.subspan(1))
                          : test::check_models_bytes(bytes.subspan(1), bytes[0] % 2 == 0);
}

struct Target {
  std::string_view name;
  std::string (*check)(Bytes bytes);
};
constexpr std::array<Target, 8> kTargets{{
    {"scene", [](Bytes bytes) { return test::check_scene_text(text_of(bytes)); }},
    {"model", check_any_model},
    {"tree", [](Bytes bytes) { return check_tree_text(text_of(bytes)); }},
    {"link",
     [](Bytes bytes) {
       const std::string finding = test::check_link_bytes(bytes);
       return finding.empty() ? test::check_link_bytes(test::link_stream(bytes)) : finding;
     }},
    {"modbus", [](Bytes bytes) { return test::check_modbus_bytes(bytes); }},
    {"stored", check_stored},
    {"console", [](Bytes bytes) { return test::check_console_bytes(bytes); }},
    {"mcap",
     [](Bytes bytes) {
       const std::string finding = test::check_mcap_bytes(bytes);
       return finding.empty() ? test::check_mcap_bytes(test::without_sums({bytes.begin(), bytes.end()})) : finding;
     }},
}};

const Target& target() {
  const char* const name = std::getenv("FUZZ_TARGET");
  const auto* const found = std::ranges::find(kTargets, std::string_view(name == nullptr ? "" : name), &Target::name);
  if (found != kTargets.end()) return *found;
  std::fprintf(stderr, "fuzz: FUZZ_TARGET names no parser. Next: see tests/fuzz/run.sh\n");
  std::exit(2);
}

}  // namespace

// NOLINTNEXTLINE(readability-identifier-naming): the name is libFuzzer's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Target& judge = target();
  const std::string finding = judge.check({data, size});
  if (finding.empty()) return 0;
  std::fprintf(stderr, "finding of %s: %s\n", judge.name.data(), finding.c_str());
  std::abort();
}
