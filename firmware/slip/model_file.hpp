// SPDX-License-Identifier: Apache-2.0
// The loadable form of a slip tree: a file of fixed size, read into a table (model.hpp) that has been proved to be a
// tree before it may decide anything. No heap, no recursion; one pass over the nodes.
//
// All numbers are little-endian. Whatever is not in use is zero, so that a model has one form only.
//
//   offset  bytes  what
//        0      8  magic: 89 48 46 54 0D 0A 1A 0A; a copy that changes line ends or the eighth bit breaks it
//        8      2  version of this table: 3
//       10      2  nodes in use, 3 to 511
//       12      1  features in use, 1 to 32
//       13      3  zero
//       16      4  CRC-32 of the model's text
//       20     32  name of the model: a letter, then letters, digits and _, all small; zero-padded
//       52     32  name of its feature set, zero-padded
//       84   1024  names of the set's features in its order, 32 bytes each, zero-padded
//     1108     32  fraction bits (Qn) of these features, one byte each
//     1140   4088  nodes of 8 bytes, in preorder:
//                    0  4  split: threshold, signed. x <= threshold goes to the next node,
//                    4  2         all else to the node of this number
//                    6  1         which of the features above x is
//                    7  1  0 leaf hold, 1 leaf slip, 2 split, 3 leaf slip without a second frame; of a leaf
//                       all else is zero
//     5228     64  signature: all zero, the only form that this version reads. What goes onto a device is signed as a
//                  whole, by the seal around these bytes (store/sealed.hpp), which covers number and kind as well;
//                  a second signature here that nobody checks would only look like one
//     5292      4  CRC-32 of all bytes before it
//     5296
//
// The features are listed although the set's name stands for them: a firmware whose set of that name differs refuses.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "slip/model.hpp"
#include "slip/tree_io.hpp"

namespace holdfast::model_file {

using model::kNameBytes;
inline constexpr std::array<std::uint8_t, 8> kMagic{0x89, 'H', 'F', 'T', '\r', '\n', 0x1A, '\n'};
inline constexpr std::uint16_t kVersion = 3;
inline constexpr int kMaxFeatures = 32;

inline constexpr std::size_t kVersionAt = 8;
inline constexpr std::size_t kNodeCountAt = 10;
inline constexpr std::size_t kFeatureCountAt = 12;
inline constexpr std::size_t kTextCrcAt = 16;
inline constexpr std::size_t kNameAt = 20;
inline constexpr std::size_t kSetAt = kNameAt + kNameBytes;
inline constexpr std::size_t kFeaturesAt = kSetAt + kNameBytes;
inline constexpr std::size_t kQAt = kFeaturesAt + std::size_t{kMaxFeatures} * kNameBytes;
inline constexpr std::size_t kNodesAt = kQAt + kMaxFeatures;
inline constexpr std::size_t kNodeBytes = 8;
inline constexpr std::size_t kSignatureAt = kNodesAt + model::kMaxNodes * kNodeBytes;
inline constexpr std::size_t kCrcAt = kSignatureAt + 64;
inline constexpr std::size_t kBytes = kCrcAt + 4;
static_assert(kNodesAt == 1140 && kSignatureAt == 5228 && kBytes == 5296, "the table above says so");
static_assert(std::ranges::all_of(kFeatureSets, [](const FeatureSet& set) {
  return set.name.size() <= kNameBytes && set.size() <= kMaxFeatures;
}));
static_assert(std::ranges::all_of(kFeatures, [](const FeatureInfo& f) { return f.name.size() <= kNameBytes; }));

enum class Refusal : std::uint8_t {
  kNone,
  kMagic,
  kVersion,
  kSize,
  kCrc,
  kSigned,
  kForm,
  kSetUnknown,
  kFeatures,
  kNode,
  kNoChild,
  kCircle,
  kTwoParents,
  kUnreachable,
  kTooDeep,
  kOneWay,
  kOneVerdict,
};

struct RefusalInfo {
  Refusal refusal;
  std::string_view what;   // what is wrong
  std::string_view cause;  // the likely cause
  std::string_view next;   // what to do next
};

inline constexpr std::string_view kCompileAgain = "compile it again from its text with holdfast compile";
inline constexpr std::string_view kByHand = "written by another program, or changed by hand";

inline constexpr auto kRefusals = std::to_array<RefusalInfo>({
    {Refusal::kNone, "nothing to report", "-", "-"},
    {Refusal::kMagic, "the file is no compiled model", "another file, or one that was copied as text",
     "give what holdfast compile --binary wrote, copied byte by byte"},
    {Refusal::kVersion, "the compiled model has a version that is not known here", "made for another firmware",
     "compile it with the holdfast of this firmware"},
    {Refusal::kSize, "the compiled model is too short or too long", "a copy that broke off", "copy it again"},
    {Refusal::kCrc, "the compiled model's check sum is wrong", "damaged on the way, or changed by hand",
     "copy it again, or compile it again"},
    {Refusal::kSigned, "the model is signed, which this firmware cannot check", "made for a later firmware",
     "give an unsigned one, or update the firmware"},
    {Refusal::kForm, "a field of the compiled model holds what it may not", kByHand, kCompileAgain},
    {Refusal::kSetUnknown, "the model's feature set is not known here", "made for another firmware",
     "give a model of a set that this firmware has, or update the firmware"},
    {Refusal::kFeatures, "the model's feature set has other features here", "made for another firmware",
     "train the model again for this firmware"},
    {Refusal::kNode, "a node is neither a split by a listed feature nor a leaf", kByHand, kCompileAgain},
    {Refusal::kNoChild, "a child lies outside of the model", kByHand, kCompileAgain},
    {Refusal::kCircle, "a path of the tree runs in a circle", kByHand, kCompileAgain},
    {Refusal::kTwoParents, "a node is the child of two nodes", kByHand, kCompileAgain},
    {Refusal::kUnreachable, "no path leads to some node", kByHand, kCompileAgain},
    {Refusal::kTooDeep, "the tree is too deep", kByHand, kCompileAgain},
    {Refusal::kOneWay, "a split is always true or always false", kByHand, kCompileAgain},
    {Refusal::kOneVerdict, "the tree has one answer only", kByHand, kCompileAgain},
});

[[nodiscard]] constexpr const RefusalInfo& info(Refusal refusal) {
  return kRefusals[static_cast<std::size_t>(refusal)];
}
static_assert(kRefusals.size() == std::size_t{static_cast<std::uint8_t>(Refusal::kOneVerdict)} + 1);
static_assert(std::ranges::all_of(kRefusals, [](const RefusalInfo& row) { return &info(row.refusal) == &row; }));

// Reads a whole file. Anything but kNone: `tree` is that which nobody filled, and answers slip.
[[nodiscard]] Refusal read(std::span<const std::uint8_t> bytes, model::Tree& tree);

// Proves that tree.nodes is one: each node reached by one path, no path longer than kMaxDepth, every predicate open to
// both ways where it stands (which keeps its threshold inside the feature's range), both verdicts there. Part of
// read(). Range: any table with 1 to kMaxNodes nodes. Each split is entered once and left once.
[[nodiscard]] Refusal check(const model::Tree& tree);

}  // namespace holdfast::model_file
