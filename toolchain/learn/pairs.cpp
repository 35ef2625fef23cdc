// SPDX-License-Identifier: Apache-2.0
#include "toolchain/learn/pairs.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string_view>
#include <utility>

#include "base/math.hpp"

namespace holdfast::learn {
namespace {

// Of the speeds at frames i of one and i + lag of the other, where both are.
double correlation(std::span<const double> a, std::span<const double> b, int lag) {
  const int from = std::max(0, -lag);
  const int to = std::min(static_cast<int>(a.size()), static_cast<int>(b.size()) - lag);
  double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (int i = from; i < to; ++i) {
    const double x = a[idx(i)], y = b[idx(i + lag)];
    ++n, sa += x, sb += y, saa += x * x, sbb += y * y, sab += x * y;
  }
  const double spread = (n * saa - sa * sa) * (n * sbb - sb * sb);
  return spread > 0 ? (n * sab - sa * sb) / std::sqrt(spread) : 0.0;
}

// Speeds span four decades; a shake is no more like itself where it is fastest.
std::vector<double> logarithms(std::span<const double> speeds) {
  std::vector<double> values;
  double sum = 0.0;
  for (const double speed : speeds) sum += speed;
  const double scale = sum > 0.0 ? static_cast<double>(speeds.size()) / sum : 1.0;
  for (const double speed : speeds) values.push_back(std::log1p(speed * scale));
  return values;
}

// Of lags up to `most`, each of which costs.
Offset most_alike(std::span<const double> left, std::span<const double> right, int most, double cost) {
  const std::vector<double> a = logarithms(left);
  const std::vector<double> b = logarithms(right);
  Offset best;
  double most_like = -2.0;
  for (int lag = -most; lag <= most; ++lag) {
    const double like = correlation(a, b, lag);
    if (like - cost * std::abs(lag) <= most_like) continue;
    most_like = like - cost * std::abs(lag);
    best = {lag, like};
  }
  return best;
}

std::optional<Frames> moved(std::optional<Frames> frames, int by) {
  if (!frames) return frames;
  frames->from += by;
  if (frames->to != kUnknownEnd) frames->to += by;
  return frames;
}

std::optional<Frames> either(const std::optional<Frames>& a, const std::optional<Frames>& b) {
  if (!a || !b) return a ? a : b;
  return Frames{std::min(a->from, b->from), std::max(a->to, b->to)};
}

template <typename One, typename Join>
std::vector<One> both(const std::vector<One>& left, const std::vector<One>& right, const Join& join) {
  std::vector<One> out;
  for (const One& a : left) {
    for (const One& b : right) {
      One one = join(a, b);
      one.from = std::max(a.from, b.from);
      one.to = std::min(a.to, b.to);
      if (one.from <= one.to) out.push_back(one);
    }
  }
  return out;
}

}  // namespace

std::vector<std::array<std::size_t, 2>> pairs_of(std::span<const ClipLabels> clips) {
  std::map<std::string, std::vector<std::size_t>> trials;
  for (std::size_t c = 0; c < clips.size(); ++c) {
    if (const std::size_t at = clips[c].name.rfind("__"); at != std::string::npos) {
      trials[clips[c].name.substr(0, at)].push_back(c);
    }
  }
  std::vector<std::array<std::size_t, 2>> pairs;
  for (auto& [name, members] : trials) {
    if (members.size() != 2) continue;
    if (clips[members[1]].name < clips[members[0]].name) std::swap(members[0], members[1]);
    pairs.push_back({members[0], members[1]});
  }
  return pairs;
}

Offset find_offset(std::span<const double> left, std::span<const double> right) {
  constexpr int kShare = 25;
  constexpr int kLeast = 2;
  const int most = static_cast<int>(std::min(left.size(), right.size())) / kShare;
  return most_alike(left, right, std::max(kLeast, most), 0.01);
}

Offset find_far_offset(std::span<const double> left, std::span<const double> right) {
  constexpr double kClearly = 0.15;
  const Offset near = find_offset(left, right);
  constexpr int kFarShare = 4;
  const Offset far = most_alike(left, right, static_cast<int>(std::min(left.size(), right.size())) / kFarShare, 0.001);
  return far.correlation >= near.correlation + kClearly ? far : near;
}

ClipLabels merged(const ClipLabels& left, const ClipLabels& right, int offset) {
  ClipLabels out = left;
  out.name = left.name.substr(0, left.name.rfind("__"));
  out.contact = either(left.contact, moved(right.contact, -offset));
  const std::optional<Frames> slip = moved(right.slip, -offset);
  out.slip = either(left.slip, slip);
  const bool right_first = slip && (!left.slip || slip->from < left.slip->from);
  out.onset_recorded = right_first ? right.onset_recorded : left.onset_recorded;
  if (right_first) out.slip_kind = right.slip_kind;
  out.release = either(left.release, moved(right.release, -offset));
  // A second slip counts as an onset whatever the other finger's event is called; a loss leaves no load to step.
  const std::optional<Frames> event = moved(right.event, -offset);
  out.event = either(left.event, event);
  constexpr std::string_view kSecond = "second_slip_loss";
  for (const std::string_view kind : {kSecond, std::string_view("contact_lost")}) {
    const bool of_left = left.event_kind == kind;
    const bool of_right = right.event_kind == kind;
    if (!of_left && !of_right) continue;
    out.event_kind = kind;
    if (kind == kSecond && of_left != of_right) out.event = of_left ? left.event : event;
    break;
  }
  if (!left.event) out.event_kind = right.event_kind;
  std::vector<SilentFrames> silent = right.silent;
  for (SilentFrames& one : silent) one.from -= offset, one.to -= offset;
  out.silent = both(left.silent, silent, [](const SilentFrames& a, const SilentFrames& b) {
    return a.confidence > b.confidence ? a : b;  // the less sure
  });
  std::vector<Frames> empty = right.empty;
  for (Frames& one : empty) one.from -= offset, one.to -= offset;
  out.empty = both(left.empty, empty, [](const Frames& a, const Frames&) { return a; });
  out.confidence = std::max(left.confidence, right.confidence);
  return out;
}

void FusionScore::add(const ClipScore& score) {
  within_5 += score.onsets.within[0];
  within_10 += score.onsets.within[1];
  quiet += score.silent.count + score.empty.count;
  whole += score.whole().count;
}

FusionScore& FusionScore::operator+=(const FusionScore& other) {
  within_5 += other.within_5;
  within_10 += other.within_10;
  quiet += other.quiet;
  whole += other.whole;
  return *this;
}

std::size_t choose(std::span<const FusionScore> settings, const FusionScore& left, const FusionScore& right) {
  const int least_5 = std::max(left.within_5, right.within_5);
  const int least_10 = std::max(left.within_10, right.within_10);
  const auto missed = [&](const FusionScore& s) {
    return std::max(0, least_5 - s.within_5) + std::max(0, least_10 - s.within_10);
  };
  const auto first = [&](const FusionScore& s) { return std::pair(missed(s), s.quiet); };
  const auto all_first = first(*std::ranges::min_element(settings, {}, first));
  int fewest = std::numeric_limits<int>::max();
  for (const FusionScore& s : settings) {
    if (first(s) == all_first) fewest = std::min(fewest, s.whole);
  }
  const double limit = fewest + std::sqrt(static_cast<double>(fewest));
  std::size_t best = settings.size();
  for (std::size_t i = 0; i < settings.size(); ++i) {
    if (first(settings[i]) != all_first || settings[i].whole > limit) continue;
    if (best == settings.size() || settings[i].within_5 > settings[best].within_5) best = i;
  }
  return best;
}

}  // namespace holdfast::learn
