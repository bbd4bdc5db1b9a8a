#!/usr/bin/env python3
"""The rooms of the source tree: who includes whom, and on which floor each stands.

A room is framework/src/<room> together with framework/include/viable/<room>, or a folder of tools/; all of plugins/ counts as
one. Fails where rooms include each other in a circle, or one that stands behind it in the tables of framework/README.md: the
first lists the framework's rooms, the second those of tools/; where a plugin includes a room of tools/; where a public header
includes a private one; where a file names something of the standard library without including its
header (a precompiled header would hide that); where a public header says that it throws Error and does not include it;
where a link of a page leads nowhere.
Usage: check.py [SOURCE_DIR]
"""
import re
import sys
from pathlib import Path

# Names of the standard library that are unmistakable, and the header that each must come from.
STD = {
    "vector": "vector", "map": "map", "multimap": "map", "set": "set", "optional": "optional", "nullopt": "optional",
    "function": "functional", "unique_ptr": "memory", "shared_ptr": "memory", "make_unique": "memory",
    "make_shared": "memory", "ifstream": "fstream", "ofstream": "fstream", "ostringstream": "sstream",
    "istringstream": "sstream", "stringstream": "sstream", "string_view": "string_view", "thread": "thread",
    "mutex": "mutex", "atomic": "atomic", "numeric_limits": "limits", "array": "array", "filesystem": "filesystem",
    "mt19937_64": "random", "mt19937": "random", "from_chars": "charconv", "to_chars": "charconv",
    "variant": "variant", "unordered_map": "unordered_map", "deque": "deque", "runtime_error": "stdexcept",
    "sort": "algorithm", "min_element": "algorithm", "max_element": "algorithm", "snprintf": "cstdio",
    "memcpy": "cstring", "strcmp": "cstring", "getenv": "cstdlib", "strtod": "cstdlib",
}
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^">]+)[">]', re.MULTILINE)
COMMENT_OR_TEXT = re.compile(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"', re.DOTALL)
THROWS_ERROR = re.compile(r"\bthrows? Error\b", re.IGNORECASE)
STD_NAME = re.compile(r"\bstd::(\w+)")


def room_of(path: Path, root: Path):
    """The room of a source file, or None where it belongs to none."""
    parts = path.relative_to(root).parts
    if parts[:2] == ("framework", "src"):
        return parts[2]
    if parts[:3] == ("framework", "include", "viable"):
        return parts[3]
    if parts[0] == "plugins":
        return "plugins"
    if parts[0] == "tools" and len(parts) > 2 and parts[1] != "templates":
        return parts[1]
    return None


class Tree:
    def __init__(self, root: Path):
        self.root = root
        self.public = root / "framework/include"
        self.private = root / "framework/src"
        self.files = [
            path
            for folder in ("framework/src", "framework/include", "plugins", "tools")
            for path in sorted((root / folder).rglob("*"))
            if path.suffix in (".h", ".cpp") and room_of(path, root) is not None
        ]
        self.text = {path: path.read_text(encoding="utf-8") for path in self.files}
        self.includes = {path: [name for _, name in INCLUDE.findall(text)] for path, text in self.text.items()}
        self.closure = {}

    def find(self, path: Path, name: str):
        """The file of the project that `name` means in `path`; None where it is somebody else's."""
        for folder in (path.parent, self.public, self.private, self.root / "tools"):
            if (folder / name).is_file():
                return (folder / name).resolve()
        return None

    def reach(self, path: Path):
        """The names of all headers that a file includes, by itself or by headers of the project."""
        if path not in self.closure:
            self.closure[path] = found = set()  # first: headers may include each other
            for name in self.includes.get(path, []):
                found.add(name)
                target = self.find(path, name)
                if target in self.text:
                    found |= self.reach(target)
        return self.closure[path]


def check_public_headers(tree: Tree):
    for path in tree.files:
        if not path.is_relative_to(tree.public):
            continue
        if THROWS_ERROR.search(tree.text[path]) and "viable/core/Error.h" not in tree.reach(path):
            yield f"{path.relative_to(tree.root)}: says that it throws Error, but does not include viable/core/Error.h"
        for name in tree.includes[path]:
            target = tree.find(path, name)
            if target is not None and not target.is_relative_to(tree.public):
                yield f"{path.relative_to(tree.root)}: a public header includes the private {name}"


def check_standard_headers(tree: Tree):
    """Each file must include what it names, by itself or by a header of the project that it includes."""
    for path in tree.files:
        code = COMMENT_OR_TEXT.sub('""', tree.text[path])
        missing = sorted({STD[name] for name in STD_NAME.findall(code) if name in STD} - tree.reach(path))
        if missing:
            yield f"{path.relative_to(tree.root)}: uses, but does not include, " + " ".join(f"<{h}>" for h in missing)


def find_arrows(tree: Tree):
    """{room: {other room: a file that includes it}}"""
    arrows = {}
    for path in tree.files:
        room = room_of(path, tree.root)
        arrows.setdefault(room, {})
        for name in tree.includes[path]:
            target = tree.find(path, name)
            other = room_of(target, tree.root) if target else None
            if other and other != room:
                arrows[room].setdefault(other, f"{path.relative_to(tree.root)} includes {name}")
    return arrows


def find_circle(arrows):
    """A list of rooms, each of which includes the next and the last the first; empty where there is none."""
    done, trail = set(), []

    def walk(room):
        if room in trail:
            return trail[trail.index(room):]
        if room in done:
            return []
        trail.append(room)
        for other in sorted(arrows.get(room, {})):
            if circle := walk(other):
                return circle
        trail.pop()
        done.add(room)
        return []

    for room in sorted(arrows):
        if circle := walk(room):
            return circle
    return []


def check_order(root: Path, arrows):
    """The tables of framework/README.md: a room includes only rooms before it, those of tools/ stand behind all others."""
    page = (root / "framework/README.md").read_text(encoding="utf-8")
    tables = [re.findall(r"^\| `([a-z]+)` \|", table, re.MULTILINE) for table in page.split("\n| room | what |\n")[1:]]
    framework = {p.name for p in (root / "framework/src").iterdir() if p.is_dir()}
    tools = {p.relative_to(root / "tools").parts[0] for p in (root / "tools").rglob("*.cpp")} - {"templates"}
    for table, rooms, folder in zip(tables, (framework, tools), ("framework/src", "tools")):
        if sorted(table) != sorted(rooms):
            yield f"a table of framework/README.md and the rooms of {folder} differ: {sorted(set(table) ^ rooms)}"
    place = {room: i for i, room in enumerate(room for table in tables for room in table)}
    if len(tables) != 2 or len(place) != len(framework) + len(tools):
        yield "framework/README.md has not two tables of rooms, or a room stands in both"
    for other in sorted(tools & set(arrows.get("plugins", {}))):
        yield f"a plugin includes a room of tools/: {arrows['plugins'][other]}"
    for room, others in sorted(arrows.items()):
        for other, how in sorted(others.items()):
            if place.get(other, -1) > place.get(room, len(place)):
                yield f"{room} stands before {other} in the tables of framework/README.md, and includes it: {how}"


def list_headings(page: Path):
    """The anchors of a page, as its viewers make them."""
    anchors, in_code = set(), False
    for line in page.read_text(encoding="utf-8").splitlines():
        in_code ^= line.startswith("```")
        if not in_code and line.startswith("#"):
            title = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"[`*]", "", line.lstrip("#").strip().lower()))
            anchors.add(re.sub(r"[^\w\- ]", "", title).replace(" ", "-"))
    return anchors


