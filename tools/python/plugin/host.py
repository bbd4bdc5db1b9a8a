"""The part of viable's plugins in Python that is itself in Python: makes a class, and tells of what it raises."""

import collections
import difflib
import gc
import importlib.util
import inspect
import io
import os
import stat
import sys
import threading
import traceback

State = collections.namedtuple("State", "q qd qdd")
Limits = collections.namedtuple("Limits", "position velocity acceleration jerk")
Dynamics = collections.namedtuple("Dynamics", "M b gravity J tool")
JointCommand = collections.namedtuple("JointCommand", "q qd")
ToolCommand = collections.namedtuple("ToolCommand", "tool twist")
Setup = collections.namedtuple("Setup", "robot joints tick duration limits start tool")

USE = {
    "compute": "def compute(self, command, nominal, dynamics):` returns torques [Nm]",
    "filter": "def filter(self, nominal, torque, dynamics):` returns jerks [rad/s^3], or None to change nothing",
    "sample": "def sample(self, t):` returns joint positions [rad]",
}
ATTRIBUTES = {
    "compute": ("follows", ("joint", "tool", "both")),
    "filter": ("holds", ("jerk", "acceleration")),
    "sample": ("space", ("joint", "tool")),
}


def _make_plain(text):
    """What C++ can read: without halves of characters."""
    return text.encode("utf-8", "replace").decode("utf-8")


class Refused(Exception):
    """Arguments: parameter that is wrong, or "", what is wrong, remedy."""

    def __init__(self, parameter, cause, remedy):
        super().__init__(*map(_make_plain, (parameter, cause, remedy)))


def explain(error, file):
    """"ZeroDivisionError: division by zero (/path/my_law.py:12, in compute)"."""
    name = type(error).__name__
    try:
        text = " ".join(str(error).split())
    except BaseException:  # of an exception whose text cannot be made
        text = "(its text cannot be made)"
    text = f"{name}: {text[:240]}" if text else name
    if isinstance(error, SyntaxError) and error.filename:
        return _make_plain(f"{name}: {error.msg} ({error.filename}:{error.lineno})")
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename == file] or [frame for frame in frames if frame.filename != __file__]
    return _make_plain(f"{text} ({own[-1].filename}:{own[-1].lineno}, in {own[-1].name})" if own else text)


_folders = set()  # of the files so far
_loading = threading.RLock()


def _enter(folder):
    """As of a script: the file imports its neighbours. Where a class of another folder has one of the same name, that one is
    forgotten here, and stays with whoever imported it."""
    if folder in _folders and folder in sys.path:
        sys.path.remove(folder)
    sys.path.insert(0, folder)
    _folders.add(folder)
    for name, module in list(sys.modules.items()):
        if "." in name or _find_home(module) not in _folders - {folder}:
            continue
        if os.path.exists(os.path.join(folder, name + ".py")) or os.path.isdir(os.path.join(folder, name)):
            for each in list(sys.modules):
                if each.partition(".")[0] == name:
                    del sys.modules[each]


def _find_home(module):
    """The folder that a module, or the folder of a package, lies in; None: in none."""
    try:
        inside = next(iter(getattr(module, "__path__", ())), None) or getattr(module, "__file__", None)
        return os.path.dirname(inside) if inside else None
    except Exception:  # of what only stands for a module
        return None


def load(file):
    """Runs the file as a module of its own: classes of two cases share nothing but what they import."""
    with _loading:
        return _load(file)


def _load(file):
    folder, name = os.path.split(file)
    _enter(folder)
    name = "viable_plugin_" + name.removesuffix(".py")
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickles look there
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        raise Refused("", f"{file} cannot be loaded: {explain(error, file)}", "Correct the file: run it with /usr/bin/python3") from None
    return module


def make(file, name, parameters, method):
    """An object of the class, given its parameters."""
    module = load(file)
    kind = getattr(module, name, None)
    if not inspect.isclass(kind):
        there = [key for key, value in vars(module).items() if inspect.isclass(value) and value.__module__ == module.__name__]
        raise Refused("", f"{file} has no class `{name}`", f"It has {_list(there)}" if there else "Write one")
    if not callable(getattr(kind, method, None)):
        raise Refused("", f"the class {name} has no method `{method}`", f"`{USE[method]}")
    try:
        takes = inspect.signature(kind).parameters.values()
    except (TypeError, ValueError):
        takes = None
    if takes is not None:
        _check(name, takes, parameters)
    try:
        made = kind(**parameters)
    except BaseException as error:
        raise Refused("", f"the class {name} did not take its parameters: {explain(error, file)}",
                      "Correct the values here, or the class") from None
    return made


def _check(name, takes, parameters):
    named = [each for each in takes if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)]
    names = [each.name for each in named]
    if not any(each.kind == each.VAR_KEYWORD for each in takes):
        for key in parameters:
            if key not in names:
                close = difflib.get_close_matches(key, names, 1)
                raise Refused(key, f"the class {name} takes no parameter `{key}`",
                              (f"Did you mean `{close[0]}`? " if close else "")
                              + (f"It takes {_list(names)}" if names else "It takes none: its __init__ has no arguments"))
    for each in named:
        if each.default is each.empty and each.name not in parameters:
            raise Refused("", f"`{each.name}` is missing: the class {name} has no default for it", f"Add `{each.name}: ...` here")


def _show(value):
    try:
        text = " ".join(repr(value).split())
    except BaseException:
        text = "(its text cannot be made)"
    return text if len(text) <= 80 else f"{text[:80]}..."


def _list(names):
    return ", ".join(f"`{name}`" for name in names)


def choose(made, method, file):
    """The word that the object has for what it follows, holds or gives."""
    attribute, words = ATTRIBUTES[method]
    try:
        word = getattr(made, attribute, words[0])
    except BaseException as error:
        raise Refused("", f"`{attribute}` of the class {type(made).__name__} raised {explain(error, file)}",
                      f"Write one of {_list(words)} there") from None
    if not isinstance(word, str) or word not in words:
        raise Refused("", f"`{attribute}` of the class {type(made).__name__} is {_show(word)}", f"Write one of {_list(words)}")
    return word


def flush():
    """Writes what open files hold back, where Python is never ended, which would do it. A pipe might keep us waiting."""
    for each in gc.get_objects():
        if issubclass(type(each), (io.TextIOWrapper, io.BufferedWriter, io.BufferedRandom)):
            try:
                if stat.S_ISREG(os.fstat(each.fileno()).st_mode):
                    each.flush()
            except Exception:  # closed, or its disk is full
                pass
