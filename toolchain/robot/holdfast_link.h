// SPDX-License-Identifier: Apache-2.0
// clang-format off
// The frames of firmware/link/LINK.md, written by hand; tests/toolchain/robot_link_test.cpp holds every number, name,
// meaning and byte against the firmware's tables.
//
// The robot's end of a serial line to holdfastd, for C99 and C++: no heap, no globals, nothing to link. Zeroed
// structs are ready for use. README.md, beside this file, shows a program.
#ifndef HOLDFAST_LINK_H
#define HOLDFAST_LINK_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum {
  HOLDFAST_LINK_VERSION = 1,
  HOLDFAST_LINK_HAND_VERSION = 2,  // of a status frame that tells of each finger
  HOLDFAST_LINK_MAX_WIRE = 37,
  HOLDFAST_STATUS_PAYLOAD = 32,
  HOLDFAST_HAND_STATUS_PAYLOAD = 35,
  HOLDFAST_COMMAND_PAYLOAD = 8,
  HOLDFAST_ANSWER_PAYLOAD = 8,
  HOLDFAST_EVIDENCE_PAYLOAD = 27,
  HOLDFAST_LOAD_PAYLOAD = 17,
  HOLDFAST_COMMAND_WIRE = 11,  // what holdfast_link_command() writes: one 0x00 before the frame as well
  HOLDFAST_GRIP_FRESH_MS = 150
};

// What holdfast_link_push() returns when it is not 0.
enum {
  HOLDFAST_KIND_STATUS = 1,
  HOLDFAST_KIND_COMMAND = 2,
  HOLDFAST_KIND_ANSWER = 3,
  HOLDFAST_KIND_EVIDENCE = 6,
  HOLDFAST_KIND_LOAD = 7,
  HOLDFAST_LINK_DAMAGED = -1,  // what began as a frame is none; dropped
  HOLDFAST_LINK_OTHER = -2     // a sound frame of a version, kind or length that this header does not know
};

enum holdfast_flag {
  HOLDFAST_FLAG_SLIP = 1,  // the debounced decision: the object slips
  HOLDFAST_FLAG_GRIP_OK = 2,  // level of the line GRIP_OK; counts only while ALIVE is fresh
  HOLDFAST_FLAG_FEATURES_VALID = 4,  // markers and features belong to this frame; otherwise they are 0
  HOLDFAST_FLAG_ALIVE = 8  // level of the line ALIVE; toggles once per accepted frame
};

enum holdfast_state {
  HOLDFAST_STATE_BOOT = 0,  // started, no frame accepted yet
  HOLDFAST_STATE_REFERENCE = 1,  // learning the rest position of the markers on the empty gel
  HOLDFAST_STATE_OK = 2,  // healthy, referenced and no slip
  HOLDFAST_STATE_SLIP = 3,  // the object slips: tighten
  HOLDFAST_STATE_DEGRADED = 4,  // measuring, but not well enough to confirm the grip
  HOLDFAST_STATE_FAULT = 5  // cannot measure: hold the grip and look at the reason
};

