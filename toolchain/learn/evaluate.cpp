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
#include <sstream>

#include "base/crc32.hpp"
#include "drivers/sim/scene/math/random.hpp"
#include "toolchain/learn/splits.hpp"
#include "toolchain/play/paper.hpp"
#include "toolchain/play/thread_time.hpp"

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

OneThreshold best_threshold(std::span<const double> values, std::span<const std::uint8_t> slip) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  const auto slips = static_cast<double>(std::count(slip.begin(), slip.end(), 1));
  const double holds = static_cast<double>(slip.size()) - slips;
  OneThreshold best;
  if (slips == 0.0 || holds == 0.0) return best;
  double slips_below = 0.0;
  double holds_below = 0.0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    (slip[order[i]] != 0 ? slips_below : holds_below) += 1.0;
    if (i + 1 < order.size() && values[order[i + 1]] == values[order[i]]) continue;
    const double above = 0.5 * (1.0 - slips_below / slips + holds_below / holds);
    const double score = std::max(above, 1.0 - above);
    if (score > best.balanced_accuracy) best = {score, values[order[i]], above >= 0.5};
  }
  return best;
}

std::optional<double> quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::nullopt;
  const double rank = std::ceil(share * static_cast<double>(values.size())) - 1.0;
  const auto at = static_cast<std::ptrdiff_t>(std::clamp(rank, 0.0, static_cast<double>(values.size() - 1)));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
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

