"""Plugins in Python: classes of a .py file in a run, and what becomes of their faults (fault 90)."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import tempfile
import textwrap
import time
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

import viable
from viable._paths import find_program

EXPERIMENT = """
schema: 1
title: Laws in Python
robot: planar_two_link
duration_s: 0.5
start: {position_rad: [-pi/4, pi/2]}
command: {plugin: waypoints, points: [[0, 0.3, 0.6]], interpolation: hold}
controller: {plugin: joint_pd, stiffness: 64, damping: 16}
filter: {plugin: certified_braking}
"""

CONTROLLER = """
import numpy as np
class Law:
    def __init__(self, stiffness=64.0, damping=16.0):
        self.stiffness, self.damping = stiffness, damping
    def configure(self, setup):
        self.n = len(setup.joints)
    def reset(self, state):
        self.ticks = 0
    def compute(self, command, nominal, dynamics):
        self.ticks += 1
        a = self.stiffness * (command.q - nominal.q) + self.damping * (command.qd - nominal.qd)
        return dynamics.M @ a + dynamics.b
"""


class Plugins(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))

    def write(self, code, name="law.py"):
        (self.folder / name).write_text(textwrap.dedent(code), encoding="utf-8")

    def read_joints(self, run, group, name):
        return viable.Log(self.folder / run / "A.mcap").joint_array(group, name)

    def write_experiment(self, changes=()):
        """The experiment with the lines that begin as `changes` do replaced by them."""
        lines = EXPERIMENT.splitlines()
        for change in changes:
            key = change.split(":")[0]
            lines = [line for line in lines if not line.startswith(key + ":")] + [change]
        (self.folder / "law.yaml").write_text("\n".join([*lines, "cases: {A: {}}"]) + "\n", encoding="utf-8")
        return self.folder / "law.yaml"

    def run_with(self, *changes, **options):
        return viable.run(self.write_experiment(changes), **options)

    def run_law(self, body, method="compute(self, command, nominal, dynamics)", key="controller", **options):
        """A run whose class has this body of its method; `raised at` tells the line."""
        self.write("import numpy as np\nclass Law:\n    ticks = 0\n    def " + method + ":\n        self.ticks += 1\n"
                   + textwrap.indent(textwrap.dedent(body), "        "))
        return self.run_with(f"{key}: {{plugin: law.py:Law}}", **options)

    def expect_good(self, summary):
        self.assertEqual(summary["exit_code"], 0, summary["cases"]["A"]["stop"])

    def assert_contains(self, told, texts):
        for text in texts:
            self.assertIn(text, told)

    def expect_fault(self, summary, *texts):
        """The arm was braked, and the run says why."""
        case = summary["cases"]["A"]
        self.assertEqual(summary["exit_code"], 4, case["stop"])
        self.assert_contains(case["stop"], texts)
        return case

    def expect_refusal(self, *texts, changes=("controller: {plugin: law.py:Law}",)):
        with self.assertRaises(viable.Error) as caught:
            self.run_with(*changes)
        self.assert_contains(str(caught.exception), texts)
        return caught.exception

    # --- what they can do

    def test_a_controller_gives_the_torques_of_the_compiled_one(self):
        self.write(CONTROLLER)
        self.run_with("controller: {plugin: law.py:Law}", out=self.folder / "python")
        self.run_with(out=self.folder / "compiled")
        for group, unit in (("desired", "tau_Nm"), ("nominal", "q_rad")):
            first, second = (self.read_joints(name, group, unit) for name in ("python", "compiled"))
            np.testing.assert_allclose(first, second, atol=1e-6)  # whose order of additions is another one
        self.assertGreater(np.ptp(first[:, 0]), 0.1)

    def test_a_filter_holds_jerks_accelerations_or_passes(self):
        for word, name, begin in (("jerk", "jerk_radps3", 0), ("acceleration", "qdd_radps2", 1)):
            self.write(f"import numpy as np\nclass Law:\n    holds = '{word}'\n"
                       "    def filter(self, nominal, torque, dynamics):\n        return np.array([3.0, -2.0])\n")
            self.run_with("filter: {plugin: law.py:Law}", "duration_s: 0.05", out=self.folder / word)
            values = self.read_joints(word, "nominal", name)[begin:]
            np.testing.assert_allclose(values, np.broadcast_to([3.0, -2.0], values.shape), atol=1e-9)
        self.write("class Law:\n    def filter(self, nominal, torque, dynamics):\n        return None\n")
        self.run_with("filter: {plugin: law.py:Law}", out=self.folder / "none")
        self.run_with("filter: {plugin: pass_through}", out=self.folder / "pass")
        np.testing.assert_array_equal(*(self.read_joints(name, "nominal", "q_rad") for name in ("none", "pass")))

    def test_filters_in_a_row_and_a_guarantee_behind_them(self):
        self.write("class Law:\n    def filter(self, nominal, torque, dynamics):\n        return 1e7 * torque\n")
        summary = self.run_with("filter: [{plugin: law.py:Law}, certified_braking]", "duration_s: 1")
        self.expect_good(summary)
        self.assertIn("all limits kept", summary["cases"]["A"]["verdict"])

    def test_a_command_in_joints_and_of_the_tool(self):
        self.write("import numpy as np\nclass Law:\n    def sample(self, t):\n"
                   "        return [0.1 * t, 0.2], np.array([0.1, 0], dtype=np.float32)\n")
        self.run_with("command: {plugin: law.py:Law}", out=self.folder / "joint")
        log = viable.Log(self.folder / "joint/A.mcap")
        np.testing.assert_array_equal(log.joint_array("command", "q_rad")[:, 0], 0.1 * log["time_s"])
        self.write("""
            import numpy as np
            class Law:
                space = "tool"
                def configure(self, setup):
                    self.pose = setup.tool
                def sample(self, t):
                    pose = self.pose.copy()
                    pose[2, 3] -= 0.1 * t
                    return pose
            """)
        self.expect_good(self.run_with("command: {plugin: law.py:Law}", "controller: {plugin: tool_servo}"))

    def test_a_class_hears_of_arm_limits_and_parameters(self):
        self.write("""
            import json
            class Law:
                def __init__(self, gain, mode="a", many=(), on=False, name="", **rest):
                    self.given = [gain, mode, many, on, name, rest]
                def configure(self, setup):
                    self.given += [setup.joints, setup.tick, setup.duration, setup.limits.velocity.tolist(), setup.start.q.tolist()]
                    json.dump(self.given, open("given.json", "w"))
                def compute(self, command, nominal, dynamics):
                    return dynamics.b
            """)
        with contextlib.chdir(self.folder):
            self.run_with("controller: {plugin: law.py:Law, gain: 2*pi, mode: fast, many: [[1, 2], [2.5]], on: true, name: '7', more: [.inf, pi]}")
        given = json.loads((self.folder / "given.json").read_text())
        robot = viable.Robot("planar_two_link")
        self.assertEqual(given[:6], [2 * np.pi, "fast", [[1, 2], [2.5]], True, "7", {"more": [np.inf, np.pi]}])
        self.assertEqual(given[6:9], [list(robot.joints), 0.001, 0.5])
        np.testing.assert_array_equal(given[9], robot.limits.velocity)
        np.testing.assert_allclose(given[10], [-np.pi / 4, np.pi / 2])

    def test_a_run_and_its_replay_are_the_same_to_the_bit(self):
        self.write(CONTROLLER)
        self.run_with("controller: {plugin: law.py:Law, stiffness: 40}", out=self.folder / "run")
        ended = subprocess.run([find_program(), "run", self.folder / "run/A.mcap", "--again"], capture_output=True, text=True,
                               cwd="/")
        self.assertEqual(ended.returncode, 0, ended.stdout + ended.stderr)

    def test_cases_share_no_module_and_run_at_once(self):
        self.write(CONTROLLER + "\ncount = 0\n")
        self.write_experiment(["controller: {plugin: law.py:Law}"])
        text = (self.folder / "law.yaml").read_text().replace("cases: {A: {}}", "cases: {A: {}, B: {}, C: {}}")
        (self.folder / "law.yaml").write_text(text)
        results = [viable.run(self.folder / "law.yaml", jobs=jobs)["cases"] for jobs in (1, 3)]
        for cases in results:
            self.assertEqual({case["stop"] for case in cases.values()}, {""})

    def test_neighbours_dataclasses_and_print(self):
        self.write("GAIN = 3.0\n", "law_neighbour.py")
        self.write("""
            from __future__ import annotations
            from dataclasses import dataclass
            import law_neighbour
            @dataclass
            class Law:
                gain: float = law_neighbour.GAIN
                def compute(self, command, nominal, dynamics):
                    return dynamics.b
            """)
        self.assertEqual(self.run_with("controller: {plugin: law.py:Law}")["exit_code"], 0)

    def test_neighbours_of_one_name_in_two_folders(self):
        for folder, torque in (("one", 1.0), ("two", 2.0)):
            (self.folder / folder).mkdir()
            self.write(f"TORQUE = {torque}\n", f"{folder}/law_neighbour.py")
            self.write("import json\nimport law_neighbour\nclass Law:\n"
                       "    def configure(self, setup): json.dump(law_neighbour.TORQUE, open(__file__ + '.json', 'w'))\n"
                       "    def compute(self, command, nominal, dynamics): return dynamics.b\n"
                       "    def filter(self, nominal, torque, dynamics): return None\n", f"{folder}/law.py")
        self.run_with("controller: {plugin: one/law.py:Law}", "filter: {plugin: two/law.py:Law}", "duration_s: 0.01")
        for folder, torque in (("one", 1.0), ("two", 2.0)):
            self.assertEqual(json.loads((self.folder / folder / "law.py.json").read_text()), torque)

    def test_what_a_thread_keeps_lasts_from_reset_on(self):
        self.write("""
            import threading
            import numpy as np
            local = threading.local()
            class Law:
                def reset(self, state):
                    np.seterr(over="raise")
                    local.word = "kept"
                def compute(self, command, nominal, dynamics):
                    assert np.geterr()["over"] == "raise"
                    assert local.word == "kept"
                    return dynamics.b
            """)
        self.expect_good(self.run_with("controller: {plugin: law.py:Law}", "duration_s: 0.05"))

    def test_what_open_files_hold_back_is_written(self):
        for isolate in (False, True):
            with self.subTest(isolate=isolate):
                name = self.folder / f"{isolate}.txt"
                self.write(f"file = open({str(name)!r}, 'w')\nclass Law:\n    def compute(self, command, nominal, dynamics):\n"
                           "        file.write('tick\\n')\n        return dynamics.b\n")
                self.run_with("controller: {plugin: law.py:Law}", "duration_s: 0.05", isolate=isolate)
                self.assertEqual(name.read_text(), "tick\n" * 50)

    def test_without_a_known_python_the_installed_one_runs_it(self):
        self.write(CONTROLLER)
        for executable in (None, ""):
            with mock.patch("sys.executable", executable):
                self.assertEqual(self.run_with("controller: {plugin: law.py:Law}", "duration_s: 0.01")["exit_code"], 0)
        with mock.patch.dict(os.environ, VIABLE_PYTHON=""):
            self.call(0, "run", self.folder / "law.yaml", "--no-report")

    def test_isolated_it_gives_the_same(self):
        self.write(CONTROLLER)
        for name in ("here", "isolated"):
            self.run_with("controller: {plugin: law.py:Law}", "duration_s: 0.1", isolate=name == "isolated", out=self.folder / name)
        np.testing.assert_array_equal(*(self.read_joints(name, "nominal", "q_rad") for name in ("here", "isolated")))

    # --- what is wrong with them before a run

    def test_unknown_and_missing_parameters(self):
        self.write(CONTROLLER)
        error = self.expect_refusal("takes no parameter `stifness`", "Did you mean `stiffness`?", "It takes `stiffness`, `damping`",
                                    changes=["controller: {plugin: law.py:Law, stifness: 3}"])
        self.assertIn("law.yaml:9:", error.place)
        self.assertIn("controller.stifness", error.place)
        self.write("class Law:\n    def __init__(self, gain): pass\n    def compute(self, a, b, c): return b.q\n")
        self.expect_refusal("`gain` is missing", "Add `gain: ...` here")
        self.expect_refusal("controller.gain", "a map", changes=["controller: {plugin: law.py:Law, gain: {a: 1}}"])

    def test_parameters_that_the_class_refuses(self):
        self.write("""
            class Law:
                def __init__(self, gain=1.0):
                    if not gain > 0:
                        raise ValueError("gain must be above 0")
                def compute(self, command, nominal, dynamics): return dynamics.b
            """)
        self.expect_refusal("did not take its parameters: ValueError: gain must be above 0", "law.py:5, in __init__",
                            changes=["controller: {plugin: law.py:Law, gain: -1}"])

    def test_files_and_classes_that_are_none(self):
        self.expect_refusal("there is no Python file", "law.py")
        self.write("class Law:\n    def compute(self, a, b c): pass\n")
        self.expect_refusal("cannot be loaded: SyntaxError", "law.py:2")
        self.write("import no_such_module_here\n")
        self.expect_refusal("ModuleNotFoundError", "no_such_module_here", "law.py:1")
        self.write("class Other:\n    pass\n")
        self.expect_refusal("has no class `Law`", "It has `Other`")
        self.write("class Law:\n    pass\n")
        self.expect_refusal("has no method `compute`", "def compute(self, command, nominal, dynamics):")
        self.expect_refusal("names no class", "my_law.py:MyLaw", changes=["controller: {plugin: law.py}"])
        self.write("class Law:\n    follows = 'hand'\n    def compute(self, a, b, c): pass\n")
        self.expect_refusal("`follows` of the class Law is 'hand'", "`joint`, `tool`, `both`")

    def test_only_commands_controllers_and_filters(self):
        self.write(CONTROLLER)
        self.expect_refusal("a robust_loop cannot be a class in Python", "viable new robust_loop",
                            changes=["real_plant: {plugin: simbody}", "robust_loop: {plugin: law.py:Law}"])

    def test_a_controller_of_joints_is_refused_for_a_tool(self):
        self.write(CONTROLLER)
        self.expect_refusal("the controller Law cannot follow the command", changes=[
            "command: {plugin: generated_hand_motion}", "controller: {plugin: law.py:Law}"])

    def test_what_configure_raises_is_told(self):
        self.write("class Law:\n    def configure(self, setup): return setup.no_such\n    def compute(self, a, b, c): pass\n")
        self.expect_refusal("the configure() of Law raised AttributeError", "law.py:2, in configure")
        self.write("class Law:\n    def reset(self, state): 1 / 0\n    def compute(self, a, b, c): pass\n")
        self.expect_refusal("its reset() raised ZeroDivisionError", "law.py:2, in reset")

    def test_a_check_names_the_class_that_raises(self):
        self.write("class Law:\n    space = 'tool'\n    def sample(self, t): return 1 / 0\n")
        self.expect_failed_check(["command: {plugin: law.py:Law}", "controller: {plugin: tool_servo}"], "the command plugin 'Law'",
                                 "it raised ZeroDivisionError", "law.py:3, in sample")
        self.write("class Law:\n    def compute(self, a, b, c): return 1 / 0\n")
        self.expect_failed_check(["controller: {plugin: law.py:Law}"], "the controller plugin 'Law'", "it raised ZeroDivisionError",
                                 "law.py:2, in compute")

    def expect_failed_check(self, changes, *texts):
        told = self.call(4, "check", self.write_experiment(changes))
        self.assert_contains(told, texts)
        self.assertNotIn("report", told)

    def call(self, code, *words, program=None, **more):
        """The program ends with this exit code. Returns what it wrote to stderr."""
        ended = subprocess.run([program or find_program(), *words], capture_output=True, text=True, cwd=self.folder, **more)
        self.assertEqual(ended.returncode, code, ended.stderr)
        return ended.stderr

    def test_the_word_of_a_class_is_none(self):
        self.write("import numpy as np\nclass Law:\n    follows = np.array(['joint', 'tool'])\n    def compute(self, a, b, c): pass\n")
        error = self.expect_refusal("`follows` of the class Law is array(", "`joint`, `tool`, `both`")
        self.assertNotIn("configure()", str(error))
        self.write("class Law:\n    @property\n    def follows(self): return 1 / 0\n    def compute(self, a, b, c): pass\n")
        error = self.expect_refusal("`follows` of the class Law raised ZeroDivisionError", "law.py:3, in follows")
        self.assertNotIn("configure()", str(error))

    def test_halves_of_characters_in_texts(self):
        self.expect_fault(self.run_law("raise ValueError('half \\ud800 of it')"), "it raised ValueError: half ? of it", "law.py:6, in compute")
        self.write("raise ValueError('half \\ud800 of it')\n")
        self.expect_refusal("cannot be loaded: ValueError: half ? of it", "law.py:1")

    def test_live_refuses_it_with_the_reason(self):
        self.write(CONTROLLER)
        file = self.write_experiment(["controller: {plugin: law.py:Law}"])
        self.assert_contains(self.call(2, "live", file, "--duration", "1"),
                             ("a class in Python cannot drive an arm in real time", "330 ms at worst", "viable new controller NAME",
                              "stream", "law.yaml"))

    def test_without_the_module_the_remedy_is_told(self):
        """The program alone, as the Debian package viable has it."""
        root = self.folder / "root"
        (root / "bin").mkdir(parents=True)
        build = Path(find_program()).parent
        shutil.copy2(build / "viable", root / "bin/viable")
        os.symlink(build / "plugins", root / "bin/plugins")
        os.symlink(build.parent / "share", root / "share")
        os.symlink(build.parent / "lib", root / "lib")
        self.write(CONTROLLER)
        file = self.write_experiment(["controller: {plugin: law.py:Law}"])
        self.assert_contains(self.call(2, "run", file, program=root / "bin/viable"),
                             ("viable_python.so", "python3-viable", "Tried: "))

    # --- what goes wrong in a tick

    def test_an_exception_is_told_with_its_line_and_the_tick_and_the_arm_is_braked(self):
        summary = self.run_law("if self.ticks > 200: return [1.0 / 0, 0]\nreturn dynamics.b")
        case = self.expect_fault(summary, "it raised ZeroDivisionError: float division by zero", "law.py:6, in compute", "(tick ",
                                 "the controller plugin 'Law'")
        self.assertGreater(case["stop_time_s"], 0.1)
        for isolate in (False, True):
            case = self.expect_fault(self.run_law("raise RuntimeError('no\\nmore')", isolate=isolate), "it raised RuntimeError: no more")
            self.assertEqual(case["stop_time_s"], 0.0)

    def test_it_comes_to_rest_within_its_limits(self):
        summary = self.run_law("if self.ticks > 400: raise KeyError('x')\nreturn dynamics.M @ [3.0, 3.0] + dynamics.b",
                               out=self.folder / "run")
        self.expect_fault(summary, "KeyError: 'x'")
        qd, jerk = (self.read_joints("run", "nominal", name) for name in ("qd_radps", "jerk_radps3"))
        self.assertGreater(abs(qd).max(), 0.2)
        np.testing.assert_allclose(qd[-1], 0, atol=1e-3)
        limits = viable.Robot("planar_two_link").limits
        self.assertLessEqual(abs(jerk).max(), limits.jerk[1].max() * (1 + 1e-9))

    def test_a_filter_and_a_command_that_raise(self):
        self.expect_fault(self.run_law("raise ValueError('f')", "filter(self, nominal, torque, dynamics)", "filter"),
                          "the filter plugin 'Law'", "it raised ValueError: f", "in filter")
        self.expect_fault(self.run_law("raise ValueError('c')", "sample(self, t)", "command"), "the command plugin 'Law'",
                          "it raised ValueError: c", "in sample")

    def test_what_is_raised_need_not_be_an_exception(self):
        for code, text in (("raise KeyboardInterrupt", "it raised KeyboardInterrupt"), ("import sys; sys.exit(0)", "it raised SystemExit"),
                           ("def f(): f()\nf()", "it raised RecursionError")):
            with self.subTest(code):
                self.expect_fault(self.run_law(code), text)

    def test_wrong_shapes_and_types(self):
        for code, text in (
                ("return np.zeros(3)", "what compute() returned: the array has shape (3,). Give one number per joint, shape (2,)"),
                ("return np.zeros((2, 1))", "the array has shape (2, 1)"), ("return None", "what compute() returned"),
                ("return 'ab'", "what compute() returned"), ("return np.zeros(2, dtype=complex)", "the array's type is complex128"),
                ("return {}", "what compute() returned")):
            with self.subTest(code):
                self.expect_fault(self.run_law(code), text)
        self.expect_fault(self.run_law("return np.eye(3)", "sample(self, t)", "command"), "what sample() returned", "shape (3, 3)")

    def test_other_arrays_are_taken(self):
        for code in ("return dynamics.b.astype(np.float32)", "return list(dynamics.b)", "return np.zeros(4)[::2]", "return (1, 2)",
                     "x = np.zeros(2); x.flags.writeable = False; return x"):
            with self.subTest(code):
                self.assertEqual(self.run_law(code)["exit_code"], 0)

    def test_nan_is_answered_as_of_any_plugin(self):
        self.expect_fault(self.run_law("return dynamics.b * np.nan"), "it gave no usable torque")
        self.expect_good(self.run_law("return dynamics.b * (np.nan if self.ticks % 50 == 7 else 1)"))
        self.expect_fault(self.run_law("return [np.inf, 0]", "filter(self, nominal, torque, dynamics)", "filter"),
                          "its decision has the wrong size or is not finite")

    def test_what_it_is_given_is_its_own(self):
        self.expect_good(self.run_law("for x in (*nominal, dynamics.M, dynamics.b, command.q): x[:] = np.nan\nreturn np.zeros(2)"))

    def test_a_hang_is_named_and_isolated_the_arm_is_braked(self):
        self.write("class Law:\n    ticks = 0\n    def compute(self, command, nominal, dynamics):\n        self.ticks += 1\n"
                   "        while self.ticks > 20: pass\n        return dynamics.b\n")
        file = self.write_experiment(["controller: {plugin: law.py:Law}"])
        self.assert_contains(self.call(4, "run", file, "--no-report", "--watchdog", "1", timeout=60), ("'Law'", "in tick 20"))
        self.call(4, "run", file, "--no-report", "--isolate", "--watchdog", "1", "--out", "isolated", timeout=60)
        np.testing.assert_allclose(self.read_joints("isolated", "nominal", "qd_radps")[-1], 0, atol=1e-3)

    def test_ctrl_c_ends_a_run_with_its_log(self):
        self.write("import time\nclass Law:\n    def compute(self, command, nominal, dynamics):\n        time.sleep(0.002)\n"
                   "        return dynamics.b\n")
        file = self.write_experiment(["controller: {plugin: law.py:Law}", "duration_s: 60"])
        process = subprocess.Popen([find_program(), "run", file, "--no-report", "--out", self.folder / "run"], cwd=self.folder,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while not list(self.folder.glob("run/*.mcap")):
            time.sleep(0.05)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(30), 130)
        self.assertGreater(len(viable.Log(self.folder / "run/A.mcap")["time_s"]), 10)

    def test_garbage_is_collected_in_the_middle_of_a_call(self):
        self.expect_good(self.run_law("import gc\nx = []; x.append(x); del x\ngc.collect()\nreturn dynamics.b", set={"duration_s": 0.1}))

    def test_threads_of_its_own_do_not_lock_it_out(self):
        self.write("""
            import threading
            class Law:
                def configure(self, setup):
                    threading.Thread(target=self.work, daemon=True).start()
                def work(self):
                    while True: sum(range(1000))
                def compute(self, command, nominal, dynamics):
                    return dynamics.b
            """)
        self.expect_good(self.run_with("controller: {plugin: law.py:Law}", "duration_s: 0.05"))

    def test_it_leaves_the_programs_ways_alone(self):
        """Locale, signals, working folder and the allocations of a tick: no warning."""
        for first in ("", "import subprocess\n"):  # which imports `signal`
            self.write(first + CONTROLLER)
            self.assertEqual(self.run_with("controller: {plugin: law.py:Law}")["cases"]["A"]["warnings"], [])


if __name__ == "__main__":
    unittest.main()
