// SPDX-License-Identifier: Apache-2.0
// holdfast calibrate: what a gel does when nothing touches it, and whether a model's thresholds stand clear of that;
// or, with a known weight on it, the scale of its forces.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <variant>

#include "drivers/common/input_file.hpp"
#include "drivers/common/trouble.hpp"
#include "drivers/sim/recording.hpp"
#include "toolchain/holdfast/commands.hpp"
#include "toolchain/learn/calibrate.hpp"
#include "toolchain/learn/dataset.hpp"
#include "toolchain/learn/firmware_row.hpp"
#include "toolchain/learn/weigh.hpp"
#include "toolchain/log/recording_file.hpp"
#include "toolchain/play/play.hpp"
#include "toolchain/play/reference_picture.hpp"
#include "toolchain/play/rig.hpp"
#include "toolchain/sealed/record_file.hpp"
#include "toolchain/sealed/settings_toml.hpp"
#include "toolchain/support/atomic_file.hpp"
#include "toolchain/support/json_text.hpp"
#include "toolchain/support/progress.hpp"

namespace holdfast::tool {
namespace {

// 1 s at 25 fps: a spread of so many is known to 14 %. Ten seconds show how slow drifts go, too.
constexpr std::size_t kLeastFrames = 25;
constexpr double kLeastFps = 12, kMostFps = 32;  // health::Config's periods

struct CalibrateOptions {
  CommonOptions common;
  std::string input;
  std::string reference;
  long from = 0;
  long to = std::numeric_limits<long>::max();
  double fps = 0;
  double weight_g = 0;  // 0: no weight, the gel at rest
  std::string as = "shear";
  double share_pct = 0;  // 0: half of it as shear, all of it as normal load
  std::string output;
};

bool is_scene(const std::string& input) {
  return input.ends_with(".json");
}

// One frame of the firmware.
using Look = std::function<void(long frame, const pipeline::Result&, const pipeline::State&, const pipeline::Config&)>;

// --from and --to are of this input, whose last frame is `last`. Empty, or an error line.
std::string check_end(const CalibrateOptions& options, long last) {
  const long asked = options.to < std::numeric_limits<long>::max() ? options.to : options.from;
  if (asked <= last) return {};
  return trouble(fmt::format("{}: frame {} was asked for, and {} is the last", options.input, asked, last),
                 "a typing error, or the frames of another recording", "give --from and --to within it");
}

// The frames asked for, of which the first still ones teach the rest position unless there is a picture of it.
// Empty, or an error line.
std::string watch_recording(const CalibrateOptions& options, const Params& params, bool auto_grid, const Look& look) {
  auto opened = log::open_recording(options.input, {options.fps});
  if (const auto* error = std::get_if<sim::Error>(&opened)) return error->line;
  auto& recording = std::get<sim::Recording>(opened);
  if (const double fps = recording.info().time_base_fps; fps < kLeastFps || fps > kMostFps) {
    return trouble(fmt::format("{}: {:.3g} frames a second; a device decides at {:g} to {:g}, and the noise of others "
                               "is another",
                               options.input, fps, kLeastFps, kMostFps),
                   "another camera's rate, or frames that were dropped while it was recorded",
                   "record the gel as the device sees it, or give --fps where the recording carries no time");
  }
  const pipeline::Config config = pipeline_config(params, auto_grid);
  OneThreadDecoder jpeg(params);
  const auto state = std::make_unique<pipeline::State>();
  if (!options.reference.empty()) {
    const auto picture = reference_picture(recording, options.reference, config.luma);
    if (const auto* error = std::get_if<sim::Error>(&picture)) return error->line;
    const hal::Frame rest = sim::as_frame(std::get<sim::RecordedFrame>(picture));
    if (const Status s = pipeline::learn(*state, config, jpeg.get(), rest); !s.ok()) {
      const ReasonInfo& why = holdfast::info(s.reason);
      return fmt::format("{} as picture of the empty gel: {}. Likely cause: {}. Next: {}", options.reference, why.what,
                         why.cause, why.next);
    }
  }
  sim::RecordedFrame recorded;
  Progress progress("calibrate", recording.info().frames);
  sim::Read read = sim::Read::kFrame;
  Reason reason = Reason::kNone;
  bool any = false;
  long last = -1;
  while (!interrupted() && (read = recording.next(recorded)) == sim::Read::kFrame && recorded.index <= options.to) {
    progress.update(recorded.index + 1);
    last = recorded.index;
    if (recorded.index < options.from) continue;
    const pipeline::Result result = pipeline::update(*state, config, jpeg.get(), sim::as_frame(recorded));
    if (!result.quality.ok()) reason = result.quality.reason;
    any = any || (result.quality.ok() && result.referenced);
    look(recorded.index, result, *state, config);
  }
  if (interrupted()) return interrupted_line();
  if (read == sim::Read::kError) return recording.error();
  if (read == sim::Read::kEnd) {
    if (std::string error = check_end(options, last); !error.empty()) return error;
  }
  if (!any && reason != Reason::kNone) {
    const ReasonInfo& why = holdfast::info(reason);
    return fmt::format("{}: no frame could be used: {}. Likely cause: {}. Next: {}", options.input, why.what, why.cause,
                       why.next);
  }
  return {};
}

std::string watch_scene(const CalibrateOptions& options, Params params, scene::Scene scene, const Look& look) {
  // Features of a true rest position are not what the device has.
  if (scene.level.inject == scene::Inject::kFeatures) scene.level.inject = scene::Inject::kMarkers;
  params.grid_rows = scene.markers.rows;
  params.grid_cols = scene.markers.cols;
  Rig rig(params);
  Player player(scene, rig.clock());
  App& app = rig.connect(player.camera());
  if (const Status s = app.start(params); !s.ok()) {
    const ReasonInfo& why = holdfast::info(s.reason);
    return fmt::format("{}: {}. Likely cause: {}. Next: {}", options.input, why.what, why.cause, why.next);
  }
  Progress progress("calibrate", scene::frame_count(scene));
  while (!interrupted() && player.step(app, params, false)) {
    const scene::Snapshot& truth = player.snapshot();
    progress.update(truth.frame + 1);
    if (truth.frame > options.to) break;
    if (truth.frame < options.from) continue;
    if (options.weight_g == 0 && truth.contact.normal_n >= learn::kTouch_n) {
      return fmt::format(
          "{}: not empty: an object presses with {:.2f} N in frame {}. Likely cause: a scene of a grasp. Next: give "
          "tests/scenes/empty_gel.json, or the empty frames with --from and --to",
          options.input, truth.contact.normal_n, truth.frame);
    }
    look(truth.frame, app.result(), app.state(), pipeline_config(params));
  }
  if (interrupted()) return interrupted_line();
  return check_end(options, scene::frame_count(scene) - 1);
}

// Whether what was seen is a gel at rest. Empty, or an error line.
std::string check_study(const CalibrateOptions& options, const learn::RestStudy& study) {
  const auto used = study.rest().size();
  if (!study.moved().empty()) {
    const bool whole = study.moved().size() * 2 > used;
    return fmt::format(
        "{}: the gel is not at rest: its markers are off their places in {} of {} frames, from {} to {}. Likely cause: "
        "{}. Next: {}",
        options.input, study.moved().size(), used, study.moved().front(), study.moved().back(),
        whole ? "something touches the gel all the time, or the reference is no picture of it empty"
              : "it was touched, or the sensor was moved",
        whole ? "record the empty gel, or name an empty frame with --reference"
              : "record ten seconds without a touch, or name the still frames with --from and --to");
  }
  if (used >= kLeastFrames) return {};
  return fmt::format(
      "{}: {} of {} frames can be used, {} are needed. Likely cause: {}. Next: record the empty gel for ten seconds",
      options.input, used, study.frames(), kLeastFrames,
      study.frames() < 2 * static_cast<long>(kLeastFrames)
          ? "the recording, or what --from and --to leave of it, is too short"
          : "the rest position was not found for long, or frames were rejected");
}

double in_units(double raw, const FeatureInfo& feature) {
  return raw / std::exp2(feature.q);
}

void print_tables(const learn::RestStudy& study, const learn::ModelCheck& check, const std::string& model_text,
                  bool clear) {
  fmt::print("verdict   the model's thresholds {}\n",
             clear ? "stand clear of this gel's noise" : "do not stand clear of this gel's noise: see the end");
  const learn::RestStudy::Jitter jitter = study.jitter();
  fmt::print("rest      {} of {} frames; marker jitter (RMS) {:.2f} um in x and {:.2f} um in y, the worst {:.2f} um\n",
             study.rest().size(), study.frames(), jitter.x_um, jitter.y_um, jitter.worst_um);
  fmt::print("\n{:26} {:>10} {:>10} {:>10} {:>10} {:>10}  unit\n", "feature at rest", "mean", "deviation", "robust",
             "least", "most");
  for (int i = 0; i < kFeatureCount; ++i) {
    const FeatureInfo& feature = kFeatures[static_cast<std::size_t>(i)];
    const learn::RestFigures f = learn::figures_of(study.rest(), i);
    fmt::print("{:26} {:10.4g} {:10.4g} {:10.4g} {:10.4g} {:10.4g}  {}\n", feature.name, in_units(f.mean, feature),
               in_units(f.deviation, feature), in_units(f.robust, feature), in_units(f.least, feature),
               in_units(f.most, feature), feature.unit);
  }
  fmt::print("\n{}\n{:>4} {:38} {:>9} {:>9} {:>24} {:>8}\n", model_text, "node", "threshold", "below", "above",
             "margin of the nearest", "sigmas");
  for (const learn::ThresholdCheck& t : check.thresholds) {
    const FeatureInfo& feature = kFeatures[static_cast<std::size_t>(t.feature)];
    const bool one_way = (t.below == 0) != (t.above == 0);
    fmt::print("{:4} {:38} {:9} {:9} {:>24} {:>8}  {}\n", t.node, fmt::format("{} <= {}", feature.name, t.threshold),
               t.below, t.above,
               one_way ? fmt::format("{} = {:.4g} {}", t.margin, in_units(static_cast<double>(t.margin), feature),
                                     feature.unit)
                       : "",
               t.sigmas                ? fmt::format("{:.1f}", *t.sigmas)
               : t.below + t.above > 0 ? "no noise"
                                       : "",
               name_of(t.clearance));
  }
  for (const learn::LeafCheck& leaf : check.leaves) {
    if (leaf.frames == 0) continue;
    fmt::print("{:4} {:38} {:9} frames end here\n", leaf.node, leaf.verdict != Verdict::kHold ? "slip" : "hold",
               leaf.frames);
  }
}

void print_json(const learn::RestStudy& study, const learn::ModelCheck& check, const std::string& model_text) {
  const learn::RestStudy::Jitter jitter = study.jitter();
  nlohmann::json out;
  out["frames"] = study.frames();
  out["rest_frames"] = study.rest().size();
  out["jitter_um"] = {{"x", jitter.x_um}, {"y", jitter.y_um}, {"worst", jitter.worst_um}};
  for (int i = 0; i < kFeatureCount; ++i) {
    const learn::RestFigures f = learn::figures_of(study.rest(), i);
    out["features"][std::string(kFeatures[static_cast<std::size_t>(i)].name)] = {
        {"mean", f.mean},     {"deviation", f.deviation}, {"median", f.median},
        {"robust", f.robust}, {"least", f.least},         {"most", f.most}};
  }
  out["model"] = model_text;
  out["thresholds"] = nlohmann::json::array();
  for (const learn::ThresholdCheck& t : check.thresholds) {
    nlohmann::json row = {{"node", t.node},
                          {"feature", kFeatures[static_cast<std::size_t>(t.feature)].name},
                          {"threshold", t.threshold},
                          {"below", t.below},
                          {"above", t.above},
                          {"margin", t.margin},
                          {"verdict", name_of(t.clearance)}};
    if (t.sigmas) row["sigmas"] = *t.sigmas;
    out["thresholds"].push_back(row);
  }
  out["slip_frames"] = check.slip_frames();
  out["verdict"] = name_of(check.worst());
  fmt::print("{}\n", text_of_json(out));
}

// Every frame asked for. false: a line has said why not.
bool watch(const CalibrateOptions& options, const Params& params, bool auto_grid, const Look& look) {
  std::string error;
  if (is_scene(options.input)) {
    const std::optional<scene::Scene> scene = load_scene(options.input);
    if (!scene) return false;
    error = watch_scene(options, params, *scene, look);
  } else {
    error = watch_recording(options, params, auto_grid, look);
  }
  if (!error.empty()) (void)fail(error);
  return error.empty();
}

// What is wrong with the model on this gel. Empty: nothing.
std::string complaint(const learn::ModelCheck& check, const std::string& model_text, std::size_t frames) {
  constexpr std::string_view kNext =
      "look whether light, focus or gel are worse than usual and record again; else train with --marker-noise-um of "
      "this gel in `holdfast dataset`, or give another model";
  if (const long slips = check.slip_frames(); slips > 0) {
    return fmt::format(
        "{}: says slip in {} of {} frames of the gel at rest. Likely cause: its thresholds were learned "
        "on less noise than this gel has. Next: {}",
        model_text, slips, frames, kNext);
  }
  for (const learn::ThresholdCheck& t : check.thresholds) {
    if (t.clearance == learn::Clearance::kNoMatter || t.clearance != check.worst()) continue;
    if (t.clearance == learn::Clearance::kClear) return {};
    return fmt::format(
        "{}: node {} ({} <= {}) is {}{}. Likely cause: its thresholds were learned on less noise than this gel has. "
        "Next: {}",
        model_text, t.node, kFeatures[static_cast<std::size_t>(t.feature)].name, t.threshold,
        t.clearance == learn::Clearance::kClose ? "close to the noise of the gel" : "inside the noise of the gel",
        t.sigmas ? fmt::format(", {:.1f} sigmas from rest", *t.sigmas) : "", kNext);
  }
  return {};
}

// The scale in a file of settings, whose other values stay. Empty, or an error line.
std::string write_scale(const std::string& path, const ParamInfo& scale, std::int32_t permille) {
  Params params;
  std::string text;
  if (std::filesystem::exists(path)) {
    if (std::string error = drivers::read_file(path, "settings", "give a TOML file", text); !error.empty())
      return error;
    if (std::string error = settings_of_toml(text, path, params); !error.empty()) return error;
  }
  params.*scale.member = permille;
  AtomicFile out(path);
  if (!out.error().empty()) return out.error();
  out.stream() << toml_of_settings(params);
  return out.commit();
}

// With a known weight on the gel: how stiff it is.
int weigh(const CalibrateOptions& options, const Params& params, bool auto_grid) {
  const auto force = options.as == "shear" ? learn::Force::kShear : learn::Force::kNormal;
  const ParamInfo& scale = *find_param(force == learn::Force::kShear ? "shear_scale" : "normal_scale");
  const double share_pct = options.share_pct > 0 ? options.share_pct : force == learn::Force::kShear ? 50.0 : 100.0;
  constexpr double kMillinewtonsPerGram = 9.80665;
  const double true_mn = options.weight_g * kMillinewtonsPerGram * share_pct / 100.0;
  learn::Weighing weighing(force);
  if (!watch(options, params, auto_grid,
             [&](long frame, const pipeline::Result& result, const pipeline::State&, const pipeline::Config&) {
               weighing.add(frame, result);
             })) {
    return 1;
  }
  const auto result = weighing.find(true_mn);
  if (const auto* wrong = std::get_if<std::string>(&result)) return fail(options.input + ": " + *wrong);
  const auto& found = std::get<learn::Weighing::Found>(result);
  if (!options.output.empty()) {
    if (const std::string error = write_scale(options.output, scale, found.scale_permille); !error.empty()) {
      return fail(error);
    }
  }
  if (options.common.json) {
    fmt::print("{}\n", text_of_json(nlohmann::ordered_json{{"force", options.as},
                                                           {"weight_g", options.weight_g},
                                                           {"share_pct", share_pct},
                                                           {"true_mn", true_mn},
                                                           {"first", found.first},
                                                           {"last", found.last},
                                                           {"frames", found.frames},
                                                           {"reading_mn", found.reading_mn},
                                                           {"spread_mn", found.spread_mn},
                                                           {"within", found.within},
                                                           {std::string(scale.name), found.scale_permille}}));
    return 0;
  }
  fmt::print("weight    {:g} g, of which this gel carries {:g} %: {:.3f} N of {}\n", options.weight_g, share_pct,
             true_mn * 1e-3, force == learn::Force::kShear ? "shear" : "normal load");
  fmt::print("reading   {:.3f} N on a gel of 35 kPa, deviation {:.1f} mN in the {} frames from {} to {}\n",
             found.reading_mn * 1e-3, found.spread_mn, found.frames, found.first, found.last);
  fmt::print("setting   {} = {}\n", scale.name, found.scale_permille);
  constexpr double kScaledKpa = 35, kSoftestKpa = 30, kStiffestKpa = 115;  // toolchain/README.md, forces
  constexpr double kOwnError = 1.2;                                        // of a reading of normal load: 15 %
  const double kpa = kScaledKpa * found.scale_permille / 1000.0;
  if (kpa * kOwnError < kSoftestKpa || kpa > kStiffestKpa * kOwnError) {
    fmt::print(
        "note      this says a gel of {:.0f} kPa, and {:g} to {:g} are reported. Likely cause: the weight or its share "
        "is another, or something pressed on the gel at the start. Next: weigh again\n",
        kpa, kSoftestKpa, kStiffestKpa);
  }
  if (2 * found.within < found.frames) {
    fmt::print(
        "note      the contact is not known to lie within the lattice, and the scale takes its error along: an "
        "object that touches on less than 6 mm, in the middle, is exact\n");
  }
  fmt::print(
      "next      {}\n",
      options.output.empty()
          ? fmt::format("`set {} {}` and `save` on the device's console, or -o settings.toml", scale.name,
                        found.scale_permille)
          : fmt::format("holdfast settings compile {}, or `set` and `save` on the device's console", options.output));
  return 0;
}

int calibrate(const CalibrateOptions& options) {
  Params params;
  bool auto_grid = false;
  std::unique_ptr<model::Tree> unused_tree;
  std::string model_text;
  CommonOptions common = options.common;
  common.model.clear();
  if (const std::string error = settle(common, params, auto_grid, unused_tree, model_text); !error.empty()) {
    return fail(error);
  }
  if (options.weight_g > 0) return weigh(options, params, auto_grid);
  params = learn::with_all_features(params);
  treec::Model model;
  if (options.common.model.empty()) {
    (void)treec::parse(learn::compiled_model_text(), model);
  } else {
    if (const std::string error = read_model(options.common.model, model); !error.empty()) return fail(error);
    model_text = fmt::format("{} ({})", model.name, options.common.model);
  }
  learn::RestStudy study;
  const bool watched = watch(options, params, auto_grid,
                             [&](long frame, const pipeline::Result& result, const pipeline::State& state,
                                 const pipeline::Config& config) { study.add(frame, result, state, config); });
  if (!watched) return 1;
  if (const std::string error = check_study(options, study); !error.empty()) return fail(error);
  const learn::ModelCheck check = learn::check_rest(model, study.rest());
  const std::string complained = complaint(check, model_text, study.rest().size());
  if (common.json) {
    print_json(study, check, model_text);
  } else {
    print_tables(study, check, model_text, complained.empty());
  }
  return complained.empty() ? 0 : fail(complained);
}

std::string frame_number(const std::string& text) {
  long value = 0;
  return CLI::detail::lexical_cast(text, value) && value >= 0 ? "" : fmt::format("'{}' is no number of a frame", text);
}

}  // namespace

void add_calibrate(CLI::App& app, std::vector<Command>& commands) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* command =
      app.add_subcommand("calibrate",
                         "learn a gel's noise at rest and hold a model's thresholds against it; or, with a known "
                         "weight on it, the scale of its forces");
  command
      ->add_option("INPUT", options->input,
                   "recording of the empty gel as for replay, ten seconds or more; or a scene (.json)")
      ->required()
      ->check(not_empty);
  command->add_option("--from", options->from, "first frame of those in which the gel is empty, from 0")
      ->check(frame_number);
  command->add_option("--to", options->to, "last of them")->check(frame_number);
  command
      ->add_option("--reference", options->reference,
                   "which frame shows the empty gel, or an image of it; unless given the first still frames, as on "
                   "the device")
      ->check(not_empty);
  command->add_option("--model", options->common.model, "model text to judge instead of the compiled tree")
      ->check(not_empty);
  command->add_option("--grid", options->common.grid, "printed grid as COLSxROWS, or auto: take the lattice found")
      ->capture_default_str();
  command->add_option("--mode", options->common.mode, "speed setting for JPEG pictures")->capture_default_str();
  command
      ->add_option("--fps", options->fps,
                   "frames per second of inputs that carry no time (else 25), or a wrong one: those at which a device "
                   "decides, because the noise of slower ones is another")
      ->check(number_from_to(kLeastFps, kMostFps));
  CLI::Option* const weight =
      command->add_option("--weight", options->weight_g, "grams that hang on the gel or stand on it in INPUT")
          ->check(number_from_to(1.0, 5000.0));
  command->add_option("--as", options->as, "what the weight is to this gel: shear or normal")
      ->needs(weight)
      ->check(CLI::IsMember({"shear", "normal"}))
      ->capture_default_str();
  command
      ->add_option("--share", options->share_pct,
                   "percent of the weight that this gel carries; 50 as shear (two like fingers), 100 as normal")
      ->needs(weight)
      ->check(number_from_to(1.0, 100.0));
  command
      ->add_option("-o,--output", options->output,
                   "settings to write the scale into, TOML; its other values stay, comments do not")
      ->needs(weight)
      ->check(not_empty);
  command->add_flag("--json", options->common.json, "print the figures as JSON, features in raw units");
  command->footer(
      "Exit status 0: every threshold that matters stands six sigmas clear; 1: not, or the gel was not at rest.\n"
      "It can see that the gel is still, and that it is empty only by a reference picture.\n"
      "With --weight: one second of the empty gel, then the weight on it, still for two seconds.\n"
      "  shear   close the grip on an object of that weight and lift it clear; the gels hang upright. Two like "
      "fingers\n"
      "          carry half each; a finger whose other side rolls freely carries all\n"
      "  normal  lay the sensor down, gel up and level, and stand the weight on it by a round foot of 5 to 8 mm\n"
      "One of them gives both scales, because both stand on the gel's stiffness.\n"
      "Example:\n  holdfast calibrate empty.avi --model slip_v2.tree\n"
      "  holdfast calibrate --weight 200 hanging.avi -o gel.toml\n"
      "  holdfast calibrate grasp.avi --from 304 --to 449");
  commands.push_back({command, [options, command] {
                        for (const char* own : {"--reference", "--grid", "--fps"}) {
                          if (!is_scene(options->input) || command->count(own) == 0) continue;
                          return fail(trouble(fmt::format("{} is of no use to a scene", own),
                                              "a scene brings its empty gel, its grid and its time",
                                              "leave it out, or give a recording"));
                        }
                        return calibrate(*options);
                      }});
}

}  // namespace holdfast::tool
