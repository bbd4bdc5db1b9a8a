"""Writes the URDF of a MuJoCo model to standard output, behind `note: ...` lines: what MuJoCo's own library makes of the file.

What a URDF has no word for stands in <dynamics armature=".." home=".."/>. A fault ends it with 93 and two lines on standard
error: what is wrong, and what to do. Started by `viable new robot --mjcf`, which limits its time and memory.
"""
import os
import sys
import xml.etree.ElementTree as tree
from xml.sax.saxutils import quoteattr

MOST_BODIES, MOST_BYTES, MOST_FILES = 1000, 64 << 20, 2000


def refuse(what, remedy="Correct the file; MuJoCo's own viewer shows the same."):
    print(" ".join(str(what).split())[:600], remedy, sep="\n", file=sys.stderr)
    sys.exit(93)


def read_xml(path):
    with open(path, "rb") as file:
        text = file.read(MOST_BYTES)
    if b"<!ENTITY" in text or b"<!DOCTYPE" in text:
        refuse(f"{path} declares entities, which may grow without end", "Write out what they stand for.")
    try:
        return tree.fromstring(text)
    except (tree.ParseError, ValueError) as error:
        refuse(f"{path} is not XML: {error}")


def check_files(model):
    """Refuses what names files outside of the model's folder, or would keep the library busy; before the library reads it.
    Returns the folders in which the files are."""
    home = os.path.dirname(model)
    inside = os.path.realpath(home)
    waiting, parts, folders, bytes_left, bodies = [model], [], {home}, 4 * MOST_BYTES, 0
    seen = set()
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        if len(seen) > MOST_FILES:
            refuse(f"it includes more than {MOST_FILES} files", "Give the arm's own file.")
        folders.add(os.path.dirname(path))
        for element in read_xml(path).iter():
            if element.tag in ("replicate", "composite", "flexcomp", "plugin"):
                refuse(f"{path} has a <{element.tag}>, of which no arm is made", "Give the arm's own file, without the scene.")
            bodies += element.tag == "body"
            if bodies > MOST_BODIES:
                refuse(f"it has more than {MOST_BODIES} bodies", "Give the arm's own file; no arm has so many.")
            for name, value in element.attrib.items():
                if element.tag == "compiler" and name.endswith("dir"):
                    folders.update(os.path.join(base, value) for base in list(folders))
                elif name.startswith("file"):
                    parts.append(value)
                    if element.tag in ("include", "model"):
                        waiting += [p for base in list(folders) if os.path.isfile(p := os.path.join(base, value)) and within(inside, p)]
    for value in parts:
        for path in {os.path.join(base, name) for base in folders for name in (value, os.path.basename(value))}:
            if not os.path.exists(path):
                continue
            if not within(inside, path):
                refuse(f"it names the file {value}, outside of its folder", "Copy what the model needs into the folder of its file.")
            size = os.path.getsize(path)
            bytes_left -= size
            if not os.path.isfile(path) or size > MOST_BYTES or bytes_left < 0:
                refuse(f"the file {value} is no plain file of at most {MOST_BYTES} bytes", "Give smaller meshes, or leave pictures out.")
    return sorted(folders)


def within(folder, path):
    return os.path.commonpath([folder, os.path.realpath(path)]) == folder


def load(path):
    os.environ.setdefault("MUJOCO_GL", "disable")  # nothing is drawn
    os.chdir("/proc/self")  # where nobody can write: the library leaves a log of its warnings wherever it is
    try:
        global mujoco, np
        import mujoco
        import numpy as np
    except ImportError as error:
        refuse(f"the Python package mujoco, which reads it, cannot be imported by {sys.executable}: {error}",
               "Run `pip install mujoco` for the python3 that is first in PATH, such as that of a virtual environment.")
    try:
        return mujoco.MjModel.from_xml_path(path)
    except Exception as error:
        refuse(f"MuJoCo {mujoco.__version__} does not take it: {error}")


