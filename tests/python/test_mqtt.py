# SPDX-License-Identifier: Apache-2.0
"""holdfast-mqtt at a real mosquitto on loopback, with TLS and the configuration of toolchain/mqtt. One board is
holdfastd, the others are pseudo terminals. HOLDFAST_FLEET=500 is the number of boards (5), 100 to a process."""

import binascii
import json
import os
import re
import resource
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import tty
import unittest
import urllib.request
from pathlib import Path

from deadline import DEADLINE_S

SOURCE = Path(__file__).resolve().parents[2]
BIN = Path(os.environ["HOLDFAST_BIN"])
FLEET = int(os.environ.get("HOLDFAST_FLEET", "5"))
PER_PROCESS = 100
QUEUE, IN_FLIGHT = 20, 10
MOSQUITTO = shutil.which("mosquitto", path=os.environ["PATH"] + ":/usr/sbin")

NEEDED = {
    "mosquitto": MOSQUITTO,
    "mosquitto-clients": shutil.which("mosquitto_sub"),
    "openssl": shutil.which("openssl"),
}
for name, there in NEEDED.items():
    if not there:
        print(f"SKIPPED: no {name}. Next: tests/run.sh --only packages")
        sys.exit(77)
if not (BIN / "holdfast-mqtt").exists():
    print("SKIPPED: holdfast-mqtt was not built, without libmosquitto-dev. Next: tests/run.sh --only packages")
    sys.exit(77)

OK, SLIP, FAULT = (2, 0, True), (3, 98, False), (5, 1, False)  # state, reason, grip_ok


def frame(sequence, state, reason, grip_ok):
    """A status frame by LINK.md, its CRC and COBS by Python's own library."""
    flags = (state == 3) | grip_ok << 1 | (sequence & 1) << 3
    body = struct.pack("<BBHIHBBBB4i", 1, 1, sequence & 0xFFFF, sequence, 400, state, reason, flags, 0, 0, 0, 0, 0)
    body += struct.pack("<H", binascii.crc_hqx(body, 0xFFFF))
    return b"".join(bytes([len(run) + 1]) + run for run in body.split(b"\0")) + b"\0"


class Pretended:
    """A board as a pseudo terminal: a frame every 80 ms."""

    def __init__(self):
        self.end, self.port = os.openpty()
        tty.setraw(self.port)
        os.set_blocking(self.end, False)
        self.path, self.state, self.sequence, self.talks = os.ttyname(self.port), OK, 0, True

    def say(self):
        self.sequence += 1
        try:
            os.write(self.end, frame(self.sequence, *self.state))
        except BlockingIOError:
            pass  # nobody reads yet

    def close(self):
        os.close(self.end)
        os.close(self.port)


