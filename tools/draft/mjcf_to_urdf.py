"""Writes the URDF of a MuJoCo model to standard output, behind `note: ...` lines: what MuJoCo's own library makes of the file.

What a URDF has no word for stands in <dynamics armature=".." home=".."/>. A fault ends it with 93 and two lines on standard
error: what is wrong, and what to do. Started by `viable new robot --mjcf`, which limits its time and memory.
"""
import os
import sys
import xml.etree.ElementTree as tree
from xml.sax.saxutils import quoteattr

MOST_BODIES, MOST_BYTES, MOST_FILES, MOST_FOLDERS = 1000, 64 << 20, 2000, 50


def refuse(what, remedy="Correct the file; MuJoCo's own viewer shows the same."):
    print(make_line(what)[:600], remedy, sep="\n", file=sys.stderr)
    sys.exit(93)


def make_line(text):
    return " ".join(str(text).split())


def read_xml(path):
    try:
        with open(path, "rb") as file:
            text = file.read(MOST_BYTES)
        if b"<!ENTITY" in text or b"<!DOCTYPE" in text:
            refuse(f"{path} declares entities, which may grow without end", "Write out what they stand for.")
        return tree.fromstring(text)
    except OSError as error:
        refuse(f"{path} cannot be read: {error.strerror}", "Make it a file that you may read.")
    except (tree.ParseError, ValueError, LookupError) as error:
        refuse(f"{path} is not XML: {error}")


def check_files(model):
    """Refuses what names files outside of the model's folder, or would keep the library busy; before the library reads it.
    Returns the folders in which the files are."""
    home = os.path.dirname(model)
    inside = os.path.realpath(home)
    waiting, seen, parts, nested, folders, bytes_left, bodies = {model}, set(), set(), set(), {home}, 4 * MOST_BYTES, 0
    while waiting:
        path = waiting.pop()
        seen.add(path)
        folders.add(os.path.dirname(path))
        for element in read_xml(path).iter():
            tag = element.tag.rpartition("}")[2]  # the library knows no namespaces
            if tag in ("replicate", "composite", "flexcomp", "plugin"):
                refuse(f"{path} has a <{tag}>, of which no arm is made", "Give the arm's own file, without the scene.")
            bodies += tag == "body"
            if bodies > MOST_BODIES:
                refuse(f"it has more than {MOST_BODIES} bodies", "Give the arm's own file; no arm has so many.")
            for name, value in element.attrib.items():
                if tag == "compiler" and name.endswith("dir"):
                    folders |= {os.path.join(base, value) for base in (home, os.path.dirname(path))}
                elif name.startswith("file"):
                    parts.add(value)
                    nested |= {value} if tag in ("include", "model") else set()
            if len(seen) + len(parts) > MOST_FILES or len(folders) > MOST_FOLDERS:
                refuse(f"it names more than {MOST_FILES} files or {MOST_FOLDERS} folders", "Give the arm's own file.")
        if not waiting:
            waiting = {place for place in find_places(folders, nested) - seen if os.path.isfile(place) and within(inside, place)}
    for value in sorted(parts):
        for path in {os.path.realpath(place) for place in find_places(folders, (value,)) if os.path.exists(place)}:
            if not within(inside, path):
                refuse(f"it names the file {value}, outside of its folder", "Copy what the model needs into the folder of its file.")
            size = os.path.getsize(path)
            bytes_left -= size
            if not os.path.isfile(path) or size > MOST_BYTES or bytes_left < 0:
                refuse(f"the file {value} is no plain file of at most {MOST_BYTES} bytes", "Give smaller meshes, or leave pictures out.")
    return sorted(folders)


def find_places(folders, names):
    """Where the library may look: as named, without the folder, and with `..` taken out of the text."""
    places = {os.path.join(folder, name) for folder in folders for given in names for name in (given, os.path.basename(given))}
    return places | {os.path.normpath(place) for place in places}


def within(folder, path):
    return os.path.commonpath([folder, os.path.realpath(path)]) == folder


def load(path):
    os.environ.setdefault("MUJOCO_GL", "disable")  # nothing is drawn
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # each thread reserves memory
    os.chdir("/proc/self")  # where nobody can write: the library leaves a log of its warnings wherever it is
    try:
        global mujoco, np
        import mujoco
        import numpy as np
    except ImportError as error:
        refuse(f"the Python package mujoco, which reads it, cannot be imported by {sys.executable}: {error}",
               "Run `pip install mujoco` for the python3 that is first in PATH, such as that of a virtual environment.")
    try:
        spec = mujoco.MjSpec.from_file(path) if hasattr(getattr(mujoco, "MjSpec", None), "from_file") else None
        return spec.compile() if spec else mujoco.MjModel.from_xml_path(path), spec
    except Exception as error:
        refuse(f"MuJoCo {mujoco.__version__} does not take it: {error}")