enum holdfast_reason {
  HOLDFAST_REASON_NONE = 0,  // nothing to report
  HOLDFAST_REASON_NO_FRAME = 1,  // no frame arrived in time
  HOLDFAST_REASON_CAMERA_GONE = 2,  // the camera ended the stream
  HOLDFAST_REASON_JPEG_DAMAGED = 3,  // the JPEG picture is damaged
  HOLDFAST_REASON_FRAME_FORMAT = 4,  // the frame changed size or format
  HOLDFAST_REASON_GPIO_FAILED = 5,  // an output line could not be set
  HOLDFAST_REASON_FRAME_FROZEN = 6,  // the camera sends the same picture again and again
  HOLDFAST_REASON_CAPTURE_HUNG = 7,  // the output watchdog found no accepted frame in time
  HOLDFAST_REASON_CAMERA_WRONG = 8,  // a different sensor is connected than at the start
  HOLDFAST_REASON_TOO_FEW_DOTS = 32,  // too few dark dots in the picture
  HOLDFAST_REASON_NO_LATTICE = 33,  // the dots do not form a lattice
  HOLDFAST_REASON_GRID_MISMATCH = 34,  // the lattice found has another size than configured
  HOLDFAST_REASON_GRID_AMBIGUOUS = 35,  // the lattice is larger than configured
  HOLDFAST_REASON_MARKERS_LOST = 36,  // too many markers are lost
  HOLDFAST_REASON_PICTURE_TOO_SMALL = 37,  // the picture is too small to hold the markers
  HOLDFAST_REASON_PICTURE_TOO_LARGE = 38,  // the picture is larger than the fixed memory
  HOLDFAST_REASON_DOTS_OVERFLOW = 39,  // too many blobs in the picture
  HOLDFAST_REASON_EXPOSURE = 40,  // the picture is too dark or too bright
  HOLDFAST_REASON_CAMERA_CONTROLS = 41,  // the camera does not take its settings of brightness or frame rate
  HOLDFAST_REASON_TIME_NOT_FORWARD = 64,  // the frame is not newer than the one before
  HOLDFAST_REASON_TIME_GAP = 65,  // too long since the frame before
  HOLDFAST_REASON_FRAME_STALE = 66,  // the frame is too old to confirm the grip
  HOLDFAST_REASON_FRAME_RATE = 67,  // frames come slower or faster than the sensor's 15 to 27 fps
  HOLDFAST_REASON_DEADLINE = 68,  // more than 1 % of the frames of the last 10 s were decided late
  HOLDFAST_REASON_FRAME_UNSTAMPED = 69,  // the frame has no usable time stamp: nobody knows how old it is
  HOLDFAST_REASON_FEW_MARKERS = 96,  // some markers are lost
  HOLDFAST_REASON_LEARNING = 97,  // the rest position is being learned
  HOLDFAST_REASON_SLIP = 98,  // the object slips
  HOLDFAST_REASON_MANY_REJECTED = 99,  // more than 3 of the last 10 frames were rejected or did not come
  HOLDFAST_REASON_RECOVERING = 100,  // a fault has passed; a few good frames must follow
  HOLDFAST_REASON_NEEDS_ARM = 101,  // a fault has passed and is latched
  HOLDFAST_REASON_OPENING = 102,  // the gripper opens: loss of contact is no slip
  HOLDFAST_REASON_FORCE_LIMIT = 103,  // the object slips and the grip force is at its limit
  HOLDFAST_REASON_CONTACT_LOST = 104,  // the contact ended without OPENING
  HOLDFAST_REASON_LIGHT_CHANGED = 105,  // the light changed while the rest position was being learned: that begins anew
  HOLDFAST_REASON_REFERENCE_LOADED = 106,  // the lattice of the markers is bent: it was refused as rest position
  HOLDFAST_REASON_CONFIG = 128,  // settings or the model are lost, damaged or out of range
  HOLDFAST_REASON_GRIPPER_SILENT = 160,  // the gripper does not answer
  HOLDFAST_REASON_GRIPPER_REPLY = 161,  // the gripper's replies are damaged
  HOLDFAST_REASON_GRIPPER_ACTIVATING = 162,  // the gripper is being activated
  HOLDFAST_REASON_GRIPPER_HOT = 163,  // the gripper is too hot
  HOLDFAST_REASON_GRIPPER_LOST = 164,  // the gripper's fingers closed on nothing
  HOLDFAST_REASON_GRIPPER_UNDERVOLTAGE = 165,  // the gripper's supply voltage is too low
  HOLDFAST_REASON_GRIPPER_RELEASING = 166,  // the gripper's automatic release is running
  HOLDFAST_REASON_GRIPPER_INTERNAL = 167,  // the gripper reports an internal fault
  HOLDFAST_REASON_GRIPPER_ACTIVATION = 168,  // the gripper's activation failed
  HOLDFAST_REASON_GRIPPER_OVERCURRENT = 169,  // the gripper's motor took too much current
  HOLDFAST_REASON_GRIPPER_RELEASED = 170,  // the gripper's automatic release has ended
  HOLDFAST_REASON_BOARD_UNDERVOLTAGE = 192  // the board's supply voltage is too low
};

enum holdfast_command_number {
  HOLDFAST_COMMAND_TARE = 1,  // forget the rest position of the markers and learn it anew (argument 0: only while nothing touches the gel; 1: even then)
  HOLDFAST_COMMAND_OPENING = 2,  // the gripper opens: loss of contact is no slip, for `opening_max_ms` at most (argument 1: begins; 0: has ended)
  HOLDFAST_COMMAND_RELEASE = 3,  // lower the grip force step by step, to let the object go (argument 0)
  HOLDFAST_COMMAND_ARM = 4,  // leave a latched fault; activates the gripper anew (argument 0)
  HOLDFAST_COMMAND_GRIP = 5  // move the gripper (argument 1: close and hold with the starting force; 0: open)
};

enum holdfast_result {
  HOLDFAST_RESULT_DONE = 0,  // taken; what comes of it is in the status frames
  HOLDFAST_RESULT_TOUCHING = 1,  // refused: something touches the gel
  HOLDFAST_RESULT_STATE = 2,  // refused: no gripper is set up
  HOLDFAST_RESULT_UNKNOWN = 3,  // refused: this firmware does not know the command
  HOLDFAST_RESULT_ARGUMENT = 4,  // refused: the argument is out of the command's range
  HOLDFAST_RESULT_LOCKED = 5,  // refused: this is the console's port, and it is locked
  HOLDFAST_RESULT_OVERDUE = 6  // refused: OPENING lasted for `opening_max_ms` and was not ended
};

