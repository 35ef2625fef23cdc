# SPDX-License-Identifier: Apache-2.0
"""What the daemon notices of what runs beside it: holdfast-mqtt with a broker and TLS, holdfast-ros2 with a DDS peer of
another vendor, and a check for an update from a server with its download, over and over.

    HOLDFAST_BIN=build/sim/bin python3 tests/bench/beside.py [PAIRS]    # 12 pairs of 8 s

holdfastd runs once, on its simulated sensor. By turns all the others are stopped (SIGSTOP) and go on (SIGCONT) for a block
of 100 frames. Told are, of each pair of blocks, the daemon's CPU time a frame beside over alone, with the 95 % interval of the
median; and the time of a frame by the daemon's own `tasks`. Both ends of its link are read here and handed on, by both kinds
of blocks. The last line is for tests/checks/claims.txt. Status 77: something is not installed."""

import glob
import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
import tty
import unittest
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "tests/python"))
sys.path.insert(0, str(SOURCE / "toolchain/python"))
import test_mqtt  # noqa: E402  its broker, certificates and ends
import test_ros2  # noqa: E402
from deadline import DEADLINE_S  # noqa: E402
from holdfast import link  # noqa: E402

BIN = test_mqtt.BIN
PAIRS = int(sys.argv[1]) if len(sys.argv) > 1 else 12
FRAMES = 100