class Fleet(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, max(soft, 8 * FLEET + 200)), hard))
        cls.certificates = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.certificates.cleanup)
        new = "req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes"
        for name in ("ca", "other"):
            cls.openssl(f"{new} -x509 -days 2 -subj /CN={name} -keyout {name}.key -out {name}.pem")
        Path(cls.certificates.name, "names").write_text("subjectAltName=DNS:localhost\n")
        for name in ("broker", "gateway", "reader", "HF0001", "stranger"):
            by = "other" if name == "stranger" else "ca"
            sign = f"x509 -req -CA {by}.pem -CAkey {by}.key -days 2 -extfile names"
            cls.openssl(f"{new} -subj /CN={name} -keyout {name}.key -out {name}.csr")
            cls.openssl(f"{sign} -in {name}.csr -out {name}.pem")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            cls.broker_port = free.getsockname()[1]

    @classmethod
    def openssl(cls, words):
        command = ["openssl", *words.split()]
        subprocess.run(command, check=True, cwd=cls.certificates.name, capture_output=True, timeout=60)

    def setUp(self):
        self.work = tempfile.TemporaryDirectory()
        self.addCleanup(self.work.cleanup)
        self.fed, self.feeding = [], True
        feeder = threading.Thread(target=self.feed)
        feeder.start()
        self.addCleanup(feeder.join)
        self.addCleanup(setattr, self, "feeding", False)
        conf = (SOURCE / "toolchain/mqtt/mosquitto.conf").read_text()
        conf = conf.replace("listener 8883", f"listener {self.broker_port} 127.0.0.1")
        conf = conf.replace("/etc/mosquitto/certs", self.certificates.name)
        conf = conf.replace("/var/lib/mosquitto/", self.work.name + "/")
        conf = conf.replace("/etc/mosquitto", str(SOURCE / "toolchain/mqtt")) + "user root\n"
        Path(self.work.name, "conf").write_text(conf)
        self.start_broker()

    def feed(self):
        while self.feeding:
            for board in list(self.fed):
                if board.talks:
                    board.say()
            time.sleep(0.08)

    def start(self, command, **more):
        process = subprocess.Popen([str(part) for part in command], stdin=subprocess.DEVNULL, **more)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        return process

    def start_broker(self):
        log = open(Path(self.work.name, "broker.log"), "ab")
        self.addCleanup(log.close)
        self.broker = self.start([MOSQUITTO, "-c", f"{self.work.name}/conf"], stdout=log, stderr=log)
        self.until("the broker answers", self.answers)

    def answers(self):
        try:
            socket.create_connection(("127.0.0.1", self.broker_port), 1).close()
            return True
        except OSError:
            return False

    def secured(self, name):
        own = f"{self.certificates.name}/{name}"
        return ["--cert", f"{own}.pem", "--key", f"{own}.key"]

    def subscriber(self, *more):
        ca = f"{self.certificates.name}/ca.pem"
        command = [
            "mosquitto_sub",
            "-h",
            "localhost",
            "-p",
            self.broker_port,
            "--cafile",
            ca,
            *self.secured("reader"),
            *more,
        ]
        return [str(part) for part in command]

    def publisher(self, boards, name="gateway", *more):
        log = open(Path(self.work.name, "publisher.log"), "ab")
        self.addCleanup(log.close)
        command = [BIN / "holdfast-mqtt", "--broker-port", self.broker_port, "--queue", QUEUE, "--every", "1"]
        command += ["--ca", f"{self.certificates.name}/ca.pem", *self.secured(name), *more]
        return self.start(command + [f"{serial}={path}" for serial, path in boards.items()], stderr=log)

    def until(self, what, holds):
        end = time.monotonic() + DEADLINE_S
        while not holds():
            self.assertLess(time.monotonic(), end, what)
            time.sleep(0.05)

    def retained(self):
        """What the broker has, by topic."""
        seconds = 2 if FLEET < 100 else 5
        command = self.subscriber("-t", "holdfast/+/+", "--retained-only", "-W", seconds, "-F", "%t %p")
        said = subprocess.run(command, capture_output=True, text=True, timeout=60).stdout
        return {topic: json.loads(payload) for topic, payload in (line.split(" ", 1) for line in said.splitlines())}

    def until_retained(self, what, wanted):
        """Until every one of `wanted`, (topic, key, value), is what the broker has; returns all that it has."""
        end = time.monotonic() + DEADLINE_S
        while True:
            has = self.retained()
            lacks = [(topic, key, value) for topic, key, value in wanted if has.get(topic, {}).get(key) != value]
            if not lacks:
                return has
            self.assertLess(
                time.monotonic(), end, f"{what}: not yet {lacks[:3]} of {len(lacks)}; {has.get(lacks[0][0])}"
            )

    def pretended(self, count):
        boards = {f"HF{k:04}": Pretended() for k in range(1, count + 1)}
        for board in boards.values():
            self.addCleanup(board.close)
        self.addCleanup(self.fed.clear)
        self.fed += boards.values()
        return boards

    def test_a_fleet_through_the_end_of_its_broker(self):
        boards = self.pretended(FLEET - 1)
        ports = {serial: board.path for serial, board in boards.items()}
        real = Path(self.work.name, "link")
        daemon = self.start([BIN / "holdfastd", "--real-time", "--empty", "--link", real], stdout=subprocess.DEVNULL)
        ports["real"] = real
        serials = list(ports)
        publishers = []
        for at in range(0, len(serials), PER_PROCESS):
            some = {serial: ports[serial] for serial in serials[at : at + PER_PROCESS]}
            publishers.append(self.publisher(some, "gateway", "--firmware", "0.1.0"))
        fine = [(f"holdfast/{s}/online", "online", 1) for s in serials]
        fine += [(f"holdfast/{s}/state", "heard", 1) for s in serials]
        fine += [(f"holdfast/{s}/state", "state", "OK") for s in serials]
        fine += [(f"holdfast/{s}/version", "firmware", "0.1.0") for s in serials]
        has = self.until_retained("all are fine", fine + [("holdfast/real/state", "confirmed", 1)])
        self.assertEqual(len(has), 4 * len(serials))
        self.assertGreater(has["holdfast/HF0001/counters"]["frames"], 0)
        self.assertEqual(has["holdfast/HF0001/version"]["link"], 1)

        # A slip, a silence, a board that is unplugged.
        boards["HF0001"].state = SLIP
        boards["HF0002"].talks = False
        daemon.kill()
        slipped = [("holdfast/HF0001/state", "reason", "slip"), ("holdfast/HF0001/state", "slip", 1)]
        silent = [(f"holdfast/{s}/state", key, 0) for s in ("HF0002", "real") for key in ("heard", "confirmed")]
        self.until_retained("what happened", slipped + silent)
        boards["HF0002"].talks = True

        # The broker is killed and forgets all; meanwhile every board changes, one of them more often than fits the queue.
        self.broker.kill()
        self.broker.wait()
        Path(self.work.name, "mosquitto.db").unlink(missing_ok=True)
        busy = boards["HF0001"]
        busy.talks = False
        time.sleep(0.1)  # the feeder has gone past it
        os.set_blocking(busy.end, True)
        memory = self.memory(publishers[0])
        changes = 2000
        for k in range(changes):
            busy.state = SLIP if k % 2 else OK
            busy.say()
        busy.state, busy.talks = FAULT, True
        for serial, board in boards.items():
            board.state = FAULT
        collected = Path(self.work.name, "collected")
        self.start_broker()
        with open(collected, "wb") as file:
            self.start(self.subscriber("-t", "holdfast/HF0001/state", "-F", "%p"), stdout=file)
        new = [(f"holdfast/{s}/online", "online", 1) for s in serials]
        new += [(f"holdfast/{s}/state", "state", "FAULT") for s in boards]
        new += [(f"holdfast/{s}/version", "link", 1) for s in serials]
        has = self.until_retained("nothing is lost", new)
        counted = has["holdfast/HF0001/counters"]
        self.assertGreaterEqual(counted["changes"], changes)
        self.assertEqual(counted["connects"], 2)
        # What waited in the queue, what was in flight, and the state that is told with a new connection.
        sent = counted["changes"] - counted["dropped"]
        self.assertGreaterEqual(counted["dropped"], changes - QUEUE - IN_FLIGHT - 1)
        told = [json.loads(line) for line in collected.read_text().splitlines()]
        self.assertLessEqual(len(told), sent + IN_FLIGHT + 2)
        times = [one["time"] for one in told]
        self.assertEqual(times, sorted(times))
        self.assertLess(self.memory(publishers[0]) - memory, 4_000_000)
        self.assertEqual([p.poll() for p in publishers], [None] * len(publishers))

        # Killed: the broker tells the will. Ended in order: it is told by themselves.
        publishers[0].kill()
        self.until_retained("the last will", [(f"holdfast/{s}/online", "online", 0) for s in serials[:PER_PROCESS]])
        for publisher in publishers[1:]:
            publisher.send_signal(signal.SIGTERM)
            self.assertEqual(publisher.wait(DEADLINE_S), 0)
        self.until_retained("all have gone", [(f"holdfast/{s}/online", "online", 0) for s in serials])

    @staticmethod
    def memory(process):
        status = Path(f"/proc/{process.pid}/status").read_text()
        return 1024 * int(re.search(r"VmRSS:\s+(\d+)", status)[1])

    @unittest.skipUnless(shutil.which("prometheus-mqtt-exporter"), "no prometheus-mqtt-exporter")
    def test_prometheus_reads_it(self):
        board = self.pretended(1)["HF0001"]
        self.publisher({"HF0001": board.path}, "HF0001")
        conf = (SOURCE / "toolchain/mqtt/exporter.yaml").read_text()
        conf = conf.replace("localhost:8883", f"localhost:{self.broker_port}").replace(
            "/etc/mosquitto/certs", self.certificates.name
        )
        Path(self.work.name, "exporter").write_text(conf)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        exporter = [
            "prometheus-mqtt-exporter",
            "-config",
            f"{self.work.name}/exporter",
            "-listen-address",
            "127.0.0.1",
            "-listen-port",
            str(port),
        ]
        self.start(exporter, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        def metrics():
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5) as page:
                    text = page.read().decode()
            except OSError:
                return {}
            return {
                name: float(value)
                for name, value in re.findall(r'^holdfast_(\w+)\{sensor="HF0001",[^}]*\} (\S+)', text, re.M)
            }

        fine = {"online": 1, "heard": 1, "confirmed": 1, "slip": 0, "state": 2, "reason": 0, "slips_total": 0}
        self.until("fine", lambda: fine.items() <= metrics().items() and metrics().get("frames_total", 0) > 0)
        board.state = SLIP
        self.until(
            "a slip",
            lambda: {"slip": 1, "state": 3, "reason": 98, "slips_total": 1, "confirmed": 0}.items()
            <= metrics().items(),
        )
        names = set(re.findall(r"prom_name: holdfast_(\w+)", conf))
        self.assertEqual(set(metrics()), names)

    def test_ends_in_order(self):
        publisher = self.publisher({"HF0001": self.pretended(1)["HF0001"].path}, "HF0001")
        self.until_retained("online", [("holdfast/HF0001/online", "online", 1)])
        publisher.send_signal(signal.SIGTERM)
        self.assertEqual(publisher.wait(DEADLINE_S), 0)
        self.assertEqual(self.retained()["holdfast/HF0001/online"]["online"], 0)
        self.until(
            "the broker's word",
            lambda: "holdfast-HF0001 disconnected" in Path(self.work.name, "broker.log").read_text(),
        )

    def test_a_board_writes_its_own_topics_alone(self):
        boards = self.pretended(2)
        self.publisher({"HF0002": boards["HF0002"].path}, "HF0001")
        self.publisher({"HF0001": boards["HF0001"].path}, "HF0001")
        log = Path(self.work.name, "broker.log")
        self.until(
            "both have connected",
            lambda: {"holdfast-HF0001", "holdfast-HF0002"} <= set(re.findall(r" as (\S+)", log.read_text())),
        )
        has = self.until_retained(
            "its own", [("holdfast/HF0001/online", "online", 1), ("holdfast/HF0001/state", "heard", 1)]
        )
        self.assertEqual({topic.split("/")[1] for topic in has}, {"HF0001"})

    def test_a_board_that_was_started_anew_is_asked_again(self):
        """Its console streams nothing then, and its adapter has not hung up."""
        (board,) = self.pretended(1).values()
        board.talks = False

        def asked():
            try:
                return b"watch on" in os.read(board.end, 4096)
            except BlockingIOError:
                return False

        self.publisher({"HF0001": board.path}, "gateway", "--console")
        self.until("it asks", asked)
        board.talks = True
        self.until_retained("it hears", [("holdfast/HF0001/state", "heard", 1)])
        self.assertFalse(asked())
        board.talks = False
        self.until("it asks again", asked)

    def test_a_stranger_is_refused_and_refuses_a_strange_broker(self):
        board = self.pretended(1)["HF0001"]
        said = Path(self.work.name, "publisher.log")
        self.publisher({"HF0001": board.path}, "stranger")
        self.until("it says so", lambda: "HF0001: not connected to localhost:" in said.read_text())
        said.write_text("")
        strange = ["--broker-port", self.broker_port, "--ca", f"{self.certificates.name}/other.pem"]
        with open(said, "ab") as log:
            self.start([BIN / "holdfast-mqtt", *strange, f"HF0002={board.path}"], stderr=log)
        self.until("it says so", lambda: "HF0002: not connected to localhost:" in said.read_text())
        self.assertEqual(self.retained(), {})

    def test_says_what_is_wrong_with_its_command_line(self):
        def refused(*words):
            tried = subprocess.run([BIN / "holdfast-mqtt", *words], capture_output=True, text=True, timeout=60)
            self.assertEqual(tried.returncode, 1)
            self.assertEqual(tried.stderr.count("\n"), 1, tried.stderr)
            return tried.stderr

        self.assertRegex(refused("HF0001=/dev/null"), "no --ca.*Likely cause.*Next: ")
        self.assertRegex(refused("--plain", "HF0001"), "is no board.*Likely cause.*Next: ")
        self.assertRegex(refused("--plain", "HF/1=/dev/null"), "is no board")
        self.assertRegex(refused("--plain", "#=/dev/null"), "is no board")
        self.assertRegex(refused("--plain", "A=/dev/null", "A=/dev/zero"), "'A' is there twice")
        self.assertRegex(refused("--plain"), "BOARD is required.*Likely cause.*Next: holdfast-mqtt --help")
        self.assertRegex(refused("--plan", "A=/dev/null"), "'--plan' is not known to holdfast-mqtt.*Likely cause.*Next: ")
        self.assertRegex(refused("--plain", "--queue", "0", "A=/dev/null"), "--queue.*Likely cause.*Next: ")
        self.assertRegex(
            refused("--plain", "--firmware", b"1.4\xff", "HF0001=/dev/null"), "--firmware.*UTF-8.*Likely cause.*Next: "
        )
        self.assertRegex(refused("--plain", "--every", "nan", "HF0001=/dev/null"), "'nan' is no number from 0.1 to 86400")


if __name__ == "__main__":
    unittest.main()
