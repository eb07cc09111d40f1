#!/usr/bin/env python3
"""False alarms: what is a right recording told that is not so? Random robots of many kinds, calibrated without steps, beside their truth.

    benchmarks/healthy.py                              # 700 recordings, all kinds in turn
    benchmarks/healthy.py --guesses --robots 300       # the noise is as `kincal init` guesses it, and truly 0.1 to 10 times that
    benchmarks/healthy.py --kind scara --seed 60 --robots 1 --keep build/scara     # one of them, with its files
    benchmarks/healthy.py --exact --robots 28          # proof of the recordings: residuals and chi2/dof of the truth
    benchmarks/healthy.py --ids                        # what a healthy recording may be told, and why
    benchmarks/healthy.py --json new.json --beside old.json     # this program beside another one's rows (--rows FILE: of rows that are there already)

Every recording has a number, its seed; its kind is a remainder of that. The forward model is that of automatic.py, which shares nothing with the
program, with what it lacks (poses, a tilting laser, sockets, flanges) here. It needs numpy, scipy and PyYAML.

What is wrong is what every robot has. Mounts are absent from the rig (half of them) or 1 to 3 cm and up to 30 mrad off; zeros are off by some
milliradians (normal, sigma 2 or 5 mrad; of slides 0.2 m times that), lengths by 0.3 to 1 mm a joint in half of the robots. Gears, boards and lenses
are as drawn, the noise is as stated. Poses of a flange are right but for noise, for its robot's zeros would be a mistake there.
A recording is enough: were only the mounts unknown (and nothing else wrong), its noise would leave them to 5 mm and 0.5 degrees, half of
what a warning is about; others are drawn again. What no posture tells is known to the user and held, as the program asks for it: the height of a
SCARA's target, the squares of boards that a camera only pans and tilts over.

A false alarm: a verdict that is not `good`, an exit code that is not 0, a finding, or a warning whose id is not one of --ids.
Errors are judged as automatic.py does; silently wrong is a `good` one with an error beyond 3 times the predicted.
"""
import argparse
import collections
import dataclasses
import json
import math
import multiprocessing
import os
import shutil
import sys
import tempfile

import automatic as base
from automatic import exp, inverse, inside, motion, rotation
import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation
import yaml

FRESH = base.FRESH
KINDS = {   # what is drawn in turn
    "hand": ["hand"], "room": ["room"], "flange": ["hand", "room", "mocap"], "head": ["head"], "scara": ["hand", "room", "tracker"],
    "gantry": ["hand", "room", "mocap"], "rail": ["hand", "room", "tracker"], "tracker": ["tracker"], "mocap": ["mocap"], "laser": ["laser"],
    "pantilt": ["pantilt"], "sockets": ["sockets"], "few": ["hand", "room", "mocap", "tracker"], "unstated": ["hand", "room", "mocap"]}
ABOUT = {
    "hand": "arm, camera in the hand, board on the wall", "room": "arm, camera in the room, board in the gripper",
    "flange": "the flange's poses in place of joints, their noise stated in half of them", "head": "two arms, camera on pan and tilt, boards in the grippers",
    "scara": "four axes, all along z, with a camera or a tracker", "gantry": "three slides and a wrist", "rail": "arm on a rail",
    "tracker": "arm, tracker and one reflector", "mocap": "arm, motion capture of a body on the flange", "laser": "arm, tilting laser, board in the gripper",
    "pantilt": "camera with a long lens on pan and tilt, boards around it", "sockets": "ball at the flange in sockets of a plate", "few": "8 to 12 samples",
    "unstated": "nobody states the noise of the joints"}
LEGITIMATE = {   # ids of warnings -> where (words of what a recording is about; "": everywhere), why
    "base_frame": ("", "where the base frame is nobody can measure: it and the first zero are one number. True of what stands at the base, and no doubt"),
    "last_zero": ("", "the last zero and how the thing behind it is turned are one number: true of every arm, and no doubt"),
    "unchecked": ("", "readings of a slide or squares of boards that nothing checks: true of what is recorded, and no doubt"),
    "gauge": ("", "what no posture tells and the program fixed: true of such a robot, and no doubt"),
    "noise": ("not stated", "nobody stated the noise, so it is found and told"),
}
POOR = ["sigma", "few_turns", "unobservable", "few_data", "ambiguous_start", "loose"]     # ids that say that the data tell too little
POSE_AXES = np.eye(6)


# ---- the forward model: what automatic.py lacks

def scan_readings(model, frames, pair):
    """Of every point (n, points) the reading of the scanning joint at which the laser's plane meets it, between the joint's limits; nan: at none."""
    sensor = model.sensors[pair[0]]
    joint = next(j for j in model.joints.values() if j.child == sensor.link)
    before = frames[joint.parent] @ joint.origin
    target = base.target_frame(model, frames, pair[1])
    behind = inverse(before) @ target
    x = in_frame(behind, model.targets[pair[1]].points())
    normal, shift = sensor.pose[:3, 2], sensor.pose[:3, 3]
    along = (x @ joint.axis) * (normal @ joint.axis)
    a, b, c = x @ normal - along, -np.cross(joint.axis, x) @ normal, along - normal @ shift
    with np.errstate(invalid="ignore"):
        middle, half = np.arctan2(b, a), np.arccos(-c / np.hypot(a, b))
    best = np.full(x.shape[:-1], np.nan)
    for q in (middle - half, middle + half):
        q = np.mod(q + np.pi, 2 * np.pi) - np.pi
        m = (joint_turned(joint, -q, x) - shift) @ sensor.pose[:3, :3]
        good = (q > joint.limits[0]) & (q < joint.limits[1]) & (abs(np.arctan2(m[..., 1], m[..., 0])) < math.radians(135))
        best = np.where(good & ~(abs(best) < abs(q)), q, best)
    return (best - joint.offset) / joint.scale


def in_frame(frames, points):
    """Points (points, 3) of frames (n, 4, 4) as their parent sees them: (n, points, 3)."""
    return points @ np.swapaxes(frames[..., :3, :3], -1, -2) + frames[..., None, :3, 3]


def joint_turned(joint, angles, points):
    return (base.rotation(np.multiply.outer(angles, joint.axis)) @ points[..., None])[..., 0]


