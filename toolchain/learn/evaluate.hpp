// SPDX-License-Identifier: Apache-2.0
// The paper's experiments on our data, and what the paper leaves out: events, delays, false alarms.
//
// Classifiers: our own tree, which the device runs, and the paper's best, k-NN (learners.hpp). Samples of objects that
// kPaperObjects does not call unseen are `known`: five-fold and leave-one-object-out look at them alone; `unseen` ones
// are only ever tested on. Every verdict that counts here comes from a classifier that has not seen the trial
// (by_frame: the row). Seeds vary the folds and the classifiers' own chance; trials and objects stay. Intervals over
// seeds hence say how repeatable a figure is, not how far it would move with other grasps: for that, look at the spread
// over objects.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slip/decision.hpp"
#include "slip/model.hpp"
#include "toolchain/learn/learners.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/learn/samples.hpp"

namespace holdfast::learn {

// --- statistics ---

// Exact (Garwood) interval for the mean of a Poisson count: chi-square quantiles over 2. 0 alarms: [0, 3.69].
struct PoissonInterval {
  double low = 0.0;
  double high = 0.0;
};
[[nodiscard]] PoissonInterval poisson_interval(long count, double confidence = 0.95);

// Lower tail of the gamma distribution, shape a > 0, x >= 0: 1e-12. Chi-square with k degrees: a = k / 2, x / 2.
[[nodiscard]] double gamma_p(double a, double x);

// --- results ---

struct Scores {
  Interval accuracy;
  Interval precision;
  Interval recall;
  Interval f1;
  Interval balanced;
};
[[nodiscard]] Scores scores_of(std::span<const Confusion> repetitions);

struct ObjectScore {
  std::string object;
  Confusion frames;
};

// Table I, one cell: confusion pooled over the folds, one repetition a seed.
struct FiveFoldScore {
  const FeatureSet* set = nullptr;
  Kind kind = Kind::kTree;
  Scores by_trial;
  Scores by_frame;
};

// Table II (each object by those who trained on the others) and III (unseen objects by those who trained on the known).
struct ObjectsScore {
  const FeatureSet* set = nullptr;
  Kind kind = Kind::kTree;
  std::vector<ObjectScore> objects;

  [[nodiscard]] double mean_accuracy() const;
  [[nodiscard]] const ObjectScore& worst() const;  // by accuracy; there is at least one
};

// Trials of one kind through the decision stage.
struct EventGroup {
  std::string kind;  // "all", or Trial::kind
  int trials = 0;
  int onsets = 0;
  int before = 0;              // alarm up already when the onset came: neither detected nor missed
  int missed = 0;              // never raised at or after the onset
  std::vector<double> frames;  // delay of the detections, sorted
  std::vector<double> ms;
  int false_alarms = 0;  // on hold rows and before the onset
  int open_alarms = 0;   // on rows without contact or during release: not judged
  double held_s = 0.0;   // exposure of the false alarms

  void add(const GraspEvent& event);
  [[nodiscard]] double within(int count) const;  // share of the onsets detected in at most that many frames
  [[nodiscard]] double alarms_per_hour() const;
  [[nodiscard]] PoissonInterval alarms_per_hour_interval() const;  // high = infinity without exposure
};

// What an alarm stands on: a set's tree that has not seen the object; by the firmware's defaults.
struct EventScore {
  std::string name;
  std::vector<EventGroup> groups;  // "all" first
};

struct Evaluation {
  std::vector<FiveFoldScore> five_fold;
  std::vector<ObjectsScore> left_out;
  std::vector<ObjectsScore> unseen;
  std::vector<EventScore> events;  // leave one object out, kTree
};

// --- work ---

struct Options {
  std::vector<const FeatureSet*> sets;
  Settings tree;  // of kTree; k-NN keeps Settings' defaults. Kind and seed are set here
  int seeds = 5;
  int folds = 5;
  bool unseen = true;
  std::function<bool(long, long)> progress;  // units of work done, of all; false stops
};

// Whether the paper keeps this object out of training.
[[nodiscard]] bool is_unseen(std::string_view object);

// Nothing, or one line that says what is wrong (or "stopped"); `out` is void then.
[[nodiscard]] std::optional<std::string> evaluate(const Samples& samples, const Options& options, Evaluation& out);

}  // namespace holdfast::learn
