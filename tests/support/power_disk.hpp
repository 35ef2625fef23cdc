// SPDX-License-Identifier: Apache-2.0
// A disk with one file that can lose its power: what was written lies in the page cache until fsync or fdatasync, and
// what is on the medium after a cut is any choice of what was under way, sector by sector.
//
// Modelled: each sector of 512 bytes that was written since the last sync holds after a cut its old bytes, those of
// any write since, or garbage; the last write of all may also break off at any byte. The file's size is any that it had
// since. Its name is on the medium once its folder was synced; before that it may be or not. fdatasync takes the size
// along, as POSIX says (it is needed to read the data).
// Not modelled: damage to sectors that nobody wrote.
#pragma once

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "drivers/common/file_calls.hpp"

namespace holdfast::test {

class PowerDisk final : public drivers::FileCalls {
 public:
  static constexpr std::size_t kSector = 512;
  // Up to so many images of one moment are made by every combination; of more, a choice (for_each_image).
  static constexpr std::size_t kMostCombinations = 5000;
  using Bytes = std::vector<std::uint8_t>;
  struct Image {
    bool there = false;
    Bytes bytes;
  };

  PowerDisk() = default;
  // After the power came back.
  explicit PowerDisk(const Image& image)
      : there_(image.there), named_(image.there), cache_(image.bytes), medium_(image.bytes) {}
  // The same disk under another process: the page cache outlives the one before.
  PowerDisk(const PowerDisk& other)
      : FileCalls(other),
        there_(other.there_),
        named_(other.named_),
        cache_(other.cache_),
        medium_(other.medium_),
        sizes_(other.sizes_),
        pending_(other.pending_),
        last_(other.last_) {}
  PowerDisk& operator=(const PowerDisk&) = delete;
  ~PowerDisk() override = default;

  // Behind every call.
  std::function<void()> boundary;
  // The call with this number (from 1) fails with `error`; a write has written `partly` bytes of its own before.
  int fails_at = 0, error = EIO;
  std::size_t partly = 0;
  // Writes take so many bytes at once; 0: all.
  std::size_t most_at_once = 0;
  int calls = 0;

  // What a power cut now may leave.
  void for_each_image(const std::function<void(const Image&)>& visit) const {
    if (!there_ || !named_) visit({});
    if (!there_) return;
    std::vector<std::size_t> sizes{medium_.size()};
    for (const std::size_t size : sizes_) {
      if (std::find(sizes.begin(), sizes.end(), size) == sizes.end()) sizes.push_back(size);
    }
    std::vector<Choice> choices;
    for (const auto& [sector, versions] : pending_) {
      Choice choice{sector, {on_medium(sector)}};
      for (const Bytes& version : versions) {
        if (std::find(choice.candidates.begin(), choice.candidates.end(), version) == choice.candidates.end()) {
          choice.candidates.push_back(version);
        }
      }
      choice.newest = choice.candidates.size() - 1;
      Bytes garbage(kSector);
      for (std::size_t k = 0; k < kSector; ++k) garbage[k] = static_cast<std::uint8_t>(0xA5 ^ (k * 7 + sector));
      choice.candidates.push_back(std::move(garbage));
      choices.push_back(std::move(choice));
    }
    for (const std::size_t size : sizes) each_combination(choices, size, visit);
    torn_by_bytes(visit);
  }

  [[nodiscard]] int open(const char* path, How how) override {
    if (const int wrong = begin(); wrong != 0) return end(-wrong);
    if (how == How::kFolder) return end(kFolder);
    if (how == How::kRead && !there_) return end(-ENOENT);
    path_ = path;
    if (!there_) {
      there_ = true;
      sizes_.push_back(0);
    }
    return end(kFile);
  }
  void close(int /*fd*/) override {
    (void)begin();
    (void)end(0);
  }
  [[nodiscard]] std::int64_t size(int /*fd*/) override {
    if (const int wrong = begin(); wrong != 0) return end(-wrong);
    return end(static_cast<std::int64_t>(cache_.size()));
  }
  [[nodiscard]] std::int64_t pread(int /*fd*/, std::span<std::uint8_t> bytes, std::int64_t at) override {
    if (const int wrong = begin(); wrong != 0) return end(-wrong);
    const auto from = static_cast<std::size_t>(at);
    if (from >= cache_.size()) return end(std::int64_t{0});
    const std::size_t count = std::min(bytes.size(), cache_.size() - from);
    std::copy_n(cache_.begin() + at, count, bytes.begin());
    return end(static_cast<std::int64_t>(count));
  }
  [[nodiscard]] std::int64_t pwrite(int /*fd*/, std::span<const std::uint8_t> bytes, std::int64_t at) override {
    const int wrong = begin();
    std::size_t count = bytes.size();
    if (most_at_once != 0) count = std::min(count, most_at_once);
    if (wrong != 0) count = std::min(count, partly);
    if (count > 0) put(bytes.first(count), static_cast<std::size_t>(at));
    return end(wrong != 0 ? -wrong : static_cast<std::int64_t>(count));
  }
  [[nodiscard]] int allocate(int /*fd*/, std::int64_t size) override {
    if (const int wrong = begin(); wrong != 0) return end(-wrong);
    if (const std::size_t had = cache_.size(); had < static_cast<std::size_t>(size)) {
      put(Bytes(static_cast<std::size_t>(size) - had), had);
    }
    return end(0);
  }
  [[nodiscard]] int fsync(int fd) override {
    if (const int wrong = begin(); wrong != 0) return end(-wrong);
    if (fd == kFolder) {
      named_ = there_;
    } else {
      settle();
    }
    return end(0);
  }
  [[nodiscard]] int fdatasync(int /*fd*/) override {
    if (const int wrong = begin(); wrong != 0) return end(-wrong);
    settle();
    return end(0);
  }

