// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry for texts of trees (toolchain/treec): a refused one names a line that is there; of one that is
// taken the text, and the file that a device loads, give the same tree again. Run by run.sh, which also tells how to
// replay what was found.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

#include "toolchain/treec/tree_model.hpp"

namespace {

// A finding in words; empty: nothing to say.
std::string check_tree_text(std::string_view text) {
  using namespace holdfast;
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

}  // namespace

// NOLINTNEXTLINE(readability-identifier-naming): the name is libFuzzer's
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string finding = check_tree_text({reinterpret_cast<const char*>(data), size});
  if (finding.empty()) return 0;
  std::fprintf(stderr, "tree_fuzz: %s\n", finding.c_str());
  std::abort();
}
