// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/study.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "app/app.hpp"
#include "base/math.hpp"
#include "drivers/sim/scene/math/portable.hpp"
#include "drivers/sim/scene/simulation.hpp"
#include "tactile/features.hpp"
#include "tactile/field_features.hpp"
#include "toolchain/learn/charts.hpp"
#include "toolchain/learn/learners.hpp"
#include "toolchain/learn/splits.hpp"

namespace holdfast::learn {
namespace {

constexpr double kStill_mm = 1e-4;
constexpr std::array<std::int32_t, 5> kRanges_um{250, 500, 1000, 1900, 3000};
constexpr std::array<int, 3> kCounts{8, 15, 30};
constexpr int kFolds = 5;
constexpr int kDepth = 6;

// n weights, of any sum.
double entropy_of_weights(std::span<const double> weights) {
  const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
  double entropy = 0.0;
  for (const double w : weights) {
    if (w > 0.0) entropy -= w / sum * scene::portable::log(w / sum);
  }
  return std::max(0.0, entropy);
}

// Of the markers' squared lengths, um^2. Compares squares, as the firmware: a length on an edge belongs above it.
int hard_bin(const EntropyForm& form, std::int64_t length_2) {
  int bin = 0;
  while (bin < form.count - 1 && length_2 * square(form.count) >= square(std::int64_t{form.range_um} * (bin + 1))) {
    ++bin;
  }
  return bin;
}

bool still(const std::vector<scene::Vec2>& now, const std::vector<scene::Vec2>& before) {
  if (now.size() != before.size()) return false;
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (std::abs(now[i].x - before[i].x) >= kStill_mm || std::abs(now[i].y - before[i].y) >= kStill_mm) return false;
  }
  return true;
}

std::vector<int> all_trials(const Samples& samples) {
  std::vector<int> trials(samples.trials.size());
  std::iota(trials.begin(), trials.end(), 0);
  return trials;
}

const FeatureSet& pair_set() {
  return *find_feature_set("entropy");
}

// Learns on one side, adds the verdicts on the other to `out`.
std::optional<std::string> try_out(const Samples& samples, const Split& split, Confusion& out) {
  Settings settings;
  settings.kind = Kind::kTree;
  settings.max_depth = kDepth;
  const auto learner = make_learner(settings);
  if (auto error = learner->fit(matrix_of(samples, pair_set(), split.train))) {
    return fmt::format(
        "{}: cannot be left out: {}. Likely cause: too few objects or kinds of grasp. Next: give at least "
        "two objects",
        split.name, *error);
  }
  const Matrix test = matrix_of(samples, pair_set(), split.test);
  const std::vector<std::uint8_t> said = learner->predict(test);
  for (std::size_t i = 0; i < said.size(); ++i) out.add(test.slip[i] != 0, said[i] != 0);
  return {};
}

struct MeanSquare {
  double sum = 0.0;
  long count = 0;
  void add(double value) {
    sum += value * value;
    ++count;
  }
  [[nodiscard]] double root() const { return count == 0 ? 0.0 : std::sqrt(sum / static_cast<double>(count)); }
};

struct Share {
  long part = 0;
  long whole = 0;
  void add(bool is_part) {
    part += is_part ? 1 : 0;
    ++whole;
  }
  [[nodiscard]] double value() const {
    return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
  }
};

void measure(const EntropyRows& rows, std::size_t form, EntropyScore& score) {
  Share blind_hold, blind_slip;
  MeanSquare empty, held;
  std::vector<double> levels;
  std::vector<std::uint8_t> slip;
  for (std::size_t i = 0; i < rows.frames.size(); ++i) {
    const Row& row = rows.samples.rows[i];
    const EntropyFrame& frame = rows.frames[i];
    if (!row.accepted) continue;
    const EntropyPair& pair = frame.of[form];
    if (judged(row)) {
      levels.push_back(pair.nat_q16);
      slip.push_back(row.label == Label::kSlip ? 1 : 0);
    }
    if (!frame.has_rate) continue;
    const double rate = pair.nat_s_q8 / 256.0;
    if (row.label == Label::kHold) blind_hold.add(pair.nat_s_q8 == 0);
    if (row.label == Label::kSlip) blind_slip.add(pair.nat_s_q8 == 0);
    if (frame.calm == Calm::kEmpty) empty.add(rate);
    if (frame.calm == Calm::kTouched && row.label == Label::kHold) held.add(rate);
  }
  score.blind_hold = blind_hold.value();
  score.blind_slip = blind_slip.value();
  score.tremble_empty = empty.root();
  score.tremble_held = held.root();
  score.level = best_threshold(levels, slip);
}

// The score of that form; there is one.
template <typename Scores>
auto& of_form(Scores& scores, const EntropyForm& form) {
  return *std::ranges::find(scores, form, &EntropyScore::form);
}

}  // namespace

