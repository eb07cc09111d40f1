// The code of compensation_header() and compensation_module(), around their data. This header is
// internal to this folder.
#pragma once

namespace kincal {

inline constexpr char kCompensationHead[] = R"c(#ifndef KINCAL_COMPENSATION_H
#define KINCAL_COMPENSATION_H
#include <math.h>
)c";

inline constexpr char kCompensationTypes[] = R"c(
struct kincal_pose { double r[9], p[3]; }; /* rotation by rows, position (m) */
struct kincal_joint {
  int above, type, reading, bends; /* type 0: fixed, 1: turns, 2: slides */
  struct kincal_pose origin;
  double axis[3], scale, offset, factor, shift;
  const double* curve;
  double temperature; /* per kelvin */
  int ripples, couplings;
  const double* ripple; /* ratio, cos, sin, cos 2, sin 2 of each */
  const int* coupled_to;
  const double* coupling;
  double basis[9], compliance[3], load[3];
};
struct kincal_robot {
  int joints, base, tip, rotor;
  double gravity[3];
  struct kincal_pose base_frame, tip_frame;
  const struct kincal_joint* joint;
};

)c";

inline constexpr char kCompensationCode[] = R"c(
static void kincal_times(const double* a, const double* b, double* c) { /* c = a b, 3 x 3 */
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}
static void kincal_turn(const double* a, const double* v, double* w) { /* w = a v */
  const double x = v[0], y = v[1], z = v[2];
  for (int i = 0; i < 3; ++i) w[i] = a[3 * i] * x + a[3 * i + 1] * y + a[3 * i + 2] * z;
}
static void kincal_turn_back(const double* a, const double* v, double* w) { /* w = a' v */
  const double x = v[0], y = v[1], z = v[2];
  for (int i = 0; i < 3; ++i) w[i] = a[i] * x + a[3 + i] * y + a[6 + i] * z;
}
static void kincal_cross(const double* a, const double* b, double* c) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}
static double kincal_norm(const double* v) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }
static void kincal_exp(const double* w, double* r) { /* of a rotation vector */
  const double angle = kincal_norm(w), half = angle / 2;
  const double a = angle < 1e-5 ? 1 - angle * angle / 6 : sin(angle) / angle;
  const double s = angle < 1e-5 ? 0.5 - angle * angle / 48 : sin(half) / angle;
  const double b = 2 * s * s;
  const double k[9] = {0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0};
  double kk[9];
  kincal_times(k, k, kk);
  for (int i = 0; i < 9; ++i) r[i] = (i % 4 == 0) + a * k[i] + b * kk[i];
}
static void kincal_log(const double* r, double* w) { /* of a rotation by less than half a turn */
  const double v[3] = {r[7] - r[5], r[2] - r[6], r[3] - r[1]};
  const double sine = 0.5 * kincal_norm(v), angle = atan2(sine, 0.5 * (r[0] + r[4] + r[8] - 1));
  const double by = sine < 1e-9 ? 0.5 : 0.5 * angle / sine;
  for (int i = 0; i < 3; ++i) w[i] = by * v[i];
}
static void kincal_chain(const struct kincal_pose* a, const struct kincal_pose* b,
                         struct kincal_pose* c) { /* c = a b */
  struct kincal_pose out;
  kincal_times(a->r, b->r, out.r);
  kincal_turn(a->r, b->p, out.p);
  for (int i = 0; i < 3; ++i) out.p[i] += a->p[i];
  *c = out;
}
static void kincal_back(const struct kincal_pose* a, const struct kincal_pose* b,
                        struct kincal_pose* c) { /* c = a^-1 b */
  struct kincal_pose out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      out.r[3 * i + j] = a->r[i] * b->r[j] + a->r[3 + i] * b->r[3 + j] + a->r[6 + i] * b->r[6 + j];
  for (int i = 0; i < 3; ++i) out.p[i] = b->p[i] - a->p[i];
  kincal_turn_back(a->r, out.p, out.p);
  *c = out;
}
/* The error curve at a reading, a periodic cubic B-spline of 96 values, and its slope. */
static double kincal_curve(const double* c, double reading, double* slope) {
  const double per = 96 / 6.283185307179586, u = reading * per, t = u - floor(u), s = 1 - t;
  const int piece = (int)(floor(u) - 96 * floor(u / 96));
  const double w[4] = {s * s * s / 6, (4 - 6 * t * t + 3 * t * t * t) / 6,
                       (4 - 6 * s * s + 3 * s * s * s) / 6, t * t * t / 6};
  const double d[4] = {-s * s / 2, (3 * t - 4) * t / 2, (4 - 3 * s) * s / 2, t * t / 2};
  double out = 0;
  *slope = 0;
  for (int i = 0; i < 4; ++i) {
    out += w[i] * c[(piece + i - 1 + 96) % 96];
    *slope += per * d[i] * c[(piece + i - 1 + 96) % 96];
  }
  return out;
}
static double kincal_temperature = 20; /* of the robot, degrees Celsius: set it */
static double kincal_position(const struct kincal_joint* j, const double* q, double* by_reading) {
  double slope = 0, out;
  if (j->type == 0) return *by_reading = 0;
  out = j->scale * q[j->reading] + j->offset + j->temperature * (kincal_temperature - 20);
  if (j->curve) out += kincal_curve(j->curve, q[j->reading], &slope);
  for (int i = 0; i < 2 * j->ripples; ++i) {
    const double *of = j->ripple + 5 * (i / 2), *c = of + 1 + 2 * (i % 2);
    const double ratio = (1 + i % 2) * of[0], angle = ratio * q[j->reading];
    out += c[0] * cos(angle) + c[1] * sin(angle);
    slope += ratio * (c[1] * cos(angle) - c[0] * sin(angle));
  }
  for (int i = 0; i < j->couplings; ++i) out += j->coupling[i] * q[j->coupled_to[i]];
  *by_reading = j->factor * (j->scale + slope);
  return j->factor * out + j->shift;
}

