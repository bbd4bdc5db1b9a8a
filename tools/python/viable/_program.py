"""What the program `viable` does, called as a process of its own: a plugin that crashes does not take Python along, and the
numbers are the program's."""

from __future__ import annotations

import contextlib
import ctypes
import json
import math
import numbers
import os
import re
import signal
import sqlite3
import subprocess
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ._errors import Error, make_error
from ._paths import find_program, make_environment

PathLike = str | os.PathLike


def format_value(value: Any) -> str:
    """A value as an experiment file has it."""
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    if isinstance(value, os.PathLike):
        value = os.fsdecode(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{format_value(key)}: {format_value(each)}" for key, each in value.items()) + "}"
    if isinstance(value, str):
        return value if _is_plain(value) else json.dumps(value, ensure_ascii=False)
    if hasattr(value, "tolist"):
        return format_value(value.tolist())
    if isinstance(value, Sequence):
        return "[" + ", ".join(format_value(each) for each in value) + "]"
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    return str(value) if isinstance(value, numbers.Number) else json.dumps(str(value), ensure_ascii=False)


def _is_plain(word: str) -> bool:
    """Without quotes it is read as this very text, or as the expression that it is (2 * pi): no syntax, number, truth or null."""
    if not re.fullmatch(r"-?[A-Za-z0-9_./(]([A-Za-z0-9_./()*+ -]*[A-Za-z0-9_./)])?", word):
        return False
    if word.lower().lstrip("-").removeprefix(".") in {"true", "false", "null", "yes", "no", "on", "off", "y", "n", "inf", "nan"}:
        return False
    return not re.fullmatch(r"-?(0[xo][0-9A-Fa-f_]+|[0-9_]*\.?[0-9_]*([eE][+-]?[0-9]+)?)", word)


def _overrides(values: Mapping[str, Any] | None) -> list[str]:
    arguments = []
    for key, value in (values or {}).items():
        arguments += ["--set", f"{key}={format_value(value)}"]
    return arguments


def _cases(cases: str | Sequence[str] | None) -> list[str]:
    names = [cases] if isinstance(cases, str) else list(cases or [])
    return [part for name in names for part in ("--case", name)]


def _options(**values: Any) -> list[Any]:
    """Those that are given."""
    return [word for name, value in values.items() if value is not None for word in ("--" + name, value)]


def _call(arguments: Sequence[str], allowed: Sequence[int], progress: Callable[[dict], None] | None = None,
          is_done: Callable[[], bool] | None = None) -> tuple[int, str]:
    """Runs the program. Returns exit code and standard output; raises its Error for a code that is not `allowed`, and one that it
    told where it is not done.

    KeyboardInterrupt, and whatever `progress` raises: the program brakes the arm, finishes its log and ends before that goes
    on."""
    environment = make_environment() | {"VIABLE_MESSAGES": "json"}
    command = [find_program(), *map(str, arguments)]
    output: list[str] = []
    error: dict | None = None
    words: list[str] = []
    process: subprocess.Popen | None = None
    reader: threading.Thread | None = None
    try:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   env=environment, text=True, encoding="utf-8", errors="replace", start_new_session=True,
                                   preexec_fn=_follow_parent(os.getpid()))
        reader = threading.Thread(target=output.extend, args=(process.stdout,), daemon=True)
        reader.start()
        for line in process.stderr:
            message = _parse(line)
            if "progress" in message:
                if progress:
                    progress(message["progress"])
            elif "error" in message:
                error = message["error"]
            else:
                words.append(line)
        code = process.wait()
    except BaseException:
        if process:
            _end(process)
        raise
    finally:
        if process:
            if process.poll() is None:  # ending it was itself interrupted
                process.kill()
                process.wait()
            if reader and reader.ident:
                reader.join()
            process.stdout.close()
            process.stderr.close()
    if code in allowed and not (error and is_done and not is_done()):
        return code, "".join(output)
    if error:
        raise make_error(error["kind"], error["place"], error["cause"], error["remedy"])
    text = "".join(words).strip().removeprefix("viable: ")
    raise make_error(code, "", text or f"the program ended with code {code}", "")


