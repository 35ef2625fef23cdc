// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/metrics.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

#include "base/math.hpp"

namespace holdfast::learn {
namespace {

double share(long part, long whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

// Probability that Student's t with `freedom` degrees lies within +-t: Abramowitz and Stegun, 26.7.3 and 26.7.4.
double student_within(double t, int freedom) {
  const double angle = std::atan(t / std::sqrt(static_cast<double>(freedom)));
  const double cosine = std::cos(angle);
  const bool odd = freedom % 2 == 1;
  double term = odd ? cosine : 1.0;
  double sum = freedom == 1 ? 0.0 : term;
  for (int k = odd ? 3 : 2; k <= freedom - 2; k += 2) {
    term *= cosine * cosine * (k - 1) / k;
    sum += term;
  }
  const double area = std::sin(angle) * sum;
  return odd ? (angle + area) * 2.0 / std::numbers::pi : area;
}

// The t that 95 % lie within. Beyond 1000 degrees the quantile is taken at 1000: less than 0.2 % too wide.
double student_95(int freedom) {
  double low = 1.9;
  double high = 12.8;  // 1.96 for many degrees, 12.706 for one
  for (int i = 0; i < 60; ++i) {
    const double t = (low + high) / 2.0;
    (student_within(t, std::min(freedom, 1000)) < 0.95 ? low : high) = t;
  }
  return high;
}

Micros micros_of(double t_s) {
  return Micros(std::llround(t_s * 1e6));
}

// What row i stands for: the time to the next row; the last one's as long as the one before it.
double duration_s(std::span<const Row> rows, std::size_t i) {
  if (rows.size() < 2) return 0.0;
  const std::size_t from = std::min(i, rows.size() - 2);
  return rows[from + 1].t_s - rows[from].t_s;
}

}  // namespace

void Confusion::add(bool is_slip, bool said_slip) {
  ++(is_slip ? (said_slip ? true_slip : false_hold) : (said_slip ? false_slip : true_hold));
}

Confusion& Confusion::operator+=(const Confusion& other) {
  true_slip += other.true_slip;
  false_slip += other.false_slip;
  true_hold += other.true_hold;
  false_hold += other.false_hold;
  return *this;
}

double Confusion::accuracy() const {
  return share(true_slip + true_hold, count());
}

double Confusion::balanced_accuracy() const {
  return (recall() + share(true_hold, true_hold + false_slip)) / 2.0;
}

double Confusion::precision() const {
  return share(true_slip, true_slip + false_slip);
}

double Confusion::recall() const {
  return share(true_slip, true_slip + false_hold);
}

double Confusion::f1() const {
  return share(2 * true_slip, 2 * true_slip + false_slip + false_hold);
}

Interval interval_of(std::span<const double> values) {
  Interval interval;
  interval.count = static_cast<int>(values.size());
  if (values.empty()) return interval;
  const auto n = static_cast<double>(values.size());
  for (const double value : values) interval.mean += value / n;
  if (values.size() < 2) return interval;
  double squares = 0.0;
  for (const double value : values) squares += (value - interval.mean) * (value - interval.mean);
  interval.half = student_95(interval.count - 1) * std::sqrt(squares / (n - 1.0) / n);
  return interval;
}

std::optional<double> quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::nullopt;
  const double rank = std::ceil(share * static_cast<double>(values.size())) - 1.0;
  const auto at = static_cast<std::ptrdiff_t>(std::clamp(rank, 0.0, static_cast<double>(values.size() - 1)));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
}

namespace {

bool labelled(const Row& row) {
  return row.label == Label::kHold || row.label == Label::kSlip;
}

}  // namespace

GraspEvent event_of(const Samples& samples, int trial, std::span<const std::uint8_t> verdicts,
                    const decision::Config& config) {
  const std::span<const Row> rows = samples.of(samples.trials[idx(trial)]);
  assert(verdicts.size() == rows.size());
  const auto first_slip =
      std::find_if(rows.begin(), rows.end(), [](const Row& row) { return row.label == Label::kSlip; });
  const auto onset = static_cast<std::size_t>(first_slip - rows.begin());

  GraspEvent event;
  event.trial = trial;
  event.slips = onset < rows.size();
  if (event.slips) event.onset_s = first_slip->t_s;
  decision::State state;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    const bool was_raised = state.raised;
    if (i == onset) event.raised_before = was_raised;
    if (row.accepted) {
      const Verdict verdict = verdicts[i] != 0 ? Verdict::kSlip : Verdict::kHold;
      (void)decision::update(state, config, verdict, micros_of(row.t_s));
    }
    if (state.raised && i >= onset && !event.raised_s) {
      event.raised_s = row.t_s;
      event.raised_frames = static_cast<int>(i - onset);
    }
    if (state.raised && !was_raised && row.label == Label::kHold) ++event.false_alarms;
    if (state.raised && !was_raised && !labelled(row)) ++event.open_alarms;
    if (row.label == Label::kHold) event.held_s += duration_s(rows, i);
  }
  return event;
}

std::vector<std::uint8_t> requests_of(const Samples& samples, const Trial& trial,
                                      std::span<const std::uint8_t> verdicts, const decision::Config& config) {
  std::vector<std::uint8_t> raised;
  decision::State state;
  const std::span<const Row> rows = samples.of(trial);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].accepted) {
      const auto now = Micros(std::llround(rows[i].t_s * 1e6));
      (void)decision::update(state, config, verdicts[i] != 0 ? Verdict::kSlip : Verdict::kHold, now);
    }
    raised.push_back(state.raised ? 1 : 0);
  }
  return raised;
}

}  // namespace holdfast::learn