/* Poses of a robot: of every joint's frame before its motion (bent) and of the link behind it, seen
   from the root. Returns 0; 1: there is no equilibrium. */
struct kincal_poses { struct kincal_pose frame[KINCAL_JOINTS], link[KINCAL_JOINTS]; double by_reading[KINCAL_JOINTS], at[KINCAL_JOINTS]; };
static int kincal_stand(const struct kincal_robot* robot, const double* q, struct kincal_poses* out) {
  struct kincal_pose motion[KINCAL_JOINTS];
  double bend[KINCAL_JOINTS][9], delta[KINCAL_JOINTS][3], moment[KINCAL_JOINTS][3];
  double frame[KINCAL_JOINTS][9], link[KINCAL_JOINTS][9], before = 0;
  int any = 0, fails = 0;
  for (int j = 0; j < robot->joints; ++j) {
    const struct kincal_joint* joint = robot->joint + j;
    const double at = kincal_position(joint, q, out->by_reading + j);
    out->at[j] = at;
    any = any || joint->bends;
    for (int i = 0; i < 3; ++i) {
      motion[j].p[i] = joint->type == 2 ? at * joint->axis[i] : 0;
      delta[j][i] = 0;
    }
    { /* about a unit axis */
      const double c = cos(at), s = sin(at), *a = joint->axis;
      for (int i = 0; i < 9; ++i) motion[j].r[i] = joint->type == 1 ? (1 - c) * a[i / 3] * a[i % 3] : 0;
      for (int i = 0; i < 3; ++i) motion[j].r[4 * i] += joint->type == 1 ? c : 1;
      if (joint->type == 1) {
        motion[j].r[7] += s * a[0], motion[j].r[5] -= s * a[0];
        motion[j].r[2] += s * a[1], motion[j].r[6] -= s * a[1];
        motion[j].r[3] += s * a[2], motion[j].r[1] -= s * a[2];
      }
    }
    for (int i = 0; i < 9; ++i) bend[j][i] = i % 4 == 0;
  }
  for (int round = 0; any && round < 100; ++round) {
    double change = 0;
    for (int j = 0; j < robot->joints; ++j) {
      const struct kincal_joint* joint = robot->joint + j;
      double turned[9];
      if (joint->above < 0)
        for (int i = 0; i < 9; ++i) frame[j][i] = joint->origin.r[i];
      else
        kincal_times(link[joint->above], joint->origin.r, frame[j]);
      kincal_exp(delta[j], bend[j]);
      kincal_times(frame[j], bend[j], turned);
      kincal_times(turned, motion[j].r, link[j]);
      kincal_turn(link[j], joint->load, moment[j]);
    }
    for (int j = robot->joints - 1; j >= 0; --j)
      if (robot->joint[j].above >= 0)
        for (int i = 0; i < 3; ++i) moment[robot->joint[j].above][i] += moment[j][i];
    for (int j = 0; j < robot->joints; ++j) {
      const struct kincal_joint* joint = robot->joint + j;
      double basis[9], torque[3], d[3];
      if (!joint->bends) continue;
      for (int i = 0; i < 9; ++i) basis[i] = joint->basis[i];
      if (robot->rotor) kincal_times(motion[j].r, joint->basis, basis);
      kincal_cross(moment[j], robot->gravity, torque);
      kincal_turn_back(frame[j], torque, torque);
      kincal_turn_back(basis, torque, d);
      for (int i = 0; i < 3; ++i) d[i] *= joint->compliance[i];
      kincal_turn(basis, d, d);
      for (int i = 0; i < 3; ++i) torque[i] = d[i] - delta[j][i];
      if (!(kincal_norm(torque) <= change)) change = kincal_norm(torque);
      for (int i = 0; i < 3; ++i) delta[j][i] = d[i];
    }
    if (!(change < 3)) return 1;
    if (change <= 1e-15) break;
    if (round > 0 && change >= before) {
      fails = !(change < 1e-12);
      break;
    }
    before = change;
    fails = round == 99;
  }
  for (int j = 0; j < robot->joints; ++j) {
    const struct kincal_joint* joint = robot->joint + j;
    struct kincal_pose bent = {{0}, {0}};
    kincal_exp(delta[j], bent.r);
    out->frame[j] = joint->origin;
    if (joint->above >= 0) kincal_chain(&out->link[joint->above], &joint->origin, &out->frame[j]);
    kincal_chain(&out->frame[j], &bent, &out->frame[j]);
    kincal_chain(&out->frame[j], &motion[j], &out->link[j]);
  }
  return fails;
}
static void kincal_tip_of(const struct kincal_robot* robot, const struct kincal_poses* poses,
                          struct kincal_pose* tip) {
  struct kincal_pose at = robot->tip_frame, from = robot->base_frame;
  if (robot->tip >= 0) kincal_chain(&poses->link[robot->tip], &at, &at);
  if (robot->base >= 0) kincal_chain(&poses->link[robot->base], &from, &from);
  kincal_back(&from, &at, tip);
}

