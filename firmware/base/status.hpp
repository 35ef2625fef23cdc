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
    {DeviceState::kDegraded, "DEGRADED", "measuring, but not well enough to confirm the grip"},
    {DeviceState::kFault, "FAULT", "cannot measure: hold the grip and look at the reason"},
}};

// Why the state is what it is. Numbers are sent on the wire and never re-used:
// 0 none, 1-31 transport, 32-63 sensor picture, 64-95 timing, 96-127 limits that act without being a fault,
// 128-159 configuration, 160-191 gripper, 192-223 board.
enum class Reason : std::uint8_t {
  kNone = 0,
  kNoFrame = 1,
  kCameraGone = 2,
  kJpegDamaged = 3,
  kFrameFormat = 4,
  kGpioFailed = 5,
  kFrameFrozen = 6,
  kCaptureHung = 7,
  kCameraWrong = 8,
  kTooFewDots = 32,
  kNoLattice = 33,
  kGridMismatch = 34,
  kGridAmbiguous = 35,
  kMarkersLost = 36,
  kPictureTooSmall = 37,
  kPictureTooLarge = 38,
  kDotsOverflow = 39,
  kExposure = 40,
  kCameraControls = 41,
  kTimeNotForward = 64,
  kTimeGap = 65,
  kFrameStale = 66,
  kFrameRate = 67,
  kDeadline = 68,
  kFrameUnstamped = 69,
  kFewMarkers = 96,
  kLearning = 97,
  kSlipDetected = 98,
  kManyRejected = 99,
  kRecovering = 100,
  kNeedsArm = 101,
  kOpening = 102,
  kForceLimit = 103,
  kContactLost = 104,
  kLightChanged = 105,
  kReferenceLoaded = 106,
  kConfig = 128,
  // 129 was never raised
  kGripperSilent = 160,
  kGripperReply = 161,
  kGripperActivating = 162,
  kGripperHot = 163,
  kGripperLost = 164,
  kGripperUndervoltage = 165,
  kGripperReleasing = 166,
  kGripperInternal = 167,
  kGripperActivation = 168,
  kGripperOvercurrent = 169,
  kGripperReleased = 170,
  kBoardUndervoltage = 192,
};

struct ReasonInfo {
  Reason reason;
  std::string_view name;   // stable key for CSV, JSON and the console
  std::string_view what;   // what happened
  std::string_view cause;  // the likely cause
  std::string_view next;   // what to do next
};

