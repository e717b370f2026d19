#!/usr/bin/env python3
"""Cuts recorded rollouts short, so that the tests can carry them.

    scripts/trim_rollouts.py FROM TO [--steps N] [--steps-of TASK=N]...

Every FROM/<Task>.npz with its .json becomes TO/<Task>.npz of the first N steps, with the arrays that
`mamf verify` reads and nothing else. Members are stored, not compressed, and the .json gives for each
array its shape and the byte at which its first number lies.
"""

import argparse
import json
import pathlib
import struct
import zipfile

import numpy as np

PER_STATE = ["qpos", "qvel", "qacc_warmstart", "time", "obs", "achieved_goal"]
PER_STEP = ["action", "ctrl", "reward", "reward_sparse", "success", "terminated"]
WHOLE = ["desired_goal", "presettle_qpos", "presettle_qvel", "presettle_qacc_warmstart", "settle_ctrl"]
SETTINGS = ["env", "made_with", "pen_inertia", "reset_seed", "frame_skip", "timestep", "dt", "nq", "nv", "nu",
            "obs_size", "actions", "reset_after_termination", "dtype"]


def data_offset(path, member):
    """Byte of the file `path` at which the numbers of `member` begin."""
    with zipfile.ZipFile(path) as archive:
        info = archive.getinfo(member)
    with open(path, "rb") as file:
        file.seek(info.header_offset + 26)
        name, extra = struct.unpack("<HH", file.read(4))
        npy = info.header_offset + 30 + name + extra
        file.seek(npy)
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            np.lib.format.read_array_header_1_0(file)
        else:
            np.lib.format.read_array_header_2_0(file)
        return file.tell()


def trim(source, target, steps):
    settings = json.loads(source.with_suffix(".json").read_text())
    arrays = np.load(source)
    rows = {name: steps + 1 for name in PER_STATE} | {name: steps for name in PER_STEP}
    rows |= {name: None for name in WHOLE}
    kept = {name: np.ascontiguousarray(arrays[name][:n]) for name, n in rows.items() if name in arrays}
    np.savez(target, **kept)
    short = {name: settings[name] for name in SETTINGS if name in settings}
    short["steps"] = steps
    short["arrays"] = {
        name: {
            "shape": list(array.shape),
            "offset": data_offset(target, f"{name}.npy"),
            "what": settings["arrays"][name]["what"],
        }
        for name, array in kept.items()
    }
    target.with_suffix(".json").write_text(json.dumps(short, indent=1) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("source", type=pathlib.Path, metavar="FROM")
    parser.add_argument("target", type=pathlib.Path, metavar="TO")
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--steps-of", action="append", default=[], metavar="TASK=N")
    args = parser.parse_args()
    steps_of = {task: int(n) for task, n in (entry.split("=") for entry in args.steps_of)}
    args.target.mkdir(parents=True, exist_ok=True)
    for source in sorted(args.source.glob("*.npz")):
        trim(source, args.target / source.name, steps_of.get(source.stem, args.steps))


if __name__ == "__main__":
    main()
