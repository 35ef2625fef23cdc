// SPDX-License-Identifier: Apache-2.0
// What the classifiers of an evaluation said: learning is nearly all of its time, so a run can be split into pieces,
// each of which has some of the classifiers learn, on whatever machine, and be put together without learning again.
// The whole is the same as of one run, but for the timing, which is measured where it is put together.
//
// Text: a line `holdfast evaluation piece,VERSION,RUN`, then a line `number,rows,verdicts` per classifier, in
// hexadecimal, four verdicts a digit, the first the lowest bit.
#pragma once

#include <cstdint>
#include <iosfwd>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace holdfast::learn {

struct Piece {
  std::uint32_t run = 0;                           // of the data and the options: pieces of two runs never mix
  std::map<long, std::vector<std::uint8_t>> said;  // by the classifier's number in the run; 1 = slip
};

void write_piece(std::ostream& out, const Piece& piece);
// Adds what `name` holds. Nothing, or one line: what is wrong, likely cause, next step.
[[nodiscard]] std::optional<std::string> read_piece(std::istream& in, std::string_view name, Piece& all);

}  // namespace holdfast::learn