def rays(model, frames, pair):
    """Joint reading, bearing and range of every point (n, points, 3)."""
    sensor = model.sensors[pair[0]]
    joint = next(j for j in model.joints.values() if j.child == sensor.link)
    t = scan_readings(model, frames, pair)
    behind = inverse(frames[joint.parent] @ joint.origin) @ base.target_frame(model, frames, pair[1])
    x = joint_turned(joint, -(joint.scale * t + joint.offset), in_frame(behind, model.targets[pair[1]].points()))
    m = (x - sensor.pose[:3, 3]) @ sensor.pose[:3, :3]
    return np.stack([t, np.arctan2(m[..., 1], m[..., 0]), np.linalg.norm(m, axis=-1)], -1)


def visible(model, frames, pair):
    """Which postures show the target: as automatic.py says, and of a laser the printed side of the whole board."""
    if model.sensors[pair[0]].type != "tilting_laser":
        return base.visible(model, frames, pair)
    points = base.points_seen(model, frames, pair)
    normal = (inverse(base.sensor_frame(model, frames, pair[0])) @ base.target_frame(model, frames, pair[1]))[:, :3, 2]
    centre = points.mean(1)
    away = np.linalg.norm(centre, axis=1)
    return np.isfinite(scan_readings(model, frames, pair)).all(1) & (np.sum(normal * centre, 1) > 0.35 * away) & (away > 0.3)


def at_lever(sensor):
    """Points of a frame whose places tell its pose as well as a sensor of poses does, and their sigma."""
    lever = sensor.sigma["translation"] / sensor.sigma["rotation"]
    return np.array([[lever, 0, 0], [0, lever, 0], [0, 0, lever]]), sensor.sigma["translation"]


def whitened(model, readings, pair, which):
    """What a sensor of the truth measures, over its noise: (n, numbers). Of sockets the one of `which`."""
    frames, sensor = base.link_frames(model, readings), model.sensors[pair[0]]
    if sensor.type == "pose":
        points, sigma = at_lever(sensor)
        pose = inverse(base.sensor_frame(model, frames, pair[0])) @ base.target_frame(model, frames, pair[1])
        values = in_frame(pose, points) / sigma
    else:
        points = base.points_seen(model, frames, pair)
        if which is not None:
            points = points[np.arange(len(points)), which][:, None]
        values = base.pixels(sensor, points) if sensor.type == "camera" else points
        values = values / (sensor.sigma["range"] if sensor.type == "tilting_laser" else sensor.sigma)
    return values.reshape(len(values), -1)


# ---- random robots

def draw_scara(rng, joints, link, name, xyz):
    """Two links that turn about z, a quill that slides along it and turns."""
    for i, shift in enumerate([[xyz[0], xyz[1], rng.uniform(0.2, 0.4)], [rng.uniform(0.2, 0.45), 0, 0]]):
        link = base.add_joint(rng, joints, "%s_%d" % (name, i + 1), link, "revolute", shift, [0, 0, 1], rng.uniform(1.5, 2.4))
    link = base.add_joint(rng, joints, name + "_quill", link, "prismatic", [rng.uniform(0.15, 0.4), 0, 0], [0, 0, 1], rng.uniform(0.05, 0.15))
    return base.add_joint(rng, joints, name + "_4", link, "revolute", [0, 0, -0.1], [0, 0, 1], rng.uniform(2, 3))


def draw_gantry(rng, joints, link, name, xyz):
    """Three slides, along x, y and z, and a wrist of two or three joints."""
    for k in (*rng.permutation(2), 2):
        half = rng.uniform(0.15, 0.3) if k == 2 else rng.uniform(0.3, 0.8)
        link = base.add_joint(rng, joints, "%s_%s" % (name, "xyz"[k]), link, "prismatic", [0, 0, 0.5], np.eye(3)[k], half)
    axes = [[0, 0, 1], [0, 1, 0], [0, 0, 1] if rng.random() < 0.5 else [1, 0, 0]][:rng.integers(2, 4)]
    for i, axis in enumerate(axes):
        link = base.add_joint(rng, joints, "%s_wrist_%d" % (name, i + 1), link, "revolute", [0, 0, -rng.uniform(0.05, 0.15)], axis, rng.uniform(1, 2.2))
    return link


def with_body(model):
    """The tracker measures the pose of a body in place of one reflector."""
    sensor = dataclasses.replace(model.sensors["tracker"], type="pose")
    body = dataclasses.replace(model.targets["reflector"], reflector=np.array([[0, 0, 0], [0.08, 0, 0], [0, 0.06, 0], [0.03, 0.02, 0.05]]))
    return base.Model(model.joints, {"mocap": sensor}, {"body": body}, [("mocap", "body")])


def draw_pantilt(rng):
    """A long lens on pan and tilt, and four to six boards on the walls."""
    joints = {}
    link = base.add_joint(rng, joints, "pan", "base", "revolute", [0, 0, rng.uniform(0.2, 1.5)], [0, 0, 1], rng.uniform(0.8, 1.4))
    link = base.add_joint(rng, joints, "tilt", link, "revolute", [rng.uniform(0, 0.05), 0, rng.uniform(0.05, 0.12)], [0, 1, 0], rng.uniform(0.5, 0.8))
    link = base.add_fixed(joints, "optical", link, "optical_link", inside(rng, 0.08), (-math.pi / 2, 0, -math.pi / 2))
    f = round(960 / math.tan(math.radians(rng.uniform(5, 14)) / 2))
    camera = base.Sensor("camera", link, 0.2, motion(rotation(inside(rng, 0.05)), inside(rng, 0.05)), (1920, 1200), np.array([f, f, 959.5, 599.5]))
    targets = {}
    for i in range(rng.integers(4, 7)):
        distance = rng.uniform(1.5, 4)
        targets["board_%d" % i] = base.Target("base", rows=6, columns=8, square=round(rng.uniform(0.35, 0.5) * 1920 / f * distance / 8.6, 3))
    model = base.Model(joints, {"camera": camera}, targets, [("camera", t) for t in targets])
    readings = base.draw_postures(rng, model, len(targets))
    for name in joints:
        if name in readings:
            readings[name] = 0.8 * (readings[name] - np.mean(joints[name].limits)) + np.mean(joints[name].limits)
    frames = base.sensor_frame(model, base.link_frames(model, readings), "camera")
    for i, name in enumerate(targets):
        distance = f * targets[name].square * 8.6 / (1920 * rng.uniform(0.35, 0.5))
        model = model.with_("targets", name, pose=frames[i] @ base.board_before(rng, targets[name], [0, 0, distance]))
    return model