inline constexpr std::array<ReasonInfo, 49> kReasons{{
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
    {Reason::kFrameFrozen, "frame_frozen", "the camera sends the same picture again and again",
     "the sensor or its driver hangs while the stream goes on", "unplug the sensor and plug it in again"},
    {Reason::kCaptureHung, "capture_hung", "the output watchdog found no accepted frame in time",
     "the thread that reads the camera hangs in the driver, or the board is overloaded",
     "restart holdfastd if it does not recover; give the sensor a USB port of its own"},
    {Reason::kCameraWrong, "camera_wrong", "a different sensor is connected than at the start",
     "a second sensor, or one that looks alike, was plugged in",
     "plug the first sensor in again, or restart holdfastd"},
    {Reason::kTooFewDots, "too_few_dots", "too few dark dots in the picture",
     "no marker gel, lens covered, or light off", "look at the picture; use a gel with printed dots"},
    {Reason::kNoLattice, "no_lattice", "the dots do not form a lattice",
     "not a marker gel, or the picture is torn or badly blurred", "look at the picture; clean the gel"},
    {Reason::kGridMismatch, "grid_mismatch", "the lattice found has another size than configured",
     "another grid was given, or rows are cut off by the picture's edge",
     "give the printed grid: grid_cols and grid_rows of a device, --grid of a recording"},
    {Reason::kGridAmbiguous, "grid_ambiguous", "the lattice is larger than configured",
     "the gel has more rows or columns than the grid that was given",
     "give the printed grid: grid_cols and grid_rows of a device, --grid of a recording"},
    {Reason::kMarkersLost, "markers_lost", "too many markers are lost", "gel torn or dirty, or object off the gel",
     "release, clean the gel, and learn the reference again"},
    {Reason::kPictureTooSmall, "picture_too_small", "the picture is too small to hold the markers",
     "not a GelSight recording, or scaled down too far", "use a picture of at least 320x240 pixels"},
    {Reason::kPictureTooLarge, "picture_too_large", "the picture is larger than the fixed memory",
     "a faster mode is needed for this camera", "use mode fast or balanced"},
    {Reason::kDotsOverflow, "dots_overflow", "too many blobs in the picture",
     "heavy noise, dirt, or a texture instead of a gel", "clean the gel; check exposure and gain"},
    {Reason::kExposure, "exposure", "the picture is too dark or too bright",
     "light off, lens covered, or exposure and gain not as set", "check the sensor's light; set manual exposure"},
    {Reason::kCameraControls, "camera_controls", "the camera does not take its settings of brightness or frame rate",
     "another program sets them, or another firmware of the sensor",
     "end the other program and plug the sensor in again; the log names the settings"},
    {Reason::kTimeNotForward, "time_not_forward", "the frame is not newer than the one before",
     "camera timestamps stand still or run backwards", "restart the stream; report the camera's driver"},
    {Reason::kTimeGap, "time_gap", "too long since the frame before", "frames were dropped or the machine stalled",
     "rates start again with this frame; look for overload if it repeats"},
    {Reason::kFrameStale, "frame_stale", "the frame is too old to confirm the grip", "frames queue up: overload",
     "close what else loads the board; use a faster mode"},
    {Reason::kFrameRate, "frame_rate", "frames come slower or faster than the sensor's 15 to 27 fps",
     "automatic exposure halves the rate, or the USB bus is overloaded", "set manual exposure; use another USB port"},
    {Reason::kDeadline, "deadline", "more than 1 % of the frames of the last 10 s were decided late",
     "the board is too hot, throttled or busy", "close what else loads the board, cool it, or use a faster mode"},
    {Reason::kFrameUnstamped, "frame_unstamped", "the frame has no usable time stamp: nobody knows how old it is",
     "the camera's driver does not stamp by the monotonic clock", "use the kernel's uvcvideo for the sensor"},
    {Reason::kFewMarkers, "few_markers", "some markers are lost", "dirt on the gel or strong shear at the edge",
     "clean the gel if it persists with an empty gripper"},
    {Reason::kLearning, "learning", "the rest position is being learned", "start or TARE",
     "keep the gel empty until the state changes"},
    {Reason::kSlipDetected, "slip", "the object slips", "too little grip force", "tighten"},
    {Reason::kManyRejected, "many_rejected", "more than 3 of the last 10 frames were rejected or did not come",
     "USB payload lost on the way, or a camera below 10 frames a second",
     "check the cable and the sensor's frame rate; look at the counters of rejected frames"},
    {Reason::kRecovering, "recovering", "a fault has passed; a few good frames must follow",
     "the camera, the gripper or holdfastd came back", "wait; look at the fault before it if it repeats"},
    {Reason::kNeedsArm, "needs_arm", "a fault has passed and is latched", "the setting `latch` asks for a command",
     "look at what happened, then send ARM"},
    {Reason::kOpening, "opening", "the gripper opens: loss of contact is no slip", "OPENING was commanded",
     "end OPENING when the gripper has opened; it ends itself after opening_max_ms"},
    {Reason::kForceLimit, "force_limit", "the object slips and the grip force is at its limit",
     "object too heavy or too smooth for the limit", "lower the load, or raise max_force if the object bears it"},
    {Reason::kContactLost, "contact_lost", "the contact ended without OPENING", "the object fell or was pulled away",
     "look for the object; send OPENING before the gripper opens on purpose"},
    {Reason::kLightChanged, "light_changed",
     "the light changed while the rest position was being learned: that begins anew",
     "the camera's exposure settles after its start, or follows the picture",
     "keep the gel empty and wait; if it stays, set manual exposure and check the sensor's light"},
    {Reason::kReferenceLoaded, "reference_loaded",
     "the lattice of the markers is bent: it was refused as rest position",
     "something pressed on the gel while its rest position was being learned",
     "open the gripper and wait; if the gel is empty all the same, send TARE once more"},
    {Reason::kConfig, "config", "settings or the model are lost, damaged or out of range",
     "the power was cut while they were written, the card wears, or they are of another version or another owner",
     "give `stored` at the console: it shows each record; then load or save them again, or give `stored accept`; with "
     "an owner, load what the owner signed"},
    {Reason::kGripperSilent, "gripper_silent", "the gripper does not answer",
     "cable, power, or another slave number or baud rate",
     "check the gripper's power and RS-485 wiring; slave 9, 115200 8N1"},
    {Reason::kGripperReply, "gripper_reply", "the gripper's replies are damaged",
     "noise on the line, no termination, or two masters", "check the termination (120 ohm) and that nobody else polls"},
    {Reason::kGripperActivating, "gripper_activating", "the gripper is being activated",
     "start, or recovery from a gripper fault", "wait until its fingers have moved; keep them free"},
    {Reason::kGripperHot, "gripper_hot", "the gripper is too hot", "long grasps at high force",
     "let it cool; lower the force"},
    {Reason::kGripperLost, "gripper_lost", "the gripper's fingers closed on nothing",
     "the object was lost or never between the fingers", "pick the object up again"},
    {Reason::kGripperUndervoltage, "gripper_undervoltage", "the gripper's supply voltage is too low",
     "weak supply or long thin wires", "check the 24 V supply, then send ARM"},
    {Reason::kGripperReleasing, "gripper_releasing", "the gripper's automatic release is running",
     "someone commanded the emergency release", "wait until it has ended, then send ARM"},
    {Reason::kGripperInternal, "gripper_internal", "the gripper reports an internal fault", "hardware of the gripper",
     "send ARM; call its maker if it comes back"},
    {Reason::kGripperActivation, "gripper_activation", "the gripper's activation failed",
     "fingers blocked while they were measured", "free the fingers, then send ARM"},
    {Reason::kGripperOvercurrent, "gripper_overcurrent", "the gripper's motor took too much current",
     "fingers blocked or object too stiff at this speed", "free the fingers, then send ARM"},
    {Reason::kGripperReleased, "gripper_released", "the gripper's automatic release has ended",
     "someone commanded the emergency release", "send ARM: the gripper is activated anew"},
    {Reason::kBoardUndervoltage, "board_undervoltage", "the board's supply voltage is too low",
     "weak supply, long thin cable, or too much on its USB ports",
     "use the board's own supply (Raspberry Pi 4: 5.1 V, 3 A) and a short cable"},
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