class Writer:
    def __init__(self, path, m, folders):
        self.path, self.m, self.folders, self.notes, self.lines = path, m, folders, [], []
        kinds = {"body": m.nbody, "joint": m.njnt, "site": m.nsite}
        self.names = {kind: self.name_all(kind, count) for kind, count in kinds.items()}
        self.links = self.names["body"] + self.names["site"]
        self.coupled = self.find_coupled()
        self.home = next((m.key_qpos[k] for k in range(m.nkey) if mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_KEY, k) == "home"), None)
        self.anchor = [np.zeros(3) for _ in range(m.nbody)]  # of a body's link, in the body's frame

    def name_all(self, kind, count):
        given = [mujoco.mj_id2name(self.m, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), i) for i in range(count)]
        taken = set(given) | (set(self.names["body"]) if kind == "site" and hasattr(self, "names") else set())
        for i, name in enumerate(given):
            if not name:
                given[i] = next(n for n in (f"{kind}{i}" + "_" * k for k in range(count + 2)) if n not in taken)
                taken.add(given[i])
        return given

    def find_coupled(self):
        """By joint that another one leads: its name. What a tendon or a closed loop leads goes into `frozen`."""
        m, coupled = self.m, {}
        self.frozen = {}

        def above(body):
            while body:
                yield body
                body = m.body_parentid[body]

        is_on = getattr(m, "eq_active0", getattr(m, "eq_active", None))
        for e in (e for e in range(m.neq) if is_on[e]):
            kind, one, other = m.eq_type[e], int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
            if kind == mujoco.mjtEq.mjEQ_JOINT:
                if other >= 0:
                    coupled[one] = self.names["joint"][other]
                else:
                    self.frozen[one] = "an equality"
            elif is_one(kind, mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
                if hasattr(m, "eq_objtype") and m.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
                    one, other = m.site_bodyid[one], m.site_bodyid[other]
                if m.body_mocapid[one] >= 0 or m.body_mocapid[other] >= 0:
                    continue  # whoever leads the arm by hand
                for body in set(above(one)) ^ set(above(other)):  # what closes the loop
                    self.frozen.update((j, "a closed loop") for j in range(m.njnt) if m.jnt_bodyid[j] == body)
        for t in range(m.ntendon):
            wraps = range(m.tendon_adr[t], m.tendon_adr[t] + m.tendon_num[t])
            led = [int(m.wrap_objid[w]) for w in wraps if m.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT]
            if len(led) > 1:
                self.frozen.update((j, "a tendon") for j in led)
        if self.frozen:
            self.notes.append("frozen, because no motor of its own leads it: " + ", ".join(f"{self.names['joint'][j]} ({why})" for j, why in self.frozen.items()))
        return coupled

    def moves_joint(self, a):
        return is_one(self.m.actuator_trntype[a], mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)

    def find_efforts(self):
        """Largest force of each joint's strongest actuator, either way; NaN: none is said."""
        m, efforts = self.m, np.full(self.m.njnt, np.nan)
        driven = set()
        for a in range(m.nu):
            if not self.moves_joint(a):
                continue
            j, gear, force = int(m.actuator_trnid[a, 0]), abs(m.actuator_gear[a, 0]), np.inf
            driven.add(j)
            if m.actuator_forcelimited[a]:
                force = min(-m.actuator_forcerange[a, 0], m.actuator_forcerange[a, 1])
            if m.actuator_ctrllimited[a] and m.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED and m.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE:
                force = min(force, abs(m.actuator_gainprm[a, 0]) * min(-m.actuator_ctrlrange[a, 0], m.actuator_ctrlrange[a, 1]))
            if np.isfinite(force) and force > 0:
                efforts[j] = np.fmax(efforts[j], gear * force)
        for j in range(m.njnt):
            if getattr(m, "jnt_actfrclimited", np.zeros(m.njnt))[j]:
                efforts[j] = np.fmin(efforts[j], min(-m.jnt_actfrcrange[j, 0], m.jnt_actfrcrange[j, 1]))
        idle = [self.names["joint"][j] for j in range(m.njnt) if j not in driven and j not in self.coupled and j not in self.frozen]
        if driven and idle:
            self.notes.append("no actuator moves " + ", ".join(idle))
        return efforts

    def find_reflected(self, of_joint, of_actuator):
        """A figure of joints, with that of the actuators behind their gears (MuJoCo 4)."""
        m, values = self.m, [float(getattr(self.m, of_joint)[d]) for d in self.m.jnt_dofadr]
        for a in range(m.nu if hasattr(m, of_actuator) else 0):
            if self.moves_joint(a):
                values[m.actuator_trnid[a, 0]] += m.actuator_gear[a, 0] ** 2 * float(np.ravel(getattr(m, of_actuator)[a])[0])
        return values

    def write(self):
        m = self.m
        self.efforts = self.find_efforts()
        self.armature = self.find_reflected("dof_armature", "actuator_armature")
        self.damping = self.find_reflected("dof_damping", "actuator_damping")
        if not np.allclose(m.opt.gravity, (0, 0, -9.81)):
            self.notes.append(f"its gravity is {show(m.opt.gravity)} m/s^2; 9.81 downwards is taken")
        for what, values in (("springs of joints", m.jnt_stiffness), ("gravcomp of bodies", getattr(m, "body_gravcomp", 0))):
            if np.any(values):
                self.notes.append(what + ": left out")
        for body in range(m.nbody):
            self.add_body(body)
        print(*(f"note: {note}" for note in self.notes), sep="\n")
        name = os.path.splitext(os.path.basename(self.path))[0]
        print(f"<robot name={quoteattr(name)}>", *self.lines, "</robot>", sep="\n")

    def add_body(self, body):
        m, name = self.m, self.names["body"][body]
        joints = [j for j in range(m.njnt) if m.jnt_bodyid[j] == body and j not in self.frozen]
        parent, place = int(m.body_parentid[body]), m.body_pos[body] - self.anchor[m.body_parentid[body]]
        turn, above = make_rotation(m.body_quat[body]), self.names["body"][parent]
        before = np.zeros(3)
        for k, j in enumerate(joints):
            child = name if j == joints[-1] else self.name_new(f"{name}_{k}")
            if child != name:
                self.lines.append(f"<link name={quoteattr(child)}/>")
            kind = m.jnt_type[j]
            slides, turns = kind == mujoco.mjtJoint.mjJNT_SLIDE, kind == mujoco.mjtJoint.mjJNT_HINGE
            at = place + turn @ (m.jnt_pos[j] - before) if turns or slides else place
            if turns or slides:
                reference = m.qpos0[m.jnt_qposadr[j]]
                axis = m.jnt_axis[j] / np.linalg.norm(m.jnt_axis[j])
                at = at - turn @ axis * reference if slides else at
                turned = turn if slides else turn @ turn_about(axis, -reference)
                self.add_joint(j, above, child, at, turned, axis, slides)
                before, place, turn = m.jnt_pos[j].copy(), np.zeros(3), np.eye(3)
            else:
                word = "floating" if kind == mujoco.mjtJoint.mjJNT_FREE else "ball"
                self.lines.append(f'<joint name={quoteattr(self.names["joint"][j])} type="{word}">{join(above, child)}{origin(place, turn)}</joint>')
                place, turn = np.zeros(3), np.eye(3)
            above = child
        self.anchor[body] = before
        self.lines.append(f"<link name={quoteattr(name)}>")
        if body and m.body_mass[body] > 0:
            R = make_rotation(m.body_iquat[body])
            I = R @ np.diag(m.body_inertia[body]) @ R.T
            values = " ".join(f'i{"xyz"[i]}{"xyz"[k]}="{number(I[i, k])}"' for i in range(3) for k in range(i, 3))
            self.lines.append(f'<inertial>{origin(m.body_ipos[body] - before, np.eye(3))}<mass value="{number(m.body_mass[body])}"/><inertia {values}/></inertial>')
        geoms = [g for g in range(m.ngeom) if m.geom_bodyid[g] == body]
        for g in geoms:
            hits = m.geom_contype[g] or m.geom_conaffinity[g]
            self.add_geom(g, "collision" if hits else "visual", before)
        self.lines.append("</link>")
        if body and not joints:
            self.lines.append(f"<joint name={quoteattr(name + '_fixed')} type=\"fixed\">{join(above, name)}{origin(place, turn)}</joint>")
        if body and body not in m.body_parentid:  # an end of the arm: its sites may be the tool
            for s in (s for s in range(m.nsite) if m.site_bodyid[s] == body):
                site = self.names["site"][s]
                site = site if site not in self.names["body"] else self.name_new(site)
                self.lines += [f"<link name={quoteattr(site)}/>",
                               f"<joint name={quoteattr(site + '_fixed')} type=\"fixed\">{join(name, site)}{origin(m.site_pos[s] - before, make_rotation(m.site_quat[s]))}</joint>"]

    def name_new(self, name):
        while name in self.links:
            name += "_"
        self.links.append(name)
        return name

    def add_joint(self, j, parent, child, at, turn, axis, slides):
        m = self.m
        limited = bool(m.jnt_limited[j])
        lower, upper = m.jnt_range[j] if limited else (0.0, 0.0)
        effort = self.efforts[j] if np.isfinite(self.efforts[j]) else 0.0
        kind = "prismatic" if slides else "revolute" if limited else "continuous"
        dof = m.jnt_dofadr[j]
        home = "" if self.home is None else f' home="{number(self.home[m.jnt_qposadr[j]])}"'
        led = f"<mimic joint={quoteattr(self.coupled[j])}/>" if j in self.coupled else ""
        self.lines.append(
            f'<joint name={quoteattr(self.names["joint"][j])} type="{kind}">{join(parent, child)}{origin(at, turn)}<axis xyz="{show(axis)}"/>'
            f'<limit lower="{number(lower)}" upper="{number(upper)}" effort="{number(effort)}" velocity="0"/>'
            f'<dynamics damping="{number(self.damping[j])}" friction="{number(m.dof_frictionloss[dof])}" armature="{number(self.armature[j])}"{home}/>{led}</joint>')

    def add_geom(self, g, tag, before):
        m, kind, size = self.m, self.m.geom_type[g], self.m.geom_size[g]
        at, turn = m.geom_pos[g] - before, make_rotation(m.geom_quat[g])
        types = mujoco.mjtGeom
        shapes = []
        if is_one(kind, types.mjGEOM_PLANE, types.mjGEOM_HFIELD):
            return
        if kind == types.mjGEOM_SPHERE:
            shapes.append((at, turn, f'<sphere radius="{number(size[0])}"/>'))
        elif is_one(kind, types.mjGEOM_CYLINDER, types.mjGEOM_CAPSULE):
            shapes.append((at, turn, f'<cylinder radius="{number(size[0])}" length="{number(2 * size[1])}"/>'))
            if kind == types.mjGEOM_CAPSULE:
                shapes += [(at + side * size[1] * turn[:, 2], turn, f'<sphere radius="{number(size[0])}"/>') for side in (-1, 1)]
        elif kind == types.mjGEOM_BOX:
            shapes.append((at, turn, f'<box size="{show(2 * size)}"/>'))
        elif kind == types.mjGEOM_MESH and hasattr(m, "mesh_scale") and m.mesh_pathadr[m.geom_dataid[g]] >= 0:
            mesh = m.geom_dataid[g]  # the library has moved its vertices to their principal axes
            path = m.paths[m.mesh_pathadr[mesh]:].split(b"\0")[0].decode()
            back = turn @ make_rotation(m.mesh_quat[mesh]).T
            places = [os.path.join(folder, path) for folder in self.folders]  # older libraries tell the name alone
            path = next((place for place in places if os.path.isfile(place)), path)
            file = os.path.relpath(path, os.path.dirname(self.path))
            shapes.append((at - back @ m.mesh_pos[mesh], back, f'<mesh filename={quoteattr(file)} scale="{show(m.mesh_scale[mesh])}"/>'))
        elif hasattr(m, "geom_aabb"):
            box = m.geom_aabb[g]
            shapes.append((at + turn @ box[:3], turn, f'<box size="{show(2 * box[3:])}"/>'))
        for place, rotation, shape in shapes:
            self.lines.append(f"<{tag}>{origin(place, rotation, 12)}<geometry>{shape}</geometry></{tag}>")


def is_one(value, *kinds):
    return any(value == kind for kind in kinds)  # `in` asks the kinds, which know no numpy number


def number(value):
    return repr(float(value) + 0.0)


def show(values):
    return " ".join(number(v) for v in values)


def join(parent, child):
    return f"<parent link={quoteattr(parent)}/><child link={quoteattr(child)}/>"


def origin(place, turn, digits=17):
    """Yaw first, then what is left of the rotation: exact also where roll and yaw turn about one axis."""
    yaw = np.arctan2(turn[1, 0], turn[0, 0])
    rest = turn_about(np.array([0.0, 0.0, 1.0]), -yaw) @ turn
    rpy = np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw
    return f'<origin xyz="{show(np.round(place, digits))}" rpy="{show(np.round(rpy, digits))}"/>'


def make_rotation(quaternion):
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.array(quaternion) / np.linalg.norm(quaternion))
    return matrix.reshape(3, 3)


def turn_about(axis, angle):
    x = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * x + (1 - np.cos(angle)) * x @ x


if __name__ == "__main__":
    given = os.path.abspath(sys.argv[1])
    found = check_files(given)
    model = load(given)
    try:
        Writer(given, model, found).write()
    except Exception as error:
        refuse(f"MuJoCo {mujoco.__version__} gives a model that is not as expected: {error!r}", "Use another version of the package mujoco.")