// --- which entropy ---

std::string name_of(const EntropyForm& form) {
  if (form.bins == Bins::kOctaves) return fmt::format("{} half octaves", form.count);
  return fmt::format("{} {}, {:g} mm", form.count, form.bins == Bins::kHard ? "hard" : "soft", form.range_um / 1e3);
}

const std::array<EntropyForm, kEntropyForms>& entropy_forms() {
  static const std::array<EntropyForm, kEntropyForms> forms = [] {
    std::array<EntropyForm, kEntropyForms> all{};
    std::size_t next = 0;
    for (const int count : kCounts) {
      for (const std::int32_t range_um : kRanges_um) all[next++] = {Bins::kHard, range_um, count};
    }
    for (const std::int32_t range_um : kRanges_um) all[next++] = {Bins::kSoft, range_um, kHistogramBins};
    all[next] = {Bins::kOctaves, 0, kHistogramBins};
    return all;
  }();
  return forms;
}

double entropy_nat(const EntropyForm& form, const DisplacementField& field) {
  std::array<double, kMaxMarkers> weights{};
  const auto used = std::span(weights).first(static_cast<std::size_t>(form.count));
  if (form.bins == Bins::kOctaves) {
    const auto counts = field_features::detail::octaves_of(field_features::detail::vectors_of(field));
    std::ranges::copy(counts, used.begin());
    return entropy_of_weights(used);
  }
  for (std::int32_t i = 0; i < field.grid.count(); ++i) {
    const MarkerDisplacement& d = field.markers[idx(i)];
    if (!d.valid) continue;
    const std::int64_t length_2 = square(d.dx.raw()) + square(d.dy.raw());
    if (form.bins == Bins::kHard) {
      used[idx(hard_bin(form, length_2))] += 1.0;
      continue;
    }
    // In bins, from the centre of the first one.
    const double place = std::clamp(std::sqrt(static_cast<double>(length_2)) * form.count / form.range_um - 0.5, 0.0,
                                    static_cast<double>(form.count - 1));
    const double below = std::floor(place);
    const auto bin = static_cast<std::size_t>(below);
    used[bin] += 1.0 - (place - below);
    if (place > below) used[bin + 1] += place - below;
  }
  return entropy_of_weights(used);
}

void play_entropies(EntropyRows& rows, const Planned& planned, const Params& params) {
  const auto& forms = entropy_forms();
  std::vector<scene::Vec2> before_mm;
  std::array<std::int32_t, kEntropyForms> before_q24{};
  double before_s = 0.0;
  const auto watch = [&](const App& app, const scene::Snapshot& truth) {
    const Row& row = rows.samples.rows.back();
    EntropyFrame& frame = rows.frames.emplace_back();
    if (row.accepted) {
      frame.has_rate = app.result().features.rates_valid;
      const std::int64_t step_us = std::llround((truth.t_s - before_s) * 1e6);
      for (std::size_t f = 0; f < forms.size(); ++f) {
        // Rounded where the firmware rounds (tactile/features.hpp).
        const auto q24 =
            static_cast<std::int32_t>(std::lround(entropy_nat(forms[f], app.state().displacement) * 0x1p24));
        EntropyPair& pair = frame.of[f];
        pair.nat_q16 = static_cast<std::int32_t>(div_round(q24, 256));
        if (frame.has_rate) {
          const std::int64_t rise = std::int64_t{q24} - before_q24[f];
          pair.nat_s_q8 = static_cast<std::int32_t>(div_round(rise * 1'000'000, step_us << 16));
        }
        before_q24[f] = q24;
      }
      before_s = truth.t_s;
    }
    if (still(truth.motion_mm, before_mm)) {
      frame.calm = truth.contact.normal_n > 0.0 ? Calm::kTouched : Calm::kEmpty;
    }
    before_mm = truth.motion_mm;
  };
  play_into(rows.samples, planned, params, {}, watch);
}

