// Statistics and rigid motions, without dependencies.
import type { Link, Pose7 } from './data';

export function rms(values: ArrayLike<number>): number {
  let sum = 0, n = 0;
  for (let i = 0; i < values.length; i++) if (!Number.isNaN(values[i])) { sum += values[i] * values[i]; n++; }
  return n ? Math.sqrt(sum / n) : NaN;
}

/** The q-quantile of the finite values, by linear interpolation between order statistics. */
export function quantile(values: ArrayLike<number>, q: number): number {
  const sorted = Float64Array.from(values).filter((v) => Number.isFinite(v)).sort();
  if (!sorted.length) return NaN;
  const at = q * (sorted.length - 1);
  const low = Math.floor(at);
  return sorted[low] + (at - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
}

export function extent(values: ArrayLike<number>): [number, number] {
  let low = Infinity, high = -Infinity;
  for (let i = 0; i < values.length; i++) {
    const v = values[i];
    if (v < low) low = v;
    if (v > high) high = v;
  }
  return low <= high ? [low, high] : [0, 1];
}

/** Counts of values in equal bins of [low, high]; what lies outside counts in the first or last bin. */
export function histogram(values: ArrayLike<number>, low: number, high: number, bins: number): Float64Array {
  const counts = new Float64Array(bins);
  const scale = bins / (high - low);
  for (let i = 0; i < values.length; i++) {
    if (Number.isNaN(values[i])) continue;
    counts[Math.min(bins - 1, Math.max(0, Math.floor((values[i] - low) * scale)))]++;
  }
  return counts;
}

/** Density of the standard normal distribution. */
export function normalDensity(x: number): number {
  return Math.exp((-x * x) / 2) / Math.sqrt(2 * Math.PI);
}
/** Density of the norm of k independent standard normal numbers (chi distribution). */
export function chiDensity(x: number, k: number): number {
  if (x < 0) return 0;
  // 2^(1-k/2) x^(k-1) exp(-x^2/2) / Gamma(k/2), and Gamma by Gamma(x+1) = x Gamma(x) from 1/2 or 1.
  let gamma = k % 2 ? Math.sqrt(Math.PI) : 1;
  for (let g = k % 2 ? 0.5 : 1; g < k / 2 - 1e-9; g++) gamma *= g;
  return (2 ** (1 - k / 2) * x ** (k - 1) * Math.exp((-x * x) / 2)) / gamma;
}

/** Values at round steps (1, 2, 5 times a power of ten) within [low, high]; about this many. */
export function ticks(low: number, high: number, about: number): number[] {
  if (!(high > low)) return [low];
  const raw = (high - low) / Math.max(1, about);
  const power = 10 ** Math.floor(Math.log10(raw));
  const widest = [1, 2, 5, 10].find((m) => m * power >= raw * 0.999) ?? 10;
  let made: number[] = [];
  // Fewer than three would leave a range around 0 with nothing but the 0.
  for (const m of [10, 5, 2, 1, 0.5, 0.2, 0.1]) {
    if (m > widest || made.length >= 3) continue;
    const step = m * power;
    made = [];
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) made.push(i * step + 0);   // + 0: no negative zero
  }
  return made;
}

// ---- rigid motions: x y z qx qy qz qw, as in the data
export const identity: Pose7 = [0, 0, 0, 0, 0, 0, 1];

/** A quaternion x y z w as the angles of a URDF (R = Rz(yaw) Ry(pitch) Rx(roll)); at pitch 90 degrees roll is 0. */
export function rollPitchYaw([x, y, z, w]: number[]): [number, number, number] {
  const pitch = Math.asin(Math.max(-1, Math.min(1, 2 * (w * y - x * z))));
  if (Math.abs(Math.abs(pitch) - Math.PI / 2) < 1e-6) return [0, pitch, Math.sign(pitch) * -2 * Math.atan2(x, w)];
  return [Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), pitch, Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))];
}

