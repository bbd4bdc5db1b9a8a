"""Targets for an arm that another process drives."""

from __future__ import annotations

import json
import os
import secrets
import socket
import stat
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np

from ._errors import Error, InputError

# As plugins/commands/stream/StreamMessage.h has them.
_MAGIC, _VERSION = 0x52545356, 1
_HEADER, _ANSWER = struct.Struct("<IHH16sQQqII"), struct.Struct("<IHHQd")
_SPACES = {"joint": 0, "tool": 1}
_TARGET, _GOODBYE = 0, 1
_MOST_ANSWERS = 64  # looked at after one target
_VERDICTS = ("taken", "malformed", "token", "busy", "space", "not_finite", "old", "stale")
_ERRORS = {
    "malformed": ("the command plugin stream does not understand it", "Use the viable that drives the arm."),
    "busy": ("another program sends targets to this arm", "End that one; half a second later this one is heard."),
    "space": ("its targets are of another size or space", "Make a new viable.Stream: the arm is another one now."),
    "not_finite": ("the arm refused its numbers", "Give finite numbers below 1000."),
}


def find_folder() -> Path:
    """Where sockets are, as the plugin has it."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    return Path(runtime) / "viable" if os.path.isabs(runtime) else Path("/tmp") / f"viable-{os.geteuid()}"


class Stream:
    """Sends targets to an arm that `viable live FILE` (or `viable run FILE`) drives with `command: {plugin: stream}`.

        with viable.Stream() as stream:
            while True:
                stream.send(policy(...))     # at 30 Hz, say; the arm ticks in C++
                time.sleep(1 / 30)

    name     as in the command's block
    timeout  how long to wait for an arm that listens [s]

    The newest target counts; where none comes the arm rests at the last one. Limits are kept by the case's filter. Use it from one
    thread. Of this computer and user only: a socket in a folder that nobody else can enter, and a token for each start of
    the program.
    """

    def __init__(self, name: str = "stream", timeout: float = 10.0) -> None:
        self._base = find_folder() / name
        self._socket: socket.socket | None = None
        self._sender = secrets.randbits(63) + 1
        self._sequence = self._answered = 0
        self.counts = dict.fromkeys(_VERDICTS, 0)
        self.age = float("nan")
        end = time.monotonic() + timeout
        while not self._connect():
            if time.monotonic() >= end:
                raise self._nobody()
            time.sleep(0.05)

    #: {verdict: answers so far}: taken, stale (late by more than the plugin's stale_s), old, ...
    counts: dict[str, int]
    #: how old the last target was when the arm looked at it [s]; nan before the first answer
    age: float
    #: names of the arm's joints, base first
    joints: list[str]
    #: joint or tool: what targets are
    space: str

    def send(self, target: Any) -> bool:
        """The place to be at now.

        target  space joint: positions, shape (n,) [rad]; space tool: the tool's pose in the base frame, shape (4, 4) [m]

        Returns False where it was not taken over because the arm takes none at the time (it waits for its start). Raises InputError
        for a wrong shape or number, and Error where nobody listens, or another program sends."""
        numbers = self._take(target)
        for attempt in (True, False):
            try:
                self._send(_TARGET, numbers.astype("<f8"))
                break
            except BlockingIOError:
                return False
            except OSError:
                if not attempt or not self._connect():
                    raise self._nobody() from None
        self._read_answers()
        return True

    def close(self) -> None:
        """The arm rests at the last target, and listens to another Stream at once."""
        if self._socket is None:
            return
        for _ in range(20):  # ms, in which it takes what it has before
            try:
                self._send(_GOODBYE, np.empty(0))
            except BlockingIOError:
                time.sleep(0.001)
                continue
            except OSError:  # it is gone: half a second of silence does as well
                pass
            break
        self._socket.close()
        self._socket = None

    def __enter__(self) -> Stream:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _nobody(self) -> Error:
        return Error(str(self._base), "no arm listens for targets there",
                     "Start `viable live FILE` with `command: {plugin: stream}`, and the same name, as the same user.", "internal")

    def _send(self, kind: int, numbers: np.ndarray) -> None:
        if self._socket is None:
            raise Error(str(self._base), "this stream is closed", "Make a new viable.Stream.", "internal")
        self._sequence += 1
        self._socket.send(_HEADER.pack(_MAGIC, _VERSION, _SPACES[self.space], self._token, self._sender, self._sequence,
                                       time.monotonic_ns(), len(numbers), kind) + numbers.tobytes())

    def _connect(self) -> bool:
        """To the program that listens now, if one does: of other senders the system drops what they send here."""
        folder = self._base.parent
        try:
            found = os.lstat(folder)
        except OSError:
            return False
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o077:
            raise Error(str(folder), "it is no folder of this user alone, so another one could listen there",
                        "Remove it, or chmod 700, or set XDG_RUNTIME_DIR.", "internal")
        made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            made.setblocking(False)
            made.connect(str(self._base) + ".socket")
            made.bind("")  # any address, for answers; after connect(): until then anybody could send there
            self._read_description()
        except (OSError, ValueError):
            made.close()
            return False
        except BaseException:
            made.close()
            raise
        if self._socket is not None:
            self._socket.close()
        self._socket = made
        self._answered = self._sequence
        return True

    def _read_description(self) -> None:
        found = json.loads(Path(f"{self._base}.json").read_text(encoding="utf-8"))
        if found["version"] != _VERSION:
            raise Error(str(self._base), f"it speaks version {found['version']} of the stream, this is {_VERSION}",
                        "Use the package of the viable that drives the arm.", "internal")
        self._token = bytes.fromhex(found["token"])
        self.space, self.joints = found["space"], found["joints"]

    def _take(self, target: Any) -> np.ndarray:
        try:
            array = np.asarray(target)
        except (TypeError, ValueError):
            raise InputError("target", f"a {type(target).__name__} is no array of numbers", "Give a numpy array.") from None
        if array.dtype.kind not in "fiub":  # not texts, and not complex numbers, which would lose their imaginary parts
            raise InputError("target", f"of type {array.dtype} it is no array of numbers", "Give a numpy array of real ones.")
        array = array.astype(float)
        shape, what = (((len(self.joints),), "one number per joint") if self.space == "joint"
                       else ((4, 4), "a pose of the tool in the base frame"))
        if array.shape != shape:
            raise InputError("target", f"the array has shape {array.shape}", f"Give {what}, shape {shape}.")
        if not np.isfinite(array).all():
            raise InputError("target", "it has numbers that are not finite", "The arm was sent nothing.")
        if self.space == "joint":
            return array
        rotation = array[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
            raise InputError("target", "the upper left 3 x 3 of the pose is no rotation",
                             "Its columns have length 1 and right angles, right-handed.")
        return np.concatenate([array[:3, 3], _quaternion(rotation)])

    def _read_answers(self) -> None:
        trouble = None
        is_other = False
        for _ in range(_MOST_ANSWERS):
            try:
                answer = self._socket.recv(64)
            except OSError:  # there is none
                break
            if len(answer) != _ANSWER.size:
                continue
            magic, version, verdict, sequence, age = _ANSWER.unpack(answer)
            if magic != _MAGIC or version != _VERSION or verdict >= len(_VERDICTS):
                continue
            word = _VERDICTS[verdict]
            if word != "malformed":  # that one tells of no sequence
                if not self._answered < sequence <= self._sequence:
                    continue
                self._answered = sequence
                self.age = age
            self.counts[word] += 1
            if word == "token":
                is_other = True
            elif word in _ERRORS:
                trouble = word
        if is_other:  # another start of the program
            self._connect()
        if trouble:
            raise Error(str(self._base), *_ERRORS[trouble], "internal")


def _quaternion(r: np.ndarray) -> np.ndarray:
    """w x y z of a rotation, by the largest of the four."""
    trace = np.trace(r)
    squares = np.array([trace, *(2 * r[i, i] - trace for i in range(3))]) + 1  # 4 w^2, 4 x^2, ...
    k = int(np.argmax(squares))
    rows = np.array([
        [squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
        [r[2, 1] - r[1, 2], squares[1], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2]],
        [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], squares[2], r[2, 1] + r[1, 2]],
        [r[1, 0] - r[0, 1], r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], squares[3]],
    ])
    return rows[k] / np.linalg.norm(rows[k])
