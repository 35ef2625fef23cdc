#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Says what a board says of the grip, by the receiver's rule: hold.py PORT [--tare]. Python's own library alone.
Ctrl-C ends it, with status 0; an error does with status 1."""

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


TARE_ANSWER_NS = 1_500_000_000  # a board answers within 0.1 s


def trouble(what, cause, next_step):
    return f"hold.py: {what}. Likely cause: {cause}. Next: {next_step}"


def open_port(path):
    """Raw, 115200 8N1."""
    listed = "holdfast devices lists the ports"
    try:
        port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except PermissionError:
        to_do = "sudo usermod -aG dialout $USER, and log in again"
        sys.exit(trouble(f"{path} may not be used", "its group is not yours", to_do))
    except IsADirectoryError:
        sys.exit(trouble(f"{path} is no serial port", "a folder was named", listed))
    except (OSError, ValueError) as error:
        why = f"{path} cannot be opened: {getattr(error, 'strerror', None) or error}"
        sys.exit(trouble(why, "a typing error, or the device is not plugged in", listed))
    try:
        tty.setraw(port, termios.TCSANOW)
        settings = termios.tcgetattr(port)
        settings[2] |= termios.CLOCAL | termios.CREAD
        settings[4] = settings[5] = termios.B115200
        termios.tcsetattr(port, termios.TCSANOW, settings)
        termios.tcflush(port, termios.TCIOFLUSH)  # what waits describes the past
    except termios.error:
        sys.exit(trouble(f"{path} is no serial port", "a file or another device was named", listed))
    return port


def gone(path):
    sys.exit(trouble(f"{path} has gone", "the cable, or holdfastd ended", "plug it in, start again"))


def read(port, path):
    try:
        data = os.read(port, 4096)
    except BlockingIOError:
        return b""
    except OSError:
        data = b""
    return data or gone(path)


def write(port, path, data):
    try:
        os.write(port, data)
    except BlockingIOError:
        pass  # it takes nothing now; the next time begins with a delimiter
    except OSError:
        gone(path)


def say(*words):
    try:
        print(*words, flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for what Python flushes at its end
        why = f"standard output cannot be written: {error.strerror}"
        sys.exit(trouble(why, "the program that read it has ended, or a disk is full", "start it again"))


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("port")
    options.add_argument("--tare", action="store_true", help="learn the rest position of the empty gel first")
    given = options.parse_args()
    if sys.stdout is None:
        sys.exit(trouble("standard output is closed", "it was started with >&-", "start it without"))
    port = open_port(given.port)
    receiver, grip, said, state = Receiver(), Grip(), None, "(no status frame yet)"
    sequence = int.from_bytes(os.urandom(2), "little")  # another one than before the last start
    asked_ns = 0 if given.tare else None
    unanswered_ns = time.monotonic_ns() + TARE_ANSWER_NS  # None: said
    turn_ns, late = time.monotonic_ns(), False
    while True:
        now_ns = time.monotonic_ns()
        if asked_ns is not None and now_ns - asked_ns > 100_000_000:  # no answer yet: the same bytes again
            write(port, given.port, command(sequence, "TARE"))
            asked_ns = now_ns
            if unanswered_ns is not None and now_ns > unanswered_ns:
                to_do = "look at the device; this goes on asking, Ctrl-C ends it"
                cause = "holdfastd is not running, the cable, or this is not its port link"
                print(trouble("TARE was not answered", cause, to_do), file=sys.stderr, flush=True)
                unanswered_ns = None
        ready, _, _ = select.select([port], [], [], 0.005 if late else 0.02)
        data = read(port, given.port) if ready else b""
        now_ns = time.monotonic_ns()
        # Stopped meanwhile: what waits describes the past, up to the first silence. tcflush() would leave what the
        # kernel holds behind a full buffer.
        late = now_ns - turn_ns > FRESH_MS * 1_000_000 or (late and bool(ready))
        turn_ns = now_ns
        if late:
            data, receiver, grip = b"", Receiver(), Grip()
            unanswered_ns = unanswered_ns and now_ns + TARE_ANSWER_NS
        frames = receiver.feed(data)
        for frame in frames:
            if frame.frame == "status":
                grip.update(frame, now_ns)
                state = frame.state_name
            elif frame.frame == "answer" and answers(frame, sequence, "TARE"):
                say("TARE:", frame.result_name)
                asked_ns = None
        says = ("grip ok" if grip.ok(now_ns) else "not confirmed", state)
        if says != said:
            say(*says)  # your reaction: hold still when it is not confirmed
            said = says


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