export function rotate(q: number[], v: number[]): number[] {
  const [x, y, z, w] = q;
  // v + 2 w (u x v) + 2 u x (u x v), u the vector part
  const tx = 2 * (y * v[2] - z * v[1]), ty = 2 * (z * v[0] - x * v[2]), tz = 2 * (x * v[1] - y * v[0]);
  return [v[0] + w * tx + y * tz - z * ty, v[1] + w * ty + z * tx - x * tz, v[2] + w * tz + x * ty - y * tx];
}
export function timesQuaternion(a: number[], b: number[]): number[] {
  return [
    a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
    a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
    a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
    a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
  ];
}
export function compose(a: Pose7, b: Pose7): Pose7 {
  const qa = a.slice(3);
  const p = rotate(qa, b);
  return [a[0] + p[0], a[1] + p[1], a[2] + p[2], ...timesQuaternion(qa, b.slice(3))];
}
export function inverse(a: Pose7): Pose7 {
  const q = [-a[3], -a[4], -a[5], a[6]];
  const p = rotate(q, a);
  return [-p[0], -p[1], -p[2], ...q];
}
export function aboutAxis(axis: number[], angle: number): number[] {
  const n = Math.hypot(axis[0], axis[1], axis[2]) || 1;
  const s = Math.sin(angle / 2) / n;
  return [axis[0] * s, axis[1] * s, axis[2] * s, Math.cos(angle / 2)];
}

/** From `after` k times as far towards (and beyond) `before`: k = 1 is `before`. Position and rotation apart, so that
 *  what is small stays a small turn in place, however far from the base it is. */
export function magnified(after: Pose7, before: Pose7, k: number): Pose7 {
  const d = timesQuaternion([-after[3], -after[4], -after[5], after[6]], before.slice(3));
  const sign = d[3] < 0 ? -1 : 1;
  const sine = Math.hypot(d[0], d[1], d[2]);
  const angle = 2 * Math.atan2(sine, sign * d[3]) * sign * k;
  const q = sine > 1e-15 ? timesQuaternion(after.slice(3), aboutAxis(d, angle)) : after.slice(3);
  return [0, 1, 2].map((i) => after[i] + k * (before[i] - after[i])).concat(q);
}

/** Pose of every link in the base link's frame. `reading` by joint name (those missing: 0). */
export function linkPoses(links: Link[], base: number, reading: (joint: string) => number,
                          which: 'before' | 'after'): Pose7[] {
  const world: Pose7[] = [];
  const scales = new Map(links.flatMap((l) => (l.scale ? [[l.joint ?? '', l.scale[which === 'before' ? 0 : 1]] as const] : [])));
  const position = (joint: string) => (scales.get(joint) ?? 1) * reading(joint);
  for (const link of links) {
    const q = link.mimic ? link.mimic.multiplier * position(link.mimic.joint) + link.mimic.offset : position(link.joint ?? '');
    const axis = link.axis ?? [0, 0, 0];
    const turns = link.type === 'revolute' || link.type === 'continuous';
    const motion: Pose7 = turns ? [0, 0, 0, ...aboutAxis(axis, q)]
      : link.type === 'prismatic' ? [axis[0] * q, axis[1] * q, axis[2] * q, 0, 0, 0, 1] : identity;
    const parent = link.parent >= 0 ? world[link.parent] : identity;
    world.push(compose(compose(parent, link[which] ?? identity), motion));
  }
  const toBase = inverse(world[base] ?? identity);
  return world.map((pose) => compose(toBase, pose));
}

/** Eigenvalues (largest first) and unit eigenvectors of a symmetric 3 x 3 matrix [xx, xy, xz, yy, yz, zz], by Jacobi
 *  rotations: each one sets the largest off-diagonal entry to zero; the sum of squares beside the diagonal falls by
 *  a third at least, so 30 are plenty. */
export function eigen3(m: number[]): { values: number[]; vectors: number[][] } {
  const a = [[m[0], m[1], m[2]], [m[1], m[3], m[4]], [m[2], m[4], m[5]]];
  const v = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  for (let round = 0; round < 30; round++) {
    const [p, q] = [[0, 1], [0, 2], [1, 2]].reduce((best, at) =>
      Math.abs(a[at[0]][at[1]]) > Math.abs(a[best[0]][best[1]]) ? at : best);
    if (Math.abs(a[p][q]) < 1e-300) break;
    const theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
    const t = Math.sign(theta || 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
    const c = 1 / Math.sqrt(t * t + 1), s = t * c;
    for (let k = 0; k < 3; k++) [a[k][p], a[k][q]] = [c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]];
    for (let k = 0; k < 3; k++) [a[p][k], a[q][k]] = [c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]];
    for (let k = 0; k < 3; k++) [v[k][p], v[k][q]] = [c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]];
  }
  const order = [0, 1, 2].sort((i, j) => a[j][j] - a[i][i]);
  return { values: order.map((i) => a[i][i]), vectors: order.map((i) => [v[0][i], v[1][i], v[2][i]]) };
}
