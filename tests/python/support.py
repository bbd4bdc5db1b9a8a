"""What the tests of guards and of batches share."""

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