def draw_robot(rng, kind, how):
    """The robot as designed, without poses (but of `pantilt`)."""
    if how == "pantilt":
        return draw_pantilt(rng)
    arm = {"scara": draw_scara, "gantry": draw_gantry}.get(kind, base.draw_arm)
    model = base.draw_robot(rng, {"mocap": "tracker", "sockets": "tracker", "laser": "room"}.get(how, how), arm)
    if how == "laser":
        ground = next(j.parent for n, j in model.joints.items() if n in ("arm_rail", "arm_waist", "arm_1"))
        tilt = base.add_joint(rng, model.joints, "laser_tilt", ground, "revolute", [rng.uniform(0, 0.2), 0, rng.uniform(0.6, 1.2)], [0, 1, 0], rng.uniform(0.7, 1.1))
        rows, columns, square = [(4, 5, 0.05), (5, 6, 0.04), (3, 4, 0.08)][rng.integers(3)]
        board = dataclasses.replace(model.targets["board"], rows=rows, columns=columns, square=square)
        return base.Model(model.joints, {"laser": base.Sensor("tilting_laser", tilt, None)}, {"board": board}, [("laser", "board")])
    if how == "sockets":
        plate = np.column_stack([rng.uniform(-0.2, 0.2, (6, 2)), rng.uniform(0, 0.1, 6)])[:rng.integers(4, 7)]
        tip, ground = model.targets["reflector"].link, model.sensors["tracker"].link
        return base.Model(model.joints, {"ball": base.Sensor("point", tip, None)}, {"plate": base.Target(ground, reflector=plate)}, [("ball", "plate")])
    return model


def place(rng, model, kind, how):
    """Poses of sensors and targets; what the user holds, as known, of these: (part, name, component). None: not possible with this robot."""
    if how == "pantilt":
        return model, []
    if how == "laser":
        return place_laser(rng, model), []
    if how == "sockets":
        ball = model.with_("sensors", "ball", pose=motion(shift=unit_beside(rng)))
        frames = base.link_frames(ball, base.draw_postures(rng, ball, 1))
        at = (inverse(frames[model.targets["plate"].link]) @ base.sensor_frame(ball, frames, "ball"))[0][:3, 3]
        return ball.with_("targets", "plate", pose=motion(rotation([*inside(rng, 0.1)[:2], rng.uniform(-3, 3)]), at + inside(rng, 0.1))), []
    if kind != "scara":
        model = base.place(rng, model, "tracker" if how == "mocap" else how)
        if model and how == "mocap":
            model = with_body(model)
            model = model.with_("targets", "body", pose=model.targets["body"].pose @ motion(base.any_rotation(rng)))
        return model, []
    if how == "tracker":
        return base.place(rng, model, how), [("targets", "reflector", 2)]
    frames = base.link_frames(model, base.draw_postures(rng, model, 1))
    frames = {n: np.broadcast_to(f, (1, 4, 4))[0] for n, f in frames.items()}
    camera, board = model.sensors["camera"], model.targets["board"]
    distance = camera.intrinsics[0] * np.linalg.norm(board.points()[-1]) / (camera.size[0] * rng.uniform(0.3, 0.5))
    down = rotation([math.pi, 0, 0]) @ rotation([0, 0, rng.uniform(-3, 3)])
    if how == "hand":       # the camera looks down, the board lies below it
        pose = motion(down @ rotation([*rng.uniform(-0.2, 0.2, 2), 0]), inside(rng, 0.1))
        seen = inverse(frames[board.link]) @ frames[camera.link] @ pose
        middle = seen[:3, 3] + seen[:3, 2] * distance - rotation([math.pi, 0, 0]) @ board.points().mean(0)
        model = model.with_("sensors", "camera", pose=pose).with_("targets", "board", pose=motion(rotation([math.pi, 0, 0]), middle))
    else:                   # the board lies on the quill, the camera looks at it from somewhere
        up = math.pi * (rng.random() < 0.5)
        pose = motion(rotation([up, 0, 0]), inside(rng, 0.1))
        camera_T_board = base.board_before(rng, board, [0, 0, distance]) @ motion(rotation([*rng.uniform(-0.3, 0.3, 2), 0]))
        model = model.with_("targets", "board", pose=pose)
        model = model.with_("sensors", "camera", pose=inverse(frames[camera.link]) @ frames[board.link] @ pose @ inverse(camera_T_board))
    return model, [("targets", "board", 2)]


def unit_beside(rng):
    """A place 5 to 15 cm beside an axis z."""
    turn = rng.uniform(-math.pi, math.pi)
    return rng.uniform(0.05, 0.15) * np.array([math.cos(turn), math.sin(turn), 0]) + [0, 0, rng.uniform(0, 0.1)]


def place_laser(rng, model):
    """The board is put into the hand so that it faces the laser in a posture in which the hand is before that."""
    model = model.with_("sensors", "laser", pose=motion(rotation(inside(rng, 0.15)), inside(rng, 0.05)))
    readings = base.draw_postures(rng, model, 2000)
    readings["laser_tilt"] = np.zeros(2000)
    frames = base.link_frames(model, readings)
    laser, hand = base.sensor_frame(model, frames, "laser") @ motion(base.from_rpy((-math.pi / 2, 0, -math.pi / 2))), frames[model.targets["board"].link]
    tip = (inverse(laser) @ hand)[:, :3, 3]
    near = np.flatnonzero((tip[:, 2] > 0.4) & (np.hypot(tip[:, 0], tip[:, 1]) < 0.3 * tip[:, 2]))
    if not len(near):
        return None
    pose = inverse(hand[near[0]]) @ laser[near[0]] @ base.board_before(rng, model.targets["board"], tip[near[0]] + inside(rng, 0.1))
    return model.with_("targets", "board", pose=pose)


def propose(rng, model, how, count):
    """Readings of postures that may show something."""
    readings = base.draw_postures(rng, model, count)
    if how == "pantilt":     # the camera looks about at a board
        boards, field = list(model.targets), 960 / model.sensors["camera"].intrinsics[0]
        which = rng.integers(len(boards), size=count)
        middle = np.array([(model.targets[b].pose @ [*model.targets[b].points().mean(0), 1])[:3] for b in boards])[which]
        for _ in range(3):   # turned by what it misses the board
            frames = base.sensor_frame(model, base.link_frames(model, readings), "camera")
            seen = (inverse(frames) @ np.column_stack([middle, np.ones(count)])[..., None])[:, :3, 0]
            readings["pan"] = readings["pan"] - np.arctan2(seen[:, 0], abs(seen[:, 2]))
            readings["tilt"] = readings["tilt"] + np.arctan2(seen[:, 1], np.hypot(seen[:, 0], seen[:, 2]))
        readings = {n: r + field * rng.uniform(-0.6, 0.6, count) for n, r in readings.items()}
    return readings