/* The pose of the tip in the base: of the real robot, or of the one that was planned with. Returns
   0; 1: the robot has no equilibrium there. */
static int kincal_forward(const struct kincal_robot* robot, const double q[KINCAL_READINGS],
                          struct kincal_pose* tip) {
  struct kincal_poses poses;
  const int fails = kincal_stand(robot, q, &poses);
  kincal_tip_of(robot, &poses, tip);
  return fails;
}

/* Joints above a link that are not above the base (1) or the other way round (-1). */
static int kincal_side(const struct kincal_robot* robot, int joint) {
  int side = 0;
  for (int j = robot->tip; j >= 0; j = robot->joint[j].above) side += j == joint;
  for (int j = robot->base; j >= 0; j = robot->joint[j].above) side -= j == joint;
  return side;
}
static void kincal_solve(double* a, double* b, int n) { /* a x = b, symmetric and positive */
  for (int i = 0; i < n; ++i) {
    for (int j = i + 1; j < n; ++j) {
      const double f = a[i * n + i] > 0 ? a[j * n + i] / a[i * n + i] : 0;
      for (int k = i; k < n; ++k) a[j * n + k] -= f * a[i * n + k];
      b[j] -= f * b[i];
    }
  }
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) b[i] -= a[i * n + k] * b[k];
    b[i] = a[i * n + i] > 0 ? b[i] / a[i * n + i] : 0;
  }
}

/* The readings q with which the real robot's tip is where the planned one's is at `planned`, and
   the remaining errors of position (m) and rotation (rad). `rows`: 6, or 3 where the rotation does not
   matter. Returns 0; 1: the robot has no equilibrium there. */
