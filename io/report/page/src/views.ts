// Residuals put together by sensor and sample. Pure functions of the columns.
import type { Context, Table } from './data';

/** Rows of each sensor, in the order of the file. */
export function rowsBySensor(residuals: Table, sensors: number): Int32Array[] {
  const of = residuals.ints('sensor');
  const counts = new Int32Array(sensors);
  for (let i = 0; i < residuals.length; i++) if (of[i] >= 0 && of[i] < sensors) counts[of[i]]++;
  const rows = Array.from(counts, (n) => new Int32Array(n));
  counts.fill(0);
  for (let i = 0; i < residuals.length; i++) {
    const s = of[i];
    if (s >= 0 && s < sensors) rows[s][counts[s]++] = i;
  }
  return rows;
}

export function taken(column: Float64Array, rows: Int32Array, factor = 1): Float64Array {
  const made = new Float64Array(rows.length);
  for (let i = 0; i < rows.length; i++) made[i] = column[rows[i]] * factor;
  return made;
}

/** Number of components of a residual: 2 or 3 a point, 6 a pose. */
export function dimension(residuals: Table, rows: Int32Array): number {
  const some = (name: string) => {
    if (!residuals.has(name)) return false;
    const column = residuals.column(name);
    return rows.some((i) => !Number.isNaN(column[i]));
  };
  return some('rx') ? 6 : some('z') ? 3 : 2;
}

/** The residuals of one sensor in one sample: number of rows, root mean square of the residual's length (base unit), its mean
 *  along each component (x, y, z, rx, ry, rz; NaN: it has none), and its size against the stated noise: 1 is as large as expected. */
export interface View { sample: number; n: number; rms: number; mean: number[]; ratio: number }

export const residualParts = ['x', 'y', 'z', 'rx', 'ry', 'rz'];
export function viewsOf(residuals: Table, rows: Int32Array): View[] {
  const parts = residualParts.map((name) => residuals.column(name));
  const [[x, y, z], w] = [parts, residuals.column('whitened')];
  const sample = residuals.ints('sample');
  const d = dimension(residuals, rows);
  const views = new Map<number, View & { squares: number; whitened: number }>();
  for (const i of rows) {
    let view = views.get(sample[i]);
    if (!view) {
      view = { sample: sample[i], n: 0, rms: 0, mean: residualParts.map(() => 0), ratio: 0, squares: 0, whitened: 0 };
      views.set(sample[i], view);
    }
    if (Number.isNaN(x[i])) continue;
    view.n++;
    view.squares += x[i] * x[i] + (Number.isNaN(y[i]) ? 0 : y[i] * y[i]) + (Number.isNaN(z[i]) ? 0 : z[i] * z[i]);
    for (let k = 0; k < parts.length; k++) view.mean[k] += parts[k][i];
    view.whitened += w[i] * w[i];
  }
  return [...views.values()].filter((view) => view.n).sort((a, b) => a.sample - b.sample).map((view) => ({
    sample: view.sample, n: view.n, rms: Math.sqrt(view.squares / view.n), mean: view.mean.map((sum) => sum / view.n),
    ratio: Math.sqrt(view.whitened / view.n / d),
  }));
}

export interface SensorViews { name: string; index: number; unit: string; rows: Int32Array; d: number; views: View[] }
const made = new WeakMap<Context, SensorViews[]>();

/** All sensors with their views; made once. */
export function sensorViews(context: Context): SensorViews[] {
  let all = made.get(context);
  if (!all) {
    const rows = rowsBySensor(context.residuals, context.sensors.length);
    all = context.sensors.map((name, index) => ({
      name, index, rows: rows[index], unit: context.result.sensors?.[name]?.unit ?? '',
      d: dimension(context.residuals, rows[index]), views: viewsOf(context.residuals, rows[index]),
    }));
    // In the order of the result, which is the rig's; names of a page come as its residuals do.
    const order = new Map(Object.keys(context.result.sensors ?? {}).map((name, i) => [name, i]));
    all.sort((a, b) => (order.get(a.name) ?? 0) - (order.get(b.name) ?? 0));
    made.set(context, all);
  }
  return all;
}

/** A line for each sample: the size of all its residuals against the stated noise, and the sensor that fits worst. */
export interface SampleLine { sample: number; id: string; train: boolean; points: number; ratio: number; worst: string }
export function sampleLines(context: Context): SampleLine[] {
  const lines = context.samples.id.map((id, sample): SampleLine & { sum: number; most: number; numbers: number } => ({
    sample, id, train: context.samples.train?.[sample] !== 0, points: 0, ratio: NaN, worst: '', sum: 0, most: -1, numbers: 0,
  }));
  for (const sensor of sensorViews(context))
    for (const view of sensor.views) {
      const line = lines[view.sample];
      if (!line) continue;
      line.points += view.n;
      line.numbers += view.n * sensor.d;
      line.sum += view.ratio * view.ratio * view.n * sensor.d;
      if (view.ratio > line.most) { line.most = view.ratio; line.worst = sensor.name; }
    }
  return lines.map(({ sum, numbers, most: _, ...line }) => ({ ...line, ratio: numbers ? Math.sqrt(sum / numbers) : NaN }));
}
