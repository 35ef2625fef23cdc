// SPDX-License-Identifier: Apache-2.0
#include "tests/support/host_jpeg_damage.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <span>
#include <thread>

#include "app/pipeline.hpp"
#include "drivers/common/jpeg_turbo.hpp"
#include "drivers/sim/scene/scenes.hpp"
#include "tests/support/scene_pictures.hpp"
#include "vision/jpeg_fast.hpp"
#include "vision/luma_input.hpp"

namespace holdfast::test {
namespace {

constexpr int kQuality = 85;

// sphere_slip pulled at 1 mm/s: what the tracker is to follow at 8 frames a second.
scene::Scene slow_drag() {
  scene::Scene scene = scene::sphere_slip();
  scene.fps = 8.0;
  scene::Waypoint& end = scene.trajectory[3];
  end.t_s = 3.08;
  end.x_mm = 1.5035;
  end.y_mm = 0.5472;
  scene.trajectory[4].t_s = 3.48;
  scene.duration_s = 3.0;
  return scene;
}

scene::PictureConfig picture_of(int width) {
  scene::PictureConfig picture = scene::camera_3280x2464();
  if (width == picture.width) return picture;
  picture = scene::scaled(picture, width);
  picture.height = width * 3 / 4;  // 640x480; the full size is a little taller than 4:3
  return picture;
}

Bytes pixels_of(const LumaBuffer& luma) {
  return {luma.pixels.begin(), luma.pixels.begin() + static_cast<std::ptrdiff_t>(luma.width) * luma.height};
}

bool same(const Bytes& pixels, const LumaBuffer& luma) {
  return pixels.size() == static_cast<std::size_t>(luma.width) * static_cast<std::size_t>(luma.height) &&
         std::equal(pixels.begin(), pixels.end(), luma.pixels.begin());
}

scene::PointPx centre(const Marker& marker) {
  return {marker.x.raw() / 256.0, marker.y.raw() / 256.0};
}

// The two decoders, each with a picture, and a tracker to try things on: the memory of one thread.
class Bench {
 public:
  explicit Bench(const DamagedFilm& film) : film_(film) {}

  bool decode_ours(const Bytes& bytes) {
    return jpeg_fast::decode(*state_, {}, {worker_.get(), 1}, crew_, bytes, *eighth_, {.min_width = 1, .min_height = 1})
        .ok();
  }
  bool decode_library(const Bytes& bytes) { return library_.decode(bytes, film_.scale, *working_).ok(); }
  [[nodiscard]] const LumaBuffer& eighth() const { return *eighth_; }
  bool is_plausible(picture_check::State& check) const {
    const std::int32_t block = 8 / static_cast<std::int32_t>(film_.scale);
    return picture_check::update(check, config_.luma.check, working().view(), block).ok();
  }
  // What the firmware tracks on.
  [[nodiscard]] const LumaBuffer& working() const { return film_.scale == DecodeScale::kEighth ? *eighth_ : *working_; }

  void judge(const Shot& shot, const Bytes& bytes, DamageFigures& sum) {
    ++sum.frames;
    const bool ours = decode_ours(bytes);
    const bool at_eighth = film_.scale == DecodeScale::kEighth;
    const bool ours_same = ours && same(shot.eighth, *eighth_);
    const bool misleads = at_eighth && ours && !ours_same && harms(shot);
    count(sum.ours, ours, ours_same, misleads);
    if (at_eighth) {
      picture_check::State check = shot.check_before;
      const bool plausible = ours && is_plausible(check);
      count(sum.checked, plausible, ours_same, misleads && plausible);
      sum.losses_passed += ours && !ours_same ? 1 : 0;
      return;
    }
    const bool library = decode_library(bytes);
    const bool library_same = library && same(shot.working, *working_);
    const bool harmful = library && !library_same && harms(shot);
    count(sum.library, library, library_same, harmful);
    count(sum.both, library && ours, library_same, harmful && ours);
    picture_check::State check = shot.check_before;
    const bool plausible = library && is_plausible(check);
    count(sum.checked, plausible, library_same, harmful && plausible);
    sum.losses_passed += ours && !(ours_same && (library_same || !library)) ? 1 : 0;
  }

 private:
  static void count(Tally& tally, bool accepted, bool identical, bool harmful) {
    ++(!accepted ? tally.rejected : identical ? tally.identical : tally.different);
    tally.harmful += harmful ? 1 : 0;
  }

  // As pipeline::update goes on after decoding.
  bool harms(const Shot& shot) {
    *tracker_ = *shot.before;
    if (!tracker::update(*tracker_, config_.tracker, working().view()).ok()) return false;
    const MarkerField& field = tracker_->field;
    if (field.valid_count() * 100 < field.grid.count() * config_.fault_markers_pct) return false;
    for (std::size_t i = 0; i < static_cast<std::size_t>(field.grid.count()); ++i) {
      const scene::PointPx now = centre(field.markers[i]);
      if (field.markers[i].valid && std::hypot(now.x - shot.centres[i].x, now.y - shot.centres[i].y) > kHarmPx) {
        return true;
      }
    }
    return false;
  }

