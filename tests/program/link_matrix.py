#!/usr/bin/env python3
"""Fault matrix of the link (faults 83, 84, 86): `viable robot` in one process, a host in another, one fault per row.

    tests/program/link_matrix.py BUILD_DIR [--seeds 1,2,3] [--rows PART] [--short] [--shm] [--host COMMAND]

A row fails where the nominal arm passes a limit by more than 1e-10 of it (exported log of every tick), where the torque that the
robot writes steps farther in a tick than it allows, where a host ends otherwise than the row expects, or where no host
is served afterwards. COMMAND is a line with the places {viable} {file} {sets} {out}; the default is `viable run`. Exit code
0: all rows as expected; 1: not; 2: it could not be run. --short: few rows, with the first seed and a slow clock, for a busy machine."""

import argparse
import csv
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time

RATE_NMPS = 1000.0
TICK_S = 0.001
TOLERANCE = 1e-10
RUN = "{viable} run {file} --case linked {sets} --out {out} --no-report"
OK, STOPPED = (0,), (4, 6)
EITHER = OK + STOPPED
CASE = "cases.linked.real_plant."


class Row:
    def __init__(self, name, robot="", act=None, codes=EITHER, short=False, sets=None, duration_s=2.0, again=True):
        self.name, self.robot, self.act, self.codes, self.short = name, robot, act, codes, short
        self.sets, self.duration_s, self.again = sets or {}, duration_s, again


def stop_for(who, seconds):
    def act(trial):
        process = getattr(trial, who)
        process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        process.send_signal(signal.SIGCONT)
    return act


def kill(who):
    return lambda trial: getattr(trial, who).kill()


def restart_robot(trial):
    trial.robot.terminate()
    trial.robot.wait()
    trial.start_robot()


def restart_host(trial):
    trial.host.send_signal(signal.SIGINT)


def delayed(ms):
    """A file that knows the delay: ticks from a state to the torque that answers it."""
    ticks = 1 + int(2 * ms)
    return {"delay_ticks": min(ticks, 20), "repeat_ticks": 20 + ticks}


ROWS = [Row("none", codes=OK, short=True)]
ROWS += [Row(f"loss {100 * p:g} %", f"--lose {p}" + (" --from 1.25" if p == 0.5 else ""), codes=OK if p < 0.3 else EITHER, short=p == 0.1) for p in (0.01, 0.1, 0.5)]
ROWS += [Row(f"bursts of {n}, {100 * p:g} %", f"--lose {p} --burst {n}" + (" --from 1.25" if n > 5 else ""),
             short=n == 50, codes=codes) for n, p, codes in ((5, 0.02, OK), (50, 0.3, STOPPED), (500, 0.8, STOPPED))]
ROWS += [Row(f"delay {ms:g} ms each way", f"--latency {ms}", codes=OK, short=ms == 5, sets=delayed(ms)) for ms in (0.1, 1, 5, 9)]
ROWS += [Row("delay 20 ms each way", "--latency 20", codes=(2,), sets=delayed(20)),
         Row("delay 5 ms, file says 1 tick", "--latency 5", codes=(2,), short=True),
         Row("delay 0 to 5 ticks", "--delay 5", sets={"delay_ticks": 6}),
         Row("reordering 20 %", "--reorder 0.2", codes=OK, short=True),
         Row("duplicates 50 %", "--duplicate 0.5", codes=OK),
         Row("corruption 20 %", "--corrupt 0.2", codes=OK, short=True),
         Row("loss, reordering, duplicates, corruption, 5 % each",
             "--lose 0.05 --reorder 0.05 --duplicate 0.05 --corrupt 0.05", codes=OK)]
ROWS += [Row(f"clock {x}", f"--clock {x}", codes=OK, short=x == 1.01) for x in (0.99, 1.01)]
ROWS += [Row("brakes closed in motion", "--brake-at 1.3", codes=STOPPED, short=True),
         Row("fault reported in motion", "--fault-at 1.3", codes=STOPPED),
         Row("robot restarts", act=restart_robot, codes=STOPPED),
         Row("host ends (Ctrl-C) and restarts", act=restart_host, codes=(130,), short=True)]
for who in ("host", "robot"):
    ROWS += [Row(f"SIGSTOP of the {who}, {1000 * t:g} ms", act=stop_for(who, t), short=(who, t) == ("host", 0.5),
                 codes=EITHER if t < 0.1 else STOPPED) for t in (0.005, 0.05, 0.5, 5.0)]
ROWS += [Row("kill -9 of the host", act=kill("host"), codes=(-9,), short=True),
         Row("kill -9 of the robot", act=kill("robot"), codes=STOPPED, short=True)]


