# SPDX-License-Identifier: Apache-2.0
# Written by wire_doc from firmware/link/{link,status_frame,command_frame,marker_frame,evidence_frame,load_frame}.hpp and firmware/base/status.hpp; do not edit.
"""Numbers and layouts of the frames on serial."""

VERSION = 1  # of what is sent
LAST_VERSION = 8  # a second byte above it begins no frame
MAX_WIRE_BYTES = 37
FRESH_MS = 150  # the receiver's rule

# (version, kind): name, bytes of the payload, fields as (name, byte, type)
FRAMES = {
    (1, 1): (
        "status",
        32,
        (
            ("version", 0, "u8"),  # -; layout of this table: 1
            ("kind", 1, "u8"),  # -; 1: status frame
            ("sequence", 2, "u16"),  # 1; counts status frames, wraps; a gap is a lost frame
            ("timestamp_us", 4, "u32"),  # us; start of the picture's exposure on the sensor's clock, low 32 bits
            ("age_100us", 8, "u16"),  # 0.1 ms; from that start to the sending of this frame, rounded up; 65535: 6.5535 s or more, or unknown
            ("state", 10, "u8"),  # -; see States
            ("reason", 11, "u8"),  # -; see Reasons; a number not listed there comes from newer firmware
            ("flags", 12, "u8"),  # bits; see Flags
            ("markers", 13, "u8"),  # 1; how many markers the features stand on
            ("vx_um_s", 14, "i32"),  # um/s; mean speed of the markers, +x right
            ("vy_um_s", 18, "i32"),  # um/s; mean speed of the markers, +y down
            ("entropy_nat_q16", 22, "i32"),  # nat/65536; entropy of the displacements' lengths, 0 to ln 15
            ("entropy_rate_nat_s_q8", 26, "i32"),  # nat/s/256; change of the entropy per second
            ("crc16", 30, "u16"),  # -; CRC-16 over bytes 0 to 29
        ),
    ),
    (2, 1): (
        "status",
        35,
        (
            ("version", 0, "u8"),  # -; layout of this table: 2
            ("kind", 1, "u8"),  # -; 1: status frame
            ("sequence", 2, "u16"),  # 1; counts status frames, wraps; a gap is a lost frame
            ("timestamp_us", 4, "u32"),  # us; start of the picture's exposure on the sensor's clock, low 32 bits
            ("age_100us", 8, "u16"),  # 0.1 ms; from that start to the sending of this frame, rounded up; 65535: 6.5535 s or more, or unknown
            ("state", 10, "u8"),  # -; see States
            ("reason", 11, "u8"),  # -; see Reasons; a number not listed there comes from newer firmware
            ("flags", 12, "u8"),  # bits; see Flags
            ("markers", 13, "u8"),  # 1; how many markers the features stand on
            ("vx_um_s", 14, "i32"),  # um/s; mean speed of the markers, +x right
            ("vy_um_s", 18, "i32"),  # um/s; mean speed of the markers, +y down
            ("entropy_nat_q16", 22, "i32"),  # nat/65536; entropy of the displacements' lengths, 0 to ln 15
            ("entropy_rate_nat_s_q8", 26, "i32"),  # nat/s/256; change of the entropy per second
            ("fingers", 30, "u8"),  # bits; fingers that there are: bit 0 left, bit 1 right
            ("healthy", 31, "u8"),  # bits; of these, in state OK or SLIP by what each sees alone
            ("contact", 32, "u8"),  # bits; of these, with something that touches the gel
            ("crc16", 33, "u16"),  # -; CRC-16 over bytes 0 to 32
        ),
    ),
    (1, 2): (
        "command",
        8,
        (
            ("version", 0, "u8"),  # -; layout of this table: 1
            ("kind", 1, "u8"),  # -; 2: command frame
            ("sequence", 2, "u16"),  # 1; chosen by the sender, another one for each new command; comes back in the answer
            ("command", 4, "u8"),  # -; see Commands
            ("argument", 5, "u8"),  # -; see Commands
            ("crc16", 6, "u16"),  # -; CRC-16 over bytes 0 to 5
        ),
    ),
    (1, 3): (
        "answer",
        8,
        (
            ("version", 0, "u8"),  # -; layout of this table: 1
            ("kind", 1, "u8"),  # -; 3: answer frame
            ("sequence", 2, "u16"),  # 1; of the command
            ("command", 4, "u8"),  # -; of the command
            ("result", 5, "u8"),  # -; see Results; a number not listed there comes from newer firmware
            ("crc16", 6, "u16"),  # -; CRC-16 over bytes 0 to 5
        ),
    ),
    (1, 4): (
        "displacement",
        30,
        (
            ("version", 0, "u8"),  # -; layout of this table: 1
            ("kind", 1, "u8"),  # -; 4: displacement, 5: rest position
            ("sequence", 2, "u16"),  # 1; of the status frame of the same picture
            ("rows", 4, "u8"),  # 1; of the lattice
            ("cols", 5, "u8"),  # 1; of the lattice
            ("first", 6, "u8"),  # 1; row * cols + col of the first of the five markers
            ("valid", 7, "u8"),  # bits; bit k: marker first + k is seen and has a rest position; its x and y are 0 otherwise
            ("x0_um", 8, "i16"),  # um; kind 4: displacement from rest; kind 5: rest position from the middle of all; +x right
            ("y0_um", 10, "i16"),  # um; likewise, +y down
            ("x1_um", 12, "i16"),  # um; marker first + 1
            ("y1_um", 14, "i16"),  # um; 
            ("x2_um", 16, "i16"),  # um; marker first + 2
            ("y2_um", 18, "i16"),  # um; 
            ("x3_um", 20, "i16"),  # um; marker first + 3
            ("y3_um", 22, "i16"),  # um; 
            ("x4_um", 24, "i16"),  # um; marker first + 4
            ("y4_um", 26, "i16"),  # um; 
            ("crc16", 28, "u16"),  # -; CRC-16 over bytes 0 to 27
        ),
    ),
    (1, 5): (
        "rest",
        30,
        (
            ("version", 0, "u8"),  # -; layout of this table: 1
            ("kind", 1, "u8"),  # -; 4: displacement, 5: rest position
            ("sequence", 2, "u16"),  # 1; of the status frame of the same picture
            ("rows", 4, "u8"),  # 1; of the lattice
            ("cols", 5, "u8"),  # 1; of the lattice
            ("first", 6, "u8"),  # 1; row * cols + col of the first of the five markers
            ("valid", 7, "u8"),  # bits; bit k: marker first + k is seen and has a rest position; its x and y are 0 otherwise
            ("x0_um", 8, "i16"),  # um; kind 4: displacement from rest; kind 5: rest position from the middle of all; +x right
            ("y0_um", 10, "i16"),  # um; likewise, +y down
            ("x1_um", 12, "i16"),  # um; marker first + 1
            ("y1_um", 14, "i16"),  # um; 
            ("x2_um", 16, "i16"),  # um; marker first + 2
            ("y2_um", 18, "i16"),  # um; 
            ("x3_um", 20, "i16"),  # um; marker first + 3
            ("y3_um", 22, "i16"),  # um; 
            ("x4_um", 24, "i16"),  # um; marker first + 4
            ("y4_um", 26, "i16"),  # um; 
            ("crc16", 28, "u16"),  # -; CRC-16 over bytes 0 to 27
        ),
    ),
    (1, 6): (
        "evidence",
        27,
        (
            ("version", 0, "u8"),  # -; layout of this table: 1
            ("kind", 1, "u8"),  # -; 6: evidence frame
            ("sequence", 2, "u16"),  # 1; of the status frame that came before it
            ("finger", 4, "u8"),  # -; 0: left, or the only one; 1: right
            ("contact", 5, "u8"),  # -; see Contact
            ("evidence", 6, "u8"),  # -; what decided, or is the strongest while nothing slips; see Evidence
            ("unit", 7, "u8"),  # -; of value and threshold; see Units
            ("run", 8, "u8"),  # 1; frames in a row that said slip; counts up to the parameter `raise_frames`
            ("patches", 9, "u16"),  # 1; patches of the gel into which something is pressed
            ("value_milli", 11, "i32"),  # unit/1000; of the evidence, in thousandths; cut where it does not fit
            ("threshold_milli", 15, "i32"),  # unit/1000; the model's first one for it, likewise
            ("motion_log2_um_q8", 19, "i16"),  # log2(um)/256; motion of the relief; 0: none
            ("coarse_log2_um_q8", 21, "i16"),  # log2(um)/256; motion of what is smoother or finer; 0: none
            ("growth_log2_q8", 23, "i16"),  # log2/256; of the relief since the picture that it is compared with
            ("crc16", 25, "u16"),  # -; CRC-16 over bytes 0 to 24
        ),
    ),
    (1, 7): (
        "load",
        17,
        (
            ("version", 0, "u8"),  # -; layout of this table: 1
            ("kind", 1, "u8"),  # -; 7: load frame
            ("sequence", 2, "u16"),  # 1; of the status frame that came before it
            ("finger", 4, "u8"),  # -; 0: left, or the only one; 1: right
            ("basis", 5, "u8"),  # -; what the forces stand on; see Basis
            ("flags", 6, "u8"),  # bits; see Load flags
            ("shear_x_mn", 7, "i16"),  # mN; force that the object lays on the gel, +x right
            ("shear_y_mn", 9, "i16"),  # mN; likewise, +y down
            ("normal_mn", 11, "i16"),  # mN; into the gel; below 0 by noise
            ("friction_use_permille", 13, "u16"),  # 1/1000; shear over normal load; 0: less than 200 mN press
            ("crc16", 15, "u16"),  # -; CRC-16 over bytes 0 to 14
        ),
    ),
}