enum holdfast_contact {
  HOLDFAST_CONTACT_EMPTY = 0,  // nothing touches the gel
  HOLDFAST_CONTACT_TOUCHING = 1,  // something touches the gel, and the contact grows
  HOLDFAST_CONTACT_HELD = 2,  // something touches the gel, and the contact does not grow
  HOLDFAST_CONTACT_UNKNOWN = 255  // nobody can tell: the model does not read the picture between the markers
};

enum holdfast_evidence_number {
  HOLDFAST_EVIDENCE_NONE = 0,  // there is none to show
  HOLDFAST_EVIDENCE_IMPRINT = 1,  // motion of the relief that the object presses into the gel
  HOLDFAST_EVIDENCE_COARSE = 2,  // motion of what is smoother or finer than the relief
  HOLDFAST_EVIDENCE_MARKERS = 3,  // a feature of the markers
  HOLDFAST_EVIDENCE_CONTACT = 4,  // the contact was lost: the patches of relief that are left
  HOLDFAST_EVIDENCE_TURNOVER = 5  // share of the relief that another has taken the place of
};

enum holdfast_basis {
  HOLDFAST_BASIS_NONE = 0,  // no reading: another lattice or pitch, or too many markers are missing
  HOLDFAST_BASIS_UNCALIBRATED = 1,  // of a gel of 35 kPa, as the simulator has it: no weight was used
  HOLDFAST_BASIS_ONE_WEIGHT = 2,  // of this gel, by a weight for shear or for the normal load; the other has its scale
  HOLDFAST_BASIS_TWO_WEIGHTS = 3  // of this gel, by a weight for each
};

enum holdfast_load_flag {
  HOLDFAST_LOAD_WITHIN = 1,  // the contact is known to lie within the lattice; otherwise the errors are larger
  HOLDFAST_LOAD_STRAINED = 2  // a marker moved by more than a quarter of the gel's thickness: beyond the linear range
};

// As in LINK.md; "?": a number from a newer firmware.
static inline const char *holdfast_state_name(uint8_t number) {
  switch (number) {
    case HOLDFAST_STATE_BOOT: return "BOOT";
    case HOLDFAST_STATE_REFERENCE: return "REFERENCE";
    case HOLDFAST_STATE_OK: return "OK";
    case HOLDFAST_STATE_SLIP: return "SLIP";
    case HOLDFAST_STATE_DEGRADED: return "DEGRADED";
    case HOLDFAST_STATE_FAULT: return "FAULT";
    default: return "?";
  }
}

static inline const char *holdfast_reason_name(uint8_t number) {
  switch (number) {
    case HOLDFAST_REASON_NONE: return "none";
    case HOLDFAST_REASON_NO_FRAME: return "no_frame";
    case HOLDFAST_REASON_CAMERA_GONE: return "camera_gone";
    case HOLDFAST_REASON_JPEG_DAMAGED: return "jpeg_damaged";
    case HOLDFAST_REASON_FRAME_FORMAT: return "frame_format";
    case HOLDFAST_REASON_GPIO_FAILED: return "gpio_failed";
    case HOLDFAST_REASON_FRAME_FROZEN: return "frame_frozen";
    case HOLDFAST_REASON_CAPTURE_HUNG: return "capture_hung";
    case HOLDFAST_REASON_CAMERA_WRONG: return "camera_wrong";
    case HOLDFAST_REASON_TOO_FEW_DOTS: return "too_few_dots";
    case HOLDFAST_REASON_NO_LATTICE: return "no_lattice";
    case HOLDFAST_REASON_GRID_MISMATCH: return "grid_mismatch";
    case HOLDFAST_REASON_GRID_AMBIGUOUS: return "grid_ambiguous";
    case HOLDFAST_REASON_MARKERS_LOST: return "markers_lost";
    case HOLDFAST_REASON_PICTURE_TOO_SMALL: return "picture_too_small";
    case HOLDFAST_REASON_PICTURE_TOO_LARGE: return "picture_too_large";
    case HOLDFAST_REASON_DOTS_OVERFLOW: return "dots_overflow";
    case HOLDFAST_REASON_EXPOSURE: return "exposure";
    case HOLDFAST_REASON_CAMERA_CONTROLS: return "camera_controls";
    case HOLDFAST_REASON_TIME_NOT_FORWARD: return "time_not_forward";
    case HOLDFAST_REASON_TIME_GAP: return "time_gap";
    case HOLDFAST_REASON_FRAME_STALE: return "frame_stale";
    case HOLDFAST_REASON_FRAME_RATE: return "frame_rate";
    case HOLDFAST_REASON_DEADLINE: return "deadline";
    case HOLDFAST_REASON_FRAME_UNSTAMPED: return "frame_unstamped";
    case HOLDFAST_REASON_FEW_MARKERS: return "few_markers";
    case HOLDFAST_REASON_LEARNING: return "learning";
    case HOLDFAST_REASON_SLIP: return "slip";
    case HOLDFAST_REASON_MANY_REJECTED: return "many_rejected";
    case HOLDFAST_REASON_RECOVERING: return "recovering";
    case HOLDFAST_REASON_NEEDS_ARM: return "needs_arm";
    case HOLDFAST_REASON_OPENING: return "opening";
    case HOLDFAST_REASON_FORCE_LIMIT: return "force_limit";
    case HOLDFAST_REASON_CONTACT_LOST: return "contact_lost";
    case HOLDFAST_REASON_LIGHT_CHANGED: return "light_changed";
    case HOLDFAST_REASON_REFERENCE_LOADED: return "reference_loaded";
    case HOLDFAST_REASON_CONFIG: return "config";
    case HOLDFAST_REASON_GRIPPER_SILENT: return "gripper_silent";
    case HOLDFAST_REASON_GRIPPER_REPLY: return "gripper_reply";
    case HOLDFAST_REASON_GRIPPER_ACTIVATING: return "gripper_activating";
    case HOLDFAST_REASON_GRIPPER_HOT: return "gripper_hot";
    case HOLDFAST_REASON_GRIPPER_LOST: return "gripper_lost";
    case HOLDFAST_REASON_GRIPPER_UNDERVOLTAGE: return "gripper_undervoltage";
    case HOLDFAST_REASON_GRIPPER_RELEASING: return "gripper_releasing";
    case HOLDFAST_REASON_GRIPPER_INTERNAL: return "gripper_internal";
    case HOLDFAST_REASON_GRIPPER_ACTIVATION: return "gripper_activation";
    case HOLDFAST_REASON_GRIPPER_OVERCURRENT: return "gripper_overcurrent";
    case HOLDFAST_REASON_GRIPPER_RELEASED: return "gripper_released";
    case HOLDFAST_REASON_BOARD_UNDERVOLTAGE: return "board_undervoltage";
    default: return "?";
  }
}