def in_socket(model, readings, which, miss):
    """Readings near the given ones at which the ball is in its socket, but for `miss` (n, 3; m), and how far it is from there."""
    names = [n for n, j in model.joints.items() if j.type != "fixed"]
    for _ in range(25):
        frames = {n: base.link_frames(model, {**readings, n: readings[n] + 1e-6}) for n in names}
        error = base.points_seen(model, base.link_frames(model, readings), ("ball", "plate"))[np.arange(len(which)), which] - miss
        jacobian = np.stack([(base.points_seen(model, frames[n], ("ball", "plate"))[np.arange(len(which)), which] - miss - error) / 1e-6 for n in names], -1)
        step = np.linalg.pinv(jacobian, rcond=1e-3) @ error[..., None]
        size = np.abs(step).max(axis=1, keepdims=True)
        step = step * np.minimum(1, 0.3 / np.maximum(size, 1e-12))
        readings = {**readings, **{n: readings[n] - step[:, i, 0] for i, n in enumerate(names)}}
    return readings, np.linalg.norm(error, axis=1)


def see(rng, model, how, count):
    """Postures that show something, for each target in turn: readings, pair -> which of them show it, and of sockets which one. None: too few."""
    if how == "sockets":
        tries = 3 * count + 40
        which = rng.integers(len(model.targets["plate"].reflector), size=tries)
        readings, missed = in_socket(model, base.draw_postures(rng, model, tries), which, np.zeros((tries, 3)))
        good = missed < 1e-9
        for name, r in readings.items():
            good &= (r > model.joints[name].limits[0]) & (r < model.joints[name].limits[1])
        good = np.flatnonzero(good)[:count]
        return None if len(good) < count else ({n: r[good] for n, r in readings.items()}, {p: np.ones(count, bool) for p in model.pairs}, which[good])
    kept, found = [], np.zeros(len(model.pairs), int)
    for batch in range(15):
        readings = propose(rng, model, how, 5000)
        frames = base.link_frames(model, readings)
        seen = np.stack([visible(model, frames, p) for p in model.pairs])
        wanted = np.zeros(5000, bool)
        for i in range(len(model.pairs)):
            most = count / len(model.pairs) + 1 if not batch else (count - found.sum()) / len(model.pairs)
            new = np.flatnonzero(seen[i] & ~wanted)[:math.ceil(most)]
            wanted[new] = True
            found[i] += len(new)
        kept.append({n: r[wanted] for n, r in readings.items()})
        if found.sum() >= count or found.sum() < (batch + 1) * count / 16:
            break
    if found.sum() < count or found.min() < count / len(model.pairs) / 2:
        return None
    order = rng.permutation(found.sum())[:count]
    readings = {n: np.concatenate([k[n] for k in kept])[order] for n in kept[0]}
    frames = base.link_frames(model, readings)
    return readings, {p: visible(model, frames, p) for p in model.pairs}, None


def by_flange(model, readings, believed):
    """The same robot, known by the poses of its flange only; last as a robot `believed` computes these."""
    frames = base.link_frames(model, readings)
    tip = next(x.link for x in [*model.sensors.values(), *model.targets.values()] if frames[x.link].ndim == 3)
    changed = base.Model({"flange": base.Joint("base", "flange", "floating", np.eye(4))}, model.sensors, model.targets, model.pairs)
    for part in ("sensors", "targets"):
        for name, x in getattr(model, part).items():
            new = {"link": "flange"} if x.link == tip else {"link": "base", "pose": frames[x.link] @ x.pose}
            changed = changed.with_(part, name, **new)
    return changed, {"flange": frames[tip]}, {"flange": base.link_frames(believed, readings)[tip]}


def moving_ground(model):
    """Whether a joint that moves stands below everything."""
    return "torso" in model.joints


def fits_kind(model, kind):
    railed = any(n.endswith("_rail") for n in model.joints)
    return railed == (kind == "rail") and not (kind == "flange" and moving_ground(model))


# ---- what is wrong, and how much the recording tells

@dataclasses.dataclass
class Case:
    """As of automatic.py; `nominal` is what the rig says: with poses that are off, or None; with the stated noise."""
    seed: int
    kind: str
    how: str
    about: str
    nominal: base.Model
    truth: base.Model
    readings: dict
    seen: dict
    which: np.ndarray             # of sockets: the one that the ball is in; else None
    samples: int
    stated: dict                  # joint -> stated sigma; {}: not stated
    noise: dict                   # joint -> true sigma; of a flange {translation, rotation}
    held: list                    # (part, name, component): known to the user
    believed: dict                # readings without noise


def mounts(model, held):
    """(part, name, components) of all poses of which anything that is measured depends."""
    out = []
    for name, s in model.sensors.items():
        out.append(("sensors", name, range(3) if name == "ball" else range(6)))
    for name, t in model.targets.items():
        out.append(("targets", name, [c for c in (range(3) if t.reflector is not None and len(t.reflector) == 1 else range(6)) if ("targets", name, c) not in held]))
    return out


def with_noise(rng, model):
    """The sensors with noise."""
    for name, s in model.sensors.items():
        sigma = {"camera": lambda: s.sigma, "point": lambda: float(rng.choice([0.00002, 0.00005, 0.0002]) if name == "tracker" else rng.choice([0.0001, 0.0003])),
                 "pose": lambda: {"translation": float(rng.choice([0.0001, 0.0003, 0.0005])), "rotation": float(rng.choice([0.0005, 0.001]))},
                 "tilting_laser": lambda: {"joint": 0.0005, "bearing": 0.0005, "range": float(rng.choice([0.002, 0.005]))}}[s.type]()
        model = model.with_("sensors", name, sigma=sigma)
    return model


def times(sigma, factor):
    return {k: v * factor for k, v in sigma.items()} if isinstance(sigma, dict) else sigma * factor


def plant(rng, model):
    """The robot as it is, and that in words."""
    spread, crooked = float(rng.choice([0.002, 0.005])), rng.random() < 0.5
    for name, joint in model.joints.items():
        if joint.type != "fixed":
            xi = np.concatenate([base.unit(rng) * rng.uniform(0.0003, 0.001) * crooked, np.zeros(3)])
            model = model.with_("joints", name, offset=rng.normal() * spread * (0.2 if joint.type == "prismatic" else 1), origin=joint.origin @ exp(xi))
    return model, "zeros %g mrad, lengths %s%s" % (1000 * spread, "off" if crooked else "as drawn", ", on a torso" if moving_ground(model) else "")


