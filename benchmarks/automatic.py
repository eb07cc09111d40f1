#!/usr/bin/env python3
"""Is the predicted error honest? Robots that nobody had prepared, calibrated without steps, beside their truth.

    benchmarks/automatic.py                            # 300 robots, all kinds in turn
    benchmarks/automatic.py --seed 17 --robots 1 --keep build/seventeen     # one of them, with its files
    benchmarks/automatic.py --exact --robots 12        # proof of the forward model: residuals of data without noise
    benchmarks/automatic.py --mounts-only              # proof of the prediction: nothing is wrong but the mounts, and only these are freed
    benchmarks/automatic.py --known                    # the same, and the best that can be: everything free, with priors as wide as what was planted

Every robot has a number of its own, its seed: the first has --seed, the next the number after it. The kind is a remainder of the seed. The
forward model stands here and shares nothing with the program. It needs numpy, scipy and PyYAML.

A robot is random: arms of 6 or 7 revolute joints with orthogonal and parallel axes, a rail or a torso in some, links before the paths in some.
What is wrong with it, in equal shares where nothing else is said: joint offsets (normal, sigma 0, 2, 5, 10, 20 mrad; of rails 0.2 m times that);
every origin up to 1 mm and 2 mrad (half of the robots); boards up to 4 % (two thirds); lenses up to 1 % (a third). Mounts of sensors and targets
are not in the rig. Noise is as stated (40 %), half or double of that, or the joints are stated to be exact and have 0.2 mrad.

Judged are 50 fresh postures, drawn as those of the samples were, at readings without noise:
  points: each target's points in the frame of the sensor that sees it; of a free board where the chain has it, in the camera's frame
  frames: the origin of each sensor's and each mounted target's frame, in the base
Error: rms of estimate minus truth. Predicted: root of the mean trace of J C J', with J from differences of the model here and C from
covariance.csv. "As drawn" is predicted / actual of errors that are drawn from C: where one direction decides, its median is 1.5 (1 / 0.674), not 1.
Errors below a micrometre count as none. Robots that end with another exit code than 0 (5: their model does not
explain the data) are counted and not judged.
"""
import argparse
import csv
import dataclasses
import fnmatch
import json
import math
import multiprocessing
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as xml

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
KINDS = ["hand", "room", "head", "tracker", "both", "free"]
ABOUT = {"hand": "camera in the hand, board on the wall", "room": "camera in the room, board in the gripper",
         "head": "camera on pan and tilt, boards in two grippers", "tracker": "tracker, reflector on the flange",
         "both": "camera in the hand and tracker", "free": "free board in the hand: chain and camera"}
FRESH = 50          # postures to judge
DRAWS = 20          # errors drawn from the predicted covariance
NONE = 1e-6         # m; smaller errors count as none
COMPONENTS = ["x", "y", "z", "rx", "ry", "rz"]


# ---- motions: arrays (..., 4, 4)

def rotation(w):
    """Rotation matrices of rotation vectors (..., 3)."""
    w = np.asarray(w, float)
    return Rotation.from_rotvec(w.reshape(-1, 3)).as_matrix().reshape(w.shape[:-1] + (3, 3))


def motion(turn=np.eye(3), shift=(0, 0, 0)):
    t = np.zeros(np.broadcast_shapes(np.shape(turn)[:-2], np.shape(shift)[:-1]) + (4, 4))
    t[..., :3, :3], t[..., :3, 3], t[..., 3, 3] = turn, shift, 1
    return t


def inverse(t):
    turn = np.swapaxes(t[..., :3, :3], -1, -2)
    return motion(turn, -(turn @ t[..., :3, 3:])[..., 0])


def left_jacobian(w):
    angle, k = np.linalg.norm(w), np.cross(np.eye(3), w)
    if angle < 1e-4:
        return np.eye(3) + k / 2 + k @ k / 6
    return np.eye(3) + (1 - math.cos(angle)) / angle**2 * k + (angle - math.sin(angle)) / angle**3 * k @ k


def exp(xi):
    """SE(3); xi = [translation, rotation]."""
    xi = np.asarray(xi, float)
    return motion(rotation(xi[3:]), left_jacobian(xi[3:]) @ xi[:3])


def log(t):
    w = Rotation.from_matrix(t[:3, :3]).as_rotvec()
    return np.concatenate([np.linalg.solve(left_jacobian(w), t[:3, 3]), w])


def from_rpy(rpy):
    return Rotation.from_euler("xyz", rpy).as_matrix()


def to_rpy(r):
    """Roll, pitch, yaw about fixed axes; roll from what yaw leaves, so that pitch near 90 degrees does no harm."""
    yaw = math.atan2(r[1, 0], r[0, 0]) if math.hypot(r[0, 0], r[1, 0]) > 1e-9 else 0.0
    rest = rotation([0, 0, -yaw]) @ r
    return [math.atan2(-rest[1, 2], rest[1, 1]), math.atan2(-rest[2, 0], rest[0, 0]), yaw]


# ---- the forward model

@dataclasses.dataclass(frozen=True)
class Joint:
    parent: str
    child: str
    type: str                     # revolute, prismatic, fixed; floating: its readings are poses (n, 4, 4)
    origin: np.ndarray            # parent_T_joint
    axis: np.ndarray = None
    limits: tuple = None
    offset: float = 0.0
    scale: float = 1.0


@dataclasses.dataclass(frozen=True)
class Sensor:
    type: str                     # camera, point, chain; here nothing else is written or drawn: pose, tilting_laser
    link: str
    sigma: object                 # as stated in the rig
    pose: np.ndarray = None
    size: tuple = None
    intrinsics: np.ndarray = None
    distortion: tuple = None      # k1 k2 p1 p2 k3; None: not in the rig, zeros


@dataclasses.dataclass(frozen=True)
class Target:
    link: str                     # None: free, and held by the sensor `chain`
    chain: str = None
    pose: np.ndarray = None
    rows: int = 0
    columns: int = 0
    square: float = 0.0
    reflector: np.ndarray = None  # its points, of a target that is no board

    def points(self):
        if self.reflector is not None:
            return self.reflector
        return np.array([[c * self.square, r * self.square, 0] for r in range(self.rows) for c in range(self.columns)])


