"""The type stubs against the module: the same classes, members and arguments, and everything documented."""

import ast
import importlib
import inspect
import math
import re
import unittest
from pathlib import Path

import viable
from viable import _viable

STUBS = ast.parse((Path(viable.__file__).parent / "_viable.pyi").read_text(encoding="utf-8"))
USUAL = {"__init__", "__doc__", "__module__", "__hash__", "__eq__", "__repr__", "__len__"}


def arguments_of(function):
    """[(name, is keyword only, has a default)] of a stub."""
    a = function.args
    positional = [*a.posonlyargs, *a.args]
    defaults = [False] * (len(positional) - len(a.defaults)) + [True] * len(a.defaults)
    found = [(arg.arg, False, default) for arg, default in zip(positional, defaults)]
    found += [(arg.arg, True, default is not None) for arg, default in zip(a.kwonlyargs, a.kw_defaults)]
    if a.kwarg:
        found.append(("**" + a.kwarg.arg, True, False))
    return found


def split(text):
    """At commas that are in no bracket."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "[({") - (letter in "])}")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


def arguments_in(function):
    """The same from pybind11's first line of documentation."""
    text = re.match(r"\w+\((.*)\) -> ", function.__doc__.splitlines()[0]).group(1)
    found, is_keyword = [], False
    for part in split(text):
        if part == "*":
            is_keyword = True
        elif part == "**kwargs":
            found.append((part, True, False))
        else:
            found.append((re.match(r"\w+", part).group(), is_keyword, "=" in re.sub(r"^[^=]*?:[^=]*", "", part)))
    return found


class Stubs(unittest.TestCase):
    def test_names(self):
        stubbed = {node.name for node in STUBS.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
        there = {name for name in vars(_viable) if not name.startswith("__") and callable(getattr(_viable, name))}
        self.assertEqual(stubbed, there)

    def test_members_and_arguments(self):
        compared = 0
        for node in STUBS.body:
            if isinstance(node, ast.FunctionDef):
                self.assertEqual(arguments_of(node), arguments_in(getattr(_viable, node.name)), node.name)
                continue
            if not isinstance(node, ast.ClassDef):
                continue
            actual = getattr(_viable, node.name)
            members = {member.name: member for member in node.body}
            there = {name for name in vars(actual) if not re.match(r"__|_pybind", name)}
            self.assertEqual({name for name in members if name not in USUAL}, there, node.name)
            for name, member in members.items():
                is_property = any(getattr(d, "id", "") == "property" for d in member.decorator_list)
                self.assertEqual(isinstance(vars(actual).get(name), property), is_property, f"{node.name}.{name}")
                if is_property or name in {"__len__", "__eq__", "__repr__"}:
                    continue
                compared += 1
                self.assertEqual(arguments_of(member)[1:], arguments_in(getattr(actual, name))[1:], f"{node.name}.{name}")
        self.assertGreater(compared, 15)

    def test_keywords_are_those_of_the_settings(self):
        for cls, stub in ((getattr(_viable, node.name), node) for node in STUBS.body if isinstance(node, ast.ClassDef)):
            if "__signature__" not in vars(cls):
                continue
            line = f"def {cls.__init__.__doc__.splitlines()[0]}: ..."
            written = next(member for member in stub.body if getattr(member, "name", "") == "__init__")
            self.assertEqual(ast.unparse(written), ast.unparse(ast.parse(line)),
                             f"Write this line into class {cls.__name__} of _viable.pyi: {line}")

    def test_signatures_are_told(self):
        self.assertEqual(str(inspect.signature(viable.ReferenceGuard)),
                         "(robot: 'Robot', tick: 'float' = 0.001, *, limits: 'Limits | None' = None, "
                         "between: 'str' = 'extrapolate', share: 'float' = 1, velocity_filter: 'float' = 0, "
                         "recovery: 'bool' = False) -> 'None'")
        self.assertEqual(inspect.signature(viable.Guard).parameters["k_alpha"].default, math.inf)
        self.assertEqual(inspect.signature(viable.Batch), inspect.signature(_viable.Batch))

        class Mine(viable.Batch):
            def __init__(self, arms):
                super().__init__(viable.Robot("indy7"), arms)

        self.assertEqual(list(inspect.signature(Mine).parameters), ["arms"])
        self.assertRegex(viable.Batch.__doc__, r"\n\n  limits: Limits, None; default None\n      The limits that are kept")
        self.assertEqual(len(Mine(2)), 2)

    def test_everything_of_the_package_is_documented(self):
        for name in viable.__all__:
            if name not in {"__version__", "STATUS", "ACTING"}:
                self.assertTrue(getattr(viable, name).__doc__, name)
        for cls in (viable.Guard, viable.ReferenceGuard, viable.Robot, viable.Limits, viable.Dynamics, viable.Servo, _viable.Batch):
            self.assertGreater(len(cls.__doc__), 40, cls)
            for name, member in vars(cls).items():
                if not name.startswith("_") and name not in {"name", "folder", "limits"}:
                    lines = (member.__doc__ or "").splitlines()
                    body = lines if isinstance(member, property) else lines[1:]
                    self.assertTrue("".join(body).strip(), f"{cls.__name__}.{name}")

    def test_what_is_exported_is_there(self):
        self.assertEqual(len(viable.__all__), len(set(viable.__all__)))
        namespace = {}
        exec("from viable import *", namespace)
        self.assertTrue(set(viable.__all__) <= set(namespace))
        self.assertIs(importlib.import_module("viable"), viable)


if __name__ == "__main__":
    unittest.main()
