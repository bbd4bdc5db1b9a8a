"""What somebody does who has the wheel and nothing else of the project: test_portable_wheel.py runs it, with the Python of a fresh
environment, in an empty folder."""

import re
import signal
import ssl
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import numpy as np

begin = time.perf_counter()
import viable  # noqa: E402

print(f"import viable: {1000 * (time.perf_counter() - begin):.0f} ms after numpy, Python {sys.version.split()[0]}, numpy {np.__version__}")
program = Path(sys.prefix, "bin", "viable")
prefix = Path(viable.find_program()).parent.parent
experiments = prefix / "share/viable/experiments"
inside = Path(viable.__file__).parent.parent
for line in Path("/proc/self/maps").read_text().splitlines():
    if (file := line.rpartition(" ")[2]) and re.search(r"viable|SimTK|octomap|hdf5|assimp|ldl|urdfdom", Path(file).name):
        assert Path(file).is_relative_to(inside), file


def call(*command, code=0):
    ended = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert ended.returncode == code, (command, ended.returncode, ended.stdout, ended.stderr)
    return ended.stdout + ended.stderr


assert call(program, "--version") == call(sys.executable, "-m", "viable", "--version") == f"viable {viable.__version__}\n"

# Guard and batch, with torques that ask for too much.
robot = viable.Robot("panda")
limits = robot.limits.replace(velocity=1.0)
rng = np.random.default_rng(0)
guard = viable.Guard(robot, tick=0.001, limits=limits)
guard.start(robot.home)
limited, worst = 0, 0.0
for tick in range(2000):
    if tick % 20 == 0:
        torque = robot.dynamics(guard.nominal.q).gravity + rng.uniform(-40, 40, 7)
    guard.step(guard.nominal.q, guard.nominal.qd, torque)
    limited += guard.status == "limited"
    worst = max(worst, abs(guard.nominal.qd).max())
assert limited > 100 and 0.5 < worst <= 1 + 1e-9 and guard.stop_reason == "none", (limited, worst)
batch = viable.Batch(robot, n=64, action="torque", limits=limits, plant={"payload_kg": "~uniform(0, 2)"})
batch.random_reset(rng)
for _ in range(20):
    batch.step(rng.uniform(-80, 80, (64, 7)), substeps=10)
assert 0.5 < abs(batch.qd).max() <= 1 + 1e-9 and (batch.acting != 0).any() and not np.array_equal(batch.real_q, batch.q)

# The main experiment and both engines, a report, a log elsewhere.
run = viable.run(experiments / "indy7_teleoperation.yaml", set={"duration_s": 1}, out="run", report=True)
assert run["exit_code"] == 0 and len(run["cases"]) > 2, run
assert run["cases"]["C3"]["verdict"].startswith("all limits kept"), run["cases"]["C3"]["verdict"]
assert "<html" in Path("run/report.html").read_text(encoding="utf-8")[:2000] and Path("run/report.html").stat().st_size > 700000
assert viable.run(experiments / "indy7_two_engines.yaml", set={"duration_s": 0.2})["exit_code"] == 0
assert len(viable.Log("run/C3.mcap")["time_s"]) == 1000
assert viable.verify("run/C3.mcap", signal="nominal")["outcome"] == "held"
call(program, "export", "run/C3.mcap", "--to", "hdf5", "C3.h5")
assert Path("C3.h5").read_bytes()[1:4] == b"HDF"

# A law in Python, for which this Python must have a shared library.
Path("law.py").write_text("class Half:\n    def filter(self, nominal, torque, dynamics):\n        return -10 * nominal.qdd\n")
Path("law.yaml").write_text("schema: 1\ntitle: mine\nrobot: indy7\nduration_s: 0.2\ncommand: {plugin: random_steps, seed: 1}\n"
                            "controller: {plugin: joint_pd, stiffness: 16, damping: 8}\ncases: {mine: {filter: {plugin: law.py:Half}}}\n")
if "VIABLE_LIBPYTHON" in viable._paths.make_environment():
    call(program, "run", "law.yaml", "--no-report", "--out", "law")
else:
    print("no shared library of this Python")
    assert "apt-get install libpython3.N" in call(program, "run", "law.yaml", "--no-report", "--out", "law", code=2)

# A live arm and its page.
live = subprocess.Popen([program, "live", experiments / "indy7_live.yaml", "--case", "joints", "--page", "127.0.0.1:0", "--no-priority", "--no-report", "--out", "live"],
                        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
try:
    words = ""
    while not (address := re.search(r"^page: (\S+)\n", words, re.MULTILINE)):
        assert (line := live.stdout.readline()), words
        words += line
    with urllib.request.urlopen(address[1], context=ssl._create_unverified_context(), timeout=30) as answer:
        page = answer.read()
        assert answer.status == 200 and b"<html" in page and len(page) > 600000, page[:1000]
finally:
    live.send_signal(signal.SIGINT)
    words = live.communicate(timeout=60)[0]
assert "stopped" in words, words
print("all of it works")
