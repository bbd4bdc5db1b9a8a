"""pip install tools/python, into a virtual environment and without an index."""

import os
import subprocess
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path

import viable

SOURCE = Path(os.environ["VIABLE_SOURCE_DIR"])


class Wheel(unittest.TestCase):
    def test_version_is_the_librarys(self):
        project = tomllib.loads((SOURCE / "tools/python/pyproject.toml").read_text(encoding="utf-8"))["project"]
        self.assertEqual(project["version"], viable.__version__)

    def test_pip_installs_it_and_it_runs_from_there(self):
        if subprocess.run([sys.executable, "-c", "import ensurepip"], capture_output=True).returncode != 0:
            self.skipTest("python3-venv is not installed")
        environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIABLE_SOURCE_DIR")}
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", "venv"], cwd=folder, check=True)
            python = f"{folder}/venv/bin/python"
            ended = subprocess.run([python, "-m", "pip", "install", "--no-index", "--no-build-isolation", "--config-settings",
                                    f"build={Path(os.environ['PYTHONPATH']).parent}", SOURCE / "tools/python"],
                                   cwd=folder, env=environment, capture_output=True, text=True)
            self.assertEqual(ended.returncode, 0, ended.stdout + ended.stderr)
            code = ("import sys, viable; robot = viable.Robot('panda'); batch = viable.Batch(robot, 4, plant={});"
                    "batch.step(batch.torque.copy()); run = viable.run(robot.folder + '/../../experiments/"
                    "indy7_teleoperation.yaml', cases='C3', set={'duration_s': 0.1}); assert run['exit_code'] == 0;"
                    f"run = viable.run({str(SOURCE / 'tools/python/examples/my_law.yaml')!r}, cases='mine', set={{'duration_s': 0.1}});"
                    "assert run['exit_code'] == 0;"
                    "print(viable._viable.library, robot.folder, viable.__file__, sep='\\n')")
            ended = subprocess.run([python, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)
            self.assertEqual(ended.returncode, 0, ended.stderr)
            for line in ended.stdout.splitlines():
                self.assertTrue(line.startswith(folder), line)
            self.assertEqual(subprocess.run([f"{folder}/venv/bin/viable", "--version"], env=environment, capture_output=True,
                                            text=True).stdout, f"viable {viable.__version__}\n")
            self.assertEqual(subprocess.run([python, "-m", "pip", "uninstall", "-y", "viable"], env=environment,
                                            capture_output=True).returncode, 0)
            self.assertEqual(list(Path(folder).rglob("libviable*")), [])


if __name__ == "__main__":
    unittest.main()
