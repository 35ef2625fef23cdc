// SPDX-License-Identifier: Apache-2.0
// States and reasons: the one table that everything reads which prints, sends or documents them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace holdfast {

// What the outputs stand on. GRIP_OK is HIGH in kOk only (DESIGN.md, Outputs). Numbers are sent on the wire.
enum class DeviceState : std::uint8_t { kBoot = 0, kReference = 1, kOk = 2, kSlip = 3, kDegraded = 4, kFault = 5 };

struct StateInfo {
  DeviceState state;
  std::string_view name;  // as in CSV columns, reports and the console
  std::string_view meaning;
};

inline constexpr std::array<StateInfo, 6> kStates{{
    {DeviceState::kBoot, "BOOT", "started, no frame accepted yet"},
    {DeviceState::kReference, "REFERENCE", "learning the rest position of the markers on the empty gel"},
    {DeviceState::kOk, "OK", "healthy, referenced and no slip"},
    {DeviceState::kSlip, "SLIP", "the object slips: tighten"},
    {DeviceState::kDegraded, "DEGRADED", "measuring, but not well enough to vouch for the grip"},
    {DeviceState::kFault, "FAULT", "cannot measure: hold the grip and look at the reason"},
}};

// Why the state is what it is. Numbers are sent on the wire and never re-used:
// 0 none, 1-31 transport, 32-63 sensor picture, 64-95 timing, 96-127 limits that act without being a fault,
// 128-159 configuration.
enum class Reason : std::uint8_t {
  kNone = 0,
  kNoFrame = 1,
  kCameraGone = 2,
  kJpegDamaged = 3,
  kFrameFormat = 4,
  kGpioFailed = 5,
  kTooFewDots = 32,
  kNoLattice = 33,
  kGridMismatch = 34,
  kGridAmbiguous = 35,
  kMarkersLost = 36,
  kPictureTooSmall = 37,
  kPictureTooLarge = 38,
  kDotsOverflow = 39,
  kTimeNotForward = 64,
  kTimeGap = 65,
  kFrameStale = 66,
  kFewMarkers = 96,
  kLearning = 97,
  kSlipDetected = 98,
  kConfig = 128,
  kModel = 129,
};

struct ReasonInfo {
  Reason reason;
  std::string_view name;   // stable key for CSV, JSON and the console
  std::string_view what;   // what happened
  std::string_view cause;  // the likely cause
  std::string_view next;   // what to do next
};

inline constexpr std::array<ReasonInfo, 22> kReasons{{
    {Reason::kNone, "none", "nothing to report", "-", "-"},
    {Reason::kNoFrame, "no_frame", "no frame arrived in time", "the camera stalls or the USB bus is overloaded",
     "check the cable and give the sensor a USB port of its own"},
    {Reason::kCameraGone, "camera_gone", "the camera ended the stream", "sensor unplugged, or end of a recording",
     "plug the sensor in again"},
    {Reason::kJpegDamaged, "jpeg_damaged", "the JPEG picture is damaged", "USB payload lost on the way",
     "check the cable; single frames are skipped on purpose"},
    {Reason::kFrameFormat, "frame_format", "the frame changed size or format",
     "another camera, or a file of mixed pictures", "use one sensor and one size for the whole run"},
    {Reason::kGpioFailed, "gpio_failed", "an output line could not be set", "the line is used by another process",
     "check the wiring table of the board and who else holds the line"},
    {Reason::kTooFewDots, "too_few_dots", "too few dark dots in the picture",
     "no marker gel, lens covered, or light off", "look at the picture; use a gel with printed dots"},
    {Reason::kNoLattice, "no_lattice", "the dots do not form a lattice",
     "not a marker gel, or the picture is torn or badly blurred", "look at the picture; clean the gel"},
    {Reason::kGridMismatch, "grid_mismatch", "the lattice found has another size than configured",
     "wrong --grid, or rows cut off by the picture's edge", "give the printed grid as COLSxROWS, or --grid auto"},
    {Reason::kGridAmbiguous, "grid_ambiguous", "the lattice is larger than configured",
     "the gel has more rows or columns than --grid says", "give the printed grid as COLSxROWS, or --grid auto"},
    {Reason::kMarkersLost, "markers_lost", "too many markers are lost", "gel torn or dirty, or object off the gel",
     "release, clean the gel, and learn the reference again"},
    {Reason::kPictureTooSmall, "picture_too_small", "the picture is too small to hold the markers",
     "not a GelSight recording, or scaled down too far", "use a picture of at least 64x48 pixels"},
    {Reason::kPictureTooLarge, "picture_too_large", "the picture is larger than the fixed memory",
     "a faster mode is needed for this camera", "use mode fast or balanced"},
    {Reason::kDotsOverflow, "dots_overflow", "too many blobs in the picture",
     "heavy noise, dirt, or a texture instead of a gel", "clean the gel; check exposure and gain"},
    {Reason::kTimeNotForward, "time_not_forward", "the frame is not newer than the one before",
     "camera timestamps stand still or run backwards", "restart the stream; report the camera's driver"},
    {Reason::kTimeGap, "time_gap", "too long since the frame before", "frames were dropped or the machine stalled",
     "rates start again with this frame; look for overload if it repeats"},
    {Reason::kFrameStale, "frame_stale", "the frame is too old to vouch for the grip", "frames queue up: overload",
     "close what else loads the board; use a faster mode"},
    {Reason::kFewMarkers, "few_markers", "some markers are lost", "dirt on the gel or strong shear at the edge",
     "clean the gel if it persists with an empty gripper"},
    {Reason::kLearning, "learning", "the rest position is being learned", "start or TARE",
     "keep the gel empty until the state changes"},
    {Reason::kSlipDetected, "slip", "the object slips", "too little grip force", "tighten"},
    {Reason::kConfig, "config", "a setting is out of its range", "edited by hand or for another version",
     "look at the named parameter's range"},
    {Reason::kModel, "model", "the slip model does not fit", "built for another feature set",
     "compile the model again for this firmware"},
}};

[[nodiscard]] constexpr const ReasonInfo& info(Reason reason) {
  for (const ReasonInfo& row : kReasons) {
    if (row.reason == reason) return row;
  }
  return kReasons[0];
}

[[nodiscard]] constexpr const StateInfo& info(DeviceState state) {
  return kStates[static_cast<std::size_t>(state)];
}

// Result of something that may fail at start-up or for one frame: kNone means success.
struct [[nodiscard]] Status {
  Reason reason = Reason::kNone;
  [[nodiscard]] constexpr bool ok() const { return reason == Reason::kNone; }
};

inline constexpr Status kOkStatus{};

}  // namespace holdfast
