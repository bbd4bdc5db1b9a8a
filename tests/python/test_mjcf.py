"""`viable new robot --mjcf` against MuJoCo itself: M and bias of the robot folder, limits, hands, and what is refused.

MODELS=FOLDER test_mjcf.py: of each *.xml there as well, with a table. `test_mjcf.py Files` needs no MuJoCo.
"""

import os
import re
import resource
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import viable
from support import bring

SCRIPT = Path(os.environ["VIABLE_SOURCE_DIR"]) / "tools/draft/mjcf_to_urdf.py"
PROGRAM = Path(os.environ["PYTHONPATH"]).parent / "bin" / "viable"
HEAD = '<mujoco><compiler angle="radian" meshdir="meshes"/><asset><mesh name="part" file="part.obj" scale="1 2 1" refpos="0.1 0.2 0.3" refquat="0.8 0 0.6 0"/></asset><worldbody>'
CORNERS = np.array([[0, 0, 0], [0.09, 0, 0], [0, 0.02, 0], [0, 0, 0.01]])
BODY = '<body><joint/><geom size="0.1"/></body>'
MASS = '<inertial pos="0.01 0.02 {}" mass="{}" fullinertia="0.02 0.03 0.015 0.001 -0.002 0.003"/>'


def make_arm(joints, rest=""):
    """An arm of so many bodies: offset anchors, references, rotated frames, a slide, armature, damping, friction."""
    body, end = "", ""
    for i in range(joints):
        kind = 'type="slide" range="-0.2 0.3" ref="0.05"' if i == 2 else f'range="{-1.5 - 0.1 * i} {1.2 + 0.1 * i}" ref="{0.1 * i}"'
        body += (f'<body name="b{i}" pos="0.1 {0.02 * i} 0.2" euler="{0.3 * i} {np.pi / 2 if i == 3 else -0.2} 0.4">'
                 f'<joint name="j{i}" {kind} axis="{i % 2} 1 0.{i}" pos="0.01 0 -0.0{i}" armature="0.0{i}" damping="{i}" frictionloss="0.{i}" actuatorfrcrange="-1000 {1000 * (i != 1)}"/>'
                 + MASS.format(0.1, 3 - 0.4 * i) + f'<geom type="capsule" size="0.03" fromto="0 0 0 0.1 {0.02 * i} 0.2"/>')
        end += "</body>"
    motors = "".join(f'<position name="m{i}" joint="j{i}" gear="2" forcerange="-{60 - 5 * i} {70 - 5 * i}"/>' for i in range(joints - 1))
    return f"{HEAD}{body}<site name='tcp' pos='0 0 0.2'/><geom type='mesh' mesh='part' pos='0.05 0.01 0' euler='0 0 0.5'/>{end}</worldbody><actuator>{motors}</actuator>{rest}</mujoco>"