static inline const char *holdfast_command_name(uint8_t number) {
  switch (number) {
    case HOLDFAST_COMMAND_TARE: return "TARE";
    case HOLDFAST_COMMAND_OPENING: return "OPENING";
    case HOLDFAST_COMMAND_RELEASE: return "RELEASE";
    case HOLDFAST_COMMAND_ARM: return "ARM";
    case HOLDFAST_COMMAND_GRIP: return "GRIP";
    default: return "?";
  }
}

static inline const char *holdfast_result_name(uint8_t number) {
  switch (number) {
    case HOLDFAST_RESULT_DONE: return "done";
    case HOLDFAST_RESULT_TOUCHING: return "touching";
    case HOLDFAST_RESULT_STATE: return "state";
    case HOLDFAST_RESULT_UNKNOWN: return "unknown";
    case HOLDFAST_RESULT_ARGUMENT: return "argument";
    case HOLDFAST_RESULT_LOCKED: return "locked";
    case HOLDFAST_RESULT_OVERDUE: return "overdue";
    default: return "?";
  }
}

static inline const char *holdfast_contact_name(uint8_t number) {
  switch (number) {
    case HOLDFAST_CONTACT_EMPTY: return "EMPTY";
    case HOLDFAST_CONTACT_TOUCHING: return "TOUCHING";
    case HOLDFAST_CONTACT_HELD: return "HELD";
    case HOLDFAST_CONTACT_UNKNOWN: return "UNKNOWN";
    default: return "?";
  }
}

static inline const char *holdfast_evidence_name(uint8_t number) {
  switch (number) {
    case HOLDFAST_EVIDENCE_NONE: return "none";
    case HOLDFAST_EVIDENCE_IMPRINT: return "imprint";
    case HOLDFAST_EVIDENCE_COARSE: return "coarse";
    case HOLDFAST_EVIDENCE_MARKERS: return "markers";
    case HOLDFAST_EVIDENCE_CONTACT: return "contact";
    case HOLDFAST_EVIDENCE_TURNOVER: return "turnover";
    default: return "?";
  }
}

static inline const char *holdfast_basis_name(uint8_t number) {
  switch (number) {
    case HOLDFAST_BASIS_NONE: return "none";
    case HOLDFAST_BASIS_UNCALIBRATED: return "uncalibrated";
    case HOLDFAST_BASIS_ONE_WEIGHT: return "one_weight";
    case HOLDFAST_BASIS_TWO_WEIGHTS: return "two_weights";
    default: return "?";
  }
}

static inline const char *holdfast_unit_name(uint8_t number) {
  switch (number) {
    case 0: return "-";
    case 1: return "um";
    case 2: return "um/s";
    case 3: return "nat";
    case 4: return "nat/s";
    case 5: return "log2";
    case 6: return "1e-6/s";
    case 7: return "1";
    case 8: return "patches";
    case 9: return "%";
    default: return "?";
  }
}

