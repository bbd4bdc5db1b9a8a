"""Runs two benchmark programs by turns and says which benchmarks became slower or faster by more than noise:
    python3 compare_bench.py OLD_PROGRAM NEW_PROGRAM [--rounds COUNT] [--filter REGEX]

A round runs both programs once, the old one first in every other round, so that slow moments and drifts of the machine fall
on both. For each benchmark a round gives the ratio of the new time to the old one (CPU time). The rule:

    a benchmark changed when the median of its ratios is off 1 by more than 4 robust standard errors and by more than 5 %.

The robust standard error is that of a median of normal samples, 1.2533 sigma / sqrt(rounds), with sigma = 1.4826 times the
median absolute deviation of the logarithms of the ratios. What the rule cannot tell from a change of the code: other places
of the same code in the memory, which are worth some per cent in loops of nanoseconds. Exit code: 0 nothing is slower, 1
something is, 2 it could not be told."""

import argparse
import json
import math
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass

LEAST_ERRORS = 4.0  # 3 call one benchmark in a hundred changed that is not: the deviation of 15 rounds is a guess itself
LEAST_CHANGE = 0.05
LEAST_ROUNDS = 5  # fewer give no usable deviation
# Of the usual size of arm, and whatever has no size; not those that take minutes for their own statistics.
USUAL_FILTER = r"-whole_arm|distance_field|n:([1-589]|1[0-6])(/|$)"


@dataclass
class Verdict:
    """What the rounds say of one benchmark."""

    ratio: float  # median of new / old
    error: float  # robust standard error of it, relative
    change: str  # "slower", "faster" or ""


def judge(old, new):
    """old, new: times of the same rounds, > 0 and equally many."""
    if len(old) != len(new) or len(old) < LEAST_ROUNDS:
        raise ValueError(f"{len(old)} and {len(new)} times; at least {LEAST_ROUNDS} of each are needed, equally many")
    if not all(t > 0 and math.isfinite(t) for t in [*old, *new]):
        raise ValueError("a time that is not above 0")
    logs = [math.log(b / a) for a, b in zip(old, new)]
    middle = statistics.median(logs)
    deviation = 1.4826 * statistics.median(abs(x - middle) for x in logs)
    error = 1.2533 * deviation / math.sqrt(len(logs))
    change = ""
    if abs(middle) > LEAST_ERRORS * error:
        if middle > math.log(1 + LEAST_CHANGE):
            change = "slower"
        elif middle < -math.log(1 + LEAST_CHANGE):
            change = "faster"
    return Verdict(math.exp(middle), error, change)


def judge_all(old, new):
    """Lists of times by the names of benchmarks. Returns verdicts by name, and the names that only one of both has."""
    verdicts = {name: judge(old[name], new[name]) for name in old if name in new}
    return verdicts, sorted(set(old) ^ set(new))


def give_up(text):
    print(f"compare_bench: {text}", file=sys.stderr)
    sys.exit(2)


def run(program, name_filter):
    """CPU times [ns] of one run by the names of benchmarks."""
    with tempfile.NamedTemporaryFile(suffix=".json") as out:
        command = [program, f"--benchmark_out={out.name}", "--benchmark_out_format=json", "--benchmark_min_time=0.02"]
        if name_filter:
            command.append(f"--benchmark_filter={name_filter}")
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
        if done.returncode != 0:
            give_up(f"{program} ended with {done.returncode}\n{done.stderr}")
        rows = json.load(out)["benchmarks"]
    units = {"ns": 1.0, "us": 1e3, "ms": 1e6, "s": 1e9}
    return {row["name"]: row["cpu_time"] * units[row["time_unit"]] for row in rows if not row.get("error_occurred")}


def print_verdicts(verdicts, alone):
    for name, verdict in sorted(verdicts.items(), key=lambda item: -item[1].ratio):
        print(f"{name:48s} {verdict.ratio:6.3f} +- {verdict.error:5.3f}  {verdict.change}")
    for name in alone:
        print(f"{name:48s} only in one of both")
    counts = [sum(v.change == change for v in verdicts.values()) for change in ("slower", "faster")]
    print(f"{len(verdicts)} benchmarks: {counts[0]} slower, {counts[1]} faster (by more than "
          f"{LEAST_CHANGE * 100:.0f} % and {LEAST_ERRORS:.0f} robust standard errors)")


def main():
    parser = argparse.ArgumentParser(description="Which benchmarks became slower by more than noise?")
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--filter", default=USUAL_FILTER, help="regular expression of Google Benchmark")
    arguments = parser.parse_args()
    if arguments.rounds < LEAST_ROUNDS:
        give_up(f"at least {LEAST_ROUNDS} rounds")
    programs = (arguments.old, arguments.new)
    runs = ([], [])
    for number in range(arguments.rounds):
        for which in (0, 1) if number % 2 == 0 else (1, 0):
            runs[which].append(run(programs[which], arguments.filter))
    old, new = ({name: [one[name] for one in mine] for name in mine[0] if all(name in one for one in mine)}
                for mine in runs)
    if not old or not new:
        give_up("no benchmark fits the filter")
    verdicts, alone = judge_all(old, new)
    print_verdicts(verdicts, alone)
    return 1 if any(v.change == "slower" for v in verdicts.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
