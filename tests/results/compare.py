#!/usr/bin/env python3
"""Did a change alter results? Runs two builds of viable on the same experiments and compares what they write.

    tests/results/compare.py OLD_PROGRAM NEW_PROGRAM [--only TEXT] [--keep FOLDER] [--sweep-runs N] [--old-experiments FOLDER]

Compared: the logs of all cases of every experiment in experiments/, exported to CSV, row by row and column by column;
summary.json, key by key; the table of a sweep; the output of `bound`, `verify` and `identify`. Not compared: columns of measured time, paths and
dates. A number is equal when its text is. Exit code 0: all equal; 1: differences, listed with their size.
"""
import argparse, csv, json, math, os, re, shutil, subprocess, sys, tempfile
from concurrent.futures import ThreadPoolExecutor

SOURCE = os.path.abspath(os.path.join(os.path.dirname(__file__), "..", ".."))
TIMING = re.compile(r"(_us|_us\b.*|wall_s|_per_s|real_time_factor)$|time_us|compute")
# Words of version 5 of the plugin interface and their successors.
WORDS = {"returning": "recovering", "promise_broken": "guarantee_broken", "ticks_returning": "ticks_recovering",
         "worst_returning": "worst_recovering", "returning_ticks": "recovering_ticks"}


def run(program, *words, folder, accepted=(0, 3, 4, 7)):
    result = subprocess.run([program, *words], cwd=folder, capture_output=True, text=True)
    if result.returncode not in accepted:
        raise SystemExit(f"{program} {' '.join(words)} ended with {result.returncode}:\n{result.stderr}")
    return result.stdout


def read_rows(path):
    with open(path, newline="") as file:
        rows = csv.reader(file)
        header = [WORDS.get(name, name) for name in next(rows)]
        yield header
        yield from rows


def compare_tables(old, new, name):
    """Lines about what differs between two CSV files."""
    one, two = read_rows(old), read_rows(new)
    header, other = next(one), next(two)
    kept = [n for n in header if not TIMING.search(n)]
    lines = []
    for missing in [n for n in kept if n not in other]:
        lines.append(f"{name}: column {missing} is gone")
    for added in [n for n in other if n not in header and not TIMING.search(n)]:
        lines.append(f"{name}: column {added} is new")
    pairs = [(n, header.index(n), other.index(n)) for n in kept if n in other]
    worst, count, rows = {}, {}, 0
    for a, b in zip(one, two):
        rows += 1
        for n, i, k in pairs:
            x, y = a[i], b[k]
            if x == y or WORDS.get(x, x) == y:
                continue
            count[n] = count.get(n, 0) + 1
            try:
                size = abs(float(x) - float(y))
            except ValueError:
                size = math.inf
            worst[n] = max(worst.get(n, 0.0), size)
    left = sum(1 for _ in one), sum(1 for _ in two)
    if left != (0, 0):
        lines.append(f"{name}: {rows + left[0]} rows before, {rows + left[1]} after")
    lines += [f"{name}: {n} differs in {count[n]} of {rows} rows, by up to {worst[n]:g}" for n in count]
    return rows, len(pairs), lines


