"""tools/scripts/wheel.sh: the wheel in a fresh environment of every CPython that it is for, with numpy of PyPI, where neither the
project nor its build can be seen, does what a user does (portable_user.py)."""

import os
import re
import shutil
import subprocess
import tempfile
import unittest
import zipfile
from pathlib import Path

from support import bring

SOURCE = Path(os.environ["VIABLE_SOURCE_DIR"]).resolve()
BUILD = Path(os.environ["PYTHONPATH"]).resolve().parent
CLEAN = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIABLE_SOURCE_DIR")}


def run(*command, **more):
    ended = subprocess.run([*map(str, command)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=CLEAN, **more)
    if ended.returncode:
        raise AssertionError(f"{command} ended with {ended.returncode}: {ended.stdout[-4000:]}")
    return ended.stdout


class PortableWheel(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        bring("auditwheel==6.8.2")  # or is skipped; the script takes its own
        out = BUILD / "portable"
        run(SOURCE / "tools/scripts/wheel.sh", "--build", BUILD, out)
        cls.wheel, = out.glob("viable-*.whl")
        cls.tools = out / "work/venv/bin"

    def test_tag_size_and_licences(self):
        shown = run(self.tools / "auditwheel", "show", self.wheel)
        print(shown, f"{self.wheel.stat().st_size / 1e6:.1f} MB")
        self.assertIn(f'tag: "{self.wheel.stem.rpartition("-")[2]}"', " ".join(shown.split()))
        self.assertLess(self.wheel.stat().st_size, 40e6)
        with zipfile.ZipFile(self.wheel) as archive:
            names = archive.namelist()
            licences, = (name for name in names if name.endswith("/BUNDLED.txt"))
            rows = [line.split("\t") for line in archive.read(licences).decode().splitlines()[1:]]
        bundled = {Path(name).name for name in names if name.startswith("viable.libs/")}
        listed = {file for row in rows for file in row[2].split(", ")} - {"(compiled in)"}
        self.assertEqual({name for name in bundled if not name.startswith("libcurl")}, listed)
        self.assertTrue({"libSimTKsimbody", "liboctomap", "libldl", "libhdf5_serial"} <= {name.split("-")[0] for name in listed})
        for row in rows:
            self.assertIn(licences.replace("BUNDLED.txt", row[0]), names)
        self.assertFalse([name for name in names if re.search(r"libgnutls|libldap|libpython|libc\.so|libstdc", name)])

    def test_each_python_does_what_a_user_does(self):
        minors = re.findall(r"cp3(\d+)", self.wheel.name.split("-")[2])
        hidden = ["unshare", "--mount", "sh", "-ec", f"mount -t tmpfs none {BUILD}; mount -t tmpfs none {SOURCE}; exec \"$@\"", "sh"]
        if subprocess.run([*hidden, "true"], capture_output=True).returncode:
            print("the project stays visible: no mount namespace here")
            hidden = []
        pythons = (BUILD / "portable/work/pythons").read_text().split()
        self.assertEqual(len(pythons), len(minors))
        for python in pythons:
            with self.subTest(python), tempfile.TemporaryDirectory() as folder:
                run(python, "-m", "venv", f"{folder}/venv")
                run(f"{folder}/venv/bin/pip", "install", self.wheel)
                shutil.copy(SOURCE / "tests/python/portable_user.py", folder)
                os.mkdir(f"{folder}/empty")
                words = run(*hidden, f"{folder}/venv/bin/python", f"{folder}/portable_user.py", cwd=f"{folder}/empty")
                print(words)
                self.assertIn("all of it works", words)


if __name__ == "__main__":
    unittest.main()