@dataclasses.dataclass(frozen=True)
class Model:
    joints: dict                  # name -> Joint, parents before children
    sensors: dict
    targets: dict
    pairs: list                   # (sensor, target): who measures whose points

    def with_(self, part, name, **changes):
        """The same model with some numbers of one joint, sensor or target changed."""
        parts = dict(getattr(self, part))
        parts[name] = dataclasses.replace(parts[name], **changes)
        return dataclasses.replace(self, **{part: parts})


def joint_motion(joint, position):
    shift = np.multiply.outer(position, joint.axis)
    return motion(rotation(shift)) if joint.type == "revolute" else motion(shift=shift)


def link_frames(model, readings):
    """base_T_link of every link, for readings name -> (n)."""
    frames = {"base": np.eye(4)}
    for name, joint in model.joints.items():
        frames[joint.child] = frames[joint.parent] @ joint.origin
        if joint.type == "floating":
            frames[joint.child] = frames[joint.child] @ readings[name]
        elif joint.type != "fixed":
            frames[joint.child] = frames[joint.child] @ joint_motion(joint, joint.scale * readings[name] + joint.offset)
    return frames


def sensor_frame(model, frames, name):
    return frames[model.sensors[name].link] @ model.sensors[name].pose


def target_frame(model, frames, name):
    """Of a free target: where the chain has it."""
    target = model.targets[name]
    return sensor_frame(model, frames, target.chain) if target.chain else frames[target.link] @ target.pose


def points_seen(model, frames, pair):
    """The target's points in the sensor's frame, (n, points, 3)."""
    sensor_T_target = inverse(sensor_frame(model, frames, pair[0])) @ target_frame(model, frames, pair[1])
    points = model.targets[pair[1]].points()
    return np.atleast_3d(points @ np.swapaxes(sensor_T_target[..., :3, :3], -1, -2) + sensor_T_target[..., None, :3, 3])


def pixels(sensor, points):
    """Brown and Conrady's lens."""
    u, v = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    k1, k2, p1, p2, k3 = sensor.distortion or (0, 0, 0, 0, 0)
    s = u * u + v * v
    radial = 1 + s * (k1 + s * (k2 + s * k3))
    x = u * radial + 2 * p1 * u * v + p2 * (s + 2 * u * u)
    y = v * radial + p1 * (s + 2 * v * v) + 2 * p2 * u * v
    fx, fy, cx, cy = sensor.intrinsics
    return np.stack([fx * x + cx, fy * y + cy], -1)


