"""What the tests of guards and of batches share."""

import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import viable

EXPERIMENTS = Path(os.environ["VIABLE_SOURCE_DIR"]) / "experiments"
EFFORT = float(os.environ.get("VIABLE_EFFORT", "1"))


def assert_same(found, expected, message=""):
    """Arrays that are the same to the bit, one by one."""
    for values, wanted in zip(found, expected, strict=True):
        np.testing.assert_array_equal(values, wanted, message)


def expect_refusals(test, *refused):
    """Each of these (what is called, what the error says) is refused."""
    for call, cause in refused:
        with test.subTest(cause=cause), test.assertRaisesRegex(viable.InputError, cause):
            call()


def make_forms(values):
    """The same numbers as arrays of other kinds and as a list."""
    wide = np.zeros((len(values), 2 * values.shape[1]))
    wide[:, ::2] = values
    frozen = values.copy()
    frozen.flags.writeable = False
    return values, values.astype(float), values.tolist(), np.asfortranarray(values), wide[:, ::2], frozen


def run_teleoperation(test, case, settings):
    """The log of a case of the main experiment."""
    out = Path(test.enterContext(tempfile.TemporaryDirectory())) / "run"
    viable.run(EXPERIMENTS / "indy7_teleoperation.yaml", cases=case, out=out, set=settings)
    return viable.Log(out / f"{case}.mcap")


def find_largest(pairs):
    """By how much values are beyond a limit, relative to that; inf where one is not finite."""
    worst = 0.0
    for values, (lower, upper) in pairs:
        if not np.isfinite(values).all():
            return np.inf
        for sign, bound in ((1, upper), (-1, lower)):
            there = np.isfinite(bound)
            if there.any():
                share = sign * (values[..., there] - bound[there]) / np.maximum(abs(bound[there]), 1e-3)
                worst = max(worst, share.max())
    return worst


def read_limits(log):
    """The limits of the first tick."""
    return viable.Limits(**{name: tuple(log.joint_array("limits", f"{name}_{side}_{unit}")[0] for side in ("lower", "upper"))
                            for name, unit in (("position", "rad"), ("velocity", "radps"), ("acceleration", "radps2"),
                                               ("jerk", "radps3"))})


def bring(*packages):
    """Packages of PyPI, NAME==VERSION, for this process: from a virtual environment that is kept. Where they cannot be had, the
    tests are skipped."""
    folder = Path(os.environ["PYTHONPATH"]).parent / "from_pypi" / packages[0]
    whole = folder / "whole"
    if not whole.exists() or whole.read_text() != str(packages):
        for command in ([sys.executable, "-m", "venv", "--system-site-packages", "--clear", folder],
                        [folder / "bin/pip", "--retries", "1", "--timeout", "10", "install", *packages]):
            if (ended := subprocess.run(command, capture_output=True, text=True)).returncode != 0:
                reason = f"{', '.join(packages)} cannot be had: " + (ended.stdout + ended.stderr).strip().splitlines()[-1]
                print("skipped:", reason)
                raise unittest.SkipTest(reason)
        whole.write_text(str(packages))
    sys.path.insert(0, str(next(folder.glob("lib/python3*/site-packages"))))