typedef struct {
  uint16_t sequence;  // 1; counts status frames, wraps; a gap is a lost frame
  uint32_t timestamp_us;  // us; start of the picture's exposure on the sensor's clock, low 32 bits
  uint16_t age_100us;  // 0.1 ms; from that start to the sending of this frame, rounded up; 65535: 6.5535 s or more, or unknown
  uint8_t state;  // see States
  uint8_t reason;  // see Reasons; a number not listed there comes from newer firmware
  uint8_t flags;  // bits; see Flags
  uint8_t markers;  // 1; how many markers the features stand on
  int32_t vx_um_s;  // um/s; mean speed of the markers, +x right
  int32_t vy_um_s;  // um/s; mean speed of the markers, +y down
  int32_t entropy_nat_q16;  // nat/65536; entropy of the displacements' lengths, 0 to ln 15
  int32_t entropy_rate_nat_s_q8;  // nat/s/256; change of the entropy per second
  uint8_t fingers;  // bits; fingers that there are: bit 0 left, bit 1 right (0: version 1, which does not tell)
  uint8_t healthy;  // bits; of these, in state OK or SLIP by what each sees alone
  uint8_t contact;  // bits; of these, with something that touches the gel
} holdfast_status;

typedef struct {
  uint16_t sequence;  // 1; chosen by the sender, another one for each new command; comes back in the answer
  uint8_t command;  // see Commands
  uint8_t argument;  // see Commands
} holdfast_command;

typedef struct {
  uint16_t sequence;  // 1; of the command
  uint8_t command;  // of the command
  uint8_t result;  // see Results; a number not listed there comes from newer firmware
} holdfast_answer;

typedef struct {
  uint16_t sequence;  // 1; of the status frame that came before it
  uint8_t finger;  // 0: left, or the only one; 1: right
  uint8_t contact;  // see Contact
  uint8_t evidence;  // what decided, or is the strongest while nothing slips; see Evidence
  uint8_t unit;  // of value and threshold; see Units
  uint8_t run;  // 1; frames in a row that said slip; counts up to the parameter `raise_frames`
  uint16_t patches;  // 1; patches of the gel into which something is pressed
  int32_t value_milli;  // unit/1000; of the evidence, in thousandths; cut where it does not fit
  int32_t threshold_milli;  // unit/1000; the model's first one for it, likewise
  int16_t motion_log2_um_q8;  // log2(um)/256; motion of the relief; 0: none
  int16_t coarse_log2_um_q8;  // log2(um)/256; motion of what is smoother or finer; 0: none
  int16_t growth_log2_q8;  // log2/256; of the relief since the picture that it is compared with
} holdfast_evidence;

typedef struct {
  uint16_t sequence;  // 1; of the status frame that came before it
  uint8_t finger;  // 0: left, or the only one; 1: right
  uint8_t basis;  // what the forces stand on; see Basis
  uint8_t flags;  // bits; see Load flags
  int16_t shear_x_mn;  // mN; force that the object lays on the gel, +x right
  int16_t shear_y_mn;  // mN; likewise, +y down
  int16_t normal_mn;  // mN; into the gel; below 0 by noise
  uint16_t friction_use_permille;  // 1/1000; shear over normal load; 0: less than 200 mN press
} holdfast_load;

static inline uint8_t holdfast_get_uint8(const uint8_t *p) { return p[0]; }

static inline uint16_t holdfast_get_uint16(const uint8_t *p) {
  return (uint16_t)((uint32_t)p[0] | ((uint32_t)p[1] << 8));
}

static inline uint32_t holdfast_get_uint32(const uint8_t *p) {
  return (uint32_t)p[0] | ((uint32_t)p[1] << 8) | ((uint32_t)p[2] << 16) | ((uint32_t)p[3] << 24);
}