static int kincal_compensate(const double planned[KINCAL_READINGS], int rows,
                             double q[KINCAL_READINGS], double left[2]) {
  struct kincal_pose wanted, tip, off;
  struct kincal_poses poses;
  double now[KINCAL_READINGS], at[KINCAL_JOINTS], least = HUGE_VAL;
  int moving[KINCAL_READINGS] = {0}, columns = 0;
  if (kincal_stand(&kincal_planned, planned, &poses)) return 1;
  kincal_tip_of(&kincal_planned, &poses, &wanted);
  left[0] = left[1] = HUGE_VAL;
  for (int i = 0; i < KINCAL_READINGS; ++i) q[i] = now[i] = planned[i];
  for (int j = 0; j < KINCAL_JOINTS; ++j) at[j] = poses.at[j];
  for (int j = 0; j < KINCAL_JOINTS; ++j)
    if (kincal_real.joint[j].type != 0 && kincal_side(&kincal_real, j)) moving[kincal_real.joint[j].reading] = 1;
  for (int i = 0; i < KINCAL_READINGS; ++i) columns += moving[i];
  for (int step = 0; step < 5; ++step) { /* each joint to where it was planned */
    double last[KINCAL_READINGS];
    int done[KINCAL_READINGS] = {0};
    for (int i = 0; i < KINCAL_READINGS; ++i) last[i] = now[i];
    for (int j = 0; j < KINCAL_JOINTS; ++j) {
      const struct kincal_joint* joint = kincal_real.joint + j;
      double by = 0;
      const double is = kincal_position(joint, last, &by);
      if (joint->type == 0 || !kincal_side(&kincal_real, j) || done[joint->reading]) continue;
      now[joint->reading] += (at[j] - is) / by;
      done[joint->reading] = 1;
    }
  }
  for (int step = 0; step < 30; ++step) {
    double e[6], jacobian[6][KINCAL_READINGS] = {{0}}, size = 0, trace = 0;
    double gram[KINCAL_READINGS > 6 ? KINCAL_READINGS * KINCAL_READINGS : 36];
    double right[KINCAL_READINGS > 6 ? KINCAL_READINGS : 6];
    struct kincal_pose root_tip = kincal_real.tip_frame;
    if (kincal_stand(&kincal_real, now, &poses)) return 1;
    kincal_tip_of(&kincal_real, &poses, &tip);
    kincal_back(&tip, &wanted, &off);
    kincal_log(off.r, e + 3);
    for (int i = 0; i < 3; ++i) e[i] = off.p[i];
    for (int i = 0; i < rows; ++i) size += e[i] * e[i];
    size = sqrt(size);
    if (!(size < 0.5 * least)) break;
    least = size;
    left[0] = kincal_norm(e);
    left[1] = kincal_norm(e + 3);
    for (int i = 0; i < KINCAL_READINGS; ++i) q[i] = now[i];
    if (kincal_real.tip >= 0) kincal_chain(&poses.link[kincal_real.tip], &root_tip, &root_tip);
    for (int j = 0; j < kincal_real.joints; ++j) {
      const struct kincal_joint* joint = kincal_real.joint + j;
      const int side = kincal_side(&kincal_real, j);
      double axis[3], arm[3], v[3];
      if (side == 0 || joint->type == 0) continue;
      kincal_turn(poses.frame[j].r, joint->axis, axis);
      for (int i = 0; i < 3; ++i) axis[i] *= side;
      for (int i = 0; i < 3; ++i) arm[i] = root_tip.p[i] - poses.frame[j].p[i];
      kincal_cross(axis, arm, v);
      if (joint->type == 2)
        for (int i = 0; i < 3; ++i) v[i] = axis[i], axis[i] = 0;
      kincal_turn_back(root_tip.r, v, v);
      kincal_turn_back(root_tip.r, axis, axis);
      for (int c = -1; c < joint->couplings; ++c) {
        const int reading = c < 0 ? joint->reading : joint->coupled_to[c];
        const double by = c < 0 ? poses.by_reading[j] : joint->factor * joint->coupling[c];
        for (int i = 0; moving[reading] && i < 3; ++i) {
          jacobian[i][reading] += by * v[i];
          jacobian[3 + i][reading] += by * axis[i];
        }
      }
    }
    {
      const int wide = columns >= rows, n = wide ? rows : KINCAL_READINGS;
      for (int i = 0; i < n; ++i) {
        right[i] = wide ? e[i] : 0;
        for (int k = 0; !wide && k < rows; ++k) right[i] += jacobian[k][i] * e[k];
        for (int j = 0; j < n; ++j) {
          double sum = 0;
          for (int k = 0; k < (wide ? KINCAL_READINGS : rows); ++k)
            sum += wide ? jacobian[i][k] * jacobian[j][k] : jacobian[k][i] * jacobian[k][j];
          gram[i * n + j] = sum;
          trace += i == j ? sum : 0;
        }
      }
      for (int i = 0; i < n; ++i) gram[i * n + i] += 1e-12 * trace;
      kincal_solve(gram, right, n);
      for (int i = 0; i < KINCAL_READINGS; ++i) {
        if (!wide) now[i] += right[i];
        for (int k = 0; wide && k < rows; ++k) now[i] += jacobian[k][i] * right[k];
      }
    }
  }
  return 0;
}
#endif
)c";

