#!/usr/bin/env python3
"""The JSON Schema of experiment files against the reader: the same keys, the same ranges; what is in the project
validates; what is broken is refused by both. Usage: check.py BUILD_DIR SOURCE_DIR"""
import copy
import glob
import json
import math
import os
import re
import subprocess
import sys
import tempfile

import jsonschema
import yaml

BUILD, SOURCE = sys.argv[1:3]
VIABLE = os.path.join(BUILD, "bin", "viable")
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "VIABLE_PLUGIN_PATH"}
faults = []


class Loader(yaml.SafeLoader):
    """YAML 1.2, as the reader and editors read it; PyYAML's own 1.1 takes `1e-3` for text and `off` for false."""


Loader.yaml_implicit_resolvers = {}
for tag, pattern, first in [
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", r"[-+]?[0-9]+", "-+0123456789"),
    ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)", "-+0123456789."),
]:
    Loader.add_implicit_resolver("tag:yaml.org,2002:" + tag, re.compile(f"^(?:{pattern})$"), list(first))


def load(text):
    return yaml.load(text, Loader)


def run(*arguments):
    return subprocess.run([VIABLE, *arguments], cwd=SOURCE, env=ENVIRONMENT, capture_output=True, text=True)


def output_of(*arguments):
    done = run(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


schema = json.loads(output_of("schema"))
jsonschema.Draft7Validator.check_schema(schema)
validator = jsonschema.Draft7Validator(schema)
plugins = json.loads(output_of("plugins", "--json"))["plugins"]
BLOCK_OF_KIND = {"command": "command", "controller": "controller", "filter": "filter", "robust_loop": "robust_loop",
                 "plant": "real_plant"}

BASE = load("""
schema: 1
title: base
robot: single_joint
duration_s: 1
command: {plugin: waypoints, points: [[0, 1], [1, -1]]}
controller: {plugin: joint_pd}
filter: {plugin: tosbp}
robust_loop: {plugin: nric}
real_plant: {plugin: simbody}
cases: {A: {}}
""")

# ---------------------------------------------------------------- what is in the project

with open(os.path.join(SOURCE, "experiments/README.md")) as file:
    section = file.read().split("## An experiment file")[1]
examples = {"experiments/README.md": section.split("```yaml\n")[1].split("```")[0]}
for path in glob.glob(SOURCE + "/experiments/*.yaml") + glob.glob(SOURCE + "/tools/templates/*/experiment.yaml"):
    with open(path) as file:
        # A template's plugin is not there yet: as one that is named by its path.
        examples[path] = file.read().replace("plugin: @NAME@", "plugin: ./own.so").replace("@NAME@", "own")
assert len(examples) > 8, sorted(examples)
for path, text in examples.items():
    for error in validator.iter_errors(load(text)):
        faults.append(f"{path} does not validate: {error.json_path}: {error.message}")
for path in glob.glob(SOURCE + "/experiments/*.yaml"):
    with open(path) as file:
        link = re.fullmatch(r"# yaml-language-server: \$schema=(\S+)", file.readline().strip())
    if not link or link[1] != "experiment.schema.json":  # where it is installed (tests/package), and what README.md writes
        faults.append(f"{path}: the first line does not lead an editor to the schema")

# ---------------------------------------------------------------- the same keys

folder = tempfile.TemporaryDirectory()


def write(experiment):
    path = os.path.join(folder.name, "e.yaml")
    with open(path, "w") as file:
        file.write(experiment if isinstance(experiment, str) else yaml.safe_dump(experiment, sort_keys=False, width=10**6))
    return path


def compare_keys(what, assignment, known_to_schema):
    """The reader names all keys that it knows where it meets one that it does not."""
    message = run("check", write(BASE), "--set", assignment).stderr
    listed = message.partition("Known keys: ")[2]
    known = set(re.findall(r"`([^`]+)`", listed))
    if not known or known != set(known_to_schema):
        faults.append(f"{what}: the reader knows {sorted(known)}, the schema {sorted(known_to_schema)} ({message.strip()})")


properties = schema["properties"]
compare_keys("top", "zzzzzzzz=1", properties)
compare_keys("limits", "limits.zzzzzzzz=1", properties["limits"]["properties"])
compare_keys("start", "start.zzzzzzzz=1", properties["start"]["properties"])
compare_keys("missed_ticks", "missed_ticks=[{at_s: 0, count: 1, zzzzzzzz: 1}]", properties["missed_ticks"]["items"]["properties"])
around = properties["environment"]["properties"]
obstacle = around["obstacles"]["additionalProperties"]["properties"]
compare_keys("environment", "environment.zzzzzzzz=1", around)
open(os.path.join(folder.name, "e.bt"), "w").close()  # found, not read
compare_keys("map", "environment.map={file: " + os.path.join(folder.name, "e.bt") + ", zzzzzzzz: 1}", around["map"]["properties"])
compare_keys("waypoint", "environment.obstacles={ball: {sphere: 0.1, path: [{time_s: 0, xyz: [1, 0, 0], zzzzzzzz: 1}]}}",
             obstacle["path"]["items"]["properties"])
compare_keys("at", "environment.obstacles={ball: {sphere: 0.1, at: {xyz: [1, 0, 0], zzzzzzzz: 1}}}", obstacle["at"]["properties"])
compare_keys("cylinder", "environment.obstacles={post: {cylinder: {radius: 1, length: 1, zzzzzzzz: 1}}}",
             obstacle["cylinder"]["properties"])
compare_keys("half_space", "environment.obstacles={floor: {half_space: {normal: [0, 0, 1], offset: 0, zzzzzzzz: 1}}}",
             obstacle["half_space"]["properties"])
bounds = {key: [form["properties"] for form in properties["limits"]["properties"][key]["anyOf"] if "properties" in form]
          for key in properties["limits"]["properties"] if key != "allow_large_angles"}
compare_keys("bounds", "limits.velocity_radps={lower: -1, upper: 1, zzzzzzzz: 1}", bounds["velocity_radps"][0])
compare_keys("center", "limits.position_rad={center: 0, half_range: 1, zzzzzzzz: 1}", bounds["position_rad"][1])
if set(schema["definitions"]["case"]["properties"]) != set(properties) - {"schema", "title", "cases"}:
    faults.append("a case's keys in the schema are not those of the top without schema, title and cases")


def rule_of(kind, name):
    for rule in schema["definitions"][BLOCK_OF_KIND[kind]]["allOf"]:
        if rule["if"].get("properties", {}).get("plugin", {}).get("const") == name:
            return rule["then"]["properties"]
    faults.append(f"the schema does not know the {kind} {name}")
    return {}


for plugin in plugins:
    block, name = BLOCK_OF_KIND[plugin["kind"]], plugin["name"]
    compare_keys(f"{block} {name}", f"{block}={{plugin: {name}, zzzzzzzz: 1}}", rule_of(plugin["kind"], name))
    # What `plugins --json` says is what `--describe` and the table in the README say.
    described = json.loads(output_of("plugins", "--describe", name, "--json"))["plugins"]
    if [p["parameters"] for p in described if p["kind"] == plugin["kind"]] != [plugin["parameters"]]:
        faults.append(f"{name}: --describe --json differs from plugins --json")
    table = output_of("plugins", "--describe", name, "--markdown")
    if re.findall(r"^\| `(\w+)` ", table, re.M) != [p["name"] for p in plugin["parameters"]]:
        faults.append(f"{name}: --markdown has other parameters than --json:\n{table}")

# ---------------------------------------------------------------- the same judgement


def is_valid(experiment):
    return validator.is_valid(load(experiment) if isinstance(experiment, str) else experiment)


def judge(what, experiment, expected):
    done = run("check", write(experiment))
    if (done.returncode == 0) != expected:
        faults.append(f"{what}: the reader should {'take' if expected else 'refuse'} it: {done.stderr.strip()}")
    if is_valid(experiment) != expected:
        faults.append(f"{what}: the schema should {'take' if expected else 'refuse'} it")
    return done.stderr


def edited(path, value=None):
    """BASE with one entry set, or removed."""
    experiment = copy.deepcopy(BASE)
    *parents, last = path.split(".")
    place = experiment
    for key in parents:
        place = place.setdefault(key, {})
    if value is None:
        del place[last]
    else:
        place[last] = value
    return experiment


judge("base", BASE, True)
some_filter = next(p["library"] for p in plugins if p["name"] == "pass_through")
for path, value in [
    ("duration_s", "pi/2"), ("tick_s", 1e-3), ("tick_s", 1e-5), ("tick_s", 0.09), ("duration_s", "2*(1 + pi)"),
    ("limits", {"position_rad": math.inf}), ("limits", {"position_rad": "pi"}), ("limits", {"position_rad": ["pi"]}),
    ("limits", {"position_rad": {"lower": "-pi", "upper": math.inf}}), ("limits", {"velocity_radps": [2]}),
    ("limits", {"position_rad": {"center": [0], "half_range": "pi/2"}}),
    ("limits", {"velocity_radps": {"lower": -1, "upper": 2}}),
    ("limits", {"position_rad": 20, "allow_large_angles": True}),
    ("start", {"position_rad": 0.5, "velocity_radps": [0]}), ("missed_ticks", []),
    ("missed_ticks", [{"at_s": 0.5, "count": 20}, {"at_s": "pi/10", "count": 1}]),
    ("filter", {"plugin": "certified_braking", "k_alpha": math.inf, "recovery": True}),
    ("filter", {"plugin": some_filter}), ("title", 5), ("cases", {"A": {"filter": {"k_alpha": 4}}}),
    ("cases", {"A+b-c_1": {"filter": {"plugin": "soft_cbf", "weight": 5}}, "B": {}}),
    ("controller.stiffness", ["10/2"]), ("controller.velocity_feedforward", False),
    ("command.interpolation", "hold"), ("command.points", [[0, "pi/4"], [1.5, "-.5e-1"]]),
    ("real_plant.seed", "~integer(1, 9)"), ("real_plant.payload_kg", "~uniform(0, 2*pi)"),
    ("real_plant.friction_scale", ["~normal(1, 0.1, 0.5, 2)"]), ("real_plant.friction", "~choice(robot, none)"),
    ("limits", {"velocity_radps": {"lower": -1, "upper": "~log_uniform(1, 2)"}}),
    ("controller.velocity_feedforward", "~choice(true, false)"),
    ("real_plant.seed", 12345678901234), ("real_plant.torque_limit_factor", math.inf),
    ("payload_kg", "3/2"), ("payload_kg", 0),
    ("environment", {}), ("environment", {"safety_distance_m": 0, "field_cell_m": 0.05, "obstacles": {}}),
    ("environment.obstacles", {"table": {"box": [1, 2, "pi/2"], "at": {"xyz": [5, 0, "~uniform(0, 1)"], "rpy": [0, 0, "pi/2"]}}}),
    ("environment.obstacles", {"post": {"cylinder": {"radius": 0.1, "length": 1}, "at": {"xyz": [5, 0, 0]}},
                               "floor": {"half_space": {"normal": [0, 0, 1], "offset": -1}}}),
    ("environment.obstacles", {"ball": {"sphere": 0.1, "repeats": True,
                                        "path": [{"time_s": 0, "xyz": [5, 0, 0]}, {"time_s": 1, "xyz": [5, 1, 0]},
                                                 {"time_s": 2, "xyz": [5, 0, 0]}]}}),
]:
    judge(f"{path} = {value}", edited(path, value), True)

judge("payload", {**BASE, "payload_kg": 1, "payload_offset_m": [0, 0, "~uniform(0, 0.1)"]}, True)

for path, value in [
    ("schema", None), ("title", None), ("cases", None), ("robot", None), ("duration_s", None), ("command", None),
    ("controller", None), ("filter", None), ("schema", 2), ("schema", "one"), ("duraton_s", 3), ("cases", {}),
    ("cases", [1]), ("cases", {"a b": {}}), ("cases", {"A": {"title": "x"}}), ("cases", {"A": {"fliter": {}}}),
    ("cases", {"A": 3}), ("tick_s", 0.2), ("tick_s", 1e-6), ("tick_s", "fast"), ("duration_s", -1), ("duration_s", 90000),
    ("duration_s", math.inf), ("duration_s", "2pi"), ("duration_s", "90deg"), ("duration_s", "1 2"), ("duration_s", "007.5"),
    ("duration_s", "2**3"), ("duration_s", "~unifrom(1, 2)"), ("duration_s", "~uniform 1 2"),
    ("real_plant.seed", "~gauss(1, 2)"), ("real_plant.friction", "~robot"), ("duration_s", [1]), ("limits", {"position": 1}), ("limits", {"velocity_radps": -1}),
    ("limits", {"velocity_radps": 0}), ("limits", {"position_rad": {"lower": -1, "center": 1}}),
    ("limits", {"velocity_radps": {"lower": 1, "upper": 2}}), ("limits", {"jerk_radps3": {"lower": -1, "upper": 0}}),
    ("limits", {"position_rad": {"center": math.inf, "half_range": 1}}),
    ("limits", {"position_rad": {"center": 0, "half_range": 0}}),
    ("limits", {"velocity_radps": {"center": 0, "half_range": 1}}), ("limits", {"jerk_radps3": []}), ("limits", 3),
    ("limits", {"allow_large_angles": 1}), ("start", {"speed": 1}), ("start", {"position_rad": math.inf}),
    ("start", {"position_rad": [0] * 17}), ("missed_ticks", {"at_s": 1, "count": 1}), ("missed_ticks", [{"at_s": 1}]),
    ("missed_ticks", [{"at_s": 0, "count": 0}]), ("missed_ticks", [{"at_s": -1, "count": 1}]),
    ("missed_ticks", [{"at_s": 0, "count": 1.5}]), ("filter", {"plugin": "tosbq"}), ("filter", {"plugin": "nric"}),
    ("filter", "tosbp"), ("filter", []), ("filter", {"plugin": "tosbp", "gama": 1}), ("filter", {"gama": 1}),
    ("filter", {"plugin": "pass_through", "gamma": 1}), ("controller.stiffness", [-1]), ("controller.stiffness", "stiff"),
    ("controller.velocity_feedforward", 1), ("command.interpolation", "jump"), ("command.points", [1, 2]),
    ("command.points", [[1]]), ("real_plant.seed", 1.5), ("real_plant.payload_offset_m", [0, 0]),
    ("real_plant.payload_offset_m", 0),
    ("command", {"plugin": "recorded_poses", "file": ["a"]}),
    ("payload", {"mass_kg": 1}), ("payload_kg", -1), ("payload_offset_m", [0, 0]),
    ("environment", 3), ("environment", {"safety_distance": 0.1}), ("environment", {"safety_distance_m": -0.1}),
    ("environment", {"safety_distance_m": 2}), ("environment", {"field_cell_m": 0}), ("environment.obstacles", []),
    ("environment.obstacles", {"table": {"box": [1, 2], "at": {"xyz": [5, 0, 0]}}}),
    ("environment.obstacles", {"table": {"box": [1, 2, 0], "at": {"xyz": [5, 0, 0]}}}),
    ("environment.obstacles", {"table": {"box": [1, 2, 1], "at": [5, 0, 0]}}),
    ("environment.obstacles", {"table": {"bocks": [1, 2, 1], "at": {"xyz": [5, 0, 0]}}}),
    ("environment.obstacles", {"ball": {"sphere": 0.1, "at": {"xyz": [5, 0, 1001]}}}),
    ("environment.obstacles", {"ball": {"sphere": 0.1, "path": [{"time_s": 0}]}}),
    ("environment.obstacles", {"ball": {"sphere": 0.1, "path": [{"time_s": -1, "xyz": [5, 0, 0]}]}}),
    ("environment.obstacles", {"post": {"cylinder": 3, "at": {"xyz": [5, 0, 0]}}}),
    ("environment.map", {"file": ["a"]}), ("environment.map", {"unknown": "maybe"}),
]:
    judge(f"{path} = {value}", edited(path, value), False)
in_one_case = edited("filter")
in_one_case["cases"] = {"A": {"filter": {"plugin": "tosbp"}}, "B": {}}
judge("a case without a filter", in_one_case, False)
in_one_case["cases"]["B"] = {"filter": {"plugin": "tovzbp"}}
judge("a filter in every case", in_one_case, True)

# A chain of filters, first to last; a name without parameters needs no block.
for chain, expected in [([{"plugin": "tosbp"}, {"plugin": "certified_braking", "gamma": 10}], True), (["tosbp", some_filter], True),
                        ([{"gamma": 10}], False), ([{"plugin": "tosbp", "gama": 10}], False), ([], False), (["tosbq"], False),
                        (["tosbp"] * 17, False), ([["tosbp"]], False), (["nric"], False)]:
    judge(f"filter = {chain}", edited("filter", chain), expected)

# Every range of every parameter, at its ends.
probes = 0
for plugin in plugins:
    block, name = BLOCK_OF_KIND[plugin["kind"]], plugin["name"]
    for parameter in plugin["parameters"]:
        limits = parameter.get("range")
        if not limits:
            continue
        outside = []
        for end, step in (("min", -1), ("max", 1)):
            bound = limits[end]
            if isinstance(bound, str):
                if not limits["may_be_infinite"]:
                    outside.append(step * math.inf)
            elif parameter["type"] == "integer":
                outside.append(bound + step)
            else:
                outside.append(bound if limits[end + "_is_open"] else bound + step * 1e-9 * max(1, abs(bound)))
        for value in outside:
            if parameter["type"] == "integer" and abs(value) > 2**63 - 1:
                continue  # beyond what a program of any language can hold
            whole = {"numbers": [value] * (parameter.get("min_count") or 1),
                     "rows": [[value] * (parameter.get("min_count") or 1)]}.get(parameter["type"], value)
            others = {p["name"]: {"file": folder.name + "/e.yaml", "text": "text"}.get(p["type"], [[0, 0]])
                      for p in plugin["parameters"] if p["required"] and p["name"] != parameter["name"]}
            message = judge(f"{block} {name}.{parameter['name']} = {value!r}",
                            edited(block, {"plugin": name, **others, parameter["name"]: whole}), False)
            if "range" not in message and "finite" not in message:
                faults.append(f"{name}.{parameter['name']} = {value!r}: refused for another reason: {message}")
            probes += 1
assert probes > 60, probes

print(f"schema: {len(examples)} files of the project, {len(plugins)} plugins, {probes} ends of ranges")
for fault in faults:
    print("schema:", fault, file=sys.stderr)
sys.exit(1 if faults else 0)
