// SPDX-License-Identifier: Apache-2.0
// treec MODEL -o HEADER [--check]: compiles a slip tree's text to the header that the firmware includes.
// Exit status: 0 done (or equal), 1 bad model, unreadable file or, with --check, another header; 2 bad usage.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>

#include "toolchain/treec/tree_model.hpp"

namespace {

namespace treec = holdfast::treec;

constexpr std::string_view kUsage =
    "usage: treec MODEL -o HEADER [--check]\n"
    "  Compiles a slip tree's text to C++. The file's name is the model's name with .tree behind it.\n"
    "  --check   write nothing; exit with 1 when HEADER is not what MODEL compiles to\n"
    "example: treec toolchain/model/slip_v1.tree -o firmware/slip/slip_tree.gen.hpp\n";

struct Options {
  std::string model;
  std::string header;
  bool check = false;
};

std::optional<Options> parse_options(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string_view word = argv[i];
    if (word == "--check") {
      options.check = true;
    } else if (word == "-o" && i + 1 < argc && options.header.empty()) {
      options.header = argv[++i];
    } else if (!word.starts_with('-') && options.model.empty()) {
      options.model = word;
    } else {
      return std::nullopt;
    }
  }
  if (options.model.empty() || options.header.empty()) return std::nullopt;
  return options;
}

std::optional<std::string> read_file(const std::string& path) {
  std::error_code error;
  std::ifstream in(path, std::ios::binary);
  // A folder opens like a file and reads as empty.
  if (!in.is_open() || std::filesystem::is_directory(path, error)) return std::nullopt;
  std::ostringstream text;
  text << in.rdbuf();
  if (in.bad() || text.bad()) return std::nullopt;
  return text.str();
}

// Complete or not at all: a build that reads the header never sees half of it.
bool write_file(const std::string& path, const std::string& text) {
  const std::string temporary = path + ".tmp";
  std::error_code error;
  std::ofstream out(temporary, std::ios::binary);
  out << text;
  out.close();
  if (out) std::filesystem::rename(temporary, path, error);
  if (out && !error) return true;
  std::filesystem::remove(temporary, error);
  return false;
}

int fail(const std::string& message) {
  std::fprintf(stderr, "treec: %s\n", message.c_str());
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::string_view(argv[1]) == "--help") {
    std::fwrite(kUsage.data(), 1, kUsage.size(), stdout);
    return 0;
  }
  const std::optional<Options> options = parse_options(argc, argv);
  if (!options) {
    std::fwrite(kUsage.data(), 1, kUsage.size(), stderr);
    return 2;
  }
  const std::optional<std::string> text = read_file(options->model);
  if (!text) return fail(options->model + ": cannot be read: check the path and its permissions");

  treec::Model model;
  std::optional<treec::Problem> problem = treec::parse(*text, model);
  if (!problem) problem = treec::check(model);
  if (problem) return fail(treec::describe(*problem, options->model));
  if (std::filesystem::path(options->model).filename() != model.name + ".tree") {
    return fail(options->model + ": the model inside is named " + model.name + ": rename one of them");
  }

  const std::string header = treec::emit(model);
  if (options->check) {
    if (read_file(options->header) == header) return 0;
    return fail(options->header + ": is not what " + options->model +
                " compiles to: run treec without --check and commit the header");
  }
  if (!write_file(options->header, header)) {
    return fail(options->header + ": cannot be written: check the folder, its permissions and the disk");
  }
  return 0;
}
