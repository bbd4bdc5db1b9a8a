"""The rule by which compare_bench.py calls a benchmark slower, on times made for it: python3 compare_test.py SCRIPTS"""

import contextlib
import io
import json
import math
import os
import random
import shutil
import stat
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, sys.argv.pop(1) if len(sys.argv) > 1 else os.path.join(os.path.dirname(__file__), "../../tools/scripts"))
import compare_bench  # noqa: E402


def make_times(draw, rounds, factor, noise=0.02):
    """Times as a shared machine gives them: both programs of a round share its speed, which drifts; one run in ten meets
    other load, which only adds."""
    old, new = [], []
    for number in range(rounds):
        speed = 100.0 * (1.0 + 0.3 * math.sin(number / 4.0) + 0.02 * number)
        for times, size in ((old, 1.0), (new, factor)):
            load = draw.expovariate(1.0) if draw.random() < 0.1 else 0.0
            times.append(speed * size * math.exp(draw.gauss(0.0, noise)) * (1.0 + load))
    return old, new


def count_changes(factor, change, noise=0.02, rounds=15, tries=2000):
    draw = random.Random(21)
    return sum(compare_bench.judge(*make_times(draw, rounds, factor, noise)).change == change for _ in range(tries)) / tries


class Rule(unittest.TestCase):
    def test_nothing_changed(self):
        for noise in (0.001, 0.02, 0.08):
            self.assertLess(count_changes(1.0, "slower", noise), 0.005)
            self.assertLess(count_changes(1.0, "faster", noise), 0.005)

    def test_a_tenth_is_found_either_way(self):
        self.assertGreater(count_changes(1.1, "slower"), 0.95)
        self.assertGreater(count_changes(1 / 1.1, "faster"), 0.95)
        self.assertEqual(count_changes(1.1, "faster"), 0.0)

    def test_below_a_twentieth_nothing_is_said_however_clear(self):
        self.assertEqual(count_changes(1.045, "slower", noise=0.0005), 0.0)

    def test_noise_hides_what_is_smaller(self):
        self.assertLess(count_changes(1.08, "slower", noise=0.3), 0.02)

    def test_the_figures_by_hand(self):
        old = [100.0] * 5
        verdict = compare_bench.judge(old, [108.0, 112.0, 110.0, 111.0, 109.0])
        self.assertAlmostEqual(verdict.ratio, 1.10)
        # Deviations of the logarithms: 0.0183, 0.0180, 0, 0.0091, 0.0091; their median is 0.0091.
        self.assertAlmostEqual(verdict.error, 1.2533 * 1.4826 * 0.0091 / math.sqrt(5), places=4)
        self.assertEqual(verdict.change, "slower")
        self.assertEqual(compare_bench.judge(old, [94.0] * 5).change, "faster")
        self.assertEqual(compare_bench.judge(old, [95.5] * 5).change, "")
        self.assertEqual(compare_bench.judge(old, old).change, "")

    def test_what_cannot_be_judged_is_refused(self):
        for old, new in (([1.0] * 4, [1.0] * 4), ([1.0] * 6, [1.0] * 5), ([1.0] * 5, [0.0] * 5),
                         ([1.0] * 5, [math.nan] * 5)):
            with self.assertRaises(ValueError):
                compare_bench.judge(old, new)

    def test_benchmarks_of_one_program_alone_are_named(self):
        five = [1.0] * 5
        verdicts, alone = compare_bench.judge_all({"a": five, "b": five}, {"b": [2.0] * 5, "c": five})
        self.assertEqual(list(verdicts), ["b"])
        self.assertEqual(verdicts["b"].change, "slower")
        self.assertEqual(alone, ["a", "c"])


def make_program(time_ns):
    """The text of a program that writes the file that Google Benchmark would."""
    rows = [{"name": "same", "cpu_time": 5.0, "time_unit": "us"},
            {"name": "tick", "cpu_time": time_ns, "time_unit": "ns"},
            {"name": "broken", "error_occurred": True, "cpu_time": 0.0, "time_unit": "ns"}]
    text = json.dumps({"benchmarks": rows})
    return (f"#!{sys.executable}\nimport sys\n"
            "[out] = [a[16:] for a in sys.argv if a.startswith('--benchmark_out=')]\n"
            f"open(out, 'w').write({text!r})\n")


def write_executable(path, text):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
    os.chmod(path, stat.S_IRWXU)


