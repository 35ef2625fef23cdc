// SPDX-License-Identifier: Apache-2.0
// digest_clips [TABLE]: what the firmware makes of the real recordings beside the project (../shared/data/real), as
// digest.hpp says. Compares with TABLE (digest_clips.txt) when one is given. Each recording's last frame is taken for
// the picture of the empty gel; in the same table, so that a decoder that reads the pictures otherwise is told from a
// firmware that judges them otherwise, stands what was read.
//
// Exit status: 0 the table's, or none was given; 1 another, or a recording cannot be read; 2 wrong arguments; 77 the
// recordings are not here, or OpenCV's decoder reads them otherwise.
#include <algorithm>
#include <cstdio>
#include <string>
#include <variant>
#include <vector>

#include "drivers/sim/recording.hpp"
#include "tests/checks/digest.hpp"
#include "tests/support/host_clips.hpp"
#include "tests/support/skip.hpp"

namespace {

using namespace holdfast;

// One line; "error: ..." when the recording is not what it was.
std::string digest(const test::Clip& clip) {
  auto opened = sim::Recording::open(clip.path);
  auto* const recording = std::get_if<sim::Recording>(&opened);
  if (recording == nullptr) return std::get_if<sim::Error>(&opened)->line;
  const auto last = recording->at("last");
  const auto* const empty = std::get_if<sim::RecordedFrame>(&last);
  if (empty == nullptr) return std::get_if<sim::Error>(&last)->line;

  test::Recorder recorder(Params{});
  if (!recorder.learn(sim::as_frame(*empty))) {
    return "error: " + clip.name + ": no lattice in its last frame (the recording or the firmware is another)";
  }
  sim::RecordedFrame recorded;
  sim::Read read = recording->next(recorded);
  while (read == sim::Read::kFrame) {
    recorder.show(sim::as_frame(recorded));
    read = recording->next(recorded);
  }
  return read == sim::Read::kEnd ? recorder.line(clip.name) : recording->error();
}

}  // namespace

int main(int argc, char** argv) {
  const test::Table table(argc > 1 ? argv[1] : nullptr);
  if (argc > 2 || !table.readable()) {
    std::fputs("usage: digest_clips [TABLE], TABLE as tests/checks/digest_clips.txt\n", stderr);
    return 2;
  }
  const auto folder = test::clips_folder();
  if (folder.empty()) {
    test::skip("the real recordings are not beside the clone (../shared/data/real)");
    return test::kSkippedStatus;
  }
  std::puts("# recording, frames, accepted, slips, hashes of input, markers, features, signals");
  bool same = true;
  std::size_t read_otherwise = 0;
  const std::vector<test::Clip> clips = test::clips_in(folder);
  for (const test::Clip& clip : clips) {
    const std::string line = digest(clip);
    if (!table.same_input(clip.name, line)) {
      ++read_otherwise;
    } else {
      same = table.agrees(clip.name, line) && same;
    }
  }
  if (read_otherwise > 0) {
    std::printf("%zu of %zu recordings left out\n", read_otherwise, clips.size());
    test::skip("OpenCV reads the recordings otherwise here (another FFmpeg), so their hashes say nothing");
  }
  return !same ? 1 : read_otherwise > 0 ? test::kSkippedStatus : 0;
}
