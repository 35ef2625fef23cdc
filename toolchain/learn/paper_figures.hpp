// SPDX-License-Identifier: Apache-2.0
// The figures that the paper prints, written down once. Hu et al., "Learning to Detect Slip through Tactile Estimation
// of the Contact Force Field and its Entropy" (2024), section V. Shares in percent, as printed; names of sets,
// classifiers and objects as in kFeatureSets, name_of(Kind) and kPaperObjects.
//
// What they stand on: about 14 000 samples of ten real objects, split at random by sample (scikit-learn), so frames of
// one grasp are in training and in test: compare them with our split by frame, not only with our split by trial. The
// paper gives no intervals, no delays and no rate of false alarms. Its per-object bar chart has no numbers: "most
// objects exhibit an accuracy greater than 95 %, with only the owl falling below 90 %" (k-NN, five-fold).
#pragma once

#include <array>
#include <string_view>

namespace holdfast::learn::paper {

struct Scores {
  double accuracy = 0.0;
  double precision = 0.0;
  double recall = 0.0;
  double f1 = 0.0;
};

struct FiveFold {
  std::string_view set;
  std::string_view classifier;  // those of Kind; the paper also has a forest and an SVM
  Scores scores;
};

// Table I.
inline constexpr std::array<FiveFold, 6> kFiveFold{{
    {"velocity", "tree", {82.20, 94.72, 75.91, 83.94}},
    {"velocity", "knn", {80.25, 94.25, 74.66, 82.68}},
    {"entropy", "tree", {93.88, 90.52, 96.47, 93.38}},
    {"entropy", "knn", {92.45, 90.80, 93.43, 92.03}},
    {"paper", "tree", {92.07, 96.73, 89.09, 92.49}},
    {"paper", "knn", {95.61, 95.07, 95.76, 95.40}},
}};

struct LeftOut {
  std::string_view set;
  std::string_view object;
  Scores scores;
};

// Table II: k-NN, trained on the other nine objects.
inline constexpr std::array<LeftOut, 30> kLeftOut{{
    {"velocity", "ball", {42.92, 89.81, 45.12, 60.06}},       {"velocity", "bear", {47.93, 88.82, 44.76, 59.53}},
    {"velocity", "box", {45.95, 75.38, 44.04, 55.6}},         {"velocity", "duck", {48.79, 90.1, 42.87, 58.1}},
    {"velocity", "floss", {40.13, 91.78, 40.94, 56.62}},      {"velocity", "highlighter", {49.29, 86.5, 48.29, 61.98}},
    {"velocity", "mouse", {42.69, 89.42, 44.96, 59.84}},      {"velocity", "owl", {79.27, 77.43, 100.00, 87.28}},
    {"velocity", "screwdriver", {53.5, 89.42, 53.91, 67.26}}, {"velocity", "sponge", {38.46, 88.2, 40.54, 55.55}},
    {"paper", "ball", {71.24, 93.52, 63.52, 75.66}},          {"paper", "bear", {80.72, 94.57, 70.64, 80.87}},
    {"paper", "box", {77.84, 92.31, 68.89, 78.90}},           {"paper", "duck", {89.07, 96.25, 80.05, 87.41}},
    {"paper", "floss", {61.81, 91.17, 53.00, 67.03}},         {"paper", "highlighter", {84.02, 93.09, 77.82, 84.77}},
    {"paper", "mouse", {70.44, 90.41, 63.34, 74.49}},         {"paper", "owl", {91.06, 90.27, 100.00, 94.88}},
    {"paper", "screwdriver", {58.37, 96.96, 56.43, 71.34}},   {"paper", "sponge", {84.63, 91.15, 77.54, 83.80}},
    {"entropy", "ball", {91.67, 90.43, 91.99, 91.20}},        {"entropy", "bear", {86.91, 88.18, 82.63, 85.32}},
    {"entropy", "box", {91.09, 90.35, 89.85, 90.10}},         {"entropy", "duck", {97.58, 94.45, 99.37, 96.85}},
    {"entropy", "floss", {93.16, 92.15, 91.81, 91.98}},       {"entropy", "highlighter", {89.27, 91.99, 86.43, 89.13}},
    {"entropy", "mouse", {87.21, 91.26, 83.48, 87.20}},       {"entropy", "owl", {91.73, 91.00, 100.00, 95.29}},
    {"entropy", "screwdriver", {97.46, 95.90, 99.32, 97.58}}, {"entropy", "sponge", {90.66, 89.60, 89.04, 89.32}},
}};

struct Unseen {
  std::string_view object;
  Scores scores;
};

// Table III. The paper names neither the classifier nor the features; by its text, k-NN trained on the ten objects.
inline constexpr std::array<Unseen, 3> kUnseen{{
    {"book", {71.69, 88.45, 59.17, 70.91}},
    {"raccoon", {93.73, 97.03, 91.02, 93.93}},
    {"contact_solution", {86.66, 95.09, 80.32, 87.08}},
}};

// nullptr: the paper has no such figure.
[[nodiscard]] constexpr const Scores* five_fold(std::string_view set, std::string_view classifier) {
  for (const FiveFold& row : kFiveFold) {
    if (row.set == set && row.classifier == classifier) return &row.scores;
  }
  return nullptr;
}

[[nodiscard]] constexpr const Scores* left_out(std::string_view set, std::string_view object) {
  for (const LeftOut& row : kLeftOut) {
    if (row.set == set && row.object == object) return &row.scores;
  }
  return nullptr;
}

[[nodiscard]] constexpr const Scores* unseen(std::string_view object) {
  for (const Unseen& row : kUnseen) {
    if (row.object == object) return &row.scores;
  }
  return nullptr;
}

}  // namespace holdfast::learn::paper