// `count` of the rows, drawn without repetition; all when there are no more.
std::vector<int> draw(std::vector<int> rows, int count, std::uint64_t seed) {
  if (count <= 0 || static_cast<int>(rows.size()) <= count) return rows;
  scene::Random random(seed);
  for (int i = 0; i < count; ++i) {
    const int other = i + random.below(static_cast<int>(rows.size()) - i);
    std::swap(rows[static_cast<std::size_t>(i)], rows[static_cast<std::size_t>(other)]);
  }
  rows.resize(static_cast<std::size_t>(count));
  std::sort(rows.begin(), rows.end());
  return rows;
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

EventScore events_of(const Samples& samples, std::span<const int> trials, const Verdicts& verdicts,
                     const std::string& name, int raise_frames) {
  decision::Config config;
  config.raise_frames = raise_frames;
  EventScore score{name, raise_frames, {}};
  score.groups.emplace_back().kind = "all";
  for (const int t : trials) {
    const Trial& trial = samples.trials[static_cast<std::size_t>(t)];
    const GraspEvent event = event_of(
        samples, t,
        std::span(verdicts).subspan(static_cast<std::size_t>(trial.first), static_cast<std::size_t>(trial.count)),
        config);
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

constexpr std::array kRaiseFrames{1, 2, 3};

// --- the plan ---

int cost(Kind kind) {  // relative, for the progress bar
  switch (kind) {
    case Kind::kSvm:
      return 20;
    case Kind::kForest:
      return 8;
    case Kind::kKnn:
      return 3;
    default:
      return 1;
  }
}

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
             "objects alone. Next: give one of the unseen objects too, or leave Table III out: --without unseen";
    }
    return std::nullopt;
  }

  void plan() {
    const std::uint64_t seeds = static_cast<std::uint64_t>(options_.seeds);
    const bool whole = options_.piece == nullptr;  // what learns nothing is left to who has all pieces
    if (whole) job(1, [this] { return single(); });
    for (const FeatureSet* set : options_.sets) {
      for (const Kind kind : options_.kinds) {
        const std::size_t at = out_.five_fold.size();
        out_.five_fold.push_back({set, kind, {}, {}, {}});
        job(cost(kind) * options_.folds * static_cast<int>(2 * seeds),
            [this, at] { return five_fold(out_.five_fold[at]); });
      }
    }
    for (const FeatureSet* set : options_.sets) {
      for (const Kind kind : options_.left_out_kinds) {
        job(cost(kind) * 10, [this, set, kind] { return left_out(*set, kind); });
        if (options_.unseen) job(cost(kind), [this, set, kind] { return unseen(*set, kind); });
      }
    }
    for (const FeatureSet* set : options_.sets) {
      if (!options_.events) break;
      job(10, [this, set] { return events(*set); });
      for (const double weight : options_.slip_weights) job(10, [this, set, weight] { return curve(*set, weight); });
    }
    for (const LoadedModel& model : options_.models) {
      if (whole) job(1, [this, &model] { return given(model); });
    }
    if (!whole) return;
    job(10 + (has(Kind::kSvm) ? cost(Kind::kSvm) : 0), [this] { return timing(); });
    for (const std::string_view name : {"entropy", "velocity"}) {
      const FeatureSet* set = find_feature_set(name);
      const int units = 1 + options_.tsne_points / 50;
      if (options_.tsne_points > 0 && set != nullptr) job(units, [this, set] { return tsne_of(*set); });
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

  [[nodiscard]] bool has(Kind kind) const {
    return std::find(options_.kinds.begin(), options_.kinds.end(), kind) != options_.kinds.end();
  }

  [[nodiscard]] Settings settings(Kind kind, std::uint64_t seed) const {
    Settings settings = kind == Kind::kTree ? options_.tree : Settings{};
    settings.kind = kind;
    settings.seed = seed;
    return settings;
  }

  Outcome fit(const Samples& samples, const FeatureSet& set, const Settings& settings, std::vector<int> rows,
              std::unique_ptr<Learner>& learner) const {
    if (settings.kind == Kind::kSvm) rows = draw(std::move(rows), options_.svm_rows, settings.seed);
    learner = make_learner(settings);
    const Outcome error = learner->fit(matrix_of_rows(samples, set, rows));
    if (!error) return std::nullopt;
    return fmt::format(
        "{} on {}: {}. Likely cause: too few grasps, or all of one kind. Next: make data with grasps that slip and "
        "grasps that hold, of every object",
        name_of(settings.kind), set.name, *error);
  }

  // Learns from some rows and classifies others; or has a piece's classifier say what it said.
  Outcome fit_and_judge(const Samples& samples, const FeatureSet& set, const Settings& settings,
                        const std::vector<int>& train, const std::vector<int>& test, Verdicts& verdicts) {
    const long number = classifiers_++;
    if (options_.pieces != nullptr) return recall(*options_.pieces, number, test, verdicts);
    if (options_.piece != nullptr && number % options_.shards + 1 != options_.shard) return std::nullopt;
    std::unique_ptr<Learner> learner;
    if (Outcome error = fit(samples, set, settings, train, learner)) return error;
    if (!test.empty()) judge(samples, set, *learner, test, verdicts);
    if (options_.piece != nullptr) {
      Verdicts& said = options_.piece->said[number];
      for (const int r : test) said.push_back(verdicts[static_cast<std::size_t>(r)]);
    }
    return std::nullopt;
  }

  static Outcome recall(const Piece& pieces, long number, const std::vector<int>& test, Verdicts& verdicts) {
    const auto said = pieces.said.find(number);
    if (said == pieces.said.end() || said->second.size() != test.size()) {
      return fmt::format(
          "what classifier {} said is in none of the pieces. Likely cause: a piece left out, or a run that was "
          "stopped. Next: give all N pieces",
          number);
    }
    for (std::size_t i = 0; i < test.size(); ++i) verdicts[static_cast<std::size_t>(test[i])] = said->second[i];
    return std::nullopt;
  }

  static void judge(const Samples& samples, const FeatureSet& set, Learner& learner, const std::vector<int>& test,
                    Verdicts& verdicts) {
    const std::vector<std::uint8_t> said = learner.predict(matrix_of_rows(samples, set, test));
    for (std::size_t i = 0; i < test.size(); ++i) {
      const auto r = static_cast<std::size_t>(test[i]);
      verdicts[r] = may_slip(set, samples.rows[r]) ? said[i] : std::uint8_t{0};
    }
  }

  Outcome single() {
    const std::vector<int> rows = rows_of(samples_, known_, true);
    const Matrix all = matrix_of_rows(samples_, kFeatureSets.front(), rows);
    const auto add = [&](std::string name, const std::function<double(const Features&)>& value) {
      std::vector<double> values;
      values.reserve(rows.size());
      for (const int r : rows) values.push_back(value(samples_.rows[static_cast<std::size_t>(r)].x));
      out_.single.push_back({std::move(name), best_threshold(values, all.slip)});
    };
    if (const FeatureSet* velocity = find_feature_set("velocity"); velocity != nullptr) {
      const std::size_t x = velocity->members[0];
      const std::size_t y = velocity->members[1];
      add("|V|", [x, y](const Features& f) { return std::hypot(f[x], f[y]); });
    }
    for (std::size_t i = 0; i < kFeatures.size(); ++i) {
      const std::string name(kFeatures[i].name);
      add(name, [i](const Features& f) { return static_cast<double>(f[i]); });
      const bool is_signed = std::any_of(rows.begin(), rows.end(),
                                         [&](int r) { return samples_.rows[static_cast<std::size_t>(r)].x[i] < 0; });
      if (!is_signed) continue;
      add("|" + name + "|", [i](const Features& f) { return std::abs(static_cast<double>(f[i])); });
    }
    return std::nullopt;
  }

  Outcome five_fold(FiveFoldScore& score) {
    std::vector<Confusion> by_trials;
    std::vector<Confusion> by_frames;
    const std::vector<int> judged_rows = rows_of(samples_, known_, true);
    long extra = 0;
    for (int s = 0; s < options_.seeds; ++s) {
      const auto seed = static_cast<std::uint64_t>(s) + 1;
      Verdicts verdicts(samples_.rows.size());
      for (const Split& split : by_trial(samples_, known_, options_.folds, seed)) {
        if (!go_on(extra)) return std::nullopt;
        if (auto error =
                fit_and_judge(samples_, *score.set, settings(score.kind, seed), rows_of(samples_, split.train, true),
                              rows_of(samples_, split.test, true), verdicts)) {
          return split.name + ": " + *error;
        }
        extra += cost(score.kind);
      }
      by_trials.push_back(confusion_of(samples_, judged_rows, verdicts));
      if (s == 0) score.objects = by_objects(samples_, known_, verdicts);
      for (const RowSplit& split : by_frame(samples_, known_, options_.folds, seed)) {
        if (!go_on(extra)) return std::nullopt;
        if (auto error =
                fit_and_judge(samples_, *score.set, settings(score.kind, seed), split.train, split.test, verdicts)) {
          return "split by frame: " + *error;
        }
        extra += cost(score.kind);
      }
      by_frames.push_back(confusion_of(samples_, judged_rows, verdicts));
    }
    score.by_trial = scores_of(by_trials);
    score.by_frame = scores_of(by_frames);
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
    for (const int raise : kRaiseFrames) {
      out_.events.push_back(events_of(samples_, known_, verdicts, std::string(set.name), raise));
    }
    return std::nullopt;
  }

  Outcome curve(const FeatureSet& set, double weight) {
    Settings changed = settings(Kind::kTree, 1);
    changed.slip_weight *= weight;
    Verdicts verdicts;
    if (auto error = leave_out(samples_, known_, set, changed, true, verdicts)) return error;
    const EventScore score = events_of(samples_, known_, verdicts, {}, decision::Config{}.raise_frames);
    const EventGroup& all = score.groups.front();
    out_.curve.push_back({&set, changed.slip_weight, all.alarms_per_hour(), quantile(all.ms, 0.5), all.within(10)});
    return std::nullopt;
  }

  static Verdicts judge_all(const Samples& samples, const LoadedModel& model) {
    Verdicts verdicts;
    std::vector<std::int32_t> x(static_cast<std::size_t>(model.tree.set->size()));
    for (const Row& row : samples.rows) {
      std::transform(model.tree.set->members.begin(), model.tree.set->members.end(), x.begin(),
                     [&](std::uint8_t member) { return row.x[member]; });
      const bool slips = may_slip(*model.tree.set, row) && model::evaluate(model.tree, x) != Verdict::kHold;
      verdicts.push_back(slips ? 1 : 0);
    }
    return verdicts;
  }

  Outcome given(const LoadedModel& model) {
    const Verdicts verdicts = judge_all(samples_, model);
    std::vector<int> trials(samples_.trials.size());
    std::iota(trials.begin(), trials.end(), 0);
    out_.models.push_back({model.name, model.tree.set, by_objects(samples_, trials, verdicts)});
    for (const int raise : kRaiseFrames) {
      out_.model_events.push_back(events_of(samples_, trials, verdicts, model.name, raise));
    }
    return std::nullopt;
  }

  // As the paper: 10 repetitions of 200 single predictions.
  Outcome timing() {
    constexpr int kRepetitions = 10;
    constexpr int kPredictions = 200;
    const bool has_paper = std::any_of(options_.sets.begin(), options_.sets.end(),
                                       [](const FeatureSet* set) { return set->name == "paper"; });
    const FeatureSet& set = has_paper ? *find_feature_set("paper") : *options_.sets.front();
    out_.timing_set = set.name;
    const std::vector<int> train = rows_of(samples_, known_, true);
    const std::vector<int> asked = draw(train, kPredictions, 1);
    std::vector<Matrix> single;
    single.reserve(asked.size());
    for (const int r : asked) single.push_back(matrix_of_rows(samples_, set, std::array<int, 1>{r}));
    const auto median_us = [&](int passes, const std::function<void(const Matrix&)>& predict) {
      std::vector<double> us;
      for (int i = 0; i < kRepetitions; ++i) {
        const double start = tool::thread_us();
        for (int pass = 0; pass < passes; ++pass) {
          for (const Matrix& row : single) predict(row);
        }
        us.push_back((tool::thread_us() - start) / static_cast<double>(single.size()) / passes);
      }
      return *quantile(us, 0.5);
    };
    for (const Kind kind : options_.kinds) {
      if (!go_on()) return std::nullopt;
      std::unique_ptr<Learner> learner;
      if (auto error = fit(samples_, set, settings(kind, 1), train, learner)) return error;
      long slips = 0;  // used, so that nothing is optimised away
      const double us = median_us(1, [&](const Matrix& row) { slips += learner->predict(row).front(); });
      out_.timing.push_back({std::string(name_of(kind)), us});
      if (const auto tree = learner->tree(); kind == Kind::kTree && tree) {
        const model::Tree table = treec::to_table(*tree);
        volatile std::uint8_t last = 0;
        const double table_us =
            median_us(100, [&](const Matrix& row) { last = static_cast<std::uint8_t>(model::evaluate(table, row.x)); });
        out_.timing.push_back({"tree, the firmware's own walk", table_us});
      }
    }
    return std::nullopt;
  }

  // Equal shares of static and slip, as far as there are rows; features scaled to unit variance.
  Outcome tsne_of(const FeatureSet& set) {
    std::array<std::vector<int>, 2> classes;
    for (const int r : rows_of(samples_, known_, true)) {
      classes[samples_.rows[static_cast<std::size_t>(r)].label == Label::kSlip ? 1 : 0].push_back(r);
    }
    TsnePanel panel{&set, {}, {}};
    for (std::vector<int>& rows : classes) {
      const std::vector<int> some = draw(std::move(rows), options_.tsne_points / 2, 1);
      panel.rows.insert(panel.rows.end(), some.begin(), some.end());
    }
    const Matrix matrix = matrix_of_rows(samples_, set, panel.rows);
    const auto width = static_cast<std::size_t>(set.size());
    std::vector<double> points(matrix.x.begin(), matrix.x.end());
    for (std::size_t k = 0; k < width; ++k) {
      double sum = 0.0;
      double squares = 0.0;
      for (std::size_t i = k; i < points.size(); i += width) sum += points[i], squares += points[i] * points[i];
      const double mean = sum / static_cast<double>(panel.rows.size());
      const double variance = squares / static_cast<double>(panel.rows.size()) - mean * mean;
      const double scale = variance > 0.0 ? 1.0 / std::sqrt(variance) : 0.0;
      for (std::size_t i = k; i < points.size(); i += width) points[i] = (points[i] - mean) * scale;
    }
    tsne::Config config;
    config.iterations = options_.tsne_iterations;
    panel.points = tsne::embed(points, set.size(), config, [this] { return go_on(); });
    if (!stopped_) out_.tsne.push_back(std::move(panel));
    return std::nullopt;
  }

  const Samples& samples_;
  const Options& options_;
  Evaluation& out_;
  std::vector<int> known_;
  std::vector<int> unseen_;
  std::vector<Job> jobs_;
  long classifiers_ = 0;  // those that judged, in the order of the plan
  long total_ = 0;
  long done_ = 0;
  bool stopped_ = false;
};

// CRC-32 of everything that decides what the classifiers say.
std::uint32_t run_of(const Samples& samples, const Options& options) {
  std::ostringstream text;
  const Settings& tree = options.tree;
  text << fmt::format("{} {} {} {} {} {} {} {} {}\n", tree.max_depth, tree.min_leaf, tree.prune, tree.slip_weight,
                      static_cast<int>(tree.criterion), options.seeds, options.folds, options.unseen, options.events);
  for (const FeatureSet* set : options.sets) text << set->name << ' ';
  for (const std::vector<Kind>& kinds : {options.kinds, options.left_out_kinds}) {
    for (const Kind kind : kinds) text << name_of(kind) << ' ';
    text << '\n';
  }
  for (const double weight : options.slip_weights) text << fmt::format("{} ", weight);
  text << options.svm_rows << '\n';
  write_csv(text, samples);
  const std::string all = text.str();
  return crc32({reinterpret_cast<const std::uint8_t*>(all.data()), all.size()});
}

}  // namespace

std::optional<std::string> evaluate(const Samples& samples, const Options& options, Evaluation& out) {
  out = {};
  Work work(samples, options, out);
  if (auto error = work.check()) return error;
  const std::uint32_t run = run_of(samples, options);
  if (options.piece != nullptr) *options.piece = {run, {}};
  if (options.pieces != nullptr && options.pieces->run != run) {
    return "the pieces are of another run. Likely cause: other data or other options than those they were made with. "
           "Next: give the same, in the same order";
  }
  work.plan();
  return work.run();
}

}  // namespace holdfast::learn