_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


def _follow_parent(parent: int) -> Callable[[], None]:
    """For the child, before it becomes the program: where this process is killed, the program is told to brake and end. (The kernel
    watches the thread that calls, and that waits for the program. It may tell it twice, once for each thread: a second SIGINT
    would end the program at once, a second SIGHUP does not.)"""

    def ask() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # also under nohup
        _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGHUP, 0, 0, 0)
        if os.getppid() != parent:  # it has ended already
            os._exit(130)

    return ask


def _parse(line: str) -> dict:
    """A message of the program; {} for any other line, also one that a plugin printed and that looks like one."""
    try:
        message = json.loads(line) if line.startswith("{") else {}
    except (ValueError, RecursionError):
        return {}
    if not isinstance(message, dict):
        return {}
    shares, error = message.get("progress"), message.get("error")
    if isinstance(shares, dict) and all(isinstance(share, (int, float)) for share in shares.values()):
        return {"progress": shares}
    if (isinstance(error, dict) and type(error.get("kind")) is int
            and all(isinstance(error.get(part), str) for part in ("place", "cause", "remedy"))):
        return {"error": error}
    return {}


def _end(process: subprocess.Popen) -> None:
    """The first signal: brake, finish the log, end. A second Ctrl-C, or a plugin that hangs, is answered by the second."""
    process.send_signal(signal.SIGINT)
    drain = threading.Thread(target=process.stderr.read, daemon=True)
    drain.start()
    try:
        process.wait(30)
    except (subprocess.TimeoutExpired, KeyboardInterrupt):
        process.send_signal(signal.SIGINT)
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    drain.join()


def run(file: PathLike, *, set: Mapping[str, Any] | None = None, cases: str | Sequence[str] | None = None,
        out: PathLike | None = None, draw: str | None = None, jobs: int | None = None, report: bool = False,
        isolate: bool = False, progress: Callable[[dict[str, float]], None] | None = None) -> dict:
    """Runs an experiment file, every case, as `viable run` does.

    set       replaces entries of the file: {"duration_s": 5, "cases.C2.filter.gamma": 30}
    cases     only these
    out       a new folder for logs, summary.json and, with `report`, report.html; None: nothing is kept
    draw      "SEED:INDEX", the values of one run of a sweep
    jobs      cases at a time; None: one per core
    isolate   each plugin in a process of its own: for plugins that are not trusted yet (slow)
    progress  called with {case: share done} some ten times a second

    Returns the summary as a dict: `cases` by name with all figures of summary.json (keys carry their units), `exit_code`
    (0: as planned; tools/README.md), `folder` (None where nothing is kept). A run that trips or breaks a guarantee has a
    summary that says so; raises viable.Error where nothing could be run.
    Ctrl-C brakes the arms, finishes the logs and then raises KeyboardInterrupt.
    """
    arguments: list[Any] = ["run", file, *_overrides(set), *_cases(cases), *_options(draw=draw, jobs=jobs)]
    arguments += ["--no-report"] * (not report) + ["--isolate"] * isolate
    with tempfile.TemporaryDirectory(prefix="viable-") as scratch:
        folder = Path(scratch) / "run" if out is None else Path(out)
        before = (folder / "summary.json").exists()
        summary_file = folder / "summary.json"
        code, _ = _call([*arguments, "--out", folder], (0, 3, 4, 5, 6), progress, lambda: _has_cases(summary_file))
        if before or not summary_file.exists():
            raise Error(str(folder), "the run left no summary", "See the program's messages: run it in a terminal.", "internal")
        summary = json.loads(summary_file.read_text(encoding="utf-8"))
    summary["cases"] = {case["name"]: case for case in summary["cases"]}
    summary["exit_code"] = code
    summary["folder"] = None if out is None else str(folder)
    return summary


def _has_cases(summary: Path) -> bool:
    return summary.exists() and bool(json.loads(summary.read_text(encoding="utf-8"))["cases"])