std::optional<std::string> score_entropies(const EntropyRows& rows, std::uint64_t seed,
                                           const std::function<bool(int)>& progress,
                                           std::vector<EntropyScore>& scores) {
  scores.clear();
  const std::vector<int> trials = all_trials(rows.samples);
  const std::vector<Split> folds = by_trial(rows.samples, trials, kFolds, seed);
  const std::vector<Split> objects = by_object(rows.samples, trials);
  Samples samples = rows.samples;
  for (std::size_t f = 0; f < entropy_forms().size(); ++f) {
    EntropyScore score;
    score.form = entropy_forms()[f];
    for (std::size_t i = 0; i < samples.rows.size(); ++i) {
      const EntropyPair& pair = rows.frames[i].of[f];
      samples.rows[i].x[pair_set().members[0]] = pair.nat_q16;
      samples.rows[i].x[pair_set().members[1]] = pair.nat_s_q8;
    }
    measure(rows, f, score);
    for (const Split& split : folds) {
      if (auto error = try_out(samples, split, score.five_fold)) return error;
    }
    for (const Split& split : objects) {
      Confusion frames;
      if (auto error = try_out(samples, split, frames)) return error;
      score.objects.push_back(frames.balanced_accuracy());
      score.left_out += frames;
    }
    scores.push_back(std::move(score));
    if (!progress(static_cast<int>(f) + 1)) return "stopped";
  }
  return {};
}

// --- what the tree stands ---

std::vector<Condition> conditions() {
  std::vector<Condition> all{{"as planned", {}, {}}};
  const auto add = [&](std::string_view what, std::optional<double> Variation::*member,
                       std::initializer_list<double> values) {
    for (const double value : values) {
      all.push_back({what, value, {}});
      all.back().variation.*member = value;
    }
  };
  add("frame rate, fps", &Variation::fps, {18.75, 25.0, 50.0});
  add("marker noise, um", &Variation::marker_noise_um, {1.0, 2.0, 4.0, 6.0});
  add("marker loss", &Variation::marker_loss, {0.0, 0.02, 0.05, 0.10});
  add("shear modulus, MPa", &Variation::shear_modulus_mpa, {0.03, 0.045, 0.07, 0.115});
  return all;
}

std::vector<PlannedGrasp> thinned(const Plan& plan, int every) {
  std::vector<PlannedGrasp> some;
  for (const PlannedGrasp& grasp : plan.grasps) {
    // Along a diagonal: plain counting would meet the same kind each time, for there are five.
    const auto place = (grasp.object - scene::kPaperObjects.data()) + (grasp.primitive - scene::kPrimitives.data()) +
                       static_cast<std::ptrdiff_t>(grasp.kind) + static_cast<std::ptrdiff_t>(grasp.seed % 1000);
    if (place % every == 0) some.push_back(grasp);
  }
  return some;
}

double ConditionScore::within_ms(double ms) const {
  if (events.onsets == 0) return 0.0;
  // Half a microsecond: times are whole ones, their difference in ms is not.
  const auto end = std::upper_bound(events.ms.begin(), events.ms.end(), ms + 5e-4);
  return static_cast<double>(end - events.ms.begin()) / events.onsets;
}

void ConditionScore::add(const Samples& samples, int trial, std::span<const std::uint8_t> verdicts,
                         const decision::Config& config) {
  const std::span<const Row> rows = samples.of(samples.trials[idx(trial)]);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const Row& row = rows[k];
    if (judged(row)) frames.add(row.label == Label::kSlip, verdicts[k] != 0);
    if (!row.accepted && (row.label == Label::kHold || row.label == Label::kSlip)) ++refused;
  }
  events.add(event_of(samples, trial, verdicts, config));
}