def list_values(node, path=""):
    """Every leaf of a JSON document with its path."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from list_values(value, f"{path}.{key}" if path else key)
    elif isinstance(node, list):
        for index, value in enumerate(node):
            yield from list_values(value, f"{path}[{index}]")
    else:
        yield path, node


def compare_summaries(old, new, name):
    """Lines about what differs between two summary.json, but for measured times, paths and dates."""
    one, two = (dict(list_values(json.load(open(path)))) for path in (old, new))
    counts = lambda key: not any(TIMING.search(part) for part in re.split(r"[.\[]", key)) and not re.search(
        r"(^|[._])(date|time_utc|started|finished|host|machine|version|command_line|folder|file|path|log)\b", key)
    lines = [f"{name}: summary.json: {key} is gone" for key in one if key not in two and counts(key)]
    lines += [f"{name}: summary.json: {key} is new" for key in two if key not in one and counts(key)]
    for leaves in (one, two):  # what is measured differs from run to run
        leaves.pop("experiment", None)
        for key in leaves:
            if isinstance(leaves[key], str):  # where the plugins of a build stand
                leaves[key] = re.sub(r"/\S+\.so", "PLUGIN", leaves[key])
            if key.endswith(".account"):
                text = re.sub(r"simulated in .*", "", leaves[key])
                leaves[key] = "\n".join(line for line in text.splitlines() if not re.search(r"\bus\b|real time|\.mcap", line))
    shared = [key for key in one if key in two and counts(key)]
    lines += [f"{name}: summary.json: {key} was {one[key]!r}, is {two[key]!r}" for key in shared if one[key] != two[key]]
    return 1, len(shared), lines


def compare_texts(old, new, name):
    def clean(text):
        for word, successor in WORDS.items():
            text = text.replace(word, successor)
        return re.sub(r"/\S+", "PATH", text).splitlines()
    a, b = clean(old), clean(new)
    if a == b:
        return []
    changed = [(x, y) for x, y in zip(a, b) if x != y]
    return [f"{name}: {len(changed) + abs(len(a) - len(b))} lines of text differ"] + [
        f"    - {x}\n    + {y}" for x, y in changed[:5]]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old"), parser.add_argument("new")
    parser.add_argument("--only", default="", help="experiments whose name has this text")
    parser.add_argument("--keep", help="folder for what is written (default: a temporary one)")
    parser.add_argument("--sweep-runs", type=int, default=8)
    parser.add_argument("--old-experiments", help="folder of the same experiments in the old program's words")
    arguments = parser.parse_args()
    programs = {"old": os.path.abspath(arguments.old), "new": os.path.abspath(arguments.new)}
    experiments = {side: os.path.join(SOURCE, "experiments") for side in programs}
    if arguments.old_experiments:
        experiments["old"] = os.path.abspath(arguments.old_experiments)
    folder = os.path.abspath(arguments.keep) if arguments.keep else tempfile.mkdtemp(prefix="viable-compare-")
    os.makedirs(folder, exist_ok=True)
    differences, tables, cells = [], 0, 0

    def both(work):
        with ThreadPoolExecutor(2) as pool:
            return dict(zip(programs, pool.map(lambda side: work(side, programs[side]), programs)))

    def add(result):
        nonlocal tables, cells
        rows, columns, lines = result
        tables, cells = tables + 1, cells + rows * columns
        differences.extend(lines)

    for file in sorted(os.listdir(os.path.join(SOURCE, "experiments"))):
        path, name = {side: os.path.join(experiments[side], file) for side in programs}, file[:-5]
        if not file.endswith(".yaml") or arguments.only not in name:
            continue
        text = open(path["new"]).read()
        if "plugin: link" in text:  # needs a robot, and is timed by its clock
            continue
        if re.search(r"[:\[ ]~[a-z_]+\(", text):  # drawn values
            out = both(lambda side, program: run(program, "sweep", path[side], "--runs", str(arguments.sweep_runs), "--jobs", "1",
                                                 "--out", os.path.join(folder, f"{name}-{side}"), folder=folder))
            add(compare_tables(os.path.join(folder, f"{name}-old", "sweep.csv"),
                               os.path.join(folder, f"{name}-new", "sweep.csv"), f"{name}: sweep"))
            continue
        both(lambda side, program: run(program, "run", path[side], "--no-report", "--out",
                                       os.path.join(folder, f"{name}-{side}"), folder=folder))
        logs = sorted(n[:-5] for n in os.listdir(os.path.join(folder, f"{name}-old")) if n.endswith(".mcap"))
        for case in logs:
            made = both(lambda side, program: run(
                program, "export", os.path.join(folder, f"{name}-{side}", f"{case}.mcap"), "--to", "csv",
                os.path.join(folder, f"{name}-{side}-{case}.csv"), folder=folder))
            files = [os.path.join(folder, f"{name}-{side}-{case}.csv") for side in programs]
            add(compare_tables(*files, f"{name}: {case}"))
            for made in files:
                os.remove(made)
        add(compare_summaries(*(os.path.join(folder, f"{name}-{side}", "summary.json") for side in programs), name))
        print(f"{name}: {len(logs)} cases, {len(differences)} differences so far", flush=True)
        if "disturbance_set" in text:
            out = both(lambda side, program: run(program, "bound", path[side], folder=folder))
            differences += compare_texts(out["old"], out["new"], f"{name}: bound")
        if name == "indy7_teleoperation":
            log = lambda side: os.path.join(folder, f"{name}-{side}", "C3.mcap")
            for command in ("verify", "identify"):
                def judge(side, program):
                    result = os.path.join(folder, f"{command}-{side}.json")
                    text = run(program, command, log(side), "--json", result, folder=folder)
                    return text + json.dumps(json.load(open(result)), indent=1)
                out = both(judge)
                differences += compare_texts(out["old"], out["new"], f"{name}: {command}")
    if not arguments.keep:
        shutil.rmtree(folder)
    print("\n".join(differences))
    print(f"{tables} tables, {cells} values compared: " +
          ("all equal" if not differences else f"{len(differences)} differences"))
    return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main())