inline constexpr char kCompensationModuleHead[] =
    R"py("""A calibrated robot with what no URDF can hold. Made by kincal; it needs numpy.

forward(q): 4 x 4 pose of DATA['tip'] in DATA['base'] of the real robot at readings q, in the order of DATA['readings'] (rad, m);
forward(q, 'planned') that of the robot without (robot.urdf).  compensate(q): the readings with which the real robot is where the planned one is at q.
Set temperature, that of the robot (degrees Celsius), if DATA has joints whose position depends on it.
"""
import json

import numpy as np

temperature = 20.0

)py";

inline constexpr char kCompensationModule[] = R"py(

def skew(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def exp(w):
    """The rotation of a rotation vector."""
    angle = np.linalg.norm(w)
    k = skew(w)
    if angle < 1e-5:
        return np.eye(3) + (1 - angle ** 2 / 6) * k + (0.5 - angle ** 2 / 24) * k @ k
    return np.eye(3) + np.sin(angle) / angle * k + 2 * (np.sin(angle / 2) / angle) ** 2 * k @ k


def log(r):
    """The rotation vector of a rotation by less than half a turn."""
    v = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine = np.linalg.norm(v) / 2
    return (0.5 if sine < 1e-9 else 0.5 * np.arctan2(sine, (np.trace(r) - 1) / 2) / sine) * v


def pose(rotation, xyz):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, xyz
    return out


def back(t):
    """The inverse of a pose."""
    return pose(t[:3, :3].T, -t[:3, :3].T @ t[:3, 3])


def curve(values, reading):
    """The error curve at a reading, a periodic cubic B-spline, and its slope."""
    n = len(values)
    u = reading * n / (2 * np.pi)
    t = u - np.floor(u)
    s = 1 - t
    c = np.take(values, int(np.floor(u)) + np.arange(-1, 3), mode='wrap')
    w = np.array([s ** 3, 4 - 6 * t ** 2 + 3 * t ** 3, 4 - 6 * s ** 2 + 3 * s ** 3, t ** 3]) / 6
    d = np.array([-s * s, (3 * t - 4) * t, (4 - 3 * s) * s, t * t]) / 2
    return w @ c, n / (2 * np.pi) * (d @ c)


def ripple(terms, reading):
    """The ripple of gears at a reading, and its slope."""
    ratio, c1, s1, c2, s2 = np.reshape(terms, (-1, 5)).T
    a = ratio * reading
    return (np.sum(c1 * np.cos(a) + s1 * np.sin(a) + c2 * np.cos(2 * a) + s2 * np.sin(2 * a)),
            np.sum(ratio * (s1 * np.cos(a) - c1 * np.sin(a) + 2 * (s2 * np.cos(2 * a) - c2 * np.sin(2 * a)))))


def coupled(j):
    return list(zip(j.get('coupled_to', []), j.get('coupling', [])))


def stand(robot, q):
    """Poses of every joint's frame (bent, before its motion) and of the link behind it, seen from the root; motion by the reading; positions."""
    joints = robot['joints']
    n = len(joints)
    motion, by_reading, position = [np.eye(4) for _ in joints], np.zeros(n), np.zeros(n)
    for i, j in enumerate(joints):
        if j['type'] == 'fixed':
            continue
        reading = q[j['reading']]
        error, slope = curve(j['curve'], reading) if 'curve' in j else (0, 0)
        more, by = ripple(j['ripple'], reading) if 'ripple' in j else (0, 0)
        error, slope = error + more + j.get('temperature', 0) * (temperature - 20) + sum(c * q[o] for o, c in coupled(j)), slope + by
        at = j['factor'] * (j['scale'] * reading + j['offset'] + error) + j['shift']
        position[i], by_reading[i] = at, j['factor'] * (j['scale'] + slope)
        axis = np.array(j['axis'])
        if j['type'] == 'prismatic':
            motion[i][:3, 3] = at * axis
        else:
            motion[i][:3, :3] = np.cos(at) * np.eye(3) + np.sin(at) * skew(axis) + (1 - np.cos(at)) * np.outer(axis, axis)
    origin = [pose(j['origin']['rotation'], j['origin']['xyz']) for j in joints]
    gravity, delta, before = np.array(robot['gravity']), np.zeros((n, 3)), np.inf
    for _ in range(100 if any('compliance' in j for j in joints) else 0):
        frame, link, moment = [None] * n, [None] * n, np.zeros((n, 3))
        for i, j in enumerate(joints):
            frame[i] = origin[i][:3, :3] if j['above'] < 0 else link[j['above']] @ origin[i][:3, :3]
            link[i] = frame[i] @ exp(delta[i]) @ motion[i][:3, :3]
            moment[i] = link[i] @ j.get('load', [0, 0, 0])
        for i in reversed(range(n)):
            if joints[i]['above'] >= 0:
                moment[joints[i]['above']] += moment[i]
        change = 0
        for i, j in enumerate(joints):
            if 'compliance' not in j:
                continue
            basis = np.array(j['basis'])
            if robot['frame'] == 'rotor':
                basis = motion[i][:3, :3] @ basis
            d = basis @ (np.array(j['compliance']) * (basis.T @ (frame[i].T @ np.cross(moment[i], gravity))))
            change = max(change, np.linalg.norm(d - delta[i]))
            delta[i] = d
        if not change < 3:
            raise ValueError('the robot has no equilibrium there')
        if change <= 1e-15 or change >= before:
            break
        before = change
    frames, links = [], []
    for i, j in enumerate(joints):
        at = origin[i] if j['above'] < 0 else links[j['above']] @ origin[i]
        frames.append(at @ pose(exp(delta[i]), [0, 0, 0]))
        links.append(frames[i] @ motion[i])
    return frames, links, by_reading, position