def call(*command, text=""):
    done = subprocess.run([PROGRAM, *map(str, command)], capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout, done.stderr


def rotate(points, quaternion):
    rows = np.zeros(9)
    mujoco.mju_quat2Mat(rows, quaternion)
    return points @ rows.reshape(3, 3).T


class Files(unittest.TestCase):
    def test_files_are_refused_before_the_library_reads_them(self):
        out = Path(self.enterContext(tempfile.TemporaryDirectory()))
        (out / "in/deep").mkdir(parents=True)
        for name, text in (("outside.xml", "<mujoco/>"), ("in/big.stl", ""), ("in/deep/first.xml", '<x xmlns="u"><include file="second.xml"/></x>'),
                           ("in/deep/second.xml", f'<x xmlns="u"><replicate count="1000000">{BODY}</replicate></x>')):
            (out / name).write_text(text)
        os.truncate(out / "in/big.stl", 1 << 30)
        path = out / "in/bad.xml"
        refused = {
            '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><mujoco>&b;</mujoco>': "entities",
            '<mujoco><include file="../outside.xml"/></mujoco>': "outside of its folder",
            '<mujoco><asset><mesh file="/etc/passwd"/></asset></mujoco>': "outside of its folder",
            '<mujoco><asset><mesh file="big.stl"/></asset></mujoco>': "no plain file of at most",
            "<mujoco>" + BODY * 5000 + "</mujoco>": "more than 1000 bodies",
            f'<mujoco><replicate count="1000000">{BODY}</replicate></mujoco>': "<replicate>",
            '<mujoco><include file="deep/first.xml"/></mujoco>': "second.xml has a <replicate>",
            "<mujoco>" + "".join(f'<compiler meshdir="d{i}"/>' for i in range(60)) + "</mujoco>": "or 50 folders",
            "<mujoco><worldbody/>": "not XML",
            "": "cannot be read",
        }
        for text, cause in refused.items():
            path.write_text(text) if text else path.unlink()
            done = subprocess.run([sys.executable, "-B", SCRIPT, path], capture_output=True, text=True, timeout=60)
            self.assertRegex(f"{done.returncode} {done.stderr}", f"^93 .*{cause}.*\n.*\n$")

    def test_names_forge_no_line_and_meet_no_other(self):
        sys.path.append(str(SCRIPT.parent))
        import mjcf_to_urdf
        writer = object.__new__(mjcf_to_urdf.Writer)  # which needs MuJoCo
        writer.notes, writer.taken = [], {"b_fixed"}
        writer.note("no actuator moves ", ["a\n<robot>\u2028", "b"])
        self.assertEqual([writer.name_new("b_fixed"), writer.name_new("b_fixed"), *writer.notes], ["b_fixed_", "b_fixed__", "note: no actuator moves a <robot> , b"])


class Models(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        global mujoco
        bring("mujoco==3.3.2")
        import mujoco
        os.environ["PATH"] = f"{Path(mujoco.__file__).parents[4] / 'bin'}:{os.environ['PATH']}"  # the program's python3

    def setUp(self):
        self.out = Path(self.enterContext(tempfile.TemporaryDirectory()))
        os.chdir(self.out)  # the library leaves a log of its warnings wherever it is
        self.addCleanup(os.chdir, "/")
        for folder in ("meshes", "in/meshes"):
            (self.out / folder).mkdir(parents=True)
            (self.out / folder / "part.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")

    def write(self, text, name="arm.xml"):
        (self.out / name).write_text(text)
        return self.out / name

    def take(self, path, name, *options):
        """The robot of a model, and by how much it differs: M, bias, each relative to its largest entry; limits."""
        command = ["new", "robot", name, "--mjcf", path, "--assume", "--out", self.out, *options]
        code, _, said = call(*command)
        if "at most 16" in said:
            code, _, said = call(*command, "--tip", "auto")
        self.assertEqual(code, 0, said)
        robot = viable.Robot(self.out / name)
        model = mujoco.MjModel.from_xml_path(str(path))
        data, rng = mujoco.MjData(model), np.random.default_rng(1)
        frozen = {joint: float(at) for joint, at in re.findall(r"joint `(\S+)` is frozen at (\S+):", said)}
        frozen |= {joint: float(at) for line in re.findall("frozen(?:, because.*?)?: (.*)", said) for joint, at in re.findall(r"(\S+) at ([^\s,]+)", line)}
        rows = [model.joint(joint).dofadr[0] for joint in robot.joints]
        places = [model.joint(joint).qposadr[0] for joint in robot.joints]
        worst = np.zeros(2)
        for _ in range(50):
            lower, upper = (np.where(np.isfinite(x), x, np.copysign(np.pi, x)) for x in robot.limits.position)
            q, qd = rng.uniform(lower, upper), rng.normal(size=len(robot))
            mujoco.mj_resetData(model, data)
            for joint, at in frozen.items():
                if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint) >= 0:  # others have no name
                    data.joint(joint).qpos[0] = at
            data.qpos[places], data.qvel[rows] = q, qd
            mujoco.mj_forward(model, data)
            M = np.zeros((model.nv, model.nv))
            if hasattr(data, "qM"):
                mujoco.mj_fullM(model, M, data.qM)
            else:
                mujoco.mj_fullM(model, data, M)
            ours = robot.dynamics(q, qd)
            for k, (found, wanted) in enumerate(((ours.M, M[np.ix_(rows, rows)]), (ours.b, data.qfrc_bias[rows]))):
                worst[k] = max(worst[k], abs(found - wanted).max() / max(abs(wanted).max(), 1e-3))
        for joint, lower, upper in zip(robot.joints, *robot.limits.position):
            if model.joint(joint).limited[0] if hasattr(model.joint(joint), "limited") else model.jnt_limited[model.joint(joint).id]:
                np.testing.assert_array_equal((lower, upper), model.joint(joint).range)
        return robot, worst

    def run_hand(self, name, seconds=2):
        hand = self.out / name / "hand.yaml"
        if not hand.exists():
            return "none", ""
        code, text, said = call("run", hand, "--details", "--set", f"duration_s={seconds}", "--out", self.out / f"{name}_run")
        return code, "".join(re.findall(r"^  verdict +(.*)", text, re.M)) or said.strip()[-200:]

    def test_inertia_and_bias_are_those_of_the_library(self):
        for joints in (1, 2, 4, 7):
            pair = [f'<actuator><motor joint="j{joints - 1}" gear="{g}" forcerange="0 {50 + g}"/></actuator>' for g in (1, -1)]
            path = self.write(make_arm(joints, "".join(pair)))
            robot, worst = self.take(path, f"arm_{joints}")
            self.assertLess(max(worst), 1e-9)
            np.testing.assert_allclose(robot.torque_limit, [2 * (60 - 5 * i) for i in range(joints - 1)] + [49], rtol=0)
            np.testing.assert_allclose(robot.friction["coulomb"], [0.1 * i for i in range(joints)], rtol=1e-15)
            np.testing.assert_allclose(robot.friction["viscous"] / robot.friction["viscous_velocity"], range(joints), rtol=1e-14)
            self.assertNotIn("rotor_inertia_kgm2", robot.assumed)
            mesh = re.search(r'xyz="(.*)" rpy="(.*)" */>\s*<geometry>\s*<mesh filename="(.*)" scale="(.*)"', (self.out / f"arm_{joints}/arm_{joints}.urdf").read_text())
            at, turns, scale = (np.array(mesh[k].split(), float) for k in (1, 2, 4))
            model, quat = mujoco.MjModel.from_xml_path(str(path)), np.zeros(4)
            mujoco.mju_euler2Quat(quat, turns, "XYZ")
            ours = at + rotate(scale * CORNERS, quat) + model.jnt_pos[-1]  # from the last joint's anchor
            wanted = model.geom_pos[-1] + rotate(model.mesh_vert, model.geom_quat[-1])
            self.assertLess(np.linalg.norm(ours[:, None] - wanted, axis=2).min(axis=1).max(), 1e-6)
            self.assertEqual(mesh[3], "meshes/part.obj")

    def test_its_hand_moves(self):
        key = '<keyframe><key name="home" qpos="{}"/></keyframe>'
        home = [0.3, -0.4, 0.1, 0.5, -0.6, 0.7]
        robot, worst = self.take(self.write(make_arm(6, key.format(" ".join(map(str, home))))), "handy")
        self.assertIn('tool_link: "tcp"', (self.out / "handy/limits.yaml").read_text())
        np.testing.assert_array_equal(robot.home, home)
        code, verdict = self.run_hand("handy")
        self.assertEqual(code, 0, verdict)
        self.assertIn("limits kept", verdict)

    def test_joints_that_others_lead_are_frozen(self):
        rules = ('joint1="j6" joint2="j2" polycoef="0.1 0.5"', 'joint1="j3" joint2="j4" polycoef="0.1 1 1"', 'joint1="j4" polycoef="0.3"',
                 'joint1="j1" joint2="j5"', 'joint1="j7" joint2="j1" polycoef="0.2 1 1"')
        path = self.write(make_arm(8, f"<equality><weld body1='b1'/>{''.join(f'<joint {rule}/>' for rule in rules)}</equality>"))
        robot, worst = self.take(path, "led")
        self.assertLess(max(worst), 1e-9)
        said = call("new", "robot", "again", "--mjcf", path, "--assume", "--out", self.out)[2]
        self.assertRegex(said, "j0 at 0 [(]a closed loop[)], j1 at 0.1 [(]a closed loop[)], j4 at 0.7 [(]an equality[)], j3 at 0.79")
        self.assertRegex(said, f"`j6` is frozen at {0.7 + 0.5 * (robot.home[0] - 0.05):.3f}[0-9]*: it mimics joint `j2`")

    def test_models_of_others(self):
        for path in sorted(Path(os.environ.get("MODELS", "/nowhere")).rglob("*.xml")):
            if path.stem.startswith("scene"):
                continue
            name = f"model_{len(list(self.out.iterdir()))}"
            try:
                robot, worst = self.take(path, name)
            except AssertionError as refused:
                print(f"{path.stem:24} refused: {re.sub(r'.*? : ', '', str(refused))[:200]}", flush=True)
                continue
            print(f"{path.stem:24} {len(robot):2} M {worst[0]:.0e} bias {worst[1]:.0e} hand", *self.run_hand(name, 4), flush=True)

    def test_what_cannot_be_taken_is_refused_quickly_and_leaves_nothing(self):
        refused = {
            HEAD.replace("part.obj", "missing.stl") + "</worldbody></mujoco>": "MuJoCo .* does not take it: .*missing.stl",
            '<mujoco><include file="../arm.xml"/></mujoco>': "outside of its folder",
            f'{HEAD}<body><joint/><inertial pos="0 0 0" mass="nan" diaginertia="1 1 1"/></body></worldbody></mujoco>': "does not take it|finite",
            f'{HEAD}<body><joint type="ball"/><geom size="0.1"/></body></worldbody></mujoco>': "unknown type, `ball`",
            f"{HEAD}</worldbody></mujoco>": "no moving joint",
            "<robot name='r'><link name='a'/></robot>": "Give it with --urdf",
        }
        arm = self.write(make_arm(2))
        for text, cause in refused.items():
            path, start = self.write(text, "in/bad.xml"), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            code, _, said = call("new", "robot", "bad", "--mjcf", path, "--assume", "--out", self.out)
            self.assertEqual(code, 2, said)
            self.assertRegex(said, cause)
            self.assertFalse((self.out / "bad").exists())
            self.assertLess(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - start, 3)  # most of it imports
        self.assertFalse((self.out / "MUJOCO_LOG.TXT").exists())
        free = self.write(f'{HEAD}<body><freejoint name="f"/><geom size="0.1"/></body></worldbody></mujoco>')
        self.assertRegex(call("new", "robot", "bad", "--mjcf", free, "--out", self.out)[2], "`f` is of type floating")
        self.assertRegex(call("new", "robot", "bad", "--urdf", arm, "--out", self.out)[2], "new robot NAME --mjcf")
        (self.out / "bin").mkdir()
        os.symlink(sys.executable, self.out / "bin/python3")
        alone = subprocess.run([PROGRAM, "new", "robot", "bad", "--mjcf", arm, "--out", self.out], capture_output=True, text=True,
                               env={"PATH": "/usr/bin"} if Path("/usr/bin/python3").exists() else {"PATH": "/nowhere"})
        self.assertRegex(alone.stderr, "pip install mujoco|python3, which reads it, was not found")


if __name__ == "__main__":
    unittest.main()
