"""Plain types."""

import inspect
import math
from typing import NamedTuple

import numpy as np


class State(NamedTuple):
    """Positions [rad], velocities [rad/s] and accelerations [rad/s^2] of the joints, each (n,)."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


class Signature:
    """What `inspect.signature` tells of a class whose `__init__` documents its arguments in its first line."""

    def __init__(self, init):
        self._init = init

    def __get__(self, instance, owner):
        if owner.__init__ is not self._init:  # of a class of somebody else
            raise AttributeError("__signature__")
        names = {"inf": math.inf}
        exec(f"from __future__ import annotations\ndef {self._init.__doc__.splitlines()[0]}: pass", names)
        signature = inspect.signature(names["__init__"])
        return signature.replace(parameters=list(signature.parameters.values())[1:])


#: What Batch.status counts by.
STATUS = ("not_started", "passed", "limited", "recovering", "waiting", "stopping", "stopped", "failed")