void judge(const Samples& samples, const model::Tree& tree, const decision::Config& config, ConditionScore& score) {
  for (const int trial : all_trials(samples)) {
    std::vector<std::uint8_t> verdicts;
    for (const Row& row : samples.of(samples.trials[idx(trial)])) {
      std::array<std::int32_t, kFeatureCount> x{};
      for (int i = 0; i < tree.set->size(); ++i) x[idx(i)] = row.x[tree.set->members[idx(i)]];
      verdicts.push_back(model::evaluate(tree, x) != Verdict::kHold ? 1 : 0);
    }
    score.add(samples, trial, verdicts, config);
  }
}

// --- what is shown ---

Table entropy_table(std::span<const EntropyScore> scores) {
  Table table{.id = "entropy", .title = "Which entropy: the same fields through other histograms (simulated)"};
  table.columns = {{"bins", "bins", ""},
                   {"blind_hold_pct", "hold", "dE/dt 0, %"},
                   {"blind_slip_pct", "slip", "dE/dt 0, %"},
                   {"tremble_empty_nat_s", "empty", "RMS dE/dt at rest, nat/s", 3},
                   {"tremble_held_nat_s", "held", "RMS dE/dt at rest, nat/s", 3},
                   {"level_balanced_pct", "E alone", "balanced accuracy, %"},
                   {"five_fold_balanced_pct", "five-fold", "balanced accuracy, %"},
                   {"left_out_balanced_pct", "object left out", "balanced accuracy, %"},
                   {"left_out_worst_pct", "worst object", "balanced accuracy, %"}};
  for (const EntropyScore& s : scores) {
    table.rows.push_back({name_of(s.form), 100.0 * s.blind_hold, 100.0 * s.blind_slip, s.tremble_empty, s.tremble_held,
                          100.0 * s.level.balanced_accuracy, 100.0 * s.five_fold.balanced_accuracy(),
                          100.0 * s.left_out.balanced_accuracy(), 100.0 * std::ranges::min(s.objects)});
  }
  return table;
}

Table condition_table(std::span<const Condition> conditions, std::span<const ConditionScore> scores) {
  Table table{.id = "conditions", .title = "What the tree stands: one circumstance changed at a time (simulated)"};
  table.columns = {{"what", "changed", ""},
                   {"value", "to", "", 3},
                   {"accuracy_pct", "accuracy", "frames, %"},
                   {"balanced_pct", "balanced", "frames, %"},
                   {"recall_pct", "recall", "frames, %"},
                   {"refused", "refused", "frames", 0},
                   {"onsets", "onsets", "events", 0},
                   {"within_2_frames_pct", "in 2 fr. %", "events"},
                   {"within_5_frames_pct", "in 5 fr. %", "events"},
                   {"within_200_ms_pct", "200 ms %", "events"},
                   {"median_delay_ms", "median ms", "events", 0},
                   {"missed", "missed", "events", 0},
                   {"before", "before", "events", 0},
                   {"false_alarms", "alarms", "held contact", 0},
                   {"held_s", "seconds", "held contact", 0},
                   {"alarms_per_hour", "per hour", "held contact", 0},
                   {"alarms_per_hour_low", "from", "95 %", 0},
                   {"alarms_per_hour_high", "to", "95 %", 0}};
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const ConditionScore& s = scores[i];
    const EventGroup& e = s.events;
    const PoissonInterval hourly = e.alarms_per_hour_interval();
    table.rows.push_back({conditions[i].what, conditions[i].value, 100.0 * s.frames.accuracy(),
                          100.0 * s.frames.balanced_accuracy(), 100.0 * s.frames.recall(),
                          static_cast<double>(s.refused), e.onsets, 100.0 * e.within(2), 100.0 * e.within(5),
                          100.0 * s.within_ms(200.0), quantile(e.ms, 0.5), e.missed, e.before, e.false_alarms, e.held_s,
                          e.alarms_per_hour(), hourly.low, hourly.high});
  }
  return table;
}