def rig_poses(rng, nominal, truth, held):
    """The poses that the rig gives: of mounts that something is held of; of the others half, 1 to 3 cm and up to 30 mrad off."""
    for part, name, components in mounts(truth, held):
        known = any(h[:2] == (part, name) for h in held)
        off = np.concatenate([base.unit(rng) * rng.uniform(0.01, 0.03), base.unit(rng) * rng.uniform(0, 0.03)])
        off[[c for c in range(6) if c not in components]] = 0
        given = known or rng.random() < 0.5
        nominal = nominal.with_(part, name, pose=getattr(truth, part)[name].pose @ exp(-off) if given else None)
    return nominal


def how_well_known(case):
    """The largest sigma of a mount over 1 cm or 1 degree, were all but the mounts known."""
    readings = {n: r[:case.samples] for n, r in case.readings.items()}
    which = None if case.which is None else case.which[:case.samples]
    unknowns = [(p, n, c) for p, n, components in mounts(case.truth, case.held) for c in components]
    normal = np.zeros((case.samples, len(unknowns), len(unknowns)))
    moving = [(n, c) for n in case.noise for c in (range(6) if case.truth.joints[n].type == "floating" else [None])]
    cross, own = np.zeros((case.samples, len(moving), len(unknowns))), np.zeros((case.samples, len(moving), len(moving)))
    for pair in case.truth.pairs:
        seen = case.seen[pair][:case.samples, None]
        at = whitened(case.truth, readings, pair, which)

        def slope(model, moved):
            return np.where(seen, (whitened(model, moved, pair, which) - at) / 1e-6, 0)
        shared = [slope(case.truth.with_(p, n, pose=getattr(case.truth, p)[n].pose @ exp(1e-6 * POSE_AXES[c])), readings) for p, n, c in unknowns]
        private = []
        for name, axis in moving:
            sigma = case.noise[name]
            sigma = sigma if axis is None else sigma["translation" if axis < 3 else "rotation"]
            step = readings[name] + 1e-6 if axis is None else readings[name] @ exp(1e-6 * POSE_AXES[axis])
            private.append(sigma * slope(case.truth, {**readings, name: step}))
        j, q = np.stack(shared, -1), np.stack(private, -1)
        normal += np.swapaxes(j, 1, 2) @ j
        cross += np.swapaxes(q, 1, 2) @ j
        own += np.swapaxes(q, 1, 2) @ q
    told = np.sum(normal - np.swapaxes(cross, 1, 2) @ np.linalg.solve(own + np.eye(len(moving)), cross), axis=0)
    sigma = np.sqrt(np.diag(np.linalg.inv(told + 1e-2 * np.eye(len(unknowns)))))     # 10 m, 10 rad where nothing is told
    return max(s / (0.01 if c < 3 else math.radians(1)) for s, (_, _, c) in zip(sigma, unknowns))


def with_guesses(rng, nominal, truth, guess):
    """The rig and the robot, what is stated of the joints and true of them, and that in words: guesses, and 0.1 to 10 times these."""
    sensors, joints = (math.exp(rng.uniform(-1, 1) * math.log(10)) for _ in range(2))
    usual = {"floating": {"translation": 0.0001, "rotation": 0.0002}, "prismatic": guess["slide"], "revolute": guess["joint"]}
    guessed = {n: usual[j.type] for n, j in truth.joints.items() if j.type != "fixed"}
    for name, s in nominal.sensors.items():
        nominal = nominal.with_("sensors", name, sigma=guess[s.type])
        truth = truth.with_("sensors", name, sigma=times(guess[s.type], sensors))
    stated = {n: s for n, s in guessed.items() if truth.joints[n].type != "floating"}     # of a flange `init` states none
    words = ", noise of sensors %.2g and of joints %.2g times the guess" % (sensors, joints)
    return nominal, truth, stated, {n: times(s, joints) for n, s in guessed.items()}, words