 private:
  static constexpr int kFile = 3, kFolder = 4;
  struct Choice {
    std::size_t sector = 0;
    std::vector<Bytes> candidates;  // old, each that was written, garbage
    std::size_t newest = 0;
  };
  struct Last {
    std::size_t at = 0;
    Bytes before, bytes;
  };

  int begin() { return ++calls == fails_at ? error : 0; }
  template <typename Result>
  Result end(Result result) {
    if (boundary) boundary();
    return result;
  }

  static Bytes sector_of(const Bytes& bytes, std::size_t sector) {
    Bytes out(kSector);
    const std::size_t from = sector * kSector;
    if (from < bytes.size()) {
      std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(from), std::min(kSector, bytes.size() - from),
                  out.begin());
    }
    return out;
  }
  [[nodiscard]] Bytes on_medium(std::size_t sector) const { return sector_of(medium_, sector); }

  void put(std::span<const std::uint8_t> bytes, std::size_t at) {
    if (at + bytes.size() > cache_.size()) {
      cache_.resize(at + bytes.size());
      sizes_.push_back(cache_.size());
    }
    last_ = {at,
             Bytes(cache_.begin() + static_cast<std::ptrdiff_t>(at),
                   cache_.begin() + static_cast<std::ptrdiff_t>(at + bytes.size())),
             Bytes(bytes.begin(), bytes.end())};
    std::copy(bytes.begin(), bytes.end(), cache_.begin() + static_cast<std::ptrdiff_t>(at));
    for (std::size_t sector = at / kSector; sector * kSector < at + bytes.size(); ++sector) {
      pending_[sector].push_back(sector_of(cache_, sector));
    }
  }
  void settle() {
    medium_ = cache_;
    sizes_.clear();
    pending_.clear();
    last_ = {};
  }

  static Bytes with(const Bytes& medium, std::size_t size, const std::vector<Choice>& choices,
                    const std::vector<std::size_t>& chosen) {
    Bytes bytes = medium;
    bytes.resize(size);
    for (std::size_t k = 0; k < choices.size(); ++k) {
      const std::size_t from = choices[k].sector * kSector;
      if (from >= size) continue;
      const Bytes& sector = choices[k].candidates[chosen[k]];
      std::copy_n(sector.begin(), std::min(kSector, size - from), bytes.begin() + static_cast<std::ptrdiff_t>(from));
    }
    return bytes;
  }

  // Every combination, where they are few. Of many: every subset of old and new when those are few enough; every
  // prefix and suffix; and each of these with one sector of garbage.
  void each_combination(const std::vector<Choice>& choices, std::size_t size,
                        const std::function<void(const Image&)>& visit) const {
    const auto show = [&](const std::vector<std::size_t>& chosen) {
      visit({true, with(medium_, size, choices, chosen)});
    };
    std::vector<std::size_t> chosen(choices.size());
    const auto count_of = [&](auto per_choice) {
      std::size_t count = 1;
      for (const Choice& choice : choices) count = std::min(count * per_choice(choice), kMostCombinations + 1);
      return count;
    };
    const auto all = [&](auto per_choice) {
      while (true) {
        show(chosen);
        std::size_t k = 0;
        while (k < choices.size() && ++chosen[k] == per_choice(choices[k])) chosen[k++] = 0;
        if (k == choices.size()) return;
      }
    };
    const auto every = [](const Choice& choice) { return choice.candidates.size(); };
    if (count_of(every) <= kMostCombinations) return all(every);
    const auto written = [](const Choice& choice) { return choice.newest + 1; };
    if (count_of(written) <= kMostCombinations) all(written);
    for (std::size_t cut = 0; cut <= choices.size(); ++cut) {
      for (const bool suffix : {false, true}) {
        for (std::size_t k = 0; k < choices.size(); ++k) chosen[k] = (k < cut) != suffix ? choices[k].newest : 0;
        show(chosen);
        for (std::size_t k = 0; k < choices.size(); ++k) {
          const std::size_t before = std::exchange(chosen[k], choices[k].candidates.size() - 1);
          show(chosen);
          chosen[k] = before;
        }
      }
    }
  }

  // The last write, cut at each byte, over all that was written before it.
  void torn_by_bytes(const std::function<void(const Image&)>& visit) const {
    for (std::size_t cut = 1; cut < last_.bytes.size(); ++cut) {
      Image image{true, cache_};
      std::copy(last_.before.begin() + static_cast<std::ptrdiff_t>(cut), last_.before.end(),
                image.bytes.begin() + static_cast<std::ptrdiff_t>(last_.at + cut));
      visit(image);
    }
  }

  bool there_ = false, named_ = false;
  std::string path_;
  Bytes cache_, medium_;
  std::vector<std::size_t> sizes_;                     // since the last sync
  std::map<std::size_t, std::vector<Bytes>> pending_;  // by sector: what was written there since
  Last last_;
};

}  // namespace holdfast::test
