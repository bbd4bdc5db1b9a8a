"""Where program, robots and experiments are: beside the library that is loaded."""

from __future__ import annotations

import os
import shutil
import sys
import sysconfig
from pathlib import Path


def find_prefix() -> Path | None:
    """The folder with bin/viable, seen from the library: PREFIX/lib or PREFIX/lib/ARCHITECTURE."""
    from . import _viable

    library = Path(_viable.library).resolve()
    for folder in list(library.parents)[1:4]:
        if (folder / "bin" / "viable").is_file():
            return folder
    return None


def find_program() -> str:
    """The program `viable`, the one that belongs to the library."""
    from ._errors import Error

    prefix = find_prefix()
    program = str(prefix / "bin" / "viable") if prefix else shutil.which("viable")
    if program is None:
        raise Error("viable", "the program `viable` is neither beside the library nor in PATH",
                    "Install it: it comes with the library (Debian package viable).", "internal")
    return program


def make_environment() -> dict[str, str]:
    """The program's. Plugins in Python are run by this one, with its virtual environment; the library of a wheel that runs them
    is linked to no libpython, so it is told which."""
    environment = dict(os.environ)
    if sys.executable and not environment.get("VIABLE_PYTHON"):
        environment["VIABLE_PYTHON"] = sys.executable
        name, folder = sysconfig.get_config_var("INSTSONAME") or "", sysconfig.get_config_var("LIBDIR") or ""
        for place in (Path(folder), Path(folder, sysconfig.get_config_var("MULTIARCH") or ""), Path(sys.base_prefix, "lib")):
            if ".so" in name and (place / name).is_file():
                environment.setdefault("VIABLE_LIBPYTHON", str(place / name))
    return environment


def robot_folders() -> list[str]:
    """Where robots are searched, in order, as by the program."""
    folders = [folder for folder in os.environ.get("VIABLE_ROBOT_PATH", "").split(":") if folder]
    folders.append("robots")
    prefix = find_prefix()
    if prefix:
        folders.append(str(prefix / "share" / "viable" / "robots"))
    return folders


def plugin_folders() -> list[str]:
    """Where plugins are searched, in order, as by the program."""
    folders = [folder for folder in os.environ.get("VIABLE_PLUGIN_PATH", "").split(":") if folder]
    prefix = find_prefix()
    if prefix:
        from . import _viable

        folders += [str(prefix / "bin" / "plugins"), str(Path(_viable.library).resolve().parent / "viable" / "plugins")]
    return folders
