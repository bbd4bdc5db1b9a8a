"""Builds the wheel of the package: module, library, program, plugins, robots and experiments in one, for this machine.

Needs what tools/setup.sh installs (its list at the top), python3-dev and pybind11-dev, and no package index: the project's own
CMake does the work. A build in ../../build/release is used, and brought up to date; the first takes some minutes. With
`--config-settings build=FOLDER` pip takes that build as it is. The wheel depends on the shared libraries of this Debian, so it is
for machines alike.
"""

import base64
import hashlib
import os
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent.parent
PROJECT = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def _run(*command):
    print("viable:", *map(str, command), file=sys.stderr, flush=True)
    try:
        subprocess.run([*map(str, command)], check=True, stdout=sys.stderr)
    except (OSError, subprocess.CalledProcessError) as error:
        raise SystemExit(f"viable: `{command[0]}` failed: {error}. Install what is missing with tools/setup.sh release viable_python,"
                         " in the project's folder.") from None


def _metadata(python):
    readme = (HERE / "README.md").read_text(encoding="utf-8")
    return (f"Metadata-Version: 2.1\nName: {PROJECT['name']}\nVersion: {PROJECT['version']}\n"
            f"Summary: {PROJECT['description']}\nLicense: Apache-2.0\nRequires-Python: {python}\n"
            f"Requires-Dist: {PROJECT['dependencies'][0]}\nDescription-Content-Type: text/markdown\n\n{readme}")


def _tag():
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    return f"{python}-{python}-{platform}"


def get_requires_for_build_wheel(config_settings=None):
    return []


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """A wheel for this interpreter. Its tree: viable/ the package, viable/root/ what it calls (bin, lib, share)."""
    given = (config_settings or {}).get("build")
    build = Path(given) if given else SOURCE / "build" / "release"
    if not given:
        _run("cmake", "--preset", "release", "-S", SOURCE, "-B", build)
    minor = _read_cache(build).get("VIABLE_PYTHON_MINOR")
    if minor != str(sys.version_info.minor):
        raise SystemExit(
            f"viable: this is Python 3.{sys.version_info.minor}, and the module is built "
            + (f"for Debian's Python 3.{minor}" if minor else "not at all: python3-dev or pybind11-dev is missing")
            + ". Install those, and use a virtual environment of /usr/bin/python3.")
    if not given:
        _run("cmake", "--build", build, "--target", "viable_python")
    with tempfile.TemporaryDirectory() as scratch:
        return write(wheel_directory, collect(build, scratch), _tag(), PROJECT["requires-python"])


def _read_cache(build):
    lines = (build / "CMakeCache.txt").read_text(encoding="utf-8").splitlines()
    return {line.split(":", 1)[0]: line.split("=", 1)[1] for line in lines if ":" in line and "=" in line}


def collect(build, scratch):
    """{path in the wheel: (bytes, mode)} of a build, which is installed into the folder `scratch`."""
    _run("cmake", "--install", build, "--prefix", scratch, "--strip")
    prefix = Path(scratch)
    files = {}
    package = next(prefix.glob("lib/python3/dist-packages/viable"))
    for path in sorted(prefix.rglob("*")):
        if not path.is_file():
            continue
        if path.is_relative_to(package):
            target = Path("viable") / path.relative_to(package)
        else:
            within = path.relative_to(prefix)
            if within.parts[0] == "include" or "cmake" in within.parts or "doc" in within.parts:
                continue  # for plugins of one's own: the Debian package
            if path.name.startswith("libviable.so") and path.name.count(".") != 3:
                continue  # a wheel knows no links: the name that the program asks for is enough
            target = Path("viable", "root") / within
        files[str(target)] = (path.read_bytes(), 0o755 if os.access(path, os.X_OK) else 0o644)
    return files


def write(folder, files, tag, python):
    """Writes the wheel of such files, with what tells an installer about it; returns its name."""
    name = f"{PROJECT['name']}-{PROJECT['version']}"
    pythons, abis, platform = tag.split("-")
    tags = "".join(f"Tag: {each}-{abi}-{platform}\n" for each in pythons.split(".") for abi in abis.split(".") if each == abi)
    scripts = "".join(f"{script} = {call}\n" for script, call in PROJECT["scripts"].items())
    about = {"METADATA": _metadata(python), "entry_points.txt": f"[console_scripts]\n{scripts}",
             "WHEEL": f"Wheel-Version: 1.0\nGenerator: viable\nRoot-Is-Purelib: false\n{tags}"}
    write_archive(Path(folder) / f"{name}-{tag}.whl",
                  files | {f"{name}.dist-info/{each}": (text.encode(), 0o644) for each, text in about.items()})
    return f"{name}-{tag}.whl"


def write_archive(wheel, files):
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        records = []
        for target, (data, mode) in sorted(files.items()):
            entry = zipfile.ZipInfo(target, (2020, 1, 1, 0, 0, 0))
            entry.external_attr = (0o100000 | mode) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, data)
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            records.append(f"{target},sha256={digest},{len(data)}")
        record = f"{PROJECT['name']}-{PROJECT['version']}.dist-info/RECORD"
        archive.writestr(record, "\n".join([*records, f"{record},,"]) + "\n")