std::string entropy_chart(std::span<const EntropyScore> scores) {
  struct Measure {
    const char* title;
    const char* unit;
    double low;
    double (*value)(const EntropyScore&);
  };
  static constexpr std::array<Measure, 3> kMeasures{{
      {"What a tree makes of E and dE/dt on an object left out", "balanced accuracy, %", 50.0,
       [](const EntropyScore& s) { return 100.0 * s.left_out.balanced_accuracy(); }},
      {"How often dE/dt is blind in held contact", "frames with dE/dt 0, %", 0.0,
       [](const EntropyScore& s) { return 100.0 * s.blind_hold; }},
      {"Noise of dE/dt while the gel is held still", "RMS, nat/s", 0.0,
       [](const EntropyScore& s) { return s.tremble_held; }},
  }};
  std::vector<std::string> pictures;
  for (const Measure& measure : kMeasures) {
    charts::Bars chart;
    chart.title = measure.title;
    chart.unit = measure.unit;
    chart.low = measure.low;
    double most = measure.low + 1e-3;
    for (const EntropyScore& s : scores) most = std::max(most, measure.value(s));
    chart.high = measure.low > 0.0 ? 100.0 : most * 1.05;
    for (const std::int32_t range_um : kRanges_um) chart.groups.push_back(fmt::format("{:g} mm", range_um / 1e3));
    chart.groups.emplace_back("half octaves");
    const auto add = [&](Bins bins, int count) {
      charts::Bars::Series series{.name = fmt::format("{} {} bins", count, bins == Bins::kHard ? "hard" : "soft"),
                                  .values = {}};
      for (const std::int32_t range_um : kRanges_um) {
        series.values.emplace_back(measure.value(of_form(scores, {bins, range_um, count})));
      }
      if (bins == Bins::kHard && count == kHistogramBins) {
        series.values.emplace_back(measure.value(of_form(scores, {Bins::kOctaves, 0, kHistogramBins})));
      }
      chart.series.push_back(std::move(series));
    };
    for (const int count : kCounts) add(Bins::kHard, count);
    add(Bins::kSoft, kHistogramBins);
    pictures.push_back(charts::draw(chart));
  }
  return charts::stacked(pictures);
}

std::string entropy_note(std::span<const EntropyScore> scores) {
  const auto left_out = [](const EntropyScore& s) { return s.left_out.balanced_accuracy(); };
  const EntropyScore& best = *std::ranges::max_element(scores, {}, left_out);
  const EntropyScore& paper = of_form(scores, kPaperForm);
  int better = 0;
  for (std::size_t i = 0; i < best.objects.size(); ++i) better += best.objects[i] > paper.objects[i] ? 1 : 0;
  std::string note = fmt::format(
      "Best by balanced accuracy of the tree on an object left out: {} ({:.1f} %).\n"
      "The paper's form, {}: {:.1f} %, {:.1f} points less",
      name_of(best.form), 100.0 * left_out(best), name_of(paper.form), 100.0 * left_out(paper),
      100.0 * (left_out(best) - left_out(paper)));
  if (best.form != paper.form)
    note += fmt::format("; the best one is ahead on {} of {} objects", better, best.objects.size());
  const auto least = [&](double EntropyScore::*member) -> const EntropyScore& {
    return *std::ranges::min_element(scores, {}, member);
  };
  const EntropyScore& calm = least(&EntropyScore::tremble_held);
  const EntropyScore& seeing = least(&EntropyScore::blind_hold);
  note += fmt::format(
      ". It is the best of {} on the rows that chose it: a lead of under a point is none."
      "\nLeast noise of dE/dt while held still: {} ({:.3f} nat/s); dE/dt least often 0 in held contact: {} ({:.1f} "
      "%).\n"
      "entropy_nat in every output stays the paper's, {}, whatever is best here.\n",
      scores.size(), name_of(calm.form), calm.tremble_held, name_of(seeing.form), 100.0 * seeing.blind_hold,
      name_of(paper.form));
  return note;
}

}  // namespace holdfast::learn