def visible(model, frames, pair):
    """Which postures show the whole board from its printed side, not too oblique, its squares at least 8 pixels wide. Trackers see everything."""
    sensor, target = model.sensors[pair[0]], model.targets[pair[1]]
    points = points_seen(model, frames, pair)
    if sensor.type != "camera":
        return np.ones(len(points), bool)
    corners = points[:, [0, target.columns - 1, -target.columns, -1]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    view = corners.mean(1) / np.linalg.norm(corners.mean(1), axis=1)[:, None]
    good = (corners[..., 2].min(1) > 0.1) & (np.sum(normal * view, 1) > 0.35)
    good &= sensor.intrinsics[0] * target.square > 8 * corners[..., 2].max(1)
    where = np.flatnonzero(good)
    image = pixels(sensor, points[where])
    good[where] = np.all((image > 3) & (image < np.array(sensor.size) - 4), axis=(1, 2))
    return good


# ---- random robots

def unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def inside(rng, radius):
    return unit(rng) * rng.uniform(0, radius)


def any_rotation(rng):
    return Rotation.from_quat(rng.normal(size=4)).as_matrix()


def add_fixed(joints, name, parent, child, xyz, rpy=(0, 0, 0)):
    joints[name] = Joint(parent, child, "fixed", motion(from_rpy(rpy), xyz))
    return child


def add_joint(rng, joints, name, parent, type, xyz, axis, half):
    """A joint that moves about (revolute) or along its axis, by `half` to both sides of a random middle."""
    middle = rng.uniform(-0.3, 0.3) * half
    joints[name] = Joint(parent, name + "_link", type, motion(shift=xyz), np.array(axis, float), (middle - half, middle + half))
    return name + "_link"


def draw_root(rng, joints):
    """What stands between the base and the link on which everything else stands: nothing, fixed links, or a torso that no measurement depends on."""
    what = rng.choice(["nothing", "fixed", "torso"], p=[0.5, 0.25, 0.25])
    if what == "nothing":
        return "base"
    link = add_fixed(joints, "base_fixed", "base", "platform", inside(rng, 0.3), rng.uniform(-0.1, 0.1, 3))
    if what == "torso":
        lift = rng.random() < 0.5
        link = add_joint(rng, joints, "torso", link, "prismatic" if lift else "revolute", [0, 0, 0.3], [0, 0, 1], 0.15 if lift else 1.0)
    return add_fixed(joints, "ground_fixed", link, "ground", inside(rng, 0.2)) if what == "fixed" else link


def draw_arm(rng, joints, link, name, xyz):
    """Six or seven revolute joints; lengths 0.1 to 0.5 m; each axis orthogonal or parallel (at most three in a row) to the one before. Frames all
    alike at the zero posture, or turned so that every axis is z, as by Denavit and Hartenberg. Returns the link at the end."""
    if rng.random() < 0.2:
        along = np.eye(3)[rng.integers(3)]
        link = add_joint(rng, joints, name + "_rail", link, "prismatic", [0, 0, 0.1], along, rng.uniform(0.2, 0.5))
    elif rng.random() < 0.15:
        link = add_joint(rng, joints, name + "_waist", link, "revolute", [0, 0, 0.2], [0, 0, 1], rng.uniform(0.5, 1.5))
        xyz = np.add(xyz, [0.15, 0, 0])
    turned = rng.random() < 0.5
    frame, axis, at, parallel = np.eye(4), np.array([0, 0, 1.0]), np.array(xyz, float), 0
    for i in range(rng.integers(6, 8)):
        if i > 0:
            before = axis
            parallel = parallel + 1 if parallel < 2 and rng.random() < 0.3 else 0
            others = [s * e for e in np.eye(3) for s in (-1, 1) if abs(e @ before) < 0.5]
            if not parallel:
                axis = others[rng.integers(4)]
            along = others[rng.integers(4)] if parallel or rng.random() < 0.5 else before
            if along @ (at - xyz) < 0 and rng.random() < 0.85:      # mostly outwards
                along = -along
            if parallel or i < 4 or rng.random() < 0.75:            # some axes of a wrist meet
                at = at + along * rng.uniform(0.1, 0.5 if i in (2, 3) else 0.2)
        turn = np.eye(3)
        if turned:
            side = np.eye(3)[np.argmin(abs(axis))]
            turn = np.stack([side, np.cross(axis, side), axis], 1)
        next_frame = motion(turn, at)
        origin = inverse(frame) @ next_frame
        half, middle = rng.uniform(1.2, 2.6), rng.uniform(-0.5, 0.5)
        joints["%s_%d" % (name, i + 1)] = Joint(link, "%s_link_%d" % (name, i + 1), "revolute", motion(from_rpy(to_rpy(origin[:3, :3])), origin[:3, 3]),
                                                np.round(turn.T @ axis), (middle - half, middle + half))
        link, frame = "%s_link_%d" % (name, i + 1), next_frame
    if rng.random() < 0.5:
        link = add_fixed(joints, name + "_tool", link, name + "_tool_link", inside(rng, 0.15), rng.uniform(-math.pi, math.pi, 3))
    return link


def draw_camera(rng, link):
    width, height, f = [(640, 480, 520), (1280, 960, 1000), (1920, 1200, 1500)][rng.integers(3)]
    f = round(f * rng.uniform(0.9, 1.15))
    distortion = (-0.1, 0.02, 0.0, 0.0, 0.0) if rng.random() < 0.5 else None
    return Sensor("camera", link, float(rng.choice([0.1, 0.2, 0.3])), None, (width, height), np.array([f, f, width / 2 - 0.5, height / 2 - 0.5]), distortion)


def draw_board(rng, link, sizes, chain=None):
    rows, columns, square = sizes[rng.integers(len(sizes))]
    return Target(link, chain, None, rows, columns, square)


def draw_robot(rng, kind, arm=draw_arm):
    """The robot as designed; `arm` draws its arms. Poses of sensors and targets follow in `place`."""
    joints, sensors, targets, pairs = {}, {}, {}, []
    ground = draw_root(rng, joints)
    wall, small = [(6, 7, 0.06), (7, 9, 0.05), (6, 8, 0.04), (8, 11, 0.03)], [(4, 5, 0.03), (6, 7, 0.03), (6, 8, 0.025), (5, 8, 0.04)]
    head = kind == "head" or kind == "free" and rng.random() < 0.5
    sides = [("left", 0.2), ("right", -0.2)] if kind == "head" else [("arm", 0.25 * head)]
    tips = [arm(rng, joints, ground, name, [rng.uniform(0, 0.1), y, rng.uniform(0.1, 0.4)]) for name, y in sides]
    looks_from = ground
    if head:
        link = add_joint(rng, joints, "pan", ground, "revolute", [0, 0, rng.uniform(0.5, 0.8)], [0, 0, 1], rng.uniform(0.6, 1.2))
        link = add_joint(rng, joints, "tilt", link, "revolute", [rng.uniform(0, 0.1), 0, rng.uniform(0.05, 0.1)], [0, 1, 0], rng.uniform(0.5, 0.8))
        looks_from = add_fixed(joints, "optical", link, "optical_link", inside(rng, 0.1), (-math.pi / 2, 0, -math.pi / 2))
    if kind in ("hand", "both"):
        sensors["camera"], targets["board"] = draw_camera(rng, tips[0]), draw_board(rng, ground, wall)
        pairs.append(("camera", "board"))
    if kind in ("room", "head", "free"):
        sensors["camera"] = draw_camera(rng, looks_from)
    if kind == "room":
        targets["board"] = draw_board(rng, tips[0], small)
        pairs.append(("camera", "board"))
    if kind == "head":
        for (name, _), tip in zip(sides, tips):
            targets[name + "_board"] = draw_board(rng, tip, small)
            pairs.append(("camera", name + "_board"))
    if kind == "free":
        grip = float(rng.choice([0.4, 1.0]))
        sensors["hand"] = Sensor("chain", tips[0], {"translation": 0.0005 * grip, "rotation": 0.001 * grip})
        targets["board"] = draw_board(rng, None, small, "hand")
        pairs.append(("camera", "board"))
    if kind in ("tracker", "both"):
        sensors["tracker"] = Sensor("point", ground, float(rng.choice([0.00002, 0.00005, 0.0002])))
        targets["reflector"] = Target(tips[0], reflector=np.zeros((1, 3)))
        pairs.append(("tracker", "reflector"))
    return Model(joints, sensors, targets, pairs)


def plant(rng, model):
    """The robot as it is. Returns it, and what is wrong: sigma of the offsets, sigmas of the origins' numbers (m, rad), relative sigma of the
    boards' sizes, relative size of the lens' errors, and all of it in words."""
    spread = rng.choice([0, 0.002, 0.005, 0.01, 0.02])
    crooked, lens = rng.random() < 0.5, rng.random() < 1 / 3
    for name, joint in model.joints.items():
        offset = 0.0 if joint.type == "fixed" else rng.normal() * spread * (0.2 if joint.type == "prismatic" else 1)
        xi = np.concatenate([inside(rng, 0.001), inside(rng, 0.002)]) * crooked
        model = model.with_("joints", name, offset=offset, origin=joint.origin @ exp(xi))
    sizes = []
    for name, target in model.targets.items():
        size = rng.uniform(-0.04, 0.04) * (rng.random() < 2 / 3)
        if target.rows:
            model = model.with_("targets", name, square=target.square * (1 + size))
            sizes.append("%+.1f" % (100 * size + 0.0))
    for name, sensor in model.sensors.items():
        if sensor.type == "camera" and lens:
            both, ratio, centre = rng.uniform(-0.01, 0.01), rng.uniform(-0.002, 0.002), rng.uniform(-0.01, 0.01, 2) * sensor.intrinsics[0]
            factors = [1 + both, (1 + both) * (1 + ratio), 1, 1]
            model = model.with_("sensors", name, intrinsics=sensor.intrinsics * factors + [0, 0, *centre])
    wrong = {"offset": spread, "origin": (0.001 / 3 * crooked, 0.002 / 3 * crooked), "size": 0.04 * math.sqrt(2) / 3, "lens": 0.01 * lens}
    words = ["right", "wrong"]
    about = "offsets %g mrad, geometry %s, boards %s %%, lens %s" % (1000 * spread, words[crooked], " ".join(sizes) or "-", words[lens])
    return model, wrong, about


def board_before(rng, board, centre):
    """A pose of a board in a camera's frame: its middle at `centre`, its print towards the camera, tilted by up to half a radian."""
    away = np.asarray(centre) / np.linalg.norm(centre)
    turn = rotation(np.cross([0, 0, 1], away)) @ rotation([*rng.uniform(-0.4, 0.4, 2), 0]) @ rotation([0, 0, rng.uniform(-math.pi, math.pi)])
    return motion(turn, centre - turn @ board.points().mean(0))


def place(rng, model, kind):
    """Poses of sensors and targets, so that camera and board see each other in a random posture. None: not possible with this robot."""
    readings = draw_postures(rng, model, 2000)
    frames = {link: np.broadcast_to(f, (2000, 4, 4)) for link, f in link_frames(model, readings).items()}
    if "tracker" in model.sensors:
        tip = model.targets["reflector"].link
        model = model.with_("targets", "reflector", pose=motion(shift=inside(rng, 0.12)))
        model = model.with_("sensors", "tracker", pose=motion(any_rotation(rng), unit(rng) * rng.uniform(1.5, 4)))
    if "camera" not in model.sensors:
        return model
    camera, first = model.sensors["camera"], True
    for pair in model.pairs:
        if pair[0] != "camera":
            continue
        board = model.targets[pair[1]]
        corners = board.points()
        distance = camera.intrinsics[0] * np.linalg.norm(corners[-1]) / (camera.size[0] * rng.uniform(0.35, 0.55))
        carrier = model.sensors[board.chain].link if board.chain else board.link
        which = 0
        if camera.link == "optical_link":       # on a head: the board is put into a hand that happens to be before the camera
            if first:
                model = model.with_("sensors", "camera", pose=motion(rotation(inside(rng, 0.2)), inside(rng, 0.05)))
            tip = (inverse(frames[camera.link] @ model.sensors["camera"].pose) @ frames[carrier])[:, :3, 3]
            near = (tip[:, 2] > 0.3) & (np.hypot(tip[:, 0], tip[:, 1]) < 0.25 * tip[:, 2])
            if not near.any():
                return None
            which = np.flatnonzero(near)[0]
            camera_T_board = board_before(rng, board, tip[which] + inside(rng, 0.1))
            pose = inverse(frames[carrier][which]) @ frames[camera.link][which] @ model.sensors["camera"].pose @ camera_T_board
        elif kind in ("hand", "both"):          # the wall is where the camera looks
            model = model.with_("sensors", "camera", pose=motion(any_rotation(rng), inside(rng, 0.12)))
            pose = inverse(frames[carrier][0]) @ frames[camera.link][0] @ model.sensors["camera"].pose @ board_before(rng, board, [0, 0, distance])
        else:                                   # the camera in the room looks at the hand
            pose = motion(any_rotation(rng), inside(rng, 0.12))
            camera_T_board = board_before(rng, board, [0, 0, distance * rng.uniform(1, 1.5)])
            model = model.with_("sensors", "camera", pose=inverse(frames[camera.link][0]) @ frames[carrier][0] @ pose @ inverse(camera_T_board))
        first = False
        model = model.with_("sensors", board.chain, pose=pose) if board.chain else model.with_("targets", pair[1], pose=pose)
    return model


def draw_postures(rng, model, count):
    return {n: rng.uniform(*j.limits, count) for n, j in model.joints.items() if j.type != "fixed"}


def see_postures(rng, model, count):
    """Postures that show something, for each board in turn: readings name -> (count), and pair -> which of them show it. None: too few."""
    looking = [p for p in model.pairs if model.sensors[p[0]].type == "camera"] or model.pairs
    kept, found = [], [0] * len(looking)
    for batch in range(12):
        readings = draw_postures(rng, model, 20000)
        frames = link_frames(model, readings)
        seen = np.stack([visible(model, frames, p) for p in looking])
        wanted = np.zeros(20000, bool)
        for i in range(len(looking)):
            new = np.flatnonzero(seen[i] & ~wanted)[:math.ceil((count - sum(found)) / len(looking) if batch else count / len(looking))]
            wanted[new] = True
            found[i] += len(new)
        if wanted.any():
            kept.append({n: r[wanted] for n, r in readings.items()})
        if sum(found) >= count or sum(found) < count / 24:
            break
    if sum(found) < count or min(found) < count / len(looking) / 2:
        return None
    order = rng.permutation(sum(found))[:count]
    readings = {n: np.concatenate([k[n] for k in kept])[order] for n in kept[0]}
    frames = link_frames(model, readings)
    seen = {p: visible(model, frames, p) for p in looking}
    return readings, {p: seen.get(p, np.ones(count, bool)) for p in model.pairs}


@dataclasses.dataclass
class Case:
    """A robot with its data. Readings and `seen` are those of the samples first, then of the postures to judge."""
    seed: int
    kind: str
    about: str
    wrong: dict                   # as `plant` says
    nominal: Model
    truth: Model
    readings: dict
    seen: dict
    samples: int
    joint_sigma: float            # stated, rad
    joint_noise: float            # true; of prismatic joints 0.2 m times that, as of joint_sigma
    factor: float                 # noise of the sensors, true over stated


def draw_case(seed, kind, right, honest):
    """`right`: nothing is wrong but the mounts; `honest`: noise is as stated. Robots whose cameras see too little are drawn again."""
    for attempt in range(1000):
        rng = np.random.default_rng([seed, attempt])
        nominal = draw_robot(rng, kind)
        truth, wrong, about = (nominal, {}, "nothing wrong") if right else plant(rng, nominal)
        sigma = float(rng.choice([0.0001, 0.0002, 0.0005, 0.001]))
        noise = "stated" if honest else rng.choice(["stated", "half", "double", "exact"], p=[0.4, 0.2, 0.2, 0.2])
        factor = {"half": 0.5, "double": 2.0}.get(noise, 1.0)
        truth = place(rng, truth, kind)
        samples = int(round(math.exp(rng.uniform(math.log(8), math.log(60)))))
        postures = truth and see_postures(rng, truth, samples + FRESH)
        if postures:
            return Case(seed, kind, "%s, noise %s, %d samples" % (about, noise, samples), wrong, nominal, truth, *postures, samples,
                        0.0 if noise == "exact" else sigma, 0.0002 if noise == "exact" else sigma * factor, factor)
    raise SystemExit("no robot of kind %s for seed %d" % (kind, seed))


# ---- files

def numbers(values):
    return [float(v) + 0.0 for v in np.ravel(values)]      # + 0.0: no -0.0


def pose_entry(pose):
    return {"xyz": numbers(pose[:3, 3]), "rpy": numbers(to_rpy(pose[:3, :3]))}


def write_urdf(path, model, folded=False):
    """`folded`: joint offsets in the origins, as the program writes them."""
    lines = ['<robot name="robot">', '  <link name="base"/>'] + ['  <link name="%s"/>' % j.child for j in model.joints.values()]
    for name, joint in model.joints.items():
        origin = joint.origin @ joint_motion(joint, joint.offset) if folded and joint.offset else joint.origin
        entry = pose_entry(origin)
        lines.append('  <joint name="%s" type="%s"><parent link="%s"/><child link="%s"/><origin xyz="%s" rpy="%s"/>%s</joint>' % (
            name, joint.type, joint.parent, joint.child, " ".join(map(repr, entry["xyz"])), " ".join(map(repr, entry["rpy"])),
            "" if joint.type == "fixed" else '<axis xyz="%s"/><limit lower="%r" upper="%r" effort="1" velocity="1"/>' % (
                " ".join(map(repr, numbers(joint.axis))), *numbers(joint.limits))))
    with open(path, "w") as f:
        f.write("\n".join(lines + ["</robot>", ""]))


def rig_of(model, robot, joint_sigma, poses=False, estimate=None):
    """Without `poses` as `kincal init` leaves it: no mount is known; with them as many as the model has."""
    rig = {"format": "kincal/1", "robot": robot, "joints": {"*": {"sigma": joint_sigma}}, "targets": {}, "sensors": {}}
    for name, joint in model.joints.items():
        if joint.type == "prismatic":
            rig["joints"][name] = {"sigma": joint_sigma * 0.2}
    for name, target in model.targets.items():
        entry = {"type": "chessboard", "rows": target.rows, "columns": target.columns, "square": float(target.square)} if target.rows else {
            "type": "points", "points": [numbers(p) for p in target.reflector]}
        entry["mount"] = "free" if target.chain else {"link": target.link, **({"pose": pose_entry(target.pose)} if poses and target.pose is not None else {})}
        rig["targets"][name] = entry
    for name, sensor in model.sensors.items():
        entry = {"type": sensor.type, "link": sensor.link, "sigma": sensor.sigma, **({"pose": pose_entry(sensor.pose)} if poses and sensor.pose is not None else {})}
        if sensor.type == "camera":
            entry.update(model="brown_conrady", image_size=list(sensor.size), intrinsics=numbers(sensor.intrinsics))
            if sensor.distortion:
                entry["distortion"] = list(sensor.distortion)
        rig["sensors"][name] = entry
    if estimate:
        rig["estimate"] = estimate
    return rig


def write_rig(path, *rig, **options):
    """What `rig_of` makes."""
    with open(path, "w") as f:
        yaml.safe_dump(rig_of(*rig, **options), f, sort_keys=False)


def write_samples(path, case, noisy):
    """`noisy`: 0 or 1, a factor of all noise."""
    rng = np.random.default_rng([case.seed, 1000])
    model, n = case.truth, case.samples
    true = {name: r[:n] for name, r in case.readings.items()}
    frames = link_frames(model, true)
    read = {name: r - noisy * case.joint_noise * (0.2 if model.joints[name].type == "prismatic" else 1) * rng.normal(size=n) for name, r in true.items()}
    grips = {}        # what the grip of a chain adds to the pose of its target
    for name, sensor in model.sensors.items():
        if sensor.type == "chain":
            sigma = noisy * case.factor * np.repeat([sensor.sigma["translation"], sensor.sigma["rotation"]], 3)
            grips[name] = [exp(sigma * rng.normal(size=6)) for _ in range(n)]
    with open(path, "w") as f:
        for i in range(n):
            sample = {"id": "sample_%03d" % i, "joints": {name: float(r[i]) for name, r in read.items()}, "views": []}
            here = {link: frame if frame.ndim == 2 else frame[i] for link, frame in frames.items()}
            for pair in model.pairs:
                sensor, target = model.sensors[pair[0]], model.targets[pair[1]]
                if not case.seen[pair][i]:
                    continue
                moved = model
                if target.chain:
                    sample["views"].append({"sensor": target.chain, "target": pair[1]})
                    moved = model.with_("sensors", target.chain, pose=model.sensors[target.chain].pose @ grips[target.chain][i])
                points = points_seen(moved, here, pair).reshape(-1, 3)
                values, key = (pixels(sensor, points), "pixels") if sensor.type == "camera" else (points, "points")
                values = values + noisy * case.factor * sensor.sigma * rng.normal(size=values.shape)
                sample["views"].append({"sensor": pair[0], "target": pair[1], key: [numbers(v) for v in values]})
            f.write(json.dumps(sample) + "\n")


def write_truth(path, case):
    """In the form that `kincal simulate` reads and writes: increments of poses are from the rig's, of mounts from the identity."""
    values = {}
    for name, joint in case.truth.joints.items():
        if joint.type != "fixed":
            values["joint/%s/offset" % name] = float(joint.offset)
        values["joint/%s/origin" % name] = numbers(log(inverse(case.nominal.joints[name].origin) @ joint.origin))
    for name, sensor in case.truth.sensors.items():
        values["sensor/%s/pose" % name] = numbers(log(sensor.pose))
        if sensor.type == "camera":
            values["sensor/%s/intrinsics" % name] = numbers(sensor.intrinsics)
    for name, target in case.truth.targets.items():
        if not target.chain:
            values["target/%s/pose" % name] = numbers(log(target.pose))
        if target.rows:
            values["target/%s/square" % name] = float(target.square)
    with open(path, "w") as f:
        json.dump({"about": "%s; %s" % (ABOUT[case.kind], case.about), "parameters": values}, f, indent=1)
        f.write("\n")


def mounts(model):
    """What --mounts-only frees. Rotations of a single reflector are not determined."""
    free = ["sensor/%s/pose" % n for n in model.sensors]
    for name, target in model.targets.items():
        if not target.chain:
            free += ["target/%s/pose" % name] if target.rows else ["target/%s/pose.%s" % (name, c) for c in "xyz"]
    return free


def known(case):
    """What --known frees besides, with priors as wide as what was planted. What no measurement depends on is named, too: it counts in the base."""
    model, wrong, priors = case.nominal, case.wrong, {}
    for name, joint in model.joints.items():
        if joint.type != "fixed" and wrong["offset"]:
            priors["joint/%s/offset" % name] = float(wrong["offset"] * (0.2 if joint.type == "prismatic" else 1))
        if wrong["origin"][0]:
            priors["joint/%s/origin" % name] = dict(zip(("translation", "rotation"), wrong["origin"]))
    for name, target in model.targets.items():
        if target.rows:
            priors["target/%s/square" % name] = wrong["size"] * target.square
    for name, sensor in model.sensors.items():
        if sensor.type == "camera" and wrong["lens"]:
            for part in ("fx", "fy", "cx", "cy"):
                priors["sensor/%s/intrinsics.%s" % (name, part)] = float(wrong["lens"] / math.sqrt(3) * sensor.intrinsics[0])
    return priors


def steps(case, options):
    """None for the automatic path. What --known frees comes after the mounts, so that it begins near the solution."""
    if not options.mounts_only and not options.known:
        return None
    first = {"step": "mounts", "free": mounts(case.nominal)}
    priors = known(case) if options.known else {}
    return [first] + ([{"step": "all", "free": first["free"] + list(priors), "priors": priors}] if priors else [])


def write_case(folder, case, options):
    write_urdf(os.path.join(folder, "robot.urdf"), case.nominal)
    write_rig(os.path.join(folder, "rig.yaml"), case.nominal, "robot.urdf", case.joint_sigma, estimate=steps(case, options))
    write_samples(os.path.join(folder, "samples.jsonl"), case, 0 if options.exact else 1)
    write_truth(os.path.join(folder, "truth.json"), case)


# ---- the program and its results

def run(*arguments, environment=None):
    """Exit code (of a signal: negative), CPU seconds, output, errors. Ten minutes of CPU are the limit."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        child = subprocess.Popen(arguments, stdout=out, stderr=err, stdin=subprocess.DEVNULL, env=environment,
                                 preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (600, 600)))
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0), err.seek(0)
        return child.returncode, usage.ru_utime + usage.ru_stime, out.read(), err.read()


def read_pose(entry):
    turn = Rotation.from_quat(entry["quat"]).as_matrix() if "quat" in entry else from_rpy(entry.get("rpy", [0, 0, 0]))
    return motion(turn, entry.get("xyz", [0, 0, 0]))


def read_model(folder, nominal):
    """The calibrated robot: the nominal one with the numbers of a result's robot.urdf and rig.yaml."""
    model = nominal
    urdf = os.path.join(folder, "robot.urdf")     # of a robot that is known by its flange there is none
    for joint in xml.parse(urdf).getroot().findall("joint") if os.path.exists(urdf) else []:
        origin = joint.find("origin")
        pose = {k: [float(v) for v in origin.get(k, "0 0 0").split()] for k in ("xyz", "rpy")}
        model = model.with_("joints", joint.get("name"), origin=read_pose(pose))
    with open(os.path.join(folder, "rig.yaml")) as f:
        rig = yaml.safe_load(f)
    for pattern, entry in (rig.get("joints") or {}).items():
        for name in fnmatch.filter(model.joints, pattern):
            changes = {k: float(entry[k]) for k in ("offset", "scale") if k in entry}
            model = model.with_("joints", name, **changes)
    for name, entry in rig["sensors"].items():
        model = model.with_("sensors", name, pose=read_pose(entry.get("pose", {})))
    for name, entry in rig["targets"].items():
        if "square" in entry:
            model = model.with_("targets", name, square=float(entry["square"]))
        if entry["mount"] != "free":
            model = model.with_("targets", name, pose=read_pose(entry["mount"].get("pose", {})))
    return model


FURTHER = ("backlash", "compliance", "coupling", "curve", "load", "print", "ripple", "temperature", "time_offset", "warp")


def further(result):
    """Parameters of bending, curves, conditions and gears: no robot here has any, and the model of this script has none."""
    gears = [g["group"] for g in result.get("automatic", ()) if g["group"] == "gears" and not g.get("held")]
    return sorted(n for n in result["parameters"] if n.rpartition("/")[2] in FURTHER) + gears


def value(result, parameter, size=1):
    return np.array(result["parameters"].get(parameter, {"value": [0.0] * size})["value"], float)


def moved(model, result, header, name, step):
    """The estimate with one number of covariance.csv moved by `step`; None: nothing that is judged depends on this number.

    A pose that is wholly estimated is T exp(delta). One that is partly estimated (other components have no sigma) is T0 exp(xi + delta), which is T exp(-xi) exp(xi + delta). The origin that
    the result's URDF has is T exp(offset): the offset, which was folded in, is taken out before and folded in again after.
    """
    kind, owner, rest = name.split("/", 1)[0], name.split("/", 1)[1].rpartition("/")[0], name.rpartition("/")[2]
    what, _, component = rest.partition(".")
    if what in ("intrinsics", "distortion", "baseline", "print", "warp"):      # (shapes of boards: fractions of a millimetre)
        return None
    if kind == "joint" and what == "offset":
        return model.with_("joints", owner, origin=model.joints[owner].origin @ joint_motion(model.joints[owner], step))
    if kind == "joint" and what == "scale":
        return model.with_("joints", owner, scale=model.joints[owner].scale + step)
    if kind == "target" and what == "square":
        return model.with_("targets", owner, square=model.targets[owner].square + step)
    if what not in ("origin", "pose"):
        raise ValueError("covariance.csv has %s, of which this script knows nothing" % name)
    parameter, delta = "%s/%s/%s" % (kind, owner, what), np.zeros(6)
    delta[COMPONENTS.index(component)] = step
    if all("%s.%s" % (parameter, c) in header for c in COMPONENTS) and all(result["parameters"].get(parameter, {"sigma": [1]})["sigma"]):
        change = exp(delta)
    else:
        xi = value(result, parameter, 6)
        change = exp(-xi) @ exp(xi + delta)
    if kind == "joint":
        joint = model.joints[owner]
        fold = np.eye(4) if joint.type == "fixed" else joint_motion(joint, value(result, "joint/%s/offset" % owner)[0])
        return model.with_("joints", owner, origin=joint.origin @ inverse(fold) @ change @ fold)
    part = kind + "s"
    return model.with_(part, owner, pose=getattr(model, part)[owner].pose @ change)


def quantities(model, readings, seen):
    """What is judged: name -> (n, 3)."""
    frames = link_frames(model, readings)
    result = {}
    for pair in model.pairs:
        result["points/%s/%s" % pair] = points_seen(model, frames, pair)[seen[pair]].reshape(-1, 3)
    for name in model.sensors:
        result["frames/sensor/" + name] = sensor_frame(model, frames, name)[..., :3, 3].reshape(-1, 3)
    for name, target in model.targets.items():
        if not target.chain:
            result["frames/target/" + name] = target_frame(model, frames, name)[..., :3, 3].reshape(-1, 3)
    return result


def rms(values):
    return math.sqrt(np.sum(np.square(values)) / len(values))


def judge(case, folder):
    """Quantity -> (error, predicted); quantity -> predicted / actual of drawn errors; difference of the result's URDF from its result.json."""
    readings = {n: r[case.samples:] for n, r in case.readings.items()}
    seen = {p: s[case.samples:] for p, s in case.seen.items()}
    estimate = read_model(folder, case.nominal)
    with open(os.path.join(folder, "result.json")) as f:
        result = json.load(f)
    with open(os.path.join(folder, "covariance.csv")) as f:
        rows = list(csv.reader(f))
    header, covariance = rows[0], np.array(rows[1:], float).reshape(-1, len(rows[0]))
    at, true = quantities(estimate, readings, seen), quantities(case.truth, readings, seen)
    derivatives = {q: np.zeros((v.size, len(header))) for q, v in at.items()}
    for column, name in enumerate(header):
        step = 1e-6
        ends = [moved(estimate, result, header, name, s) for s in (step, -step)]
        if ends[0]:
            plus, minus = (quantities(e, readings, seen) for e in ends)
            for q in at:
                derivatives[q][:, column] = np.ravel(plus[q] - minus[q]) / (2 * step)
    judged, drawn, rng = {}, {}, np.random.default_rng(case.samples)
    variances, directions = np.linalg.eigh(covariance)
    root = directions * np.sqrt(np.maximum(variances, 0))
    for q, j in derivatives.items():
        judged[q] = (rms(at[q] - true[q]), math.sqrt(max(0.0, np.sum((j @ covariance) * j) / len(at[q]))))
        sizes = np.linalg.svd(j @ root, compute_uv=False) ** 2 / len(at[q])
        errors = np.sqrt(rng.normal(size=(DRAWS, len(sizes))) ** 2 @ sizes)
        drawn[q] = list(judged[q][1] / np.maximum(errors, 1e-12))
    differs = 0.0
    for name, joint in case.nominal.joints.items():
        origin = joint.origin @ exp(value(result, "joint/%s/origin" % name, 6))
        if joint.type not in ("fixed", "floating"):
            origin = origin @ joint_motion(joint, value(result, "joint/%s/offset" % name)[0])
        differs = max(differs, abs(origin - estimate.joints[name].origin).max())
    return judged, drawn, differs


def measure(task):
    """One robot, drawn, written, calibrated and judged. What is kept of it is plain numbers."""
    seed, kind, options = task
    case = draw_case(seed, kind, options.mounts_only, options.mounts_only or options.known)
    outcome = {"seed": seed, "kind": kind, "about": case.about}
    folder = os.path.join(options.keep, "%s_%d" % (kind, seed)) if options.keep else tempfile.mkdtemp()
    try:
        if options.keep:
            shutil.rmtree(folder, ignore_errors=True)
            os.makedirs(folder)
        write_case(folder, case, options)
        samples, out = os.path.join(folder, "samples.jsonl"), os.path.join(folder, "result")
        if options.exact:
            write_urdf(os.path.join(folder, "true_robot.urdf"), case.truth, folded=True)
            true_rig = os.path.join(folder, "true_rig.yaml")
            write_rig(true_rig, case.truth, "true_robot.urdf", case.joint_sigma, poses=True)
            code, seconds, text, error = run(options.kincal, "evaluate", true_rig, samples, "--json")
            outcome.update(exit=code, seconds=seconds, error=error.strip(), residuals=code == 0 and {
                n: [s["train"]["rms"], s["train"].get("rms_rotation")] for n, s in json.loads(text)["sensors"].items()})
            return outcome
        rig = os.path.join(folder, "rig.yaml")
        code, seconds, _, error = run(options.kincal, "calibrate", rig, samples, "--out", out, "--no-report", "--quiet", "--threads", "1")
        outcome.update(exit=code, seconds=seconds, error=error.strip(), warnings=[], judged={})
        if os.path.exists(os.path.join(out, "result.json")):
            with open(os.path.join(out, "result.json")) as f:
                result = json.load(f)
            outcome["warnings"] = [w["id"] for w in result["warnings"]]
            outcome["further"] = further(result)
            if not outcome["further"]:
                outcome["judged"], outcome["drawn"], outcome["differs"] = judge(case, out)
        return outcome
    finally:
        if not options.keep:
            shutil.rmtree(folder)


# ---- tables

def beyond(outcome, what, factor):
    """Whether an error of this robot exceeds the predicted one by the factor. A prediction that is no number is exceeded."""
    return any(q.startswith(what) and error > NONE and not error <= factor * predicted for q, (error, predicted) in outcome["judged"].items())


def shares(values):
    return "%7.2f (%.2f to %.2f)" % tuple(np.percentile(values, [50, 5, 95])) if len(values) else "-"


def row(title, outcomes, what):
    judged = [o for o in outcomes if o["exit"] == 0 and o["judged"]]
    counts = ["%d + %d" % tuple(sum(beyond(o, what, k) and bool(o["warnings"]) == warned for o in judged) for warned in (False, True)) for k in (3, 5)]
    pairs = [v for o in judged for q, v in o["judged"].items() if q.startswith(what) and v[0] > NONE]
    drawn = [ratio for o in judged for q, v in o["judged"].items() if q.startswith(what) and v[0] > NONE for ratio in o["drawn"][q]]
    print("%-8s %-7s %6d  %9s  %9s  %-28s %-24s %9s  %9s" % (title, what, len(judged), *counts, shares([p / e for e, p in pairs]), shares(drawn),
          *("%.3f" % (1000 * np.median([v[i] for v in pairs])) if pairs else "-" for i in (0, 1))))


def tell(outcomes, proof):
    """`proof`: the steps are such that predicted errors must be right."""
    groups = [(k, [o for o in outcomes if o["kind"] == k]) for k in KINDS] + [("all", outcomes)]
    print("%-8s %6s  %-42s %12s %12s  %s" % ("kind", "robots", "exit codes: robots", "CPU mean, s", "worst", "exit 0 with warnings"))
    for kind, group in groups:
        if group:
            codes = {c: sum(o["exit"] == c for o in group) for c in sorted({o["exit"] for o in group})}
            seconds = [o["seconds"] for o in group]
            warned = sum(o["exit"] == 0 and bool(o["warnings"]) for o in group)
            print("%-8s %6d  %-42s %12.2f %12.2f  %d" % (kind, len(group), ", ".join("%d: %d" % c for c in codes.items()), np.mean(seconds), max(seconds), warned))
    print("\nRobots with an error beyond 3 and 5 times the predicted (without + with a warning); predicted / actual and medians over all errors")
    print("%-8s %-7s %6s  %9s  %9s  %-28s %-24s %9s  %9s" % ("kind", "what", "judged", "beyond 3", "beyond 5", "predicted / actual (5, 95 %)", "as drawn", "error, mm", "predicted"))
    for what in ("points", "frames"):
        for kind, group in groups:
            if group:
                row(kind, group, what)
    if proof:
        for what in ("points", "frames"):
            squares = [(e / p) ** 2 for o in outcomes if o["exit"] == 0 for q, (e, p) in o["judged"].items() if q.startswith(what) and p > 0]
            print("mean of (error / predicted)^2, %s: %.3f +- %.3f; 1 is right" % (what, np.mean(squares), np.std(squares) / math.sqrt(len(squares))))
    offenders = [o for o in outcomes if o["exit"] == 0 and beyond(o, "", 3)]
    print("\nBeyond 3 times the predicted: %d robots" % len(offenders))
    for o in offenders:
        worst = sorted(((e / max(p, 1e-12), q, e, p) for q, (e, p) in o["judged"].items()), reverse=True)[0]
        print("  seed %d, %s (%s)\n    %s: %.3f mm for %.3f predicted%s" % (o["seed"], o["kind"], o["about"], worst[1], 1000 * worst[2], 1000 * worst[3],
              "; warnings: " + ", ".join(sorted(set(o["warnings"]))) if o["warnings"] else "; no warning"))
    given = [o for o in outcomes if o.get("further")]
    print("\nRobots that were given parameters of bending, curves or conditions: %d (not judged)" % len(given))
    for o in given:
        print("  seed %d, %s (%s): %s" % (o["seed"], o["kind"], o["about"], ", ".join(o["further"])))
    others = [o for o in outcomes if o["exit"] != 0]
    print("\nOther exit codes than 0: %d robots" % len(others))
    for o in others:
        print("  seed %d, %s (%s): exit %d%s" % (o["seed"], o["kind"], o["about"], o["exit"], "; " + o["error"].split("\n")[-1] if o["error"] else ""))
    strange = [o for o in outcomes if o.get("differs", 0) > 1e-6]
    for o in strange:
        print("seed %d: robot.urdf differs from result.json by %g" % (o["seed"], o["differs"]))


def measured(measure, tasks, options):
    """The outcomes of all tasks, `options.jobs` at once; written to the file `options.json`, if there is one."""
    outcomes = []
    with multiprocessing.Pool(options.jobs) as pool:
        for outcome in pool.imap(measure, tasks):
            outcomes.append(outcome)
            if sys.stderr.isatty():
                print("\r%d of %d" % (len(outcomes), len(tasks)), end="", file=sys.stderr)
    if options.json:
        with open(options.json, "w") as f:
            json.dump(outcomes, f, indent=1)
    return outcomes


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0, help="of the first robot")
    parser.add_argument("--kind", choices=KINDS, help="only robots of this kind: " + "; ".join("%s: %s" % k for k in ABOUT.items()))
    parser.add_argument("--keep", metavar="DIR", help="keep each robot's files and result here")
    parser.add_argument("--kincal", metavar="PATH", default=os.path.join(ROOT, "build", "release", "kincal"))
    parser.add_argument("--jobs", type=int, default=1, help="robots at once")
    parser.add_argument("--json", metavar="FILE", help="write everything that was measured")
    parser.add_argument("--mounts-only", action="store_true")
    parser.add_argument("--known", action="store_true")
    parser.add_argument("--exact", action="store_true")
    options = parser.parse_args()
    tasks, seed = [], options.seed
    while len(tasks) < options.robots:
        if options.kind in (None, KINDS[seed % len(KINDS)]):
            tasks.append((seed, KINDS[seed % len(KINDS)], options))
        seed += 1
    outcomes = measured(measure, tasks, options)
    if not options.exact:
        return tell(outcomes, options.mounts_only or options.known)
    for o in outcomes:
        print("seed %d, %s: exit %d %s" % (o["seed"], o["kind"], o["exit"], o["error"] or o["residuals"]))


if __name__ == "__main__":
    main()