static inline int16_t holdfast_get_int16(const uint8_t *p) {
  const uint16_t bits = holdfast_get_uint16(p);
  int16_t value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static inline int32_t holdfast_get_int32(const uint8_t *p) {
  const uint32_t bits = holdfast_get_uint32(p);
  int32_t value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static inline void holdfast_put_uint8(uint8_t *p, uint8_t value) { p[0] = value; }

static inline void holdfast_put_uint16(uint8_t *p, uint16_t value) {
  p[0] = (uint8_t)(value & 0xFFu);
  p[1] = (uint8_t)((uint32_t)value >> 8);
}

// CRC-16/CCITT-FALSE, bit by bit: a frame is short.
static inline uint16_t holdfast_crc16(const uint8_t *bytes, size_t count) {
  uint32_t crc = 0xFFFFu;
  size_t i;
  int bit;
  for (i = 0; i < count; ++i) {
    crc ^= (uint32_t)bytes[i] << 8;
    for (bit = 0; bit < 8; ++bit) crc = (crc << 1) ^ ((crc & 0x8000u) != 0 ? 0x11021u : 0u);
  }
  return (uint16_t)crc;
}

// ---------------------------------------------------------------------------------------------- what arrives

typedef struct {
  uint8_t bytes[HOLDFAST_LINK_MAX_WIRE];  // since the last 0x00; behind a frame its payload, until the next push
  uint8_t count;
  uint8_t place;     // 0: a frame may have begun, 1: in text, 2: in what is to be dropped up to the end of a line
  uint32_t frames;   // heard since start, of any kind; wraps
  uint32_t damaged;  // the same of HOLDFAST_LINK_DAMAGED
} holdfast_receiver;

// COBS, in place. Returns how many bytes come out, 0: no valid COBS.
static inline size_t holdfast_link_unstuff(uint8_t *bytes, size_t count) {
  size_t from = 0, to = 0, run;
  while (from < count) {
    run = (size_t)bytes[from++] - 1u;
    if (run > count - from) return 0;
    for (; run > 0; --run) bytes[to++] = bytes[from++];
    if (from < count) bytes[to++] = 0;
  }
  return to;
}

// Give it every byte that comes. Returns 0 most of the time, the kind of the frame that this byte completes, or what
// happened (HOLDFAST_LINK_...). Text between frames is passed over.
static inline int holdfast_link_push(holdfast_receiver *receiver, uint8_t byte) {
  uint8_t *const bytes = receiver->bytes;
  size_t size;
  if (byte != 0) {
    if (receiver->place == 2 && (byte == '\n' || byte == '\r')) receiver->place = 1;
    if (receiver->place != 0) return 0;
    bytes[receiver->count++] = byte;
    if (receiver->count == 2 && byte > 8) receiver->place = 1;
    if (receiver->count < HOLDFAST_LINK_MAX_WIRE) return 0;
    receiver->place = 2;
    ++receiver->damaged;
    return HOLDFAST_LINK_DAMAGED;
  }
  size = receiver->place == 0 ? receiver->count : 0;
  receiver->place = 0;
  receiver->count = 0;
  if (size < 2) return 0;
  size = holdfast_link_unstuff(bytes, size);
  if (size < 4 || holdfast_crc16(bytes, size - 2) != holdfast_get_uint16(bytes + size - 2)) {
    ++receiver->damaged;
    return HOLDFAST_LINK_DAMAGED;
  }
  ++receiver->frames;
  if (bytes[0] == HOLDFAST_LINK_HAND_VERSION && bytes[1] == HOLDFAST_KIND_STATUS &&
      size == HOLDFAST_HAND_STATUS_PAYLOAD) {
    return HOLDFAST_KIND_STATUS;
  }
  if (bytes[0] != HOLDFAST_LINK_VERSION) return HOLDFAST_LINK_OTHER;
  if ((bytes[1] == HOLDFAST_KIND_STATUS && size == HOLDFAST_STATUS_PAYLOAD) ||
      (bytes[1] == HOLDFAST_KIND_COMMAND && size == HOLDFAST_COMMAND_PAYLOAD) ||
      (bytes[1] == HOLDFAST_KIND_ANSWER && size == HOLDFAST_ANSWER_PAYLOAD) ||
      (bytes[1] == HOLDFAST_KIND_EVIDENCE && size == HOLDFAST_EVIDENCE_PAYLOAD) ||
      (bytes[1] == HOLDFAST_KIND_LOAD && size == HOLDFAST_LOAD_PAYLOAD)) {
    return bytes[1];
  }
  return HOLDFAST_LINK_OTHER;
}

// After HOLDFAST_KIND_STATUS, before the next push. 0: the state is one that this header does not know, and `status`
// is not filled; the frame counts as not heard.
static inline int holdfast_link_status(const holdfast_receiver *receiver, holdfast_status *status) {
  const int hand = receiver->bytes[0] == HOLDFAST_LINK_HAND_VERSION;
  if (receiver->bytes[10] > 5) return 0;
  status->sequence = holdfast_get_uint16(receiver->bytes + 2);
  status->timestamp_us = holdfast_get_uint32(receiver->bytes + 4);
  status->age_100us = holdfast_get_uint16(receiver->bytes + 8);
  status->state = holdfast_get_uint8(receiver->bytes + 10);
  status->reason = holdfast_get_uint8(receiver->bytes + 11);
  status->flags = holdfast_get_uint8(receiver->bytes + 12);
  status->markers = holdfast_get_uint8(receiver->bytes + 13);
  status->vx_um_s = holdfast_get_int32(receiver->bytes + 14);
  status->vy_um_s = holdfast_get_int32(receiver->bytes + 18);
  status->entropy_nat_q16 = holdfast_get_int32(receiver->bytes + 22);
  status->entropy_rate_nat_s_q8 = holdfast_get_int32(receiver->bytes + 26);
  status->fingers = hand ? holdfast_get_uint8(receiver->bytes + 30) : 0;
  status->healthy = hand ? holdfast_get_uint8(receiver->bytes + 31) : 0;
  status->contact = hand ? holdfast_get_uint8(receiver->bytes + 32) : 0;
  return 1;
}

// After HOLDFAST_KIND_ANSWER, before the next push.
static inline void holdfast_link_answer(const holdfast_receiver *receiver, holdfast_answer *answer) {
  answer->sequence = holdfast_get_uint16(receiver->bytes + 2);
  answer->command = holdfast_get_uint8(receiver->bytes + 4);
  answer->result = holdfast_get_uint8(receiver->bytes + 5);
}

// After HOLDFAST_KIND_LOAD, before the next push.
static inline void holdfast_link_load(const holdfast_receiver *receiver, holdfast_load *load) {
  load->sequence = holdfast_get_uint16(receiver->bytes + 2);
  load->finger = holdfast_get_uint8(receiver->bytes + 4);
  load->basis = holdfast_get_uint8(receiver->bytes + 5);
  load->flags = holdfast_get_uint8(receiver->bytes + 6);
  load->shear_x_mn = holdfast_get_int16(receiver->bytes + 7);
  load->shear_y_mn = holdfast_get_int16(receiver->bytes + 9);
  load->normal_mn = holdfast_get_int16(receiver->bytes + 11);
  load->friction_use_permille = holdfast_get_uint16(receiver->bytes + 13);
}

// After HOLDFAST_KIND_EVIDENCE, before the next push.
static inline void holdfast_link_evidence(const holdfast_receiver *receiver, holdfast_evidence *evidence) {
  evidence->sequence = holdfast_get_uint16(receiver->bytes + 2);
  evidence->finger = holdfast_get_uint8(receiver->bytes + 4);
  evidence->contact = holdfast_get_uint8(receiver->bytes + 5);
  evidence->evidence = holdfast_get_uint8(receiver->bytes + 6);
  evidence->unit = holdfast_get_uint8(receiver->bytes + 7);
  evidence->run = holdfast_get_uint8(receiver->bytes + 8);
  evidence->patches = holdfast_get_uint16(receiver->bytes + 9);
  evidence->value_milli = holdfast_get_int32(receiver->bytes + 11);
  evidence->threshold_milli = holdfast_get_int32(receiver->bytes + 15);
  evidence->motion_log2_um_q8 = holdfast_get_int16(receiver->bytes + 19);
  evidence->coarse_log2_um_q8 = holdfast_get_int16(receiver->bytes + 21);
  evidence->growth_log2_q8 = holdfast_get_int16(receiver->bytes + 23);
}

// -------------------------------------------------------------------------------------------------- what is sent

// Writes the command's frame; send all HOLDFAST_COMMAND_WIRE bytes. Another command takes another sequence; the same
// frame again asks for the answer again.
static inline void holdfast_link_command(const holdfast_command *command, uint8_t wire[HOLDFAST_COMMAND_WIRE]) {
  uint8_t payload[HOLDFAST_COMMAND_PAYLOAD];
  size_t i, code = 1;
  payload[0] = HOLDFAST_LINK_VERSION;
  payload[1] = HOLDFAST_KIND_COMMAND;
  holdfast_put_uint16(payload + 2, command->sequence);
  holdfast_put_uint8(payload + 4, command->command);
  holdfast_put_uint8(payload + 5, command->argument);
  holdfast_put_uint16(payload + HOLDFAST_COMMAND_PAYLOAD - 2, holdfast_crc16(payload, HOLDFAST_COMMAND_PAYLOAD - 2));
  memset(wire, 0, HOLDFAST_COMMAND_WIRE);
  wire[code] = 1;
  for (i = 0; i < HOLDFAST_COMMAND_PAYLOAD; ++i) {
    if (payload[i] == 0) {
      code = i + 2;
      wire[code] = 1;
    } else {
      wire[i + 2] = payload[i];
      ++wire[code];
    }
  }
}

// Whether this answer is the command's.
static inline int holdfast_link_answers(const holdfast_answer *answer, const holdfast_command *command) {
  return answer->sequence == command->sequence && answer->command == command->command;
}

// -------------------------------------------------------------------------------------------- the receiver's rule

// A frame is late when its lag, by its `timestamp_us`, is more than this above the least so far. The least rises by
// 250 ppm of the time: clocks that differ by 200 ppm never make a healthy link late, and after a silence of S seconds
// a frame may be older by S/4 ms. A delay that was there from the start cannot be seen.
enum {
  HOLDFAST_GRIP_LATE_US = 150000,
  HOLDFAST_GRIP_RISE = 4,               // ms for each us
  HOLDFAST_GRIP_FALL_US = 20000,        // a backlog's lag falls by more from frame to frame
  HOLDFAST_GRIP_SETTLE_MS = 500,        // without such a fall
  HOLDFAST_GRIP_SILENT_MS = 1800000,    // a longer silence may be 2^31 us, which timestamps cannot count
  HOLDFAST_GRIP_LOST = 1000,            // frames; more are rather a device that starts anew
  HOLDFAST_GRIP_FRAME_LEAST_MS = 10,    // between the timestamps of two status frames
  HOLDFAST_GRIP_FRAME_MOST_MS = 150
};

typedef struct {
  uint32_t changed_ms;    // when `alive` changed last
  uint8_t flags;          // of the last frame
  uint8_t known;          // a frame has come: its `alive` can be compared with
  uint8_t fresh;          // `alive` has changed, and was never found too old or late since
  uint8_t settling;       // 0: the least lag is sure; 1: it is new; 2: it is new, and frames are not believed
  uint16_t sequence;      // of the last frame whose lag was looked at
  uint32_t timestamp_us;  // likewise
  uint32_t least_us;      // the least lag
  uint32_t risen_ms;      // up to when it has risen: when that frame came, or less than 4 ms before
  uint32_t settling_ms;   // since when
} holdfast_grip;

// Whether the grip may be taken for good now. Ask as often as you act on it, at least once a day: what was found too
// old stays so until `alive` changes again, even when the clock comes round. A `now_ms` that was read shortly before
// the last frame came, as where an interrupt takes the bytes, is an age of 0.
static inline int holdfast_grip_ok(holdfast_grip *grip, uint32_t now_ms) {
  const uint32_t after = now_ms - grip->changed_ms, before = grip->changed_ms - now_ms;
  if (after >= HOLDFAST_GRIP_FRESH_MS && before >= HOLDFAST_GRIP_FRESH_MS) grip->fresh = 0;
  return grip->fresh && (grip->flags & HOLDFAST_FLAG_GRIP_OK) != 0;
}

static inline int holdfast_grip_begin(holdfast_grip *grip, uint32_t lag_us, uint32_t now_ms, uint8_t settling) {
  grip->least_us = lag_us;
  grip->risen_ms = grip->settling_ms = now_ms;
  grip->settling = settling;
  return settling == 1;
}

// Whether a frame whose `alive` has changed is of now, as far as its timestamp shows. The clocks need not agree: both
// come round at 2^32 us.
static inline int holdfast_grip_in_time(holdfast_grip *grip, const holdfast_status *status, uint32_t now_ms) {
  const uint32_t lag_us = now_ms * 1000u - status->timestamp_us, step_us = status->timestamp_us - grip->timestamp_us;
  const uint32_t frames = (uint16_t)(status->sequence - grip->sequence);
  uint32_t silence_ms = now_ms - grip->risen_ms, above_us, below_us;
  int late, fits, anew, fell;
  if (!grip->known) return holdfast_grip_begin(grip, lag_us, now_ms, 1);
  if (step_us == 0) return grip->settling != 2;  // a hand that goes on without its left finger: it shows nothing
  if (silence_ms >= 0x80000000u) silence_ms = 0;  // `now_ms` of an interrupt before
  if (silence_ms > HOLDFAST_GRIP_SILENT_MS) return holdfast_grip_begin(grip, lag_us, now_ms, 2);
  grip->least_us += silence_ms / HOLDFAST_GRIP_RISE;
  grip->risen_ms += silence_ms / HOLDFAST_GRIP_RISE * HOLDFAST_GRIP_RISE;
  above_us = lag_us - grip->least_us;
  below_us = above_us >= 0x80000000u ? 0u - above_us : 0;
  late = below_us == 0 && above_us > HOLDFAST_GRIP_LATE_US;
  // A link that stalls changes neither the timestamps nor the sequence. A device that starts anew changes both.
  fits = step_us < 0x80000000u && step_us / 1000u >= frames * HOLDFAST_GRIP_FRAME_LEAST_MS &&
         step_us / 1000u <= frames * HOLDFAST_GRIP_FRAME_MOST_MS;
  fell = below_us > (uint32_t)(grip->settling != 0 ? HOLDFAST_GRIP_FALL_US : HOLDFAST_GRIP_LATE_US);
  anew = !fits && (late || frames == 0 || frames > HOLDFAST_GRIP_LOST);
  if (anew || fell) return holdfast_grip_begin(grip, lag_us, now_ms, 2);
  if (below_us > 0) grip->least_us = lag_us;
  if (now_ms - grip->settling_ms >= HOLDFAST_GRIP_SETTLE_MS) grip->settling = 0;
  return !late && grip->settling != 2;
}

// With every status frame. `now_ms`: when it arrived, by a clock of your own that never stands still and wraps at 2^32.
static inline void holdfast_grip_update(holdfast_grip *grip, const holdfast_status *status, uint32_t now_ms) {
  const int changed = ((grip->flags ^ status->flags) & HOLDFAST_FLAG_ALIVE) != 0;
  (void)holdfast_grip_ok(grip, now_ms);
  if (changed || !grip->known) {
    grip->fresh = (uint8_t)(holdfast_grip_in_time(grip, status, now_ms) && grip->known);
    if (grip->fresh) grip->changed_ms = now_ms;
    grip->sequence = status->sequence;
    grip->timestamp_us = status->timestamp_us;
  }
  grip->flags = status->flags;
  grip->known = 1;
}

#endif