class Writer:
    def __init__(self, path, m, spec, folders):
        self.path, self.m, self.notes, self.lines = path, m, [], []
        self.meshes = {mesh.id: mesh for mesh in getattr(spec, "meshes", ()) if m.mesh_pathadr[mesh.id] >= 0}
        self.folders = [os.path.join(os.path.dirname(path), getattr(spec, "meshdir", "")), *folders]  # the library's own first
        counts = {"body": m.nbody, "joint": m.njnt, "site": m.nsite}
        given = {kind: [mujoco.mj_id2name(m, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), i) for i in range(n)] for kind, n in counts.items()}
        self.taken = {name for names in given.values() for name in names}
        self.names = {kind: [name or self.name_new(f"{kind}{i}") for i, name in enumerate(names)] for kind, names in given.items()}
        self.zero = [float(m.qpos0[place]) for place in m.jnt_qposadr]
        self.coupled = self.find_coupled()
        self.home = next((m.key_qpos[k] for k in range(m.nkey) if mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_KEY, k) == "home"), None)
        self.anchor = [np.zeros(3) for _ in range(m.nbody)]  # of a body's link, in the body's frame

    def find_coupled(self):
        """By joint that another one leads: that one, and a polynomial. What no moving joint leads goes into `frozen`: why, and where."""
        m, coupled, self.frozen = self.m, {}, {}

        def above(body):
            while body:
                yield body
                body = m.body_parentid[body]

        is_on = getattr(m, "eq_active0", getattr(m, "eq_active", None))
        for e in (e for e in range(m.neq) if is_on[e]):
            kind, one, other = m.eq_type[e], int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
            if kind == mujoco.mjtEq.mjEQ_JOINT:
                coupled[one] = other, m.eq_data[e, :5]
            elif is_one(kind, mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
                if hasattr(m, "eq_objtype") and m.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
                    one, other = m.site_bodyid[one], m.site_bodyid[other]
                if m.body_mocapid[one] >= 0 or m.body_mocapid[other] >= 0:
                    continue  # whoever leads the arm by hand
                for body in set(above(one)) ^ set(above(other)):  # what closes the loop
                    self.frozen.update((j, ("a closed loop", self.zero[j])) for j in range(m.njnt) if m.jnt_bodyid[j] == body)
        for t in range(m.ntendon):
            wraps = range(m.tendon_adr[t], m.tendon_adr[t] + m.tendon_num[t])
            led = [int(m.wrap_objid[w]) for w in wraps if m.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT]
            if len(led) > 1:
                self.frozen.update((j, ("a tendon", self.zero[j])) for j in led)
        left = {j: c for j, c in coupled.items() if j not in self.frozen}
        while still := [j for j, (leader, _) in left.items() if leader not in left and (leader < 0 or leader in self.frozen)]:
            leader, curve = left.pop(still[0])
            x = self.frozen[leader][1] - self.zero[leader] if leader >= 0 else 0.0
            self.frozen[still[0]] = "an equality", self.zero[still[0]] + float(np.polyval(curve[::-1], x))
        name = self.names["joint"]
        self.note("frozen, because no motor of its own leads it: ", [f"{name[j]} at {at:.12g} ({why})" for j, (why, at) in self.frozen.items()])
        bent = [name[j] for j, (_, curve) in coupled.items() if j not in self.frozen and np.any(curve[2:])]
        self.note("led along a curve, of which the tangent at the model's own pose is taken: ", bent)
        return coupled

    def note(self, text, items=("",)):
        self.notes += [f"note: {make_line(text + ', '.join(items))}"] if items else []

    def moves_joint(self, a):
        return is_one(self.m.actuator_trntype[a], mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)

    def find_efforts(self):
        """Largest force of each joint's strongest actuators, in the weaker direction; 0: none is said for both."""
        m, ways, driven, lost = self.m, np.full((self.m.njnt, 2), np.nan), set(), set()
        for a in range(m.nu):
            if not self.moves_joint(a):
                continue
            j, low, high = int(m.actuator_trnid[a, 0]), -np.inf, np.inf
            driven.add(j)
            if m.actuator_forcelimited[a]:
                low, high = m.actuator_forcerange[a]
            if m.actuator_ctrllimited[a] and m.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED and m.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE:
                least, most = np.sort(m.actuator_gainprm[a, 0] * m.actuator_ctrlrange[a])
                low, high = max(low, least), min(high, most)
            if m.actuator_gear[a, 0] != 0:
                force = np.sort(m.actuator_gear[a, 0] * np.array([low, high])) * (-1, 1)
                ways[j] = np.fmax(ways[j], np.where(np.isfinite(force), np.maximum(force, 0), np.nan))
        for j in np.flatnonzero(getattr(m, "jnt_actfrclimited", ())):
            force = m.jnt_actfrcrange[j] * (-1, 1)
            ways[j] = np.fmin(ways[j], np.where(force > 0, force, np.nan))
            lost |= set() if np.all(force > 0) else {j}
        whole = np.all(ways > 0, axis=1)
        own = {j: self.names["joint"][j] for j in range(m.njnt) if j not in self.coupled and j not in self.frozen}
        lost = [name for j, name in own.items() if j in lost or np.any(ways[j] >= 0) and not whole[j]]
        self.note("force ranges of one direction only, left out: ", lost)
        self.note("no actuator moves ", [name for j, name in own.items() if j not in driven] if driven else ())
        return np.where(whole, ways.min(axis=1), 0.0)

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
            self.note(f"its gravity is {show(m.opt.gravity)} m/s^2; 9.81 downwards is taken")
        for what, values in (("springs of joints", m.jnt_stiffness), ("gravcomp of bodies", getattr(m, "body_gravcomp", 0))):
            self.note(what + ": left out", ("",) if np.any(values) else ())
        for body in range(m.nbody):
            self.add_body(body)
        print(*self.notes, sep="\n")
        name = os.path.splitext(os.path.basename(self.path))[0]
        print(f"<robot name={quoteattr(name)}>", *self.lines, "</robot>", sep="\n")

    def add_body(self, body):
        m, name = self.m, self.names["body"][body]
        joints = [j for j in range(m.njnt) if m.jnt_bodyid[j] == body]
        parent, place = int(m.body_parentid[body]), m.body_pos[body] - self.anchor[m.body_parentid[body]]
        turn, above = make_rotation(m.body_quat[body]), self.names["body"][parent]
        before = np.zeros(3)
        for k, j in enumerate(joints):
            child = name if j == joints[-1] else self.name_new(f"{name}_{k}")
            if child != name:
                self.lines.append(f"<link name={quoteattr(child)}/>")
            kind = m.jnt_type[j]
            slides, turns = kind == mujoco.mjtJoint.mjJNT_SLIDE, kind == mujoco.mjtJoint.mjJNT_HINGE
            at, turned = place, turn
            if turns or slides:
                axis = m.jnt_axis[j] / np.linalg.norm(m.jnt_axis[j])
                way = (self.frozen[j][1] if j in self.frozen else 0.0) - self.zero[j]  # from the model's own pose
                at = at + turn @ (m.jnt_pos[j] - before + (axis * way if slides else 0))
                turned = turn if slides else turn @ turn_about(axis, way)
                before = m.jnt_pos[j].copy()
            if (turns or slides) and j not in self.frozen:
                self.add_joint(j, above, child, at, turned, axis, slides)
            else:
                word = "fixed" if j in self.frozen else "floating" if kind == mujoco.mjtJoint.mjJNT_FREE else "ball"
                self.add_still(self.names["joint"][j], above, child, at, turned, word)
            above, place, turn = child, np.zeros(3), np.eye(3)
        self.anchor[body] = before
        self.lines.append(f"<link name={quoteattr(name)}>")
        if body and m.body_mass[body] > 0:
            R = make_rotation(m.body_iquat[body])
            I = R @ np.diag(m.body_inertia[body]) @ R.T
            values = " ".join(f'i{"xyz"[i]}{"xyz"[k]}="{number(I[i, k])}"' for i in range(3) for k in range(i, 3))
            self.lines.append(f'<inertial>{origin(m.body_ipos[body] - before, np.eye(3))}<mass value="{number(m.body_mass[body])}"/><inertia {values}/></inertial>')
        for g in (g for g in range(m.ngeom) if m.geom_bodyid[g] == body):
            hits = m.geom_contype[g] or m.geom_conaffinity[g]
            self.add_geom(g, "collision" if hits else "visual", before)
        self.lines.append("</link>")
        if body and not joints:
            self.add_still(self.name_new(name + "_fixed"), above, name, place, turn)
        if body and body not in m.body_parentid:  # an end of the arm: its sites may be the tool
            for s in (s for s in range(m.nsite) if m.site_bodyid[s] == body):
                site = self.name_new(self.names["site"][s]) if self.names["site"][s] in self.names["body"] else self.names["site"][s]
                self.lines.append(f"<link name={quoteattr(site)}/>")
                self.add_still(self.name_new(site + "_fixed"), name, site, m.site_pos[s] - before, make_rotation(m.site_quat[s]))

    def name_new(self, name):
        while name in self.taken:
            name += "_"
        self.taken.add(name)
        return name

    def add_still(self, name, parent, child, at, turn, kind="fixed"):
        self.lines.append(f'<joint name={quoteattr(name)} type="{kind}">{join(parent, child)}{origin(at, turn)}</joint>')

    def add_joint(self, j, parent, child, at, turn, axis, slides):
        m = self.m
        limited = bool(m.jnt_limited[j])
        lower, upper = m.jnt_range[j] if limited else (0.0, 0.0)
        kind = "prismatic" if slides else "revolute" if limited else "continuous"
        dof = m.jnt_dofadr[j]
        home = "" if self.home is None else f' home="{number(self.home[m.jnt_qposadr[j]])}"'
        led = ""
        if j in self.coupled:
            leader, (start, slope, *_) = self.coupled[j]
            start += self.zero[j] - slope * self.zero[leader]
            led = f'<mimic joint={quoteattr(self.names["joint"][leader])} multiplier="{number(slope)}" offset="{number(start)}"/>'
        self.lines.append(
            f'<joint name={quoteattr(self.names["joint"][j])} type="{kind}">{join(parent, child)}{origin(at, turn)}<axis xyz="{show(axis)}"/>'
            f'<limit lower="{number(lower)}" upper="{number(upper)}" effort="{number(self.efforts[j])}" velocity="0"/>'
            f'<dynamics damping="{number(self.damping[j])}" friction="{number(m.dof_frictionloss[dof])}" armature="{number(self.armature[j])}"{home}/>{led}</joint>')

    def add_geom(self, g, tag, before):
        m, kind, size = self.m, self.m.geom_type[g], self.m.geom_size[g]
        at, turn = m.geom_pos[g] - before, make_rotation(m.geom_quat[g])
        types, shapes = mujoco.mjtGeom, []
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
        elif kind == types.mjGEOM_MESH and m.geom_dataid[g] in self.meshes and (shape := self.place_mesh(m.geom_dataid[g], at, turn)):
            shapes.append(shape)
        elif hasattr(m, "geom_aabb"):
            box = m.geom_aabb[g]
            shapes.append((at + turn @ box[:3], turn, f'<box size="{show(2 * box[3:])}"/>'))
        for place, rotation, shape in shapes:
            self.lines.append(f"<{tag}>{origin(place, rotation, 12)}<geometry>{shape}</geometry></{tag}>")

    def place_mesh(self, mesh, at, turn):
        """The file as it stands, where the library has its vertices; None where a URDF cannot say so."""
        m = self.m
        scale, given = m.mesh_scale[mesh], make_rotation(self.meshes[mesh].refquat).T
        if not np.allclose(scale[:, None] * given, given * scale, rtol=0, atol=1e-9 * abs(scale).max()):
            return None  # scaled askew
        turn = turn @ make_rotation(m.mesh_quat[mesh]).T  # the library has moved the vertices to their principal axes
        at, turn = at - turn @ m.mesh_pos[mesh], turn @ given
        path = m.paths[m.mesh_pathadr[mesh]:].split(b"\0")[0].decode()
        path = next(filter(os.path.isfile, (os.path.join(folder, path) for folder in self.folders)), path)  # some tell the name alone
        file = os.path.relpath(path, os.path.dirname(self.path))
        return at - turn @ (scale * self.meshes[mesh].refpos), turn, f'<mesh filename={quoteattr(file)} scale="{show(scale)}"/>'


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
    sys.stdout.reconfigure(encoding="utf-8")
    found = check_files(given)
    loaded = load(given)
    try:
        Writer(given, *loaded, found).write()
    except Exception as error:
        refuse(f"MuJoCo {mujoco.__version__} gives a model that is not as expected: {error!r}", "Use another version of the package mujoco.")