  const DamagedFilm& film_;
  const pipeline::Config config_;
  std::unique_ptr<jpeg_fast::State> state_ = std::make_unique<jpeg_fast::State>();
  std::unique_ptr<jpeg_fast::Worker> worker_ = std::make_unique<jpeg_fast::Worker>();
  hal::Alone crew_;
  std::unique_ptr<LumaBuffer> eighth_ = std::make_unique<LumaBuffer>();
  std::unique_ptr<LumaBuffer> working_ = std::make_unique<LumaBuffer>();
  std::unique_ptr<tracker::State> tracker_ = std::make_unique<tracker::State>();
  drivers::TurboJpegDecoder library_;
};

void write(const std::filesystem::path& path, const Bytes& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

Tally& operator+=(Tally& sum, const Tally& more) {
  sum.rejected += more.rejected;
  sum.identical += more.identical;
  sum.different += more.different;
  sum.harmful += more.harmful;
  return sum;
}

}  // namespace

std::string_view name(Damage damage) {
  constexpr std::array<std::string_view, kDamages.size()> kNames{
      "512 bytes lost",  "512 bytes zeroed", "3072 bytes lost", "truncated",
      "truncated + EOI", "1 bit flipped",    "1 byte changed"};
  return kNames[static_cast<std::size_t>(damage)];
}

Bytes damaged(const Bytes& whole, Damage damage, Random& random) {
  const std::size_t begin = data_begin(whole), end = whole.size() - 2;  // EOI
  const auto place = [&](std::size_t size) { return begin + random() % (end - begin - size + 1); };
  switch (damage) {
    case Damage::kLost512:
      return erased(whole, place(512), 512);
    case Damage::kZeroed512:
      return zeroed(whole, place(512), 512);
    case Damage::kLost3072:
      return erased(whole, place(3072), 3072);
    case Damage::kTruncated:
    case Damage::kTruncatedWithEnd: {
      Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(place(1)));
      if (damage == Damage::kTruncatedWithEnd) cut.insert(cut.end(), {0xFF, 0xD9});
      return cut;
    }
    case Damage::kBitFlipped: {
      const std::size_t at = place(1);
      return changed(whole, at, whole[at] ^ (1 << random() % 8));
    }
    case Damage::kByteChanged: {
      const std::size_t at = place(1);
      return changed(whole, at, (whole[at] + in_range(random, 1, 255)) & 255);
    }
  }
  return whole;
}

DamagedFilm film(int width, int restart_interval, int shots) {
  DamagedFilm out{width, restart_interval, luma_input::scale_for(DecodeScale::kEighth, width), {}, {}};
  const scene::PictureConfig picture = picture_of(width);
  const std::vector<SceneView> views = views_of(slow_drag(), picture);
  Bench bench(out);
  tracker::Config config;
  auto state = std::make_unique<tracker::State>();
  picture_check::State check;
  Bytes rgb;
  for (int i = -1; i < shots; ++i) {  // the first is the rest position, and no shot
    const SceneView& view = views[static_cast<std::size_t>(std::max(i, 0))];
    scene::render_rgb(picture, view.dots, &view.imprint, static_cast<std::uint64_t>(i + 2), rgb);
    Shot shot;
    shot.bytes = encode_rgb(rgb, picture.width, picture.height, kQuality, restart_interval);
    shot.before = std::make_shared<const tracker::State>(*state);
    shot.check_before = check;
    const bool decoded =
        bench.decode_ours(shot.bytes) && (out.scale == DecodeScale::kEighth || bench.decode_library(shot.bytes));
    const bool tracked = decoded && tracker::update(*state, config, bench.working().view()).ok();
    if (!tracked || state->field.valid_count() != state->field.grid.count()) {
      out.error = "frame " + std::to_string(i) + (decoded ? ": markers missing" : ": not decoded");
      return out;
    }
    if (!bench.is_plausible(check)) {
      out.error = "frame " + std::to_string(i) + ": whole, and refused by the picture check";
      return out;
    }
    if (i < 0) {
      tracker::set_home(*state, state->field);
      continue;
    }
    shot.eighth = pixels_of(bench.eighth());
    shot.working = pixels_of(bench.working());
    std::transform(state->field.markers.begin(), state->field.markers.end(), shot.centres.begin(), centre);
    out.shots.push_back(std::move(shot));
  }
  return out;
}

DamageFigures judge(const DamagedFilm& film, Damage damage, long first, long count, std::uint32_t seed, int threads,
                    const std::filesystem::path& keep) {
  std::vector<DamageFigures> sums(static_cast<std::size_t>(threads));
  std::vector<std::thread> workers;
  workers.reserve(sums.size());
  const auto work = [&](int worker) {
    Bench bench(film);
    DamageFigures& sum = sums[static_cast<std::size_t>(worker)];
    for (long number = first + worker; number < first + count; number += threads) {
      std::seed_seq seeds{seed, static_cast<std::uint32_t>(damage), static_cast<std::uint32_t>(number)};
      Random random(seeds);
      const Shot& shot = film.shots[static_cast<std::size_t>(number) % film.shots.size()];
      const Bytes bytes = damaged(shot.bytes, damage, random);
      const long passed = sum.losses_passed;
      bench.judge(shot, bytes, sum);
      if (!is_loss(damage)) sum.losses_passed = passed;
      if (sum.losses_passed != passed && !keep.empty()) {
        write(keep / (std::to_string(film.width) + "_restart" + std::to_string(film.restart_interval) + "_damage" +
                      std::to_string(static_cast<int>(damage)) + "_" + std::to_string(number) + ".jpg"),
              bytes);
      }
    }
  };
  for (int worker = 0; worker < threads; ++worker) workers.emplace_back(work, worker);
  for (std::thread& worker : workers) worker.join();
  DamageFigures total;
  for (const DamageFigures& sum : sums) total += sum;
  return total;
}

DamageFigures& operator+=(DamageFigures& sum, const DamageFigures& more) {
  sum.frames += more.frames;
  sum.ours += more.ours;
  sum.checked += more.checked;
  sum.library += more.library;
  sum.both += more.both;
  sum.losses_passed += more.losses_passed;
  return sum;
}

}  // namespace holdfast::test
