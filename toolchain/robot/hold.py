#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Says what a board says of the grip, by the receiver's rule: hold.py PORT [--tare]. Python's own library alone."""

import argparse
import os
import select
import sys
import termios
import time
import tty
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "python"))  # not needed where the package is installed
from holdfast.link import Grip, Receiver, answers, command
from holdfast.tables import FRESH_MS


def open_port(path):
    """Raw, 115200 8N1."""
    port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(port, termios.TCSANOW)
    settings = termios.tcgetattr(port)
    settings[2] |= termios.CLOCAL | termios.CREAD
    settings[4] = settings[5] = termios.B115200
    termios.tcsetattr(port, termios.TCSANOW, settings)
    termios.tcflush(port, termios.TCIOFLUSH)  # what waits describes the past
    return port


def read(port, path):
    try:
        data = os.read(port, 4096)
    except OSError:
        data = b""
    if not data:
        sys.exit(f"error: {path} has gone. Likely cause: the cable, or holdfastd ended. Next: plug it in, start again")
    return data


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("port")
    options.add_argument("--tare", action="store_true", help="learn the rest position of the empty gel first")
    given = options.parse_args()
    port = open_port(given.port)
    receiver, grip, said, state = Receiver(), Grip(), None, "(no status frame yet)"
    sequence = int.from_bytes(os.urandom(2), "little")  # another one than before the last start
    asked_ns = 0 if given.tare else None
    turn_ns, late = time.monotonic_ns(), False
    while True:
        now_ns = time.monotonic_ns()
        if asked_ns is not None and now_ns - asked_ns > 100_000_000:  # no answer yet: the same bytes again
            os.write(port, command(sequence, "TARE"))
            asked_ns = now_ns
        ready, _, _ = select.select([port], [], [], 0.005 if late else 0.02)
        data = read(port, given.port) if ready else b""
        now_ns = time.monotonic_ns()
        # Stopped meanwhile: what waits describes the past, up to the first silence. tcflush() would leave what the
        # kernel holds behind a full buffer.
        late = now_ns - turn_ns > FRESH_MS * 1_000_000 or (late and bool(ready))
        turn_ns = now_ns
        if late:
            data, receiver, grip = b"", Receiver(), Grip()
        frames = receiver.feed(data)
        for frame in frames:
            if frame.frame == "status":
                grip.update(frame, now_ns)
                state = frame.state_name
            elif frame.frame == "answer" and answers(frame, sequence, "TARE"):
                print("TARE:", frame.result_name, flush=True)
                asked_ns = None
        says = ("grip ok" if grip.ok(now_ns) else "not confirmed", state)
        if says != said:
            print(*says, flush=True)  # your reaction: hold still when it is not confirmed
            said = says


if __name__ == "__main__":
    main()
