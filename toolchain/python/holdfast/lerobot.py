# SPDX-License-Identifier: Apache-2.0
"""Recordings as a dataset in LeRobot's folder layout v2.1: each .mcap an episode.

    python3 -m holdfast.lerobot OUT LOG.mcap... [--task TEXT] [--fps N]

Rows are at exactly 1/fps, as LeRobot demands: each has the last frame that was logged up to half a period after it.
There are no pictures and no `action`: this is what the finger felt, to be joined with what the robot did.
"""

import argparse
import json
import math
import os
import statistics
import sys
import tempfile

from . import parquet
from .logs import LogError, Mcap

STATE = (
    "vx_mm_s", "vy_mm_s", "entropy_nat", "entropy_rate_nat_s", "imprint_um", "coarse_um", "markers", "contact",
    "state", "reason", "slip", "grip_ok", "accepted", "features_valid",
)  # fmt: skip
_CHUNK = 1000  # episodes in a folder


def _error(path, what, cause, next_step):
    return LogError(f"{path}: {what}. Likely cause: {cause}. Next: {next_step}")


def read(path):
    """(time in ns, state, markers) of each frame, and the lattice. Markers: dx, dy of each, 0 where it was not seen."""
    log = Mcap(path)
    fields, lattice = {}, None
    states = []
    for message in log.messages():
        values = message.values
        if message.topic == "/holdfast/slip":
            states.append((message.time_ns, values["frame"], [float(values[name]) for name in STATE]))
        elif message.topic == "/holdfast/markers":
            found = list(zip(values["row"], values["col"]))
            if lattice not in (None, found):
                cause = "the gel was learned anew with another size"
                raise _error(path, "its lattice changes", cause, "give a shorter one")
            lattice = found
            seen = zip(values["valid"], values["dx_px"], values["dy_px"])
            cells = ((dx, dy) if valid else (0, 0) for valid, dx, dy in seen)
            fields[values["frame"]] = [float(cell) for pair in cells for cell in pair]
    if not states or lattice is None:
        raise _error(path, "no frame with markers", "the empty gel was never learned", "holdfast log info " + str(path))
    none = [0.0] * (2 * len(lattice))
    return [(time, state, fields.get(frame, none)) for time, frame, state in states], lattice


def on_grid(frames, fps):
    """The frames at 0, 1/fps, 2/fps ... from the first one on."""
    start, end = frames[0][0], frames[-1][0]
    rows, at = [], 0
    for k in range(round((end - start) * fps / 1e9) + 1):
        until = start + round((k + 0.5) * 1e9 / fps)
        while at + 1 < len(frames) and frames[at + 1][0] < until:
            at += 1
        rows.append(frames[at])
    return rows


def _stats(values):
    columns = list(zip(*values)) if hasattr(values[0], "__len__") else [values]
    mean = [math.fsum(column) / len(column) for column in columns]
    return {
        "min": [min(column) for column in columns],
        "max": [max(column) for column in columns],
        "mean": mean,
        "std": [math.sqrt(math.fsum((v - m) ** 2 for v in c) / len(c)) for c, m in zip(columns, mean)],
        "count": [len(values)],
    }


def export(out, paths, task="hold", fps=None):
    """Writes the folder, whole or not at all. Returns frames, and rows that stand for no frame of their own."""
    if os.path.exists(out):
        raise _error(out, "it is there already", "an earlier run", "name another folder")
    above, name = os.path.split(os.path.abspath(out))
    os.makedirs(above, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{name}-", dir=above) as scratch:
        new = f"{scratch}/{name}"
        counts = _write(new, paths, task, fps)
        os.rename(new, f"{above}/{name}")
    return counts


def _write(new, paths, task, fps):
    os.makedirs(f"{new}/meta")
    lattice, episodes, stats, index, repeated = None, [], [], 0, 0
    for number, path in enumerate(paths):
        frames, found = read(path)
        if len(frames) < 2:
            raise _error(path, "a single frame", "a recording that was cut", "leave it out")
        own = 1e9 / statistics.median(b[0] - a[0] for a, b in zip(frames, frames[1:]))
        fps = fps or round(own)
        if abs(own / fps - 1) > 0.02:
            what = f"{own:.1f} frames per second, not {fps}"
            raise _error(path, what, "another camera or mode", "export it by itself, or give --fps")
        if lattice not in (None, found):
            raise _error(path, "another lattice than the first one's", "another gel", "export it by itself")
        lattice = found
        rows = on_grid(frames, fps)
        count = len(rows)
        repeated += sum(a is b for a, b in zip(rows, rows[1:]))
        columns = [
            ("observation.state", "float32", [row[1] for row in rows]),
            ("observation.markers", "float32", [row[2] for row in rows]),
            ("timestamp", "float32", [k / fps for k in range(count)]),
            ("frame_index", "int64", list(range(count))),
            ("episode_index", "int64", [number] * count),
            ("index", "int64", list(range(index, index + count))),
            ("task_index", "int64", [0] * count),
        ]
        folder = f"{new}/data/chunk-{number // _CHUNK:03}"
        os.makedirs(folder, exist_ok=True)
        parquet.write(f"{folder}/episode_{number:06}.parquet", columns)
        episodes.append({"episode_index": number, "tasks": [task], "length": count})
        stats.append({"episode_index": number, "stats": {name: _stats(values) for name, _, values in columns}})
        index += count
    markers = [f"r{row}c{col}.{part}" for row, col in lattice for part in ("dx_px", "dy_px")]
    names = {"observation.state": list(STATE), "observation.markers": markers}
    info = {
        "codebase_version": "v2.1",
        "robot_type": "holdfast",
        "total_episodes": len(episodes),
        "total_frames": index,
        "total_tasks": 1,
        "total_videos": 0,
        "total_chunks": (len(episodes) - 1) // _CHUNK + 1,
        "chunks_size": _CHUNK,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": None,
        "features": {
            name: {"dtype": kind, "shape": [len(names.get(name, [0]))], "names": names.get(name)}
            for name, kind, _ in columns
        },
    }
    with open(f"{new}/meta/info.json", "w", encoding="utf-8") as file:
        json.dump(info, file, indent=4)
    lines = {"episodes": episodes, "episodes_stats": stats, "tasks": [{"task_index": 0, "task": task}]}
    for name, values in lines.items():
        with open(f"{new}/meta/{name}.jsonl", "w", encoding="utf-8") as file:
            file.writelines(json.dumps(value) + "\n" for value in values)
    return index, repeated


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="holdfast.lerobot", description="recordings as a LeRobot dataset, v2.1")
    parser.add_argument("out", help="the folder, which must not be there yet")
    parser.add_argument("logs", nargs="+", help="recordings with their decisions: .mcap; each is an episode")
    parser.add_argument("--task", default="hold", help="what the robot was asked to do, one for all (hold)")
    parser.add_argument("--fps", type=int, help="frames per second; the first recording's unless given")
    given = parser.parse_args(arguments)
    try:
        frames, repeated = export(given.out, given.logs, given.task, given.fps)
    except (LogError, OSError) as error:
        sys.exit(f"error: {error}")
    again = f"{repeated} of them the frame before again"
    print(f"written   {given.out}: {len(given.logs)} episodes, {frames} frames, {again}")


if __name__ == "__main__":
    main()