def check_links(root: Path):
    """Links from page to page, and to files of the tree."""
    for page in sorted(root.rglob("*.md")):
        if {"build", "runs", "node_modules", ".git"} & set(page.relative_to(root).parts):
            continue
        in_code = False
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
            in_code ^= line.startswith("```")
            for link in [] if in_code else re.findall(r"\]\(([^)\s]+)\)", line):
                name, _, anchor = link.partition("#")
                target = page.parent / name if name else page
                if link.startswith("http"):
                    continue
                if not target.exists():
                    yield f"{page.relative_to(root)}:{number}: the link {link} leads nowhere"
                elif anchor and anchor not in list_headings(target):
                    yield f"{page.relative_to(root)}:{number}: there is no heading for the link {link}"


def list_floors(arrows):
    """Rooms by floor: the lowest include nothing, each other stands above all that it includes."""
    floor = {}

    def height(room):
        if room not in floor:
            floor[room] = 1 + max((height(other) for other in arrows[room]), default=-1)
        return floor[room]

    for room in arrows:
        height(room)
    return floor


def main():
    root = Path(sys.argv[1] if len(sys.argv) > 1 else ".").resolve()
    tree = Tree(root)
    problems = [*check_public_headers(tree), *check_standard_headers(tree)]
    arrows = find_arrows(tree)
    problems += [*check_order(root, arrows), *check_links(root)]
    if circle := find_circle(arrows):
        problems.append("rooms include each other in a circle:")
        problems += [f"    {a} -> {b}: {arrows[a][b]}" for a, b in zip(circle, circle[1:] + circle[:1])]
    else:
        floor = list_floors(arrows)
        lines = {}
        for path in tree.files:
            room = room_of(path, root)
            lines[room] = lines.get(room, 0) + tree.text[path].count("\n")
        for number in range(max(floor.values()), -1, -1):
            rooms = sorted(room for room in floor if floor[room] == number)
            print(f"floor {number:2}: " + ", ".join(f"{room} ({lines[room]} lines)" for room in rooms))
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