FLAGS = {  # name: bit
    "slip": 0,  # the debounced decision: the object slips
    "grip_ok": 1,  # level of the line GRIP_OK; counts only while ALIVE is fresh
    "features_valid": 2,  # markers and features belong to this frame; otherwise they are 0
    "alive": 3,  # level of the line ALIVE; toggles once per accepted frame
}

STATES = {
    0: "BOOT",  # started, no frame accepted yet
    1: "REFERENCE",  # learning the rest position of the markers on the empty gel
    2: "OK",  # healthy, referenced and no slip
    3: "SLIP",  # the object slips: tighten
    4: "DEGRADED",  # measuring, but not well enough to confirm the grip
    5: "FAULT",  # cannot measure: hold the grip and look at the reason
}

# name, what, likely cause, next step
REASONS = {
    0: ("none", "nothing to report", "-", "-"),
    1: ("no_frame", "no frame arrived in time", "the camera stalls or the USB bus is overloaded", "check the cable and give the sensor a USB port of its own"),
    2: ("camera_gone", "the camera ended the stream", "sensor unplugged, or end of a recording", "plug the sensor in again"),
    3: ("jpeg_damaged", "the JPEG picture is damaged", "USB payload lost on the way", "check the cable; single frames are skipped on purpose"),
    4: ("frame_format", "the frame changed size or format", "another camera, or a file of mixed pictures", "use one sensor and one size for the whole run"),
    5: ("gpio_failed", "an output line could not be set", "the line is used by another process", "check the wiring table of the board and who else holds the line"),
    6: ("frame_frozen", "the camera sends the same picture again and again", "the sensor or its driver hangs while the stream goes on", "unplug the sensor and plug it in again"),
    7: ("capture_hung", "the output watchdog found no accepted frame in time", "the thread that reads the camera hangs in the driver, or the board is overloaded", "restart holdfastd if it does not recover; give the sensor a USB port of its own"),
    8: ("camera_wrong", "a different sensor is connected than at the start", "a second sensor, or one that looks alike, was plugged in", "plug the first sensor in again, or restart holdfastd"),
    32: ("too_few_dots", "too few dark dots in the picture", "no marker gel, lens covered, or light off", "look at the picture; use a gel with printed dots"),
    33: ("no_lattice", "the dots do not form a lattice", "not a marker gel, or the picture is torn or badly blurred", "look at the picture; clean the gel"),
    34: ("grid_mismatch", "the lattice found has another size than configured", "another grid was given, or rows are cut off by the picture's edge", "give the printed grid: grid_cols and grid_rows of a device, --grid of a recording"),
    35: ("grid_ambiguous", "the lattice is larger than configured", "the gel has more rows or columns than the grid that was given", "give the printed grid: grid_cols and grid_rows of a device, --grid of a recording"),
    36: ("markers_lost", "too many markers are lost", "gel torn or dirty, or object off the gel", "release, clean the gel, and learn the reference again"),
    37: ("picture_too_small", "the picture is too small to hold the markers", "not a GelSight recording, or scaled down too far", "use a picture of at least 320x240 pixels"),
    38: ("picture_too_large", "the picture is larger than the fixed memory", "a faster mode is needed for this camera", "use mode fast or balanced"),
    39: ("dots_overflow", "too many blobs in the picture", "heavy noise, dirt, or a texture instead of a gel", "clean the gel; check exposure and gain"),
    40: ("exposure", "the picture is too dark or too bright", "light off, lens covered, or exposure and gain not as set", "check the sensor's light; set manual exposure"),
    41: ("camera_controls", "the camera does not take its settings of brightness or frame rate", "another program sets them, or another firmware of the sensor", "end the other program and plug the sensor in again; the log names the settings"),
    64: ("time_not_forward", "the frame is not newer than the one before", "camera timestamps stand still or run backwards", "restart the stream; report the camera's driver"),
    65: ("time_gap", "too long since the frame before", "frames were dropped or the machine stalled", "rates start again with this frame; look for overload if it repeats"),
    66: ("frame_stale", "the frame is too old to confirm the grip", "frames queue up: overload", "close what else loads the board; use a faster mode"),
    67: ("frame_rate", "frames come slower or faster than the sensor's 15 to 27 fps", "automatic exposure halves the rate, or the USB bus is overloaded", "set manual exposure; use another USB port"),
    68: ("deadline", "more than 1 % of the frames of the last 10 s were decided late", "the board is too hot, throttled or busy", "close what else loads the board, cool it, or use a faster mode"),
    69: ("frame_unstamped", "the frame has no usable time stamp: nobody knows how old it is", "the camera's driver does not stamp by the monotonic clock", "use the kernel's uvcvideo for the sensor"),
    96: ("few_markers", "some markers are lost", "dirt on the gel or strong shear at the edge", "clean the gel if it persists with an empty gripper"),
    97: ("learning", "the rest position is being learned", "start or TARE", "keep the gel empty until the state changes"),
    98: ("slip", "the object slips", "too little grip force", "tighten"),
    99: ("many_rejected", "more than 3 of the last 10 frames were rejected or did not come", "USB payload lost on the way, or a camera below 10 frames a second", "check the cable and the sensor's frame rate; look at the counters of rejected frames"),
    100: ("recovering", "a fault has passed; a few good frames must follow", "the camera, the gripper or holdfastd came back", "wait; look at the fault before it if it repeats"),
    101: ("needs_arm", "a fault has passed and is latched", "the setting `latch` asks for a command", "look at what happened, then send ARM"),
    102: ("opening", "the gripper opens: loss of contact is no slip", "OPENING was commanded", "end OPENING when the gripper has opened; it ends itself after opening_max_ms"),
    103: ("force_limit", "the object slips and the grip force is at its limit", "object too heavy or too smooth for the limit", "lower the load, or raise max_force if the object bears it"),
    104: ("contact_lost", "the contact ended without OPENING", "the object fell or was pulled away", "look for the object; send OPENING before the gripper opens on purpose"),
    105: ("light_changed", "the light changed while the rest position was being learned: that begins anew", "the camera's exposure settles after its start, or follows the picture", "keep the gel empty and wait; if it stays, set manual exposure and check the sensor's light"),
    106: ("reference_loaded", "the lattice of the markers is bent: it was refused as rest position", "something pressed on the gel while its rest position was being learned", "open the gripper and wait; if the gel is empty all the same, send TARE once more"),
    128: ("config", "settings or the model are lost, damaged or out of range", "the power was cut while they were written, the card wears, or they are of another version or another owner", "give `stored` at the console: it shows each record; then load or save them again, or give `stored accept`; with an owner, load what the owner signed"),
    160: ("gripper_silent", "the gripper does not answer", "cable, power, or another slave number or baud rate", "check the gripper's power and RS-485 wiring; slave 9, 115200 8N1"),
    161: ("gripper_reply", "the gripper's replies are damaged", "noise on the line, no termination, or two masters", "check the termination (120 ohm) and that nobody else polls"),
    162: ("gripper_activating", "the gripper is being activated", "start, or recovery from a gripper fault", "wait until its fingers have moved; keep them free"),
    163: ("gripper_hot", "the gripper is too hot", "long grasps at high force", "let it cool; lower the force"),
    164: ("gripper_lost", "the gripper's fingers closed on nothing", "the object was lost or never between the fingers", "pick the object up again"),
    165: ("gripper_undervoltage", "the gripper's supply voltage is too low", "weak supply or long thin wires", "check the 24 V supply, then send ARM"),
    166: ("gripper_releasing", "the gripper's automatic release is running", "someone commanded the emergency release", "wait until it has ended, then send ARM"),
    167: ("gripper_internal", "the gripper reports an internal fault", "hardware of the gripper", "send ARM; call its maker if it comes back"),
    168: ("gripper_activation", "the gripper's activation failed", "fingers blocked while they were measured", "free the fingers, then send ARM"),
    169: ("gripper_overcurrent", "the gripper's motor took too much current", "fingers blocked or object too stiff at this speed", "free the fingers, then send ARM"),
    170: ("gripper_released", "the gripper's automatic release has ended", "someone commanded the emergency release", "send ARM: the gripper is activated anew"),
    192: ("board_undervoltage", "the board's supply voltage is too low", "weak supply, long thin cable, or too much on its USB ports", "use the board's own supply (Raspberry Pi 4: 5.1 V, 3 A) and a short cable"),
}

