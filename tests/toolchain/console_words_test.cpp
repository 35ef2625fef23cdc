// SPDX-License-Identifier: Apache-2.0
// What Tab does at the prompt of `holdfast console`, and where its history is kept.
#include <cstdlib>
#include <string>

#include "console/console.hpp"
#include "params/params.hpp"
#include "toolchain/console/line_input.hpp"
#include "toolchain/console/vocabulary.hpp"
// last: it redefines new
#include <CppUTest/TestHarness.h>

using namespace holdfast;
using console_tool::complete;
using console_tool::Vocabulary;

TEST_GROUP(ConsoleWords) {
  Vocabulary words;

  void setup() override {
    for (const console::CommandInfo& command : console::commands()) {
      words.commands.push_back({std::string(command.name), std::string(command.arguments), std::string(command.help)});
    }
    for (const ParamInfo& row : kParams) words.parameters.emplace_back(row.name);
  }
  void inserts(const char* before, const char* what) {
    STRCMP_EQUAL_TEXT(what, complete(words, before).insert.c_str(), before);
  }
  std::string choices(const char* before) {
    std::string out;
    for (const std::string& one : complete(words, before).choices) out += one + " ";
    return out;
  }
};

TEST(ConsoleWords, ACommandIsCompleted) {
  inserts("stat", "us ");
  inserts("  stat", "us ");
  inserts("bogus", "");
  inserts("re", "");
  STRCMP_CONTAINS("reboot record reference restore ", choices("re").c_str());
}

TEST(ConsoleWords, ArgumentsComeFromTheHelp) {
  inserts("watch s", "creen ");
  inserts("tell op", "ening ");
  inserts("log frames m", "arkers ");
  inserts("status j", "son ");
  STRCMP_EQUAL("off on ", choices("echo o").c_str());
  inserts("unlock d", "");
  inserts("lock d", "");
}

TEST(ConsoleWords, ParametersAndTheCommandsOfHelp) {
  inserts("set max_f", "orce ");
  inserts("set max", "_");
  inserts("set max_force=2", "");
  inserts("get hist", "ogram_range_um ");
  inserts("help dev", "ices ");
  inserts("help max_f", "orce ");
  inserts("set max_force hold", "");  // a value is none
}

TEST(ConsoleWords, FilesOfLocalWords) {
  inserts("restore " HOLDFAST_SOURCE_DIR "/READ", "ME.md ");
  inserts("restore " HOLDFAST_SOURCE_DIR "/toolch", "ain/");
  inserts("restore /no/such/folder/x", "");
}

TEST(ConsoleWords, TheHistoryIsInTheStateFolder) {
  ::setenv("XDG_STATE_HOME", "/tmp/state", 1);
  STRCMP_EQUAL("/tmp/state/holdfast/console_history", console_tool::history_path().c_str());
  ::setenv("XDG_STATE_HOME", "relative", 1);  // the XDG rule: to be ignored
  ::setenv("HOME", "/tmp/home", 1);
  STRCMP_EQUAL("/tmp/home/.local/state/holdfast/console_history", console_tool::history_path().c_str());
  ::unsetenv("XDG_STATE_HOME");
  ::unsetenv("HOME");
  STRCMP_EQUAL("", console_tool::history_path().c_str());
}
