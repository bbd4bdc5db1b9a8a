#!/usr/bin/env python3
"""Takes every URDF and MuJoCo model below a folder as `viable new robot --assume` does, runs its hand, and prints what became of them.

    tests/robots/collection.py FOLDER [--viable build/release/bin/viable] [--seconds 4] [--json FILE] [--keep FOLDER]

Not part of the suites: collections of robots are the work of others, and none is kept here.

"""
import argparse
import collections
import concurrent.futures
import json
import os
import pathlib
import re
import subprocess
import tempfile

REASONS = [  # the first that fits
    ("MuJoCo does not take it", r"does not take it"),
    ("more than 16 moving joints", r"moving joints; at most"),
    ("no moving joint", r"no moving joint"),
    ("xacro", r"xacro"),
    ("not connected, or a link missing", r"not connected|was not found"),
    ("loop", r"loop|child of two joints"),
    ("coupled joints", r"mimic"),
    ("no mass", r"no mass"),
    ("inertia", r"inertia"),
    ("numbers", r"finite|direction|no number"),
    ("not XML, or no URDF", r"not XML|root is|file is empty|bytes|nested|usable URDF"),
]


def call(arguments, seconds):
    """Exit code, standard output and error; 124 where it takes too long."""
    try:
        done = subprocess.run(arguments, capture_output=True, text=True, errors="replace", timeout=seconds)
        return done.returncode, done.stdout, done.stderr
    except subprocess.TimeoutExpired:
        return 124, "", f"took more than {seconds} s"


def take(viable, urdf, name, out, seconds):
    """What became of one file: a dictionary with `taken`, `reason`, `hand` and what was assumed."""
    row = {"file": str(urdf), "tip": "", "taken": False, "reason": "", "hand": "none"}
    command = [viable, "new", "robot", name, "--mjcf" if urdf.suffix == ".xml" else "--urdf", str(urdf), "--assume", "--out", str(out)]
    code, text, fault = call(command, 120)
    if code == 2 and "moving joints; at most" in fault:
        row["tip"] = "auto"
        code, text, fault = call(command + ["--tip", "auto"], 120)
    if code != 0:
        row["reason"] = next((r for r, pattern in REASONS if re.search(pattern, fault)), "other") if code == 2 else f"exit {code}"
        row["fault"] = fault[-3000:]
        return row
    row["taken"] = True
    row["repaired"] = fault.count("viable: repaired:")
    row["assumed"] = re.findall(r"^  (mass|inertia):", text, re.M)
    row["joints"] = len(re.findall(r"<joint[^>]*type=.(?:revolute|continuous|prismatic)", (out / name / f"{name}.urdf").read_text(errors="replace")))
    code, _, fault = call([viable, "robots", "--describe", str(out / name)], 60)
    if code != 0:
        row["hand"], row["fault"] = "robot refused", fault[-3000:]
        return row
    hand = out / name / "hand.yaml"
    if not hand.exists():
        row["hand"] = "no hand (fewer than three directions)"
        return row
    code, text, fault = call([viable, "run", str(hand), "--details", "--set", f"duration_s={seconds}", "--out", str(out / (name + "_run"))], 300)
    row["verdict"] = "".join(re.findall(r"^  verdict +(.*)", text, re.M))
    rms = re.search(r"real-nominal .*\[mrad\] +(.*)", text)
    if rms:
        row["rms_mrad"] = max(float(pair.split("/")[0]) for pair in rms.group(1).split("  ") if pair.strip())
    if code == 0:
        row["hand"] = "moved" if "all limits kept" in row["verdict"] else "moved, limits not kept"
    elif code == 6:
        row["hand"] = "stopped by its own defaults"
    else:
        row["hand"] = f"exit {code}"
    if code != 0:
        row["fault"] = fault[-3000:]
    return row


def run(folder, viable, seconds=4.0, workers=os.cpu_count(), out=None):
    """One row for each URDF below the folder, and each model that is no part or scene of others."""
    paths = sorted(p for suffix in ("urdf", "xml") for p in pathlib.Path(folder).rglob(f"*.{suffix}") if p.is_file())
    urdfs = [p for p in paths if p.suffix == ".urdf" or is_model(p)]
    with tempfile.TemporaryDirectory() as temporary, concurrent.futures.ThreadPoolExecutor(workers) as pool:
        target = pathlib.Path(out or temporary)
        return list(pool.map(lambda k: take(viable, urdfs[k], f"robot_{k}", target, seconds), range(len(urdfs))))


def is_model(path):
    text = path.read_text(errors="replace")
    return "<mujoco" in text and "<joint" in text and "<body" in text and "<include" not in text


def print_table(rows):
    def count(title, values):
        print(title)
        for value, number in collections.Counter(values).most_common():
            print(f"  {number:4}  {value}")

    taken = [row for row in rows if row["taken"]]
    print(f"{len(rows)} files, {len(taken)} taken ({sum(r['tip'] == 'auto' for r in taken)} by --tip auto)")
    count("refused:", [row["reason"] for row in rows if not row["taken"]])
    count("hand:", [row["hand"] for row in taken])
    count("assumed:", [what for row in taken for what in sorted(set(row["assumed"]))])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("--viable", default="build/release/bin/viable")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each hand")
    parser.add_argument("--json", help="file for all rows")
    parser.add_argument("--keep", help="folder for the robots and runs")
    options = parser.parse_args()
    if options.keep:
        pathlib.Path(options.keep).mkdir(parents=True)
    rows = run(options.folder, options.viable, options.seconds, out=options.keep)
    if options.json:
        pathlib.Path(options.json).write_text(json.dumps(rows, indent=1))
    print_table(rows)


if __name__ == "__main__":
    main()
