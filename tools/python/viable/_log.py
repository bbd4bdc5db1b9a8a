"""Logs of runs as numpy arrays."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Sequence

import numpy as np

from . import _viable
from ._errors import InputError


class Log:
    """A log (.mcap) as a table: one row per tick, columns by name.

        log = viable.Log("runs/x/C2.mcap")
        t = log["time_s"]                       # (rows,) float64
        q = log.joint_array("nominal", "q_rad")  # (rows, n)
        frame = log.to_pandas()

    Nothing but the head is read until a column is asked for; each is read once. Arrays are read-only: copy what is to be
    changed. Numbers are float64, whole numbers int64, words str.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = os.fspath(path)
        head = _viable.open_log(self.path)
        #: Names of all columns.
        self.columns: list[str] = head["columns"]
        #: Names of the joints.
        self.joints: list[str] = head["joints"]
        #: What the run was: versions, seeds, plugins.
        self.metadata: dict[str, str] = head["metadata"]
        #: Files that the log carries, such as experiment.yaml.
        self.attachments: dict[str, bytes] = head["attachments"]
        #: False: the run was killed, and the log ends with what it had written.
        self.complete: bool = head["complete"]
        self._read: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        return self.read([name])[name]

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        """Rows."""
        return len(self["time_s"])

    def __repr__(self) -> str:
        return f"<viable.Log {self.path}, {len(self.columns)} columns>"

    def read(self, names: Iterable[str]) -> dict[str, np.ndarray]:
        """Several columns in one pass over the file, each (rows,)."""
        names = list(names)
        for name in names:
            if name not in self.columns:
                close = difflib.get_close_matches(str(name), self.columns, 1)
                raise InputError(self.path, f"the log has no column {name!r}",
                                 f"Did you mean {close[0]!r}?" if close else "Log.columns lists them.")
        missing = [name for name in names if name not in self._read]
        if missing:
            for name, values in _viable.read_log(self.path, missing).items():
                values.flags.writeable = False
                self._read[name] = values
        return {name: self._read[name] for name in names}

    def joint_array(self, group: str, quantity: str) -> np.ndarray:
        """The columns GROUP.JOINT.QUANTITY of all joints, (rows, n): joint_array("nominal", "q_rad")."""
        names = [f"{group}.{joint}.{quantity}" for joint in self.joints]
        columns = self.read(names)
        return np.column_stack([columns[name] for name in names])

    def to_pandas(self, columns: Sequence[str] | None = None):
        """A pandas.DataFrame of these columns, or of all."""
        import pandas

        return pandas.DataFrame(self.read(self.columns if columns is None else columns))
