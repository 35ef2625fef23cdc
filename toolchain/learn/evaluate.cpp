// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/evaluate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <set>

#include "toolchain/learn/splits.hpp"
#include "toolchain/play/paper.hpp"

namespace holdfast::learn {

// --- statistics ---

double gamma_p(double a, double x) {
  if (x <= 0.0) return 0.0;
  const double scale = std::exp(a * std::log(x) - x - std::lgamma(a));
  if (x < a + 1.0) {  // series
    double term = 1.0 / a;
    double sum = term;
    for (double n = a + 1.0; term > 1e-17 * sum; n += 1.0) sum += term *= x / n;
    return scale * sum;
  }
  // Continued fraction of the upper tail, by Lentz's method (Numerical Recipes, 6.2).
  constexpr double kTiny = 1e-300;
  double b = x + 1.0 - a;
  double c = 1.0 / kTiny;
  double d = 1.0 / b;
  double h = d;
  for (int i = 1; i < 10000; ++i) {
    const double numerator = -i * (i - a);
    b += 2.0;
    d = numerator * d + b;
    c = b + numerator / c;
    if (std::abs(d) < kTiny) d = kTiny;
    if (std::abs(c) < kTiny) c = kTiny;
    d = 1.0 / d;
    h *= d * c;
    if (std::abs(d * c - 1.0) < 1e-16) break;
  }
  return 1.0 - scale * h;
}

namespace {

double gamma_quantile(double a, double share) {
  double low = 0.0;
  double high = a + 1.0;
  while (gamma_p(a, high) < share) high *= 2.0;
  for (int step = 0; step < 200 && high - low > 1e-13 * high; ++step) {
    const double middle = 0.5 * (low + high);
    (gamma_p(a, middle) < share ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

PoissonInterval poisson_interval(long count, double confidence) {
  const double tail = 0.5 * (1.0 - confidence);
  const auto n = static_cast<double>(count);
  return {count == 0 ? 0.0 : gamma_quantile(n, tail), gamma_quantile(n + 1.0, 1.0 - tail)};
}

Scores scores_of(std::span<const Confusion> repetitions) {
  const auto interval = [&](double (Confusion::*score)() const) {
    std::vector<double> values;
    for (const Confusion& confusion : repetitions) values.push_back((confusion.*score)());
    return interval_of(values);
  };
  return {interval(&Confusion::accuracy), interval(&Confusion::precision), interval(&Confusion::recall),
          interval(&Confusion::f1), interval(&Confusion::balanced_accuracy)};
}

// --- results ---

double ObjectsScore::mean_accuracy() const {
  double sum = 0.0;
  for (const ObjectScore& object : objects) sum += object.frames.accuracy();
  return objects.empty() ? 0.0 : sum / static_cast<double>(objects.size());
}

const ObjectScore& ObjectsScore::worst() const {
  return *std::min_element(objects.begin(), objects.end(), [](const ObjectScore& a, const ObjectScore& b) {
    return a.frames.accuracy() < b.frames.accuracy();
  });
}

void EventGroup::add(const GraspEvent& event) {
  ++trials;
  false_alarms += event.false_alarms;
  open_alarms += event.open_alarms;
  held_s += event.held_s;
  if (!event.slips) return;
  ++onsets;
  if (event.raised_before) {
    ++before;
  } else if (!event.raised_s || !event.raised_frames) {
    ++missed;
  } else {
    const auto insert = [](std::vector<double>& values, double value) {
      values.insert(std::upper_bound(values.begin(), values.end(), value), value);
    };
    insert(frames, *event.raised_frames);
    insert(ms, (*event.raised_s - event.onset_s) * 1e3);
  }
}

double EventGroup::within(int count) const {
  if (onsets == 0) return 0.0;
  const auto end = std::upper_bound(frames.begin(), frames.end(), static_cast<double>(count));
  return static_cast<double>(end - frames.begin()) / onsets;
}

double EventGroup::alarms_per_hour() const {
  return held_s > 0.0 ? false_alarms * 3600.0 / held_s : 0.0;
}

PoissonInterval EventGroup::alarms_per_hour_interval() const {
  if (held_s <= 0.0) return {0.0, std::numeric_limits<double>::infinity()};
  const PoissonInterval count = poisson_interval(false_alarms);
  return {count.low * 3600.0 / held_s, count.high * 3600.0 / held_s};
}

// --- work ---

bool is_unseen(std::string_view object) {
  return std::any_of(scene::kPaperObjects.begin(), scene::kPaperObjects.end(),
                     [&](const scene::PaperObject& known) { return known.unseen && known.name == object; });
}

namespace {

using Outcome = std::optional<std::string>;  // an error line, or nothing
using Verdicts = std::vector<std::uint8_t>;  // one a row of Samples

std::vector<int> rows_of(const Samples& samples, std::span<const int> trials, bool only_judged) {
  std::vector<int> rows;
  for (const int t : trials) {
    const Trial& trial = samples.trials[static_cast<std::size_t>(t)];
    for (int r = trial.first; r < trial.first + trial.count; ++r) {
      if (!only_judged || judged(samples.rows[static_cast<std::size_t>(r)])) rows.push_back(r);
    }
  }
  return rows;
}

Matrix matrix_of_rows(const Samples& samples, const FeatureSet& set, std::span<const int> rows) {
  Matrix matrix;
  matrix.set = &set;
  for (const int r : rows) {
    const Row& row = samples.rows[static_cast<std::size_t>(r)];
    for (const std::uint8_t member : set.members) matrix.x.push_back(row.x[member]);
    matrix.slip.push_back(row.label == Label::kSlip ? 1 : 0);
    matrix.row.push_back(r);
  }
  return matrix;
}

Confusion confusion_of(const Samples& samples, std::span<const int> rows, const Verdicts& verdicts) {
  Confusion confusion;
  for (const int r : rows) {
    const Row& row = samples.rows[static_cast<std::size_t>(r)];
    confusion.add(row.label == Label::kSlip, verdicts[static_cast<std::size_t>(r)] != 0);
  }
  return confusion;
}

// Frames by object, in the order of first appearance.
std::vector<ObjectScore> by_objects(const Samples& samples, std::span<const int> trials, const Verdicts& verdicts) {
  std::vector<ObjectScore> out;
  for (const int t : trials) {
    const std::string& object = samples.trials[static_cast<std::size_t>(t)].object;
    auto at = std::find_if(out.begin(), out.end(), [&](const ObjectScore& score) { return score.object == object; });
    if (at == out.end()) at = out.insert(out.end(), {object, {}});
    const std::array<int, 1> one{t};
    at->frames += confusion_of(samples, rows_of(samples, one, true), verdicts);
  }
  return out;
}

EventScore events_of(const Samples& samples, std::span<const int> trials, const Verdicts& verdicts, std::string name) {
  EventScore score{std::move(name), {}};
  score.groups.emplace_back().kind = "all";
  for (const int t : trials) {
    const Trial& trial = samples.trials[static_cast<std::size_t>(t)];
    const GraspEvent event = event_of(
        samples, t,
        std::span(verdicts).subspan(static_cast<std::size_t>(trial.first), static_cast<std::size_t>(trial.count)),
        decision::Config{});
    score.groups.front().add(event);
    auto at = std::find_if(score.groups.begin() + 1, score.groups.end(),
                           [&](const EventGroup& group) { return group.kind == trial.kind; });
    if (at == score.groups.end()) {
      at = score.groups.insert(score.groups.end(), EventGroup{});
      at->kind = trial.kind;
    }
    at->add(event);
  }
  return score;
}

// --- the plan ---

int cost(Kind kind) {  // relative, for the progress bar
  return kind == Kind::kKnn ? 3 : 1;
}

constexpr std::array kKinds{Kind::kTree, Kind::kKnn};

class Work {
 public:
  Work(const Samples& samples, const Options& options, Evaluation& out)
      : samples_(samples), options_(options), out_(out) {
    for (int t = 0; t < static_cast<int>(samples.trials.size()); ++t) {
      (is_unseen(samples.trials[static_cast<std::size_t>(t)].object) ? unseen_ : known_).push_back(t);
    }
  }

  [[nodiscard]] Outcome check() const {
    const auto objects = [](const Samples& samples, const std::vector<int>& trials) {
      std::set<std::string> names;
      for (const int t : trials) names.insert(samples.trials[static_cast<std::size_t>(t)].object);
      return names.size();
    };
    if (objects(samples_, known_) < 2) {
      return fmt::format(
          "the data has {} known object{}: nothing can be left out. Likely cause: a data set of one object, or of "
          "unseen objects alone. Next: make data of at least two of the paper's ten objects",
          objects(samples_, known_), objects(samples_, known_) == 1 ? "" : "s");
    }
    if (static_cast<int>(known_.size()) < options_.folds) {
      return fmt::format(
          "{} trials cannot be parted into {} folds. Likely cause: a data set cut short. Next: make more trials",
          known_.size(), options_.folds);
    }
    if (options_.unseen && unseen_.empty()) {
      return "the data has no unseen objects (book, raccoon, contact_solution). Likely cause: a data set of the ten "
             "objects alone. Next: give one of the unseen objects too, or leave Table III out: --without-unseen";
    }
    return std::nullopt;
  }

  void plan() {
    for (const FeatureSet* set : options_.sets) {
      for (const Kind kind : kKinds) {
        job(cost(kind) * options_.folds * 2 * options_.seeds, [this, set, kind] { return five_fold(*set, kind); });
        job(cost(kind) * 10, [this, set, kind] { return left_out(*set, kind); });
        if (options_.unseen) job(cost(kind), [this, set, kind] { return unseen(*set, kind); });
      }
      job(10, [this, set] { return events(*set); });
    }
  }

  Outcome run() {
    for (const Job& job : jobs_) {
      if (!go_on()) return "stopped";
      if (Outcome error = job.run()) return error;
      if (stopped_) return "stopped";
      done_ += job.units;
    }
    return std::nullopt;
  }

 private:
  struct Job {
    int units;
    std::function<Outcome()> run;
  };

  void job(int units, std::function<Outcome()> run) {
    jobs_.push_back({units, std::move(run)});
    total_ += units;
  }

  // False: told to stop. `extra` of the job at hand.
  bool go_on(long extra = 0) {
    if (options_.progress && !options_.progress(done_ + extra, total_)) stopped_ = true;
    return !stopped_;
  }

  [[nodiscard]] Settings settings(Kind kind, std::uint64_t seed) const {
    Settings settings = kind == Kind::kTree ? options_.tree : Settings{};
    settings.kind = kind;
    settings.seed = seed;
    return settings;
  }

  // Learns from some rows and classifies others.
  static Outcome fit_and_judge(const Samples& samples, const FeatureSet& set, const Settings& settings,
                               const std::vector<int>& train, const std::vector<int>& test, Verdicts& verdicts) {
    const std::unique_ptr<Learner> learner = make_learner(settings);
    if (const Outcome error = learner->fit(matrix_of_rows(samples, set, train))) {
      return fmt::format(
          "{} on {}: {}. Likely cause: too few grasps, or all of one kind. Next: make data with grasps that slip and "
          "grasps that hold, of every object",
          name_of(settings.kind), set.name, *error);
    }
    const std::vector<std::uint8_t> said = learner->predict(matrix_of_rows(samples, set, test));
    for (std::size_t i = 0; i < test.size(); ++i) {
      const auto r = static_cast<std::size_t>(test[i]);
      verdicts[r] = may_slip(set, samples.rows[r]) ? said[i] : std::uint8_t{0};
    }
    return std::nullopt;
  }

  Outcome five_fold(const FeatureSet& set, Kind kind) {
    std::vector<Confusion> by_trials;
    std::vector<Confusion> by_frames;
    const std::vector<int> judged_rows = rows_of(samples_, known_, true);
    long extra = 0;
    for (int s = 0; s < options_.seeds; ++s) {
      const auto seed = static_cast<std::uint64_t>(s) + 1;
      Verdicts verdicts(samples_.rows.size());
      for (const Split& split : by_trial(samples_, known_, options_.folds, seed)) {
        if (!go_on(extra)) return std::nullopt;
        if (auto error = fit_and_judge(samples_, set, settings(kind, seed), rows_of(samples_, split.train, true),
                                       rows_of(samples_, split.test, true), verdicts)) {
          return split.name + ": " + *error;
        }
        extra += cost(kind);
      }
      by_trials.push_back(confusion_of(samples_, judged_rows, verdicts));
      for (const RowSplit& split : by_frame(samples_, known_, options_.folds, seed)) {
        if (!go_on(extra)) return std::nullopt;
        if (auto error = fit_and_judge(samples_, set, settings(kind, seed), split.train, split.test, verdicts)) {
          return "split by frame: " + *error;
        }
        extra += cost(kind);
      }
      by_frames.push_back(confusion_of(samples_, judged_rows, verdicts));
    }
    out_.five_fold.push_back({&set, kind, scores_of(by_trials), scores_of(by_frames)});
    return std::nullopt;
  }

  // Verdicts of every row by the classifier that has not seen its object.
  Outcome leave_out(const Samples& samples, const std::vector<int>& trials, const FeatureSet& set,
                    const Settings& settings, bool every_row, Verdicts& verdicts) {
    verdicts.assign(samples.rows.size(), 0);
    for (const Split& split : by_object(samples, trials)) {
      if (!go_on()) return std::nullopt;
      if (auto error = fit_and_judge(samples, set, settings, rows_of(samples, split.train, true),
                                     rows_of(samples, split.test, !every_row), verdicts)) {
        return split.name + " left out: " + *error;
      }
    }
    return std::nullopt;
  }

  Outcome left_out(const FeatureSet& set, Kind kind) {
    Verdicts verdicts;
    if (auto error = leave_out(samples_, known_, set, settings(kind, 1), false, verdicts)) return error;
    out_.left_out.push_back({&set, kind, by_objects(samples_, known_, verdicts)});
    return std::nullopt;
  }

  Outcome unseen(const FeatureSet& set, Kind kind) {
    Verdicts verdicts(samples_.rows.size());
    if (auto error = fit_and_judge(samples_, set, settings(kind, 1), rows_of(samples_, known_, true),
                                   rows_of(samples_, unseen_, true), verdicts)) {
      return "unseen objects: " + *error;
    }
    out_.unseen.push_back({&set, kind, by_objects(samples_, unseen_, verdicts)});
    return std::nullopt;
  }

  Outcome events(const FeatureSet& set) {
    Verdicts verdicts;
    if (auto error = leave_out(samples_, known_, set, settings(Kind::kTree, 1), true, verdicts)) return error;
    out_.events.push_back(events_of(samples_, known_, verdicts, std::string(set.name)));
    return std::nullopt;
  }

  const Samples& samples_;
  const Options& options_;
  Evaluation& out_;
  std::vector<int> known_;
  std::vector<int> unseen_;
  std::vector<Job> jobs_;
  long total_ = 0;
  long done_ = 0;
  bool stopped_ = false;
};

}  // namespace

std::optional<std::string> evaluate(const Samples& samples, const Options& options, Evaluation& out) {
  out = {};
  Work work(samples, options, out);
  if (auto error = work.check()) return error;
  work.plan();
  return work.run();
}

}  // namespace holdfast::learn