COMMANDS = {
    "TARE": 1,  # forget the rest position of the markers and learn it anew; argument: 0: only while nothing touches the gel; 1: even then
    "OPENING": 2,  # the gripper opens: loss of contact is no slip, for `opening_max_ms` at most; argument: 1: begins; 0: has ended
    "RELEASE": 3,  # lower the grip force step by step, to let the object go; argument: 0
    "ARM": 4,  # leave a latched fault; activates the gripper anew; argument: 0
    "GRIP": 5,  # move the gripper; argument: 1: close and hold with the starting force; 0: open
}

# name, meaning
RESULTS = {
    0: ("done", "taken; what comes of it is in the status frames"),
    1: ("touching", "refused: something touches the gel"),
    2: ("state", "refused: no gripper is set up"),
    3: ("unknown", "refused: this firmware does not know the command"),
    4: ("argument", "refused: the argument is out of the command's range"),
    5: ("locked", "refused: this is the console's port, and it is locked"),
    6: ("overdue", "refused: OPENING lasted for `opening_max_ms` and was not ended"),
}

CONTACTS = {
    0: "EMPTY",  # nothing touches the gel
    1: "TOUCHING",  # something touches the gel, and the contact grows
    2: "HELD",  # something touches the gel, and the contact does not grow
    255: "UNKNOWN",  # nobody can tell: the model does not read the picture between the markers
}

EVIDENCES = {
    0: "none",  # there is none to show
    1: "imprint",  # motion of the relief that the object presses into the gel
    2: "coarse",  # motion of what is smoother or finer than the relief
    3: "markers",  # a feature of the markers
    4: "contact",  # the contact was lost: the patches of relief that are left
    5: "turnover",  # share of the relief that another has taken the place of
}

BASES = {
    0: "none",  # no reading: another lattice or pitch, or too many markers are missing
    1: "uncalibrated",  # of a gel of 35 kPa, as the simulator has it: no weight was used
    2: "one_weight",  # of this gel, by a weight for shear or for the normal load; the other has its scale
    3: "two_weights",  # of this gel, by a weight for each
}

UNITS = (
    "-",
    "um",
    "um/s",
    "nat",
    "nat/s",
    "log2",
    "1e-6/s",
    "1",
    "patches",
    "%",
)