def _with_json(arguments: Sequence[Any], allowed: Sequence[int]) -> tuple[int, dict]:
    with tempfile.TemporaryDirectory(prefix="viable-") as scratch:
        file = Path(scratch) / "result.json"
        code, _ = _call([*arguments, "--json", file], allowed)
        return code, json.loads(file.read_text(encoding="utf-8"))


def verify(log: PathLike, *, limits: str | None = None, signal: str = "real", columns: str | None = None,
           topic: str | None = None, confidence: float = 0.99, excess: float = 0.1, excess_duration: float = 0.05) -> dict:
    """Did the joints keep their limits? Judges noisy readings of a log or a CSV, with error bars, as `viable verify` does.

    limits   a robot whose limits count; None: those of the log
    signal   real: readings of the real arm; nominal
    columns  "NAME:UNIT,...": columns of a CSV and their units

    Returns its JSON as a dict, with `outcome`: held, broken or cannot_tell.
    """
    arguments = ["verify", log, "--excess-duration", excess_duration,
                 *_options(signal=signal, confidence=confidence, excess=excess, limits=limits, columns=columns, topic=topic)]
    code, verdict = _with_json(arguments, (0, 3, 7))
    verdict["outcome"] = {0: "held", 3: "broken", 7: "cannot_tell"}[code]
    return verdict


def identify(logs: PathLike | Sequence[PathLike], *, robot: str | None = None, payload: str = "mass_and_centre",
             out: PathLike | None = None, columns: str | None = None, sampled_torques: bool = False,
             body_masses: bool = False, rotor_inertias: bool = False, torque_offsets: bool = False) -> dict:
    """Joint friction and payload error of a real arm, from logs or CSVs of its positions and torques, as `viable identify`.

    robot    whose description is used; None: that of the logs
    payload  none, mass or mass_and_centre
    out      a new actuation.yaml for the robot's folder

    Returns all figures with their 95 % intervals.
    """
    files = [logs] if isinstance(logs, (str, os.PathLike)) else list(logs)
    arguments: list[Any] = ["identify", *files, *_options(payload=payload, robot=robot, out=out, columns=columns)]
    for name, wanted in (("--sampled-torques", sampled_torques), ("--body-masses", body_masses),
                         ("--rotor-inertias", rotor_inertias), ("--torque-offsets", torque_offsets)):
        arguments += [name] * wanted
    return _with_json(arguments, (0,))[1]


def bound(file: PathLike, *, set: Mapping[str, Any] | None = None, case: str | None = None) -> list[dict]:
    """How far the real arm can be from the nominal one, by the file's disturbance_set: one dict per case, as
    `viable bound --json`."""
    _, text = _call(["bound", file, "--json", *_overrides(set), *_cases(case)], (0,))
    return json.loads(text)


def sweep(file: PathLike, *, runs: int, out: PathLike, seed: int = 1, set: Mapping[str, Any] | None = None,
          cases: str | Sequence[str] | None = None, jobs: int | None = None) -> dict[str, list]:
    """Runs an experiment many times, its ~draws anew each time, as `viable sweep`.

    out  the folder of the table; runs that are there already are not done again

    Returns the table: one list per column, one entry per case and run (pandas.DataFrame takes it).
    """
    _call(["sweep", file, *_options(runs=runs, seed=seed, out=out, jobs=jobs), *_overrides(set), *_cases(cases)], (0, 3, 4, 6))
    return _read_table(Path(out))


def _read_table(folder: Path) -> dict[str, list]:
    file = (folder / "sweep.sqlite").resolve()
    with contextlib.closing(sqlite3.connect(file.as_uri() + "?mode=ro", uri=True)) as store:
        rows = store.execute("SELECT * FROM runs ORDER BY run, case_name")
        names = [column[0] for column in rows.description]
        columns = list(zip(*rows.fetchall()))
    return {name: list(columns[i]) if columns else [] for i, name in enumerate(names)}
