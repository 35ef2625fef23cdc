#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What a simulated grasp costs in a dataset, and what splitting adds: one set of grasps in 1, 2 and 4 shards, each shard a
# process of its own, one after the other. Processor time, so that other work on the machine counts little.
#   tests/bench/cluster_cost.sh [BIN]      default build/sim/bin
# Prints four lines of figures; toolchain/cluster/README.md plans by them. Needs python3.
set -euo pipefail
exec python3 - "$(realpath "${1:-build/sim/bin}")/holdfast" <<'PYTHON'
import json, os, subprocess, sys, tempfile

def run(arguments):
    """Processor seconds and peak memory (MB) of a process, from the kernel; what it printed."""
    process = subprocess.Popen([sys.argv[1], *arguments], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    said = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        sys.exit(f"error: holdfast {' '.join(arguments)} failed. Likely cause: see it. Next: run it by hand")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, said

with tempfile.TemporaryDirectory() as folder:
    totals, longest, memory = {}, {}, {}
    for shards in (1, 2, 4):
        seconds, parts = [], []
        for k in range(1, shards + 1):
            parts.append(os.path.join(folder, f"{shards}_{k:05}"))
            spent, peak, said = run(["dataset", "--seed", "1", "--json", "--shard", f"{k}/{shards}", "--out", parts[-1]])
            seconds.append(spent)
            memory[shards] = max(memory.get(shards, 0), peak)
            if shards == 1:
                grasps, size = json.loads(said)["trials"], os.path.getsize(parts[0])
        totals[shards], longest[shards] = sum(seconds), max(seconds)
        whole = b"".join(open(part, "rb").read() if k == 0 else open(part, "rb").read().split(b"\n", 1)[1]
                         for k, part in enumerate(parts))
        if shards == 1:
            single = whole
        elif whole != single:
            sys.exit(f"error: {shards} shards have other bytes than one. Likely cause: a fault of the tool. Next: report it")
print(f"grasp: {1000 * totals[1] / grasps:.0f} ms; {size / grasps / 1000:.1f} kB; of {grasps}")
print("growth: " + "; ".join(f"{totals[1] / longest[n]:.2f}" for n in (2, 4)))
print("added: " + "; ".join(f"{round(100 * (totals[n] / totals[1] - 1))} %" for n in (2, 4)))
print("memory: " + "; ".join(f"{memory[n]:.0f} MB" for n in (1, 2, 4)))
million = 1_000_000
print(f"million: {million * totals[1] / grasps / 3600:.1f} h; {million * size / grasps / 1e9:.0f} GB; "
      f"{million * totals[1] / grasps / 1000 / 60:.1f} min; {memory[1] + (memory[1] - memory[4]) * (1000 - grasps) / (0.75 * grasps):.0f} MB")
PYTHON