class Program(unittest.TestCase):
    def compare(self, old_ns, new_ns):
        with tempfile.TemporaryDirectory() as folder:
            paths = [os.path.join(folder, name) for name in ("old", "new")]
            for path, time_ns in zip(paths, (old_ns, new_ns)):
                write_executable(path, make_program(time_ns))
            return self.run_main(*paths, "--rounds", "5")

    def run_main(self, *arguments):
        sys.argv = ["compare_bench.py", *arguments]
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            try:
                code = compare_bench.main()
            except SystemExit as end:
                code = end.code
        return code, printed.getvalue()

    def test_what_cannot_be_told_ends_with_2(self):
        self.assertEqual(self.run_main("old", "new", "--rounds", "4"), (2, "compare_bench: at least 5 rounds\n"))
        code, text = self.run_main("/bin/false", "/bin/false")
        self.assertEqual(code, 2)
        self.assertIn("/bin/false ended with 1", text)

    def test_exit_code_and_text(self):
        code, text = self.compare(100.0, 120.0)
        self.assertEqual(code, 1)
        self.assertRegex(text, r"tick +1\.200 \+- 0\.000  slower\n")
        self.assertIn("2 benchmarks: 1 slower, 0 faster", text)
        code, text = self.compare(100.0, 80.0)
        self.assertEqual(code, 0)
        self.assertIn("2 benchmarks: 0 slower, 1 faster", text)


class Script(unittest.TestCase):
    """compare_bench.sh in a repository whose set-up copies a program instead of building one."""

    def setUp(self):
        self.root = self.enterContext(tempfile.TemporaryDirectory())
        self.git("init", "--quiet")
        for name in ("compare_bench.sh", "compare_bench.py"):
            target = os.path.join(self.root, "tools/scripts", name)
            os.makedirs(os.path.dirname(target), exist_ok=True)
            shutil.copy(os.path.join(os.path.dirname(compare_bench.__file__), name), target)
        with open(os.path.join(self.root, ".gitignore"), "w", encoding="utf-8") as file:
            file.write("/build/\n__pycache__/\n")
        for time_ns in (100.0, 125.0):
            write_executable(os.path.join(self.root, "program"), make_program(time_ns))
            write_executable(os.path.join(self.root, "tools/setup.sh"),
                             '#!/bin/bash\nset -e\ncd "$(dirname "$0")/.."\n[ "$*" = "release viable_bench" ]\n'
                             "mkdir -p build/release/tests\ncp program build/release/tests/viable_bench\n")
            self.commit(str(time_ns))

    def git(self, *arguments):
        return subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *arguments], cwd=self.root, check=True,
                              capture_output=True, text=True).stdout.strip()

    def commit(self, text):
        self.git("add", "-A")
        self.git("commit", "--quiet", "-m", text)

    def compare(self, *arguments):
        done = subprocess.run([os.path.join(self.root, "tools/scripts/compare_bench.sh"), *arguments],
                              capture_output=True, text=True, check=False)
        return done.returncode, done.stdout + done.stderr

    def test_of_two_commits_each_is_built_and_the_slower_one_told(self):
        for _ in range(2):  # the second time with what the first has left
            code, text = self.compare("HEAD~1", "HEAD", "--rounds", "5", "--filter", ".")
            self.assertEqual(code, 1, text)
            self.assertRegex(text, r"tick +1\.250 \+- 0\.000  slower\n")
        self.assertEqual(self.compare("HEAD", "HEAD~1", "--rounds", "5")[0], 0)
        self.assertEqual(self.compare("HEAD", "HEAD", "--rounds", "5")[0], 0)
        self.assertEqual(self.git("status", "--porcelain"), "")

    def test_what_is_no_commit_or_does_not_build_ends_with_2(self):
        code, text = self.compare("HEAD~7", "HEAD")
        self.assertEqual((code, text), (2, "compare_bench: 'HEAD~7' is no commit\n"))
        code, text = self.compare("HEAD")
        self.assertEqual(code, 2)
        self.assertIn("Usage: tools/scripts/compare_bench.sh OLD NEW", text)
        write_executable(os.path.join(self.root, "tools/setup.sh"), "#!/bin/bash\necho no compiler\nexit 1\n")
        self.commit("broken")
        code, text = self.compare("HEAD~1", "HEAD")
        self.assertEqual(code, 2)
        self.assertIn("no compiler\ncompare_bench: HEAD cannot be built", text)


if __name__ == "__main__":
    unittest.main()