def draw_case(seed, kind, guess, inaccurate=False):
    """`guess`: None, or the sigmas that `kincal init` writes: of types of sensors, and `joint`, `slide`. Recordings that tell too little are drawn again."""
    for attempt in range(3000):
        rng = np.random.default_rng([seed, attempt, 20])
        how = KINDS[kind][seed // len(KINDS) % len(KINDS[kind])]
        nominal = draw_robot(rng, kind, how)
        if not fits_kind(nominal, kind):
            continue
        truth, about = (nominal, "poses as they are") if kind == "flange" and not inaccurate else plant(rng, nominal)
        truth, held = place(rng, truth, kind, how)
        samples = int(rng.integers(8, 13)) if kind == "few" else int(round(math.exp(rng.uniform(math.log(15), math.log(60)))))
        samples_and = "%d samples" % samples
        postures = truth and see(rng, truth, how, samples + FRESH)
        if not postures:
            continue
        readings, seen, which = postures
        truth = with_noise(rng, truth)
        believed = readings
        if kind == "flange":
            truth, readings, believed = by_flange(truth, readings, nominal)
            nominal = truth
        sigma = float(rng.choice([0.0001, 0.0002, 0.0005, 0.001] if kind != "pantilt" else [0.00005, 0.0001]))
        told = kind != "unstated" and not (kind == "flange" and (guess or inaccurate or rng.random() < 0.5))
        noise = {n: {"translation": 0.2 * sigma, "rotation": sigma} if j.type == "floating" else sigma * (0.2 if j.type == "prismatic" else 1)
                 for n, j in truth.joints.items() if j.type != "fixed"}
        nominal = base.Model(nominal.joints, truth.sensors, truth.targets, truth.pairs)
        stated = dict(noise) if told else {}
        if guess:
            nominal, truth, stated, noise, words = with_guesses(rng, nominal, truth, guess)
            about += words
        elif not told:
            samples_and = "%d samples, noise of %s not stated" % (samples, "poses" if kind == "flange" else "joints")
        scanned = [s.link for s in truth.sensors.values() if s.type == "tilting_laser"]
        noise = {n: v for n, v in noise.items() if truth.joints[n].child not in scanned}
        stated = {n: v for n, v in stated.items() if n in noise}
        case = Case(seed, kind, how, "%s, %s, %s" % (how, about, samples_and), rig_poses(rng, nominal, truth, held), truth, readings, seen, which,
                    samples, stated, noise, held, believed)
        if how_well_known(case) < 0.5:
            return case
    raise SystemExit("no robot of kind %s for seed %d" % (kind, seed))


# ---- files

def as_guesses(rig):
    """All sigmas of a rig marked as `kincal init` marks its guesses."""
    for part in ("joints", "sensors"):
        for entry in rig.get(part, {}).values():
            if "sigma" in entry:
                entry["sigma"] = {"guess": entry["sigma"]}


def rig_of(case, model, robot, stated, poses):
    rig = base.rig_of(model, {"base": "base", "flange": "flange"} if case.kind == "flange" else robot, 0.0, poses)
    rig["joints"] = {n: {"sigma": s} for n, s in stated.items()}
    if not stated:
        del rig["joints"]
    for name, s in model.sensors.items():
        if s.type == "tilting_laser":
            rig["sensors"][name]["joint"] = next(n for n, j in model.joints.items() if j.child == s.link)
    return rig


def noisy_readings(case, rng, noisy):
    """What the joints read, true readings (of sockets: with what the ball has of play)."""
    true = {n: r[:case.samples] for n, r in case.readings.items()}
    if case.which is not None and noisy:
        miss = noisy * case.truth.sensors["ball"].sigma * rng.normal(size=(case.samples, 3))
        true, _ = in_socket(case.truth, true, case.which[:case.samples], miss)
    read = {}
    for name, sigma in case.noise.items():
        if isinstance(sigma, dict):
            d = noisy * np.repeat([sigma["translation"], sigma["rotation"]], 3) * rng.normal(size=(case.samples, 6))
            read[name] = case.believed[name][:case.samples] @ np.stack([exp(-x) for x in d])
        else:
            read[name] = true[name] - noisy * sigma * rng.normal(size=case.samples)
    return read, true


def view_of(case, here, pair, i, rng, noisy):
    """One view: what the sensor says."""
    model, sensor = case.truth, case.truth.sensors[pair[0]]
    view = {"sensor": pair[0], "target": pair[1]}
    if sensor.type == "pose":
        pose = inverse(base.sensor_frame(model, here, pair[0])) @ base.target_frame(model, here, pair[1])
        pose = pose @ motion(rotation(noisy * sensor.sigma["rotation"] * rng.normal(size=3)), noisy * sensor.sigma["translation"] * rng.normal(size=3))
        return {**view, "pose": pose_of(pose)}
    if sensor.type == "tilting_laser":
        sigma = np.array([sensor.sigma[k] for k in ("joint", "bearing", "range")])
        values = rays(model, {n: f[None] for n, f in here.items()}, pair)[0]
        return {**view, "rays": [base.numbers(v) for v in values + noisy * sigma * rng.normal(size=values.shape)]}
    if case.which is not None:
        return {**view, "ids": [int(case.which[i])], "points": [[0.0, 0.0, 0.0]]}
    points = base.points_seen(model, here, pair).reshape(-1, 3)
    values, key = (base.pixels(sensor, points), "pixels") if sensor.type == "camera" else (points, "points")
    return {**view, key: [base.numbers(v) for v in values + noisy * sensor.sigma * rng.normal(size=values.shape)]}


def pose_of(pose):
    return {"xyz": base.numbers(pose[:3, 3]), "quat": base.numbers(Rotation.from_matrix(pose[:3, :3]).as_quat())}


def write_samples(path, case, noisy):
    rng = np.random.default_rng([case.seed, 1000])
    read, true = noisy_readings(case, rng, noisy)
    frames = base.link_frames(case.truth, true)
    with open(path, "w") as f:
        for i in range(case.samples):
            here = {link: frame if frame.ndim == 2 else frame[i] for link, frame in frames.items()}
            views = [view_of(case, here, p, i, rng, noisy) for p in case.truth.pairs if case.seen[p][i]]
            joints = {n: pose_of(r[i]) if r.ndim == 3 else float(r[i]) for n, r in read.items()}
            f.write(json.dumps({"id": "sample_%03d" % i, "joints": joints, "views": views}) + "\n")


def write_case(folder, case, noisy, true, guessed=False):
    """`true`: a rig with the truth; `guessed`: its sigmas are guesses."""
    urdf = "true_robot.urdf" if true else "robot.urdf"
    if case.kind != "flange":
        base.write_urdf(os.path.join(folder, urdf), case.truth if true else case.nominal, folded=true)
    rig = rig_of(case, case.truth if true else case.nominal, urdf, case.noise if true else case.stated, True)
    if guessed:
        as_guesses(rig)
    with open(os.path.join(folder, "true_rig.yaml" if true else "rig.yaml"), "w") as f:
        yaml.safe_dump(rig, f, sort_keys=False)
    write_samples(os.path.join(folder, "samples.jsonl"), case, noisy)


def held_names(case):
    names = ["%s/%s/pose.%s" % (part[:-1], name, base.COMPONENTS[c]) for part, name, c in case.held]
    return names + (["target/%s/square" % t for t in case.truth.targets] if case.how == "pantilt" else [])


# ---- the program and what it says

def guesses(program):
    """The sigmas that `kincal init` writes: by type of a sensor, and `joint`, `slide`."""
    with tempfile.TemporaryDirectory() as folder:
        urdf, rig = os.path.join(folder, "robot.urdf"), os.path.join(folder, "rig.yaml")
        joints = {}
        link = base.add_joint(np.random.default_rng(0), joints, "slide", "base", "prismatic", [0, 0, 0], [0, 0, 1], 1)
        base.add_joint(np.random.default_rng(0), joints, "turn", link, "revolute", [0, 0, 0], [0, 0, 1], 1)
        base.write_urdf(urdf, base.Model(joints, {}, {}, []))
        types = ["camera", "point", "pose", "tilting_laser"]
        arguments = [a for t in types for a in ("--sensor", "%s:turn_link:%s" % (t, t))]
        code, _, _, error = base.run(program, "init", urdf, *arguments, "--image-size", "640x480", "--target", "chessboard:6x7:0.03@base", "--out", rig)
        if code:
            raise SystemExit(error)
        with open(rig) as f:
            written = yaml.safe_load(f)
    found = {**{t: written["sensors"][t]["sigma"] for t in types}, "joint": written["joints"]["*"]["sigma"], "slide": written["joints"]["slide"]["sigma"]}
    marked = all(isinstance(s, dict) and "guess" in s for s in found.values())     # not as the program of 9efec73 wrote them
    return {**{k: s["guess"] if marked else s for k, s in found.items()}, "marked": marked}


def cause_of(result):
    """The id of what the verdict is about; `loose`: a mount that is hardly known, and nothing else."""
    text = result["verdict"]["text"]
    if result["verdict"]["use"] == "good":
        return ""
    for f in result.get("findings", []):
        if f["id"] + ": " in text:
            return "finding " + f["id"]
    for w in result["warnings"]:
        if w["text"].split(". What to do: ")[0] in text or w["id"] == "noise" and "taken for noise" in text:
            return w["id"]
    return "loose" if result["verdict"]["use"] == "no" else "open"


def noise_found(case, result):
    """[of, part, used, true, seen, its uncertainty, interval] of every level."""
    out = []
    for level in result["noise_levels"]:
        part, name = level["of"].split("/", 1)
        sigma = case.truth.sensors[name].sigma if part == "sensor" else case.noise.get(name)
        if isinstance(sigma, dict):
            sigma = sigma[level["part"]]
        if sigma is not None:
            out.append([level["of"], level.get("part"), level["used"], sigma, level["seen"], level["uncertainty"], level.get("interval")])
    return out


def measure(task):
    """One recording, drawn, written, calibrated and judged: a row of plain numbers."""
    seed, kind, options = task
    case = draw_case(seed, kind, options.guess, options.inaccurate)
    row = {"seed": seed, "kind": kind, "how": case.how, "about": case.about}
    folder = os.path.join(options.keep, "%s_%d" % (kind, seed)) if options.keep else tempfile.mkdtemp()
    try:
        if options.keep:
            shutil.rmtree(folder, ignore_errors=True)
            os.makedirs(folder)
        samples, out = os.path.join(folder, "samples.jsonl"), os.path.join(folder, "result")
        if options.exact:
            for noisy in (0, 1):
                write_case(folder, case, noisy, True)
                code, row["seconds"], text, error = base.run(options.program, "evaluate", os.path.join(folder, "true_rig.yaml"), samples, "--json")
                row.update(exit=code, error=error.strip())
                said = json.loads(text) if code == 0 else {}
                if noisy and said:
                    row["chi2"] = [said["chi2"], said["dof"]]
                elif said:
                    row["residuals"] = {n: [s["train"]["rms"], s["train"].get("rms_rotation")] for n, s in said["sensors"].items()}
            return row
        write_case(folder, case, 1, False, bool(options.guess) and options.guess["marked"])
        fix = [a for name in held_names(case) for a in ("--fix", name)]
        code, seconds, _, error = base.run(options.program, "calibrate", os.path.join(folder, "rig.yaml"), samples, "--out", out, "--no-report", "--quiet",
                                           "--threads", "1", *fix)
        row.update(exit=code, seconds=seconds, error=error.strip()[-500:], use="no", cause="error", text="", warnings=[], findings=[], judged={}, noise=[])
        if os.path.exists(os.path.join(out, "result.json")):
            with open(os.path.join(out, "result.json")) as f:
                result = json.load(f)
            row.update(use=result["verdict"]["use"], text=result["verdict"]["text"][:400], cause=cause_of(result), status=result["status"],
                       warnings=[[w["id"], w["text"][:300]] for w in result["warnings"]],
                       findings=[[f["id"], f["text"][:300]] for f in result.get("findings", [])], chi2=[result["chi2_data"], result["dof_data"]],
                       noise=noise_found(case, result), estimated=bool(result.get("noise_estimated")) or options.guess is not None)
            row["further"] = base.further(result)
            if not row["further"]:
                row["judged"] = base.judge(case, out)[0]
        return row
    finally:
        if not options.keep:
            shutil.rmtree(folder)


# ---- tables

def is_legitimate(row, warning):
    return warning in LEGITIMATE and LEGITIMATE[warning][0] in row["about"]


def alarms(row):
    """What a healthy recording should not have been told: ids, what the verdict is about first."""
    out = [row["cause"]] if row["use"] != "good" else []
    out += ["finding " + f for f, _ in row["findings"]] + [w for w, _ in row["warnings"] if not is_legitimate(row, w)]
    return list(dict.fromkeys(out)) or (["exit %d" % row["exit"]] if row["exit"] else [])


def is_loud(row):
    return row["use"] != "good" or row["exit"] != 0 or bool(row["findings"])


def interval(k, n):
    """Clopper and Pearson's, 95 %."""
    low = stats.beta.ppf(0.025, k, n - k + 1) if k else 0.0
    return low, stats.beta.ppf(0.975, k + 1, n - k) if k < n else 1.0


def share(k, n):
    return "%d of %d | %.1f (%.1f to %.1f)" % (k, n, 100 * k / n, *(100 * x for x in interval(k, n)))


def counted(ids):
    return ", ".join("%s %d" % c for c in collections.Counter(ids).most_common()) or "-"


def groups(rows):
    return [(k, [r for r in rows if r["kind"] == k]) for k in KINDS if any(r["kind"] == k for r in rows)] + [("all", rows)]


def ratios(rows):
    """Predicted over actual errors: median, 5 and 95 %."""
    values = [p / e for r in rows for e, p in r["judged"].values() if e > base.NONE]
    return "%.2f (%.2f to %.2f)" % tuple(np.percentile(values, [50, 5, 95])) if values else "-"


def is_silently_wrong(row):
    return row["use"] == "good" and not alarms(row) and base.beyond(row, "", 3)


def tell(rows):
    print("| kind | false alarms | %, 95 % | verdict, exit or finding | of these too little data | all ids | predicted / actual (5, 95 %) | silently wrong |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for kind, group in groups(rows):
        told = [r for r in group if alarms(r)]
        loud = [r for r in group if is_loud(r)]
        print("| %s | %s | %d | %d | %s | %s | %d |" % (kind, share(len(told), len(group)), len(loud), sum(r["cause"] in POOR for r in loud),
              counted(a for r in told for a in alarms(r)), ratios([r for r in group if r["exit"] == 0]), sum(is_silently_wrong(r) for r in group)))
    given = [r for r in rows if r.get("further")]
    print("\nGiven bending, curves or conditions, which none has (not judged): %s %s" % (share(len(given), len(rows)), ", ".join("%s %d" % (r["kind"], r["seed"]) for r in given)))
    tell_seeds(rows)


def tell_seeds(rows):
    print("\nSeeds by kind and id (the verdict's first; in brackets: a warning only)")
    for kind, group in groups(rows)[:-1]:
        seeds = collections.defaultdict(list)
        for r in group:
            if alarms(r):
                seeds[alarms(r)[0] if is_loud(r) else "(%s)" % alarms(r)[0]].append(r["seed"])
        for key in sorted(seeds, key=lambda k: -len(seeds[k])):
            print("  %s: %s: %s" % (kind, key, ", ".join(map(str, seeds[key]))))
    wrong = [r for r in rows if is_silently_wrong(r)]
    if wrong:
        print("\nSilently wrong")
    for r in wrong:
        worst = max(((e / max(p, 1e-12), q, e, p) for q, (e, p) in r["judged"].items() if e > base.NONE))
        print("  seed %d, %s (%s): %s %.3f mm for %.3f predicted" % (r["seed"], r["kind"], r["about"], worst[1], 1000 * worst[2], 1000 * worst[3]))


def found(rows, of):
    """Used over true noise of what the program estimated: median, 5 and 95 %."""
    values = [used / true for r in rows if r.get("estimated", True) for name, _, used, true, *_ in r["noise"] if name.startswith(of) and used]
    return "%.2f (%.2f to %.2f)" % tuple(np.percentile(values, [50, 5, 95])) if values else "-"


def tell_guesses(rows):
    print("| kind | good | %, 95 % | no | else the verdict is about | estimated | sensors' noise, found / true | joints' | predicted / actual (5, 95 %) "
          "| good and wrong |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for kind, group in groups(rows):
        good = [r for r in group if r["use"] == "good" and r["exit"] == 0]
        wrong = sum(base.beyond(r, "", 3) for r in good)
        print("| %s | %s | %d | %s | %d | %s | %s | %s | %d |" % (kind, share(len(good), len(group)), sum(r["use"] == "no" for r in group),
              counted(r["cause"] for r in group if r not in good), sum(bool(r.get("estimated")) for r in group), found(group, "sensor/"), found(group, "joint/"),
              ratios([r for r in group if r["exit"] == 0]), wrong))
    levels = [low <= true <= high for r in rows for _, _, _, true, _, _, (low, high) in r["noise"]]
    print("\nTrue noise within the interval of 95 %%: %s levels" % share(sum(levels), len(levels)))
    print("\nSeeds of what is not good")
    for kind, group in groups(rows)[:-1]:
        seeds = collections.defaultdict(list)
        for r in group:
            if r["use"] != "good":
                seeds[r["cause"]].append(r["seed"])
        for key in sorted(seeds, key=lambda k: -len(seeds[k])):
            print("  %s: %s: %s" % (kind, key, ", ".join(map(str, seeds[key]))))


def tell_beside(rows, others, is_right):
    """Both programs' rows of the same recordings."""
    there = {(r["kind"], r["seed"]): r for r in others}
    both = [(r, there[r["kind"], r["seed"]]) for r in rows if (r["kind"], r["seed"]) in there]
    print("\nHere and there (%d recordings)\n| kind | both right | right here alone | right there alone | neither |\n| --- | --- | --- | --- | --- |" % len(both))
    for kind in [*KINDS, "all"]:
        cells = collections.Counter((is_right(a), is_right(b)) for a, b in both if kind in (a["kind"], "all"))
        if cells:
            print("| %s | %d | %d | %d | %d |" % (kind, cells[True, True], cells[True, False], cells[False, True], cells[False, False]))
    for title, want in (("Right here alone", (True, False)), ("Right there alone", (False, True))):
        seeds = ["%s %d (%s)" % (a["kind"], a["seed"], (alarms(b) if want[0] else alarms(a) or ["-"])[0]) for a, b in both if (is_right(a), is_right(b)) == want]
        print("%s: %s" % (title, ", ".join(seeds) or "none"))


def tell_exact(rows):
    for r in rows:
        chi2, dof = r.get("chi2", (math.nan, 1))
        print("seed %d, %s (%s): exit %d %s; chi2/dof with noise %.3f (%+.1f of its deviations)" % (
            r["seed"], r["kind"], r["about"], r["exit"], r["error"] or r.get("residuals"), chi2 / dof, (chi2 - dof) / math.sqrt(2 * dof)))
    z = [(r["chi2"][0] - r["chi2"][1]) / math.sqrt(2 * r["chi2"][1]) for r in rows if "chi2" in r]
    worst = max((v for r in rows for s in (r.get("residuals") or {}).values() for v in s if v is not None), default=math.nan)
    print("largest rms without noise %.2g; chi2 of the truth with noise: mean %+.2f, deviation %.2f of its own (0 and 1 are right)" % (worst, np.mean(z), np.std(z)))


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=700)
    parser.add_argument("--seed", type=int, default=0, help="of the first robot")
    parser.add_argument("--kind", choices=list(KINDS), help="only recordings of this kind: " + "; ".join("%s: %s" % k for k in ABOUT.items()))
    parser.add_argument("--keep", metavar="DIR", help="keep each recording's files and result here")
    parser.add_argument("--program", metavar="PATH", default=os.path.join(base.ROOT, "build", "release", "kincal"))
    parser.add_argument("--jobs", type=int, default=1, help="recordings at once")
    parser.add_argument("--json", metavar="FILE", help="write the rows, while they are measured")
    parser.add_argument("--rows", metavar="FILE", help="read the rows that --json has written, and measure nothing")
    parser.add_argument("--beside", metavar="FILE", help="rows of another program: what is right here and there")
    parser.add_argument("--guesses", action="store_true", help="sigmas that `kincal init` writes, the true noise 0.1 to 10 times that")
    parser.add_argument("--inaccurate", action="store_true", help="with --kind flange: its poses are those of a robot with wrong zeros and lengths")
    parser.add_argument("--exact", action="store_true", help="residuals of the truth without noise, its chi2/dof with noise")
    parser.add_argument("--ids", action="store_true", help="ids of warnings that a healthy recording may have")
    return parser.parse_args()


def read_rows(path):
    with open(path) as f:
        return [json.loads(line) for line in f]


def measured(options):
    """The rows, each written as soon as it is there."""
    options.guess = guesses(options.program) if options.guesses else None
    tasks, seed, names, rows = [], options.seed, list(KINDS), []
    while len(tasks) < options.robots:
        kind = names[seed % len(names)]
        if options.kind in (None, kind) and not (options.guesses and kind == "unstated"):
            tasks.append((seed, kind, options))
        seed += 1
    written = open(options.json, "w") if options.json else None
    with multiprocessing.Pool(options.jobs) as pool:
        for row in pool.imap(measure, tasks):
            rows.append(row)
            if written:
                print(json.dumps(row), file=written, flush=True)
            if sys.stderr.isatty():
                print("\r%d of %d" % (len(rows), len(tasks)), end="", file=sys.stderr)
    return rows


def main():
    options = arguments()
    if options.ids:
        for name, (where, why) in LEGITIMATE.items():
            print("%s (%s): %s" % (name, "noise " + where if where else "all kinds", why))
        return
    rows = read_rows(options.rows) if options.rows else measured(options)
    (tell_exact if options.exact else tell_guesses if options.guesses else tell)(rows)
    if options.beside:
        is_right = (lambda r: r["use"] == "good" and r["exit"] == 0) if options.guesses else (lambda r: not alarms(r))
        tell_beside(rows, read_rows(options.beside), is_right)


if __name__ == "__main__":
    main()