def tip_of(robot, links):
    """The pose of the tip in the base frame, and seen from the root."""
    tip, base = (pose(robot[f]['rotation'], robot[f]['xyz']) for f in ('tip_frame', 'base_frame'))
    if robot['tip'] >= 0:
        tip = links[robot['tip']] @ tip
    if robot['base'] >= 0:
        base = links[robot['base']] @ base
    return back(base) @ tip, tip


def forward(q, which='real'):
    return tip_of(DATA[which], stand(DATA[which], q)[1])[0]


def above(robot, joint):
    out = set()
    while joint >= 0:
        out.add(joint)
        joint = robot['joints'][joint]['above']
    return out


def compensate(planned, rows=6):
    """Readings, and the remaining errors of position (m) and rotation (rad); rows=3: the rotation does not matter."""
    robot, wanted = DATA['real'], forward(planned, 'planned')
    to_tip, to_base = above(robot, robot['tip']), above(robot, robot['base'])
    now, least = np.array(planned, dtype=float), np.inf
    moving = {}
    for i in sorted(to_tip ^ to_base):
        if robot['joints'][i]['type'] != 'fixed':
            moving.setdefault(robot['joints'][i]['reading'], i)
    at = stand(DATA['planned'], planned)[3]
    for _ in range(5):  # each joint to where it was planned
        by, position = stand(robot, now)[2:]
        for reading, i in moving.items():
            now[reading] += (at[i] - position[i]) / by[i]
    out = now.copy(), np.inf, np.inf
    for _ in range(30):
        frames, links, by_reading, _ = stand(robot, now)
        tip, root_tip = tip_of(robot, links)
        off = back(tip) @ wanted
        e = np.r_[off[:3, 3], log(off[:3, :3])]
        size = np.linalg.norm(e[:rows])
        if not size < 0.5 * least:
            break
        least, out = size, (now.copy(), np.linalg.norm(e[:3]), np.linalg.norm(e[3:]))
        jacobian = np.zeros((6, len(now)))
        for i in to_tip ^ to_base:
            j = robot['joints'][i]
            if j['type'] == 'fixed':
                continue
            axis = (1 if i in to_tip else -1) * (frames[i][:3, :3] @ j['axis'])
            v = axis if j['type'] == 'prismatic' else np.cross(axis, root_tip[:3, 3] - frames[i][:3, 3])
            w = np.zeros(3) if j['type'] == 'prismatic' else axis
            for reading, by in [(j['reading'], by_reading[i])] + [(o, j['factor'] * c) for o, c in coupled(j)]:
                if reading in moving:
                    jacobian[:, reading] += by * np.r_[root_tip[:3, :3].T @ v, root_tip[:3, :3].T @ w]
        a = jacobian[:rows]
        wide = len(moving) >= rows
        gram = a @ a.T if wide else a.T @ a
        gram = gram + 1e-12 * np.trace(gram) * np.eye(len(gram))
        now = now + (a.T @ np.linalg.solve(gram, e[:rows]) if wide else np.linalg.solve(gram, a.T @ e[:rows]))
    return out
)py";

}  // namespace kincal
