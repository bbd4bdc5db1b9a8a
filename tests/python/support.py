"""What the tests of guards and of batches share."""

import os
import subprocess
import sys
import unittest
from pathlib import Path

import numpy as np

import viable


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
