"""Errors of the library as exceptions."""

from __future__ import annotations

#: By the exit code of the program.
KINDS = {2: "bad_input", 3: "guarantee_broken", 4: "plugin_failed", 5: "log_not_written", 6: "tracking_lost", 70: "internal",
         71: "out_of_memory"}


class Error(RuntimeError):
    """Something cannot be done.

    place   where: an argument, a file with line and column, a library
    cause   what is wrong there, with the value and what is allowed
    remedy  what to do about it; may be empty
    kind    bad_input, guarantee_broken, plugin_failed, log_not_written, tracking_lost, internal, out_of_memory
    """

    def __init__(self, place: str, cause: str, remedy: str = "", kind: str = "bad_input") -> None:
        text = f"{place}: {cause}" if place else cause
        super().__init__(f"{text}. {remedy}" if remedy else text)
        self.place = place
        self.cause = cause
        self.remedy = remedy
        self.kind = kind

    def __reduce__(self):
        return type(self), (self.place, self.cause, self.remedy, self.kind)


class InputError(Error, ValueError):
    """What was given is not what it must be (kind bad_input)."""


def make_error(code: int, place: str, cause: str, remedy: str) -> Error:
    """The exception for an error of the library. code: its number, as the program's exit code."""
    kind = KINDS.get(code, "internal")
    return (InputError if kind == "bad_input" else Error)(place, cause, remedy, kind)