class Trial:
    """One row with one seed."""

    def __init__(self, arguments, row, seed, folder, number):
        self.row, self.seed, self.folder, self.arguments = row, seed, folder, arguments
        self.viable = os.path.join(arguments.build, "bin", "viable")
        self.port = None
        self.name = f"viable-matrix-{os.getpid()}-{number}"
        self.robot_texts, self.hosts = [], 0
        self.robot = self.host = None

    def start_robot(self):
        listen = ["--shm", self.name] if self.arguments.shm else ["--listen", f"127.0.0.1:{self.port or 0}"]
        self.robot_texts.append(os.path.join(self.folder, f"robot{len(self.robot_texts)}"))
        with open(self.robot_texts[-1], "w") as out:
            self.robot = subprocess.Popen(
                [self.viable, "robot", self.arguments.file, "--case", "simulated", "--torque-rate", f"{RATE_NMPS:g}",
                 "--seed", str(self.seed)] + listen + self.row.robot.split() +
                ([] if "--clock" in self.row.robot else ["--clock", str(self.arguments.clock)]), stdout=out, stderr=subprocess.STDOUT)
        text = self.await_words(" at ")
        self.address = text.split("\n")[0].rsplit(" at ", 1)[1]
        self.port = self.address.rsplit(":", 1)[1]

    def read_robot(self):
        with open(self.robot_texts[-1]) as text:
            return text.read()

    def await_words(self, words, seconds=20.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            text = self.read_robot()
            if words in text and text.endswith("\n"):
                return text
            if self.robot.poll() is not None:
                break
            time.sleep(0.005)
        raise RuntimeError(f"'{words}' was not said:\n{self.read_robot()}")

    def start_host(self, duration_s, sets):
        sets = {CASE + "address": f'"{self.address}"', "duration_s": duration_s,
                **{CASE + key: value for key, value in {"silence_timeout_s": 0.2, "motor_rate_Nmps": RATE_NMPS, **sets}.items()}}
        out = os.path.join(self.folder, f"host{self.hosts}")
        self.hosts += 1
        line = self.arguments.host.format(
            viable=shlex.quote(self.viable), file=shlex.quote(self.arguments.file), out=shlex.quote(out),
            sets=" ".join("--set " + shlex.quote(f"{key}={value}") for key, value in sets.items()))
        with open(out + ".txt", "w") as text:
            self.host = subprocess.Popen(shlex.split(line), stdout=text, stderr=subprocess.STDOUT)
        return out

    def run(self):
        row = self.row
        self.start_robot()
        out = self.start_host(row.duration_s, row.sets)
        if row.act:
            self.await_words("a host has come")
            if self.host.poll() is not None:
                raise RuntimeError("the host ended at once")
            time.sleep((1.2 + 0.05 * (self.seed % 3)) / self.arguments.clock)  # in full motion: it begins 1 s after the start
            row.act(self)
        code = self.host.wait(timeout=60)
        self.host = None
        result = {"code": code, "excess": self.find_excess(out, code), "far_rad": self.find_distance(out), "again": None}
        if row.again and 2 not in row.codes:  # the next host is served, by the same robot if it lives
            time.sleep(0.8)  # the next host finds it at the start: let it come to rest before
            if self.robot.poll() is not None:
                self.start_robot()
            again = self.start_host(0.05, row.sets)
            result["again"] = self.host.wait(timeout=60)
            self.host = None
            with open(again + ".txt") as text:
                result["again_text"] = text.read()
        time.sleep(0.3)
        self.robot.send_signal(signal.SIGINT)
        self.robot.wait(timeout=20)
        texts = "".join(open(text).read() for text in self.robot_texts)
        steps = [float(x) for x in re.findall(r"largest step ([0-9.e+-]+) Nm", texts)]
        result["step_Nm"] = max(steps) if steps else None
        rests = re.findall(r"come to rest in ([0-9.]+) s, ([0-9.]+) rad on", texts)
        longest = max(rests, key=lambda x: float(x[0])) if rests else None
        result["rest_s"] = float(longest[0]) if longest else None
        result["travel_rad"] = max(float(x[1]) for x in rests) if rests else None
        result["braked"] = "brakes are closed" in texts
        return result

    def find_distance(self, out):
        try:
            with open(os.path.join(out, "summary.json")) as text:
                return json.load(text)["cases"][0]["tracking"]["max_rad"]
        except (OSError, KeyError, IndexError):
            return None

    def find_excess(self, out, code):
        """By kind of limit, as a share of the limit's range; None: no tick was logged."""
        log = os.path.join(out, "linked.mcap")
        if not os.path.exists(log):
            return None
        if code < 0:
            subprocess.run([self.viable, "recover", log, "--out", log + ".r.mcap"], check=True, capture_output=True)
            log += ".r.mcap"
        table = os.path.join(self.folder, "log.csv")
        subprocess.run([self.viable, "export", log, "--force", "--to", "csv", table], check=True, capture_output=True)
        excess = {}
        with open(table) as text:
            rows = csv.DictReader(text)
            pairs = []
            for column in rows.fieldnames:
                match = re.fullmatch(r"limits\.(.+)\.(position|velocity|acceleration|jerk)_lower_(.+)", column)
                if not match:
                    continue
                joint, kind, unit = match.groups()
                value = {"position": "q", "velocity": "qd", "acceleration": "qdd", "jerk": "jerk"}[kind]
                pairs.append((kind, f"nominal.{joint}.{value}_{unit}", column, f"limits.{joint}.{kind}_upper_{unit}"))
            count = 0
            for one in rows:
                count += 1
                for kind, value, lower, upper in pairs:
                    x, low, high = float(one[value]), float(one[lower]), float(one[upper])
                    beyond = max(low - x, x - high, 0.0) / (high - low)
                    excess[kind] = max(excess.get(kind, 0.0), beyond)
        return excess if count else None


def judge(row, result):
    wrong = []
    if result["code"] not in row.codes:
        wrong.append(f"exit code {result['code']}, expected {row.codes}")
    for kind, excess in (result["excess"] or {}).items():
        if not excess <= TOLERANCE:
            wrong.append(f"{kind} of the nominal arm beyond its limit by {excess:g}")
    if result["excess"] is None and 2 not in row.codes:
        wrong.append("no log")
    if result["step_Nm"] is None or result["step_Nm"] > RATE_NMPS * TICK_S * (1 + 1e-9):
        wrong.append(f"torque step {result['step_Nm']} Nm")
    if result["again"] is not None and result["again"] not in EITHER:
        wrong.append(f"the next host: {result['again']}\n{result['again_text']}")
    return wrong


def largest(values):
    known = [value for value in values if value is not None]
    return max(known) if known else None


def show(value, form="{:.3f}"):
    return "-" if value is None else form.format(value)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build")
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--rows", default="", help="only rows whose name contains this")
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--shm", action="store_true", help="shared memory in place of UDP")
    parser.add_argument("--host", default=RUN)
    parser.add_argument("--file", default="experiments/planar_two_link_linked.yaml")
    arguments = parser.parse_args()
    arguments.build = os.path.abspath(arguments.build)
    arguments.clock = 0.4 if arguments.short else 1.0  # ctest's machine may be busy: the robot's ticks are longer there
    os.chdir(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
    if not os.access(os.path.join(arguments.build, "bin", "viable"), os.X_OK):
        print(f"link_matrix: {arguments.build}/bin/viable is not there: build it", file=sys.stderr)
        return 2
    seeds = [int(seed) for seed in arguments.seeds.split(",")]
    rows = [row for row in ROWS if arguments.rows in row.name and (row.short or not arguments.short)]
    if arguments.short:
        seeds = seeds[:1]
    print(f"seeds {seeds}; a robot that allows {RATE_NMPS * TICK_S:g} Nm per tick, over {'shm' if arguments.shm else 'UDP'}")
    print("| fault | host's exit code | largest step of torque [Nm/tick] | nominal limits exceeded by | real - nominal, at most [rad] "
          "| robot's own stop: time [s] | and way [rad] |\n|---|---|---|---|---|---|---|")
    failures, number = [], 0
    for row in rows:
        results = []
        for seed in seeds:
            number += 1
            folder = tempfile.mkdtemp(prefix="viable-matrix-")
            trial = Trial(arguments, row, seed, folder, number)
            try:
                result = trial.run()
                wrong = judge(row, result)
                results.append(result)
            except Exception as e:  # pylint: disable=broad-except
                wrong = [f"{type(e).__name__}: {e}"]
            finally:
                for process in (trial.host, trial.robot):
                    if process is not None and process.poll() is None:
                        process.kill()
                        process.wait()
            if wrong:
                text = os.path.join(folder, "host0.txt")
                said = open(text).read()[-600:] if os.path.exists(text) else ""
                failures.append(f"{row.name}, seed {seed}: " + "; ".join(wrong) + f"\n{said}")
            shutil.rmtree(folder, ignore_errors=True)
        codes = ", ".join(sorted({str(r["code"]) for r in results}))
        excess = largest([max(r["excess"].values()) for r in results if r["excess"]])
        print(f"| {row.name} | {codes} | {show(largest([r['step_Nm'] for r in results]))} | {show(excess, '{:g}')} "
              f"| {show(largest([r['far_rad'] for r in results]), '{:.4f}')} | {show(largest([r['rest_s'] for r in results]))} "
              f"| {show(largest([r['travel_rad'] for r in results]))}{' (braked)' if any(r['braked'] for r in results) else ''} |",
              flush=True)
    for failure in failures:
        print("FAILED " + failure)
    print(f"{len(rows)} rows, {len(failures)} failures")
    return 1 if failures else 0


sys.exit(main())