class Beside(test_mqtt.Fleet):
    def others(self):
        """Everything beside the daemon: processes, and the ends that get the link's bytes."""
        ends, paths = [], []
        for _ in range(2):
            end, port = pty.openpty()
            tty.setraw(port)
            os.set_blocking(end, False)
            ends.append(end)
            paths.append(os.ttyname(port))
            self.addCleanup(os.close, port)
        quiet = dict(stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        processes = [self.broker, self.start(self.subscriber("-t", "holdfast/#"), **quiet)]
        processes.append(self.publisher({"HF0001": paths[0]}))
        domain = str(100 + os.getpid() % 120)
        environment = dict(os.environ, CYCLONEDDS_URI=test_ros2.LOOPBACK)
        processes.append(self.start([BIN / "holdfast-ros2", "--domain", domain, "--link", paths[1]], env=environment, **quiet))
        peer = subprocess.Popen([BIN / "fast_dds_peer", domain], stdin=subprocess.PIPE, **quiet)  # ends with its input
        self.addCleanup(peer.wait)
        self.addCleanup(peer.kill)
        self.addCleanup(peer.stdin.close)
        processes.append(peer)
        processes += self.updates(quiet)
        return processes, ends

    def updates(self, quiet):
        """A server with a signed channel, and a board's `pull fetch` that begins again as soon as it has ended."""
        work = Path(self.work.name)
        (work / "ca.pass").write_text("a\n")
        (work / "signer.pass").write_text("b\n")
        own = dict(os.environ, HOLDFAST_CA_PASS=f"file:{work}/ca.pass", HOLDFAST_SIGNER_PASS=f"file:{work}/signer.pass", NO_COLOR="1")
        for name in ("https_proxy", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"):
            own.pop(name, None)

        def make(*command):
            command = [str(part) for part in command]
            done = subprocess.run(command, cwd=SOURCE, env=own, timeout=120, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)

        (SOURCE / "build/image").mkdir(parents=True, exist_ok=True)
        for folder in ("slot", "www", "control", "fetched", "etc"):
            (work / folder).mkdir()
        (work / "slot/root.img").write_bytes(os.urandom(1 << 20))
        (work / "slot/kernel.img").write_bytes(os.urandom(4096))
        (work / "slot/release").write_text("release=2\nversion=0.2.0\nboard=virt\n")
        make("board/image/keys.sh", work / "keys")
        make("board/pull/server_keys.sh", work / "tls", "127.0.0.1")
        make("board/image/bundle.sh", "virt", "--keys", work / "keys", "--slot", work / "slot", "--out", work / "bundle")
        make("board/pull/channel.sh", "virt", work / "www", "--keys", work / "keys", "--bundle", work / "bundle", "--share", "100")
        conf = (SOURCE / "board/image/rauc.conf").read_text().replace("@board@", "virt")
        (work / "etc/system.conf").write_text(conf)
        releases = (SOURCE / "board/image/card/usr/lib/holdfast/releases").read_text()
        (work / "releases").write_text(releases.replace("/etc/rauc/system.conf", f"{work}/etc/system.conf"))
        (work / "release").write_text("version=0.1.0\nrelease=1\nfloor=1\n")
        server = [sys.executable, SOURCE / "tests/e2e/https_server.py", work / "www"]
        server += [work / "tls/server.cert.pem", work / "tls/server.key.pem", work / "control"]
        server = self.start(server, **quiet)
        self.until("the server listens", (work / "control/port").exists)
        port = (work / "control/port").read_text()
        board = dict(own, HOLDFAST_RELEASES=f"{work}/releases", HOLDFAST_KEYRING=f"{work}/keys/keyring.pem")
        board |= dict(HOLDFAST_PULL_CA=f"{work}/tls/pull-ca.pem", HOLDFAST_RELEASE=f"{work}/release", HOLDFAST_NOTE="true")
        board |= dict(HOLDFAST_PULL_FETCHED=f"{work}/fetched", HOLDFAST_PULL_KEPT=f"{work}/kept", HOLDFAST_SERIAL="1")
        board |= dict(HOLDFAST_PULL_URL=f"https://127.0.0.1:{port}", HOLDFAST_PULL_RATE="100M")
        pull = SOURCE / "board/pull/root/usr/lib/holdfast/pull"
        again = f'while dash {pull} fetch; do rm -f "$HOLDFAST_PULL_FETCHED"/bundle-*; echo >>"{work}/pulls"; sleep 1; done'
        # A group of its own, so that its children stop and go on with it.
        loop = self.start(["sh", "-c", again], env=board, start_new_session=True, **quiet)
        self.addCleanup(os.killpg, loop.pid, signal.SIGKILL)
        return [server, loop]

    def measure(self):
        work = Path(self.work.name)
        host, port = work / "host", work / "port"
        command = [BIN / "holdfastd", "--real-time", "--empty", "--host", host, "--link", port]
        self.daemon = self.start(command, stdout=subprocess.DEVNULL)
        self.until("its ports", lambda: host.exists() and port.exists())
        self.console, self.link = os.open(host, os.O_RDWR | os.O_NOCTTY), os.open(port, os.O_RDWR | os.O_NOCTTY)
        for end in (self.console, self.link):
            tty.setraw(end)
            self.addCleanup(os.close, end)
        processes, self.ends = self.others()
        self.receiver, self.frames, self.poor = link.Receiver(), 0, 0
        self.pass_frames(50)
        self.until("an update is fetched", (work / "pulls").exists)
        self.poor = 0  # it has learned its rest
        blocks = {False: [], True: []}
        for pair in range(PAIRS):
            for beside in (pair % 2 == 0, pair % 2 == 1):
                for process in processes:
                    self.send(process, signal.SIGCONT if beside else signal.SIGSTOP)
                self.ask("tasks clear")
                self.pass_frames(5)
                before, start = self.cpu_ns(), self.frames
                self.pass_frames(FRAMES)
                cpu_us = (self.cpu_ns() - before) / (self.frames - start) / 1000
                frame = next(row for row in json.loads(self.ask("tasks json"))["tasks"] if row["task"] == "frame")
                blocks[beside].append(dict(cpu_us=cpu_us, **{key: frame[key] for key in ("p50_us", "p99_9_us", "max_us", "late")}))
        for process in processes:
            self.send(process, signal.SIGCONT)
            self.assertIsNone(process.poll(), process.args)
        self.assertEqual(self.poor, 0)
        ratios = sorted(there["cpu_us"] / alone["cpu_us"] for there, alone in zip(blocks[True], blocks[False]))
        n = len(ratios)
        # Order statistics of the median, by the binomial's normal form.
        low = max(0, int(n / 2 - 0.98 * n**0.5))

        def all_of(key, beside):
            return sorted(block[key] for block in blocks[beside])[n // 2]

        print(f"{n} pairs of {FRAMES} frames, {len((work / 'pulls').read_text())} updates fetched")
        for beside, name in ((False, "alone"), (True, "beside")):
            print(
                f"{name:7} CPU {all_of('cpu_us', beside):7.1f} us a frame; frame p50 {all_of('p50_us', beside)} us, "
                f"p99.9 {all_of('p99_9_us', beside)} us (medians of blocks), longest "
                f"{max(block['max_us'] for block in blocks[beside])} us, late {sum(block['late'] for block in blocks[beside])}"
            )
        print(
            f"beside: {ratios[n // 2]:.3f} ({ratios[low]:.3f}-{ratios[n - 1 - low]:.3f}); "
            f"{all_of('p50_us', True) / all_of('p50_us', False):.2f}; "
            f"{all_of('p99_9_us', True) / all_of('p99_9_us', False):.2f}; "
            f"{sum(block['late'] for block in blocks[True])} of {n * FRAMES}"
        )

    @staticmethod
    def send(process, number):
        try:
            (os.killpg if os.getpgid(process.pid) == process.pid else os.kill)(process.pid, number)
        except ProcessLookupError:
            pass

    def pass_frames(self, count):
        """So many status frames go from the daemon's link to whoever runs beside; each of them has to be fine."""
        wanted, end = self.frames + count, time.monotonic() + DEADLINE_S
        while self.frames < wanted:
            self.assertLess(time.monotonic(), end, "frames")
            select.select([self.link, self.console], [], [], 0.05)
            self.hand_on()

    def hand_on(self):
        if not select.select([self.link], [], [], 0)[0]:
            return
        data = os.read(self.link, 4096)
        for frame in self.receiver.feed(data):
            self.frames += 1
            self.poor += frame.state_name != "OK"
        for end in self.ends:
            try:
                os.write(end, data)
            except BlockingIOError:
                pass  # it is stopped

    def ask(self, line):
        """The answer's first line; frames go on meanwhile."""
        os.write(self.console, b"\r" + line.encode() + b"\r")
        said, end = b"", time.monotonic() + DEADLINE_S
        while not re.search(rb"\nOK\r\n", said.split(line.encode(), 1)[-1]):
            self.assertLess(time.monotonic(), end, line)
            if select.select([self.console], [], [], 0.02)[0]:
                said += os.read(self.console, 65536)
            self.hand_on()
        found = re.search(rb"\{.*\}", said)
        return found.group(0).decode() if found else ""

    def cpu_ns(self):
        """Of all its threads, by the scheduler."""
        tasks = glob.glob(f"/proc/{self.daemon.pid}/task/*/schedstat")
        return sum(int(Path(task).read_text().split()[0]) for task in tasks)


if __name__ == "__main__":
    result = unittest.TextTestRunner(verbosity=0).run(unittest.TestSuite([Beside("measure")]))
    sys.exit(0 if result.wasSuccessful() else 1)
