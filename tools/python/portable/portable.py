"""For tools/scripts/wheel.sh: portable.py BUILD MODULES OUT PYTHON... makes the wheel of an installed build and of the modules for such
versions of Python, puts every library that another Linux may lack into it (auditwheel), and the licences of all that is inside."""

import os
import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
import build_backend as backend  # noqa: E402

COMPILED_IN = ["libeigen3-dev", "libboost1*-dev", "libcli11-dev", "nlohmann-json3-dev", "pybind11-dev"]
COMMON = Path("/usr/share/common-licenses")


def ask(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def find_licences(libraries):
    """{file: text} of the Debian packages that such libraries, by their names in a wheel, are of, and what stands in which."""
    packages, lines = {}, []
    for library in sorted(libraries):
        soname = re.sub(r"-[0-9a-f]{8}(?=\.so)", "", library)
        if not soname.startswith("libcurl"):  # the empty one of CMakeLists.txt
            packages.setdefault(ask("dpkg-query", "--search", f"*/{soname}").split(":")[0], []).append(library)
    for name in ask("dpkg-query", "--show", "--showformat", "${Package}\\n", *COMPILED_IN).split():
        if Path("/usr/share/doc", name, "copyright").exists():
            packages[name] = ["(compiled in)"]
    files = {}
    for package, inside in sorted(packages.items()):
        files[f"{package}.txt"] = text = Path("/usr/share/doc", package, "copyright").read_text(encoding="utf-8")
        for each in re.findall(rf"{COMMON}/([A-Za-z0-9.+-]*[A-Za-z0-9])", text):
            if (COMMON / each).is_file():
                files[f"common/{each}"] = (COMMON / each).read_text(encoding="utf-8")
        source = ask("dpkg-query", "--show", "--showformat", "${source:Package} ${source:Version}\\n", package).splitlines()[0]
        lines.append(f"{package}.txt\tDebian source {source}\t{', '.join(inside)}\n")
    files["BUNDLED.txt"] = "Licence\tSource\tFiles\n" + "".join(lines)
    files["LICENSE"] = (backend.SOURCE / "LICENSE").read_text(encoding="utf-8")
    return files


def main(build, modules, out, *pythons):
    minors = sorted(int(ask(python, "-c", "import sys; print(sys.version_info[1])")) for python in pythons)
    with tempfile.TemporaryDirectory() as scratch:
        files = backend.collect(build, Path(scratch, "tree"))
        files = {name: file for name, file in files.items()
                 if not re.search(r"/_viable\.cpython|/viable_(contract|mpi\.so|python\.so)$|/lintian/", name)}
        for path in Path(modules, "viable").rglob("*.so"):
            files[str(path.relative_to(modules))] = (path.read_bytes(), 0o755)
        tags = ".".join(f"cp3{minor}" for minor in minors)
        machine = os.uname().machine
        plain = backend.write(scratch, files, f"{tags}-{tags}-linux_{machine}", f">=3.{minors[0]}")
        system = f"/usr/lib/{ask('gcc', '-print-multiarch').strip()}"  # whatever BLAS is this machine's: the plain one
        subprocess.run(["auditwheel", "repair", "--plat", "auto", "--wheel-dir", Path(scratch, "out"), Path(scratch, plain)], check=True,
                       stdout=sys.stderr, env=dict(os.environ, LD_LIBRARY_PATH=f"{modules}:{system}/blas:{system}/lapack"))
        repaired = next(Path(scratch, "out").glob("*.whl"))
        with zipfile.ZipFile(repaired) as archive:
            files = {entry.filename: (archive.read(entry), entry.external_attr >> 16 & 0o777) for entry in archive.infolist()
                     if not entry.is_dir() and not entry.filename.endswith("/RECORD")}
        info = next(name for name in files if name.endswith(".dist-info/METADATA")).rpartition("/")[0]
        bundled = [Path(name).name for name in files if name.startswith("viable.libs/")]
        for name, text in find_licences(bundled).items():
            files[f"{info}/licenses/{name}"] = (text.encode(), 0o644)
        wheel = Path(out, repaired.name)
        part = wheel.with_suffix(".part")
        backend.write_archive(part, files)
        part.replace(wheel)
    print(f"wheel: {wheel} ({wheel.stat().st_size / 1e6:.1f} MB, {len(bundled)} libraries bundled)")


if __name__ == "__main__":
    main(*sys.argv[1:])
