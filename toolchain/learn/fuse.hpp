// SPDX-License-Identifier: Apache-2.0
// A model of two judges. Where the object shows relief between the dots, its imprint decides: slip when it moves
// against the gel by more than a threshold. Where it shows none, a tree of the markers decides.
//
// The thresholds are read off recordings, one for each operating point: the lowest one above which the request rises no
// more than so many times while they hold, plus a margin. What they are worth is told by leaving out one object at a
// time. The tree is taken as it is; it may have seen the recordings. When quiet is asked for, only the imprint is
// heard: the markers' alarms on the recordings are all but a few those of a shaken arm.
//
// Why not one tree that learns from everything: fitted to 13 recorded onsets it alarms 20 times and more in 2.6 minutes
// of objects that it has not seen, where one threshold alarms once; simulated grasps do not cure that (their markers
// move otherwise). Why not the markers' score beside the imprint: on the recordings it finds as much as the imprint,
// but most of their onsets coincide with a motion of the arm, and in simulated grasps that only move it alarms 13 to 26
// times a minute.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "slip/tree_io.hpp"
#include "toolchain/learn/detectors.hpp"
#include "toolchain/learn/recorded.hpp"
#include "toolchain/learn/samples.hpp"
#include "toolchain/treec/tree_model.hpp"

namespace holdfast::learn {

// Index = Sensitivity. Margins in 1/256 of an octave: 1/8 and 1/16 octave are 9 and 4 %.
inline constexpr std::array<Budget, 3> kPointBudgets{{{0, 32.0}, {0, 16.0}, {4, 0.0}}};

// Fewer patches in contact than this, and the markers decide. With 5 a smooth object slides unseen for a third of a
// second under a dozen specks of dirt. Price, on the recordings, by trees that have not seen the object: 7 false alarms
// in 156 s of held contact, 6 of them in the 29 s that are shaken; with 5 patches 4; with none (the imprint alone) 0.
inline constexpr int kLeastPatches = 10;

struct Point {
  int threshold = 0;     // log2 of um in Q8
  RecordedScore unseen;  // the imprint alone, one object left out
};

struct Fused {
  treec::Model model;
  std::array<Point, 3> points;  // index = Sensitivity
};

// `markers`: a checked model of a set whose features the set touch has too. An error line, or nothing.
[[nodiscard]] std::optional<std::string> fuse(const Samples& recordings, const treec::Model& markers,
                                              const std::string& name, Fused& out);

}  // namespace holdfast::learn
