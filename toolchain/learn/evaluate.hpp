// SPDX-License-Identifier: Apache-2.0
// The paper's experiments on our data, and what the paper leaves out: events, delays, false alarms.
//
// Samples of objects that kPaperObjects does not call unseen are `known`: five-fold, leave-one-object-out and t-SNE
// look at them alone; `unseen` ones are only ever tested on. Every verdict that counts here comes from a classifier
// that has not seen the trial (by_frame: the row), except of models that are given (Options::models), which may have.
// Seeds vary the folds and the classifiers' own chance; trials and objects stay. Intervals over seeds hence say how
// repeatable a figure is, not how far it would move with other grasps: for that, look at the spread over objects.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slip/decision.hpp"
#include "slip/model.hpp"
#include "toolchain/learn/learners.hpp"
#include "toolchain/learn/metrics.hpp"
#include "toolchain/learn/piece.hpp"
#include "toolchain/learn/samples.hpp"
#include "toolchain/learn/tsne.hpp"

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

// The best balanced accuracy that one threshold on `values` reaches on these very rows, either side up: an upper bound.
struct OneThreshold {
  double balanced_accuracy = 0.5;
  double threshold = 0.0;
  bool slip_above = true;
};
[[nodiscard]] OneThreshold best_threshold(std::span<const double> values, std::span<const std::uint8_t> slip);

// The value below which `share` of them lie (nearest rank, so always one that occurred); nothing of none.
[[nodiscard]] std::optional<double> quantile(std::vector<double> values, double share);

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
  std::vector<ObjectScore> objects;  // by trial, first seed: the paper's bar chart
};

// Table II (each object by those who trained on the others) and III (unseen objects by those who trained on the known).
struct ObjectsScore {
  const FeatureSet* set = nullptr;
  Kind kind = Kind::kTree;
  std::vector<ObjectScore> objects;

  [[nodiscard]] double mean_accuracy() const;
  [[nodiscard]] const ObjectScore& worst() const;  // by accuracy; there is at least one
};

struct SingleScore {
  std::string name;
  OneThreshold best;
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

// What an alarm stands on: a set's tree that has not seen the object, or a given model.
struct EventScore {
  std::string name;
  int raise_frames = 2;
  std::vector<EventGroup> groups;  // "all" first
};

struct CurvePoint {
  const FeatureSet* set = nullptr;
  double slip_weight = 1.0;
  double alarms_per_hour = 0.0;
  std::optional<double> median_delay_ms;
  double within_10 = 0.0;
};

struct ModelScore {
  std::string name;
  const FeatureSet* set = nullptr;
  std::vector<ObjectScore> objects;
};

struct TimingScore {
  std::string name;
  double us = 0.0;  // thread CPU time of one row, median of repetitions
};

struct TsnePanel {
  const FeatureSet* set = nullptr;
  std::vector<int> rows;  // of Samples::rows
  std::vector<tsne::Point> points;
};

struct Evaluation {
  std::vector<FiveFoldScore> five_fold;
  std::vector<ObjectsScore> left_out;
  std::vector<ObjectsScore> unseen;
  std::vector<SingleScore> single;
  std::vector<EventScore> events;  // leave one object out, kTree
  std::vector<CurvePoint> curve;   // by set, then by weight
  std::vector<ModelScore> models;
  std::vector<EventScore> model_events;
  std::vector<TimingScore> timing;
  std::string timing_set;
  std::vector<TsnePanel> tsne;
};

// --- work ---

struct LoadedModel {
  std::string name;
  model::Tree tree;  // which knows its set
};

struct Options {
  std::vector<const FeatureSet*> sets;
  std::vector<Kind> kinds;           // Table I
  std::vector<Kind> left_out_kinds;  // Tables II and III
  std::vector<LoadedModel> models;
  Settings tree;  // of kTree; the others keep Settings' defaults. Kind and seed are set here
  int seeds = 5;
  int folds = 5;
  bool unseen = true;
  bool events = true;
  std::vector<double> slip_weights{0.02, 0.05, 0.1, 0.2,
                                   0.5,  1.0,  2.0, 5.0};  // times tree.slip_weight; empty: no curve
  int svm_rows = 0;                                        // drawn from those to learn from; 0: all
  int tsne_points = 2000;                                  // 0: none
  int tsne_iterations = 500;
  std::function<bool(long, long)> progress;  // units of work done, of all; false stops
  // One piece of a run (piece.hpp): only its classifiers learn, what they say goes to `piece`, and `out` is void.
  Piece* piece = nullptr;
  int shard = 1;  // 1 .. shards
  int shards = 1;
  // What all pieces of the run said: nothing learns again, but for the timing.
  const Piece* pieces = nullptr;
};

// Whether the paper keeps this object out of training.
[[nodiscard]] bool is_unseen(std::string_view object);

// Nothing, or one line that says what is wrong (or "stopped"); `out` is void then.
[[nodiscard]] std::optional<std::string> evaluate(const Samples& samples, const Options& options, Evaluation& out);

}  // namespace holdfast::learn
