// Sections of residuals: loops between sensors, each sensor by itself, samples, joints.
import { residualParts, sampleLines, sensorViews, taken, type SensorViews } from './views';
import type { Context, LoopError, Result, SceneSensor } from './data';
import { dataTable, h, lazily, missing, section, type Section } from './dom';
import { digits, none, plural, quantity, shown, type Rows } from './format';
import { chiDensity, extent, histogram, normalDensity, quantile } from './maths';
import { line, mostPoints, padded, plotFigure, points, rings, type Pen } from './plot';
import { viewsText } from './plans';
import { choose, onPart } from './state';

const thinned = (n: number) => (n > mostPoints ? `${plural(n, 'point')}; every ${Math.ceil(n / mostPoints)}th is drawn, CSV has all.` : undefined);
/** Round symmetric range that has all but the outermost of the values in it. */
function symmetric(values: ArrayLike<number>[], q = 1): [number, number] {
  const most = Math.max(...values.map((v) => Math.max(Math.abs(quantile(v, q)), Math.abs(quantile(v, 1 - q)))).filter(Number.isFinite), 0);
  return [-(most || 1) * 1.08, (most || 1) * 1.08];
}

// ---- loops
/** Two components of the error that vary most before: what a plane can show of three. */
function twoOf(columns: Float64Array[]): number[] {
  const spread = columns.map((c, i) => ({ i, s: quantile(c, 0.9) - quantile(c, 0.1) })).filter((c) => Number.isFinite(c.s));
  if (spread.length < 3) return [0, 1];
  return spread.sort((a, b) => b.s - a.s).slice(0, 2).map((c) => c.i).sort();
}

function loopCard(context: Context, pair: LoopError, rows: Int32Array): HTMLElement {
  const { loops, samples } = context;
  const unit = shown(pair.unit);
  const before = ['before_x', 'before_y', 'before_z'].map((c) => taken(loops.column(c), rows, unit.factor));
  const after = ['x', 'y', 'z'].map((c) => taken(loops.column(c), rows, unit.factor));
  const sample = Int32Array.from(rows, (i) => loops.ints('sample')[i]);
  const [a, b] = twoOf(before);
  const ofSample = (s: number) => [...sample.keys()].filter((i) => sample[i] === s);
  const name = `${pair.from} to ${pair.to}`;
  const all = (): Rows => [['sample', `before_x [${unit.name}]`, 'before_y', 'before_z', 'after_x', 'after_y', 'after_z'],
    ...Array.from(rows, (_, i) => [samples.id[sample[i]], ...before.map((c) => c[i]), ...after.map((c) => c[i])])];
  const panel = (title: string, range: [number, number], both: boolean) => plotFigure({
    title, file: `loop_${name}`, aspect: 1, x: range, y: range,
    xLabel: `${'xyz'[a]} (${unit.name})`, yLabel: `${'xyz'[b]} (${unit.name})`,
    draw: (pen) => {
      cross(pen);
      if (both) points(pen, before[a], before[b], pen.colour.before, 2, true);
      points(pen, after[a], after[b], pen.colour.after, 1.5);
    },
    over: (pen, s) => { const of = ofSample(s); if (both) rings(pen, before[a], before[b], of); rings(pen, after[a], after[b], of); },
    pick: {
      x: after[a], y: after[b], sample, text: (i) => `${samples.id[sample[i]]}: ${digits(after[a][i])}, ${digits(after[b][i])} ${unit.name}`,
    },
    csv: all, note: both ? thinned(rows.length) : undefined,
  });
  return h('article', { class: 'card loop' },
    h('h3', {}, `${pair.from} → ${pair.to}`),
    h('p', { class: 'small' }, `RMS ${quantity(pair.rms_before, pair.unit)} → ${quantity(pair.rms, pair.unit)}, ${plural(pair.points, 'point')}`),
    h('div', { class: 'pair' }, panel('Same scale', symmetric([before[a], before[b], after[a], after[b]]), true),
      panel('After, zoomed', symmetric([after[a], after[b]]), false)));
}
function cross(pen: Pen): void {
  pen.c.strokeStyle = pen.colour.faint;
  pen.c.lineWidth = 1;
  line(pen.c, pen.x(0), pen.top, pen.x(0), pen.top + pen.height);
  line(pen.c, pen.left, pen.y(0), pen.left + pen.width, pen.y(0));
}

function loopMatrix(context: Context, pairs: LoopError[]): HTMLElement {
  const names = Object.keys(context.result.sensors ?? {}).filter((s) => context.sensors.includes(s));
  const sensors = names.length === context.sensors.length ? names : context.sensors;
  const froms = sensors.filter((s) => pairs.some((p) => p.from === s));
  const tos = sensors.filter((s) => pairs.some((p) => p.to === s));
  const text = (p: LoopError) => { const u = shown(p.unit); return [digits(p.rms_before === null ? null : p.rms_before * u.factor, 2), digits(p.rms === null ? null : p.rms * u.factor, 2)]; };
  const rows = froms.map((from) => ({ from }));
  return dataTable(rows, [
    { title: 'from \\ to', cell: (row) => row.from },
    ...tos.map((to) => {
      const of = (row: { from: string }) => pairs.find((p) => p.from === row.from && p.to === to);
      return {
        title: `${to} (${shown(pairs.find((p) => p.to === to)!.unit).name})`, numeric: true,
        cell: (row: { from: string }) => { const p = of(row); if (!p) return none; const [b, a] = text(p); return h('span', {}, h('span', { class: 'was' }, b), ' ', h('b', {}, a)); },
        value: (row: { from: string }) => { const p = of(row); return p?.rms == null ? null : p.rms * shown(p.unit).factor; },
      };
    }),
  ], { caption: 'Loop errors, RMS before (grey) and after (bold). A row and column that stand out: that sensor is wrong, not the others.', file: 'loops' });
}

const everyWritten = (result: Result) => result.loops_csv?.every ?? 1;

export function loopsSection(context: Context): Section {
  return section('loops', 'Do the sensors agree?',
    'A point seen by one sensor is transformed through the robot into another sensor and compared with its measurement there. Nothing is fitted in between, so a task that looks with one and acts with the other has this error. Before: open orange squares; after: blue. Click a point to see its sample everywhere.',
    (host) => {
      const pairs = context.result.loops ?? [];
      if (!pairs.length) return void host.append(missing('No two sensors see the same target in one sample, or the result was written with --no-report.'));
      host.append(loopMatrix(context, pairs));
      if (!context.loops.length) return void host.append(missing('The single points of the loops are not in this file.'));
      const from = context.loops.ints('from'), to = context.loops.ints('to');
      const buckets = new Map<number, number[]>();
      const key = (f: number, t: number) => f * 1000 + t;
      for (let i = 0; i < context.loops.length; i++) {
        const k = key(from[i], to[i]);
        const of = buckets.get(k);
        if (of) of.push(i); else buckets.set(k, [i]);
      }
      const score = (p: LoopError) => (p.rms === null || !p.rms_before ? Infinity : p.rms / (p.unit === 'px' ? 0.2 : 0.001));
      const cards = pairs.map((pair) => ({ pair, rows: Int32Array.from(buckets.get(key(context.sensors.indexOf(pair.from), context.sensors.indexOf(pair.to))) ?? []) }))
        .filter((c) => c.rows.length).sort((p, q) => score(q.pair) - score(p.pair));
      const grid = h('div', { class: 'cards loops' });
      const add = (list: typeof cards) => grid.append(...list.map((c) => {
        const place = h('div', { class: 'lazy' });
        lazily(place, () => { place.className = ''; place.append(loopCard(context, c.pair, c.rows)); });
        return place;
      }));
      add(cards.slice(0, 6));
      const every = Number(context.report.loops?.every ?? 1);
      host.append(h('h3', {}, 'Point by point, the largest errors first'),
        every > 1 ? h('p', { class: 'small' }, `Shown: the points of one sample in ${every}; the RMS includes all. loops.csv has ${everyWritten(context.result) > 1 ? `those of one sample in ${everyWritten(context.result)}` : 'all points'}.`) : '', grid);
      if (cards.length > 6) {
        const more = h('button', { type: 'button', class: 'more', click: () => { more.remove(); add(cards.slice(6)); } }, `Show all ${cards.length} pairs`);
        host.append(more);
      }
    }, 500);
}

// ---- each sensor
function bySample(context: Context, sensor: SensorViews): HTMLElement {
  const unit = shown(sensor.unit);
  const views = sensor.views;
  const xs = Float64Array.from(views, (v) => v.sample), ys = Float64Array.from(views, (v) => v.rms * unit.factor);
  const held = views.filter((v) => context.samples.train?.[v.sample] === 0);
  return plotFigure({
    title: 'By sample', file: `${sensor.name}_by_sample`, xLabel: 'sample, in the order of the file', yLabel: `RMS (${unit.name})`,
    x: padded([0, Math.max(1, context.samples.id.length - 1)], 0.02), y: [0, (extent(ys)[1] || 1) * 1.08],
    draw: (pen) => {
      points(pen, xs, ys, pen.colour.after, 2);
      if (held.length) points(pen, held.map((v) => v.sample), held.map((v) => v.rms * unit.factor), pen.colour.held, 3, true);
    },
    over: (pen, s) => rings(pen, xs, ys, views.flatMap((v, i) => (v.sample === s ? [i] : []))),
    pick: { x: xs, y: ys, sample: views.map((v) => v.sample), text: (i) => `${context.samples.id[views[i].sample]}: ${digits(ys[i])} ${unit.name}` },
    csv: () => [['sample', `rms [${unit.name}]`, 'points', 'against stated noise'], ...views.map((v) => [context.samples.id[v.sample], v.rms * unit.factor, v.n, v.ratio])],
    note: held.length ? 'Green frames: held out from the fit.' : undefined,
  });
}

/** A histogram of whitened residuals and the density that they have if the stated noise is right. */
function whitenedPlot(context: Context, sensor: SensorViews, column: string, of: {
  title: string; xLabel: string; file: string; range: [number, number]; bins: number; density: (v: number) => number; expected: string; note?: string;
}): HTMLElement {
  const w = taken(context.residuals.column(column), sensor.rows).filter((v) => !Number.isNaN(v));
  const [from, to] = of.range;
  const step = (to - from) / of.bins;
  const counts = histogram(w, from, to, of.bins).map((n) => n / (w.length * step));
  const densities = Float64Array.from({ length: of.bins * 4 + 1 }, (_, i) => of.density(from + (i * step) / 4));
  return plotFigure({
    title: of.title, file: `${sensor.name}_${of.file}`, xLabel: of.xLabel, yLabel: 'share per sigma',
    x: of.range, y: [0, Math.max(...counts, ...densities) * 1.08],
    draw: (pen) => {
      const { c } = pen;
      c.fillStyle = pen.colour.after;
      c.globalAlpha = 0.6;
      counts.forEach((v, i) => c.fillRect(pen.x(from + i * step), pen.y(v), pen.x(step) - pen.x(0) - 1, pen.y(0) - pen.y(v)));
      c.globalAlpha = 1;
      c.strokeStyle = pen.colour.text;
      c.lineWidth = 2;
      c.beginPath();
      densities.forEach((v, i) => c.lineTo(pen.x(from + (i * step) / 4), pen.y(v)));
      c.stroke();
    },
    over: (pen, s) => {
      const all = context.residuals.column(column);
      pen.c.strokeStyle = pen.colour.chosen;
      pen.c.lineWidth = 1.5;
      for (const i of context.residuals.rowsOf(s))
        if (context.residuals.ints('sensor')[i] === sensor.index) line(pen.c, pen.x(all[i]), pen.y(0), pen.x(all[i]), pen.y(0) - 12);
    },
    csv: () => [['from', 'to', 'share per sigma', `expected (${of.expected})`], ...Array.from(counts, (v, i) => [from + i * step, from + (i + 1) * step, v, of.density(from + (i + 0.5) * step)])],
    note: of.note,
  });
}
/** How far a histogram reaches: all but the outermost, and no further than `times` what noise alone would reach. */
const reachOf = (values: Float64Array, usual: number, times: number) => Math.max(usual, Math.min(quantile(values, 0.995) * 1.1 || usual, times * usual));

function againstNoise(context: Context, sensor: SensorViews): HTMLElement {
  const w = taken(context.residuals.column('whitened'), sensor.rows).filter((v) => !Number.isNaN(v));
  return whitenedPlot(context, sensor, 'whitened', {
    title: 'Against the stated noise', xLabel: 'length of the residual, in sigmas', file: 'noise', range: [0, reachOf(w, Math.sqrt(sensor.d) + 4, 12)],
    bins: 40, density: (v) => chiDensity(v, sensor.d), expected: `chi, ${sensor.d}`,
    note: 'Bars to the right of the curve: more noise than stated. Far to the left: less noise, or the parameters absorb it.',
  });
}

/** What the components of a sensor's whitened residuals are called. */
function componentTitles(context: Context, sensor: SensorViews): string[] {
  const parts = (context.result.noise_levels ?? []).filter((level) => level.of === `sensor/${sensor.name}`).map((level) => level.part);
  if (parts.length === sensor.d && parts.every(Boolean)) return parts;
  return sensor.unit === 'px' ? ['x', 'y', 'x in the right image'] : ['x', 'y', 'z', 'rotation about x', 'rotation about y', 'rotation about z'];
}
function componentHistograms(context: Context, sensor: SensorViews): HTMLElement[] {
  const titles = componentTitles(context, sensor);
  return titles.flatMap((title, k) => {
    const column = `whitened_${k + 1}`;
    if (!context.residuals.has(column)) return [];
    const w = taken(context.residuals.column(column), sensor.rows).filter((v) => !Number.isNaN(v));
    if (!w.length) return [];
    const far = reachOf(w.map(Math.abs), 4, 6);
    const mean = w.reduce((sum, v) => sum + v, 0) / w.length;
    const spread = Math.sqrt(w.reduce((sum, v) => sum + (v - mean) ** 2, 0) / w.length);
    return [whitenedPlot(context, sensor, column, {
      title: `Noise of ${title}`, xLabel: 'residual, in sigmas', file: `noise_${title}`, range: [-far, far], bins: w.length < 200 ? 20 : 40,
      density: normalDensity, expected: 'standard normal', note: `Mean ${digits(mean, 2)}, spread ${digits(spread, 2)} sigmas; expected 0 and 1.`,
    })];
  });
}

function overImage(context: Context, sensor: SensorViews, scene: SceneSensor | undefined): HTMLElement {
  const { residuals } = context;
  const [u, v] = ['measured_1', 'measured_2'].map((c) => taken(residuals.column(c), sensor.rows));
  const [x, y] = ['x', 'y'].map((c) => taken(residuals.column(c), sensor.rows));
  const sample = Int32Array.from(sensor.rows, (i) => residuals.ints('sample')[i]);
  const [w, hgt] = scene?.image_size ?? [extent(u)[1], extent(v)[1]];
  const length = Float64Array.from(x, (_, i) => Math.hypot(x[i], y[i]));
  const typical = quantile(length, 0.9) || 1;
  const scale = (0.03 * w) / typical;                    // px of the image for one px of residual
  const stride = Math.max(1, Math.ceil(x.length / 8000));
  const arrow = (pen: Pen, i: number) => {
    const [x0, y0, x1, y1] = [pen.x(u[i]), pen.y(v[i]), pen.x(u[i] + x[i] * scale), pen.y(v[i] + y[i] * scale)];
    line(pen.c, x0, y0, x1, y1);
    pen.c.fillRect(x0 - 1, y0 - 1, 2, 2);
  };
  const times = digits(scale, 2);
  return plotFigure({
    title: `Over the image: arrows ${times} times as long as the residuals`, file: `${sensor.name}_image`,
    x: [0, w], y: [0, hgt], aspect: hgt / w, yDown: true, xLabel: 'u (px)', yLabel: 'v (px)',
    draw: (pen) => {
      // Usual residuals are thin; the largest 1 % thick and orange.
      const large = quantile(length, 0.99);
      pen.c.globalAlpha = x.length > 1500 ? 0.55 : 0.9;
      pen.c.lineWidth = 1;
      pen.c.strokeStyle = pen.c.fillStyle = pen.colour.after;
      for (let i = 0; i < x.length; i += stride) if (!(length[i] > large)) arrow(pen, i);
      pen.c.globalAlpha = 1;
      pen.c.lineWidth = 1.5;
      pen.c.strokeStyle = pen.c.fillStyle = pen.colour.before;
      for (let i = 0; i < x.length; i++) if (length[i] > large) arrow(pen, i);
    },
    over: (pen, s) => {
      pen.c.lineWidth = 2;
      pen.c.strokeStyle = pen.c.fillStyle = pen.colour.chosen;
      for (let i = 0; i < x.length; i++) if (sample[i] === s) arrow(pen, i);
    },
    pick: { x: u, y: v, sample, text: (i) => `${context.samples.id[sample[i]]}: ${digits(x[i])}, ${digits(y[i])} px` },
    csv: () => [['sample', 'u', 'v', 'residual_x [px]', 'residual_y [px]', 'sigmas'], ...Array.from(sensor.rows, (row, i) => [context.samples.id[sample[i]], u[i], v[i], x[i], y[i], residuals.column('whitened')[row]])],
    note: 'All arrows of a region in one direction: the lens model or the mount is wrong. Orange: the largest 1 %.',
  });
}

/** Points of lasers and trackers: where they are, as range and bearing, from what the sensor measured. */
function rangeBearing(context: Context, sensor: SensorViews, scene: SceneSensor | undefined): { range: Float64Array; bearing: Float64Array } {
  const [a, b, c] = ['measured_1', 'measured_2', 'measured_3'].map((name) => taken(context.residuals.column(name), sensor.rows));
  if (scene?.type === 'tilting_laser') return { range: c, bearing: b.map((v) => (v * 180) / Math.PI) };
  return { range: a.map((v, i) => Math.hypot(v, b[i], c[i])), bearing: a.map((v, i) => (Math.atan2(b[i], v) * 180) / Math.PI) };
}

function overPlace(context: Context, sensor: SensorViews, scene: SceneSensor | undefined): HTMLElement[] {
  const unit = shown(sensor.unit);
  const { range, bearing } = rangeBearing(context, sensor, scene);
  if (!range.some((v) => Number.isFinite(v))) return [];
  const parts = ['x', 'y', 'z'].map((c) => taken(context.residuals.column(c), sensor.rows, unit.factor));
  const size = parts[0].map((v, i) => Math.hypot(v, parts[1][i] || 0, parts[2][i] || 0));
  const sample = Int32Array.from(sensor.rows, (i) => context.residuals.ints('sample')[i]);
  // A sensor that measures one place only (a ball in its socket) has nothing to be drawn over.
  const varies = (xs: Float64Array) => { const [low, high] = extent(xs); return high - low > 1e-9; };
  return ([['range', 'm', range], ['bearing', 'degrees', bearing]] as const).filter(([, , xs]) => varies(xs)).map(([name, of, xs]) => plotFigure({
    title: `Over ${name}`, file: `${sensor.name}_${name}`, xLabel: `${name} (${of})`, yLabel: `length of the residual (${unit.name})`,
    x: padded(extent(xs)), y: [0, (extent(size)[1] || 1) * 1.08],
    draw: (pen) => { points(pen, xs, size, pen.colour.after, 1.5); },
    over: (pen, s) => rings(pen, xs, size, [...sample.keys()].filter((i) => sample[i] === s)),
    pick: { x: xs, y: size, sample, text: (i) => `${context.samples.id[sample[i]]}: ${digits(size[i])} ${unit.name}` },
    csv: () => [['sample', `${name} [${of}]`, `x [${unit.name}]`, 'y', 'z'], ...Array.from(xs, (x, i) => [context.samples.id[sample[i]], x, parts[0][i], parts[1][i], parts[2][i]])],
    note: thinned(xs.length),
  }));
}

function scatter(context: Context, sensor: SensorViews, kind: 'translation' | 'rotation'): HTMLElement {
  const rotation = kind === 'rotation', after = context.result.kind ? '' : ' after';
  const unit = shown(rotation ? 'rad' : sensor.unit);
  const names = rotation ? ['rx', 'ry', 'rz'] : ['x', 'y', 'z'];
  const parts = names.map((c) => taken(context.residuals.column(c), sensor.rows, unit.factor));
  const sample = Int32Array.from(sensor.rows, (i) => context.residuals.ints('sample')[i]);
  const [a, b] = sensor.unit === 'px' ? [0, 1] : twoOf(parts);
  // One outlier must not press the rest into a dot: the scale has 99.5 % of the points in it; the note counts the others.
  const range = symmetric([parts[a], parts[b]], sample.length > 400 ? 0.995 : 1);
  const outside = [...parts[a].keys()].filter((i) => Math.abs(parts[a][i]) > range[1] || Math.abs(parts[b][i]) > range[1]).length;
  return plotFigure({
    title: sensor.unit === 'px' ? `Residuals${after}` : `Residuals${after}, ${kind}`, file: `${sensor.name}_${kind}`, aspect: 1, x: range, y: range,
    xLabel: `${names[a]} (${unit.name})`, yLabel: `${names[b]} (${unit.name})`,
    draw: (pen) => { cross(pen); points(pen, parts[a], parts[b], pen.colour.after, 1.5); },
    over: (pen, s) => rings(pen, parts[a], parts[b], [...sample.keys()].filter((i) => sample[i] === s)),
    pick: { x: parts[a], y: parts[b], sample, text: (i) => `${context.samples.id[sample[i]]}: ${digits(parts[a][i])}, ${digits(parts[b][i])} ${unit.name}` },
    csv: () => [['sample', ...names.map((n) => `${n} [${unit.name}]`)], ...Array.from(sample, (s, i) => [context.samples.id[s], ...parts.map((p) => p[i])])],
    note: [outside ? `${plural(outside, 'point')} outside the frame.` : '', thinned(sample.length) ?? ''].join(' ').trim() || undefined,
  });
}

/** The residuals at the rig's values, before the calibration. */
function scatterBefore(context: Context, sensor: SensorViews): HTMLElement {
  const unit = shown(sensor.unit);
  const parts = ['before_x', 'before_y'].map((c) => taken(context.residuals.column(c), sensor.rows, unit.factor));
  const sample = Int32Array.from(sensor.rows, (i) => context.residuals.ints('sample')[i]);
  const range = symmetric(parts, 0.995);
  return plotFigure({
    title: 'Residuals before', file: `${sensor.name}_before`, aspect: 1, x: range, y: range, xLabel: `x (${unit.name})`, yLabel: `y (${unit.name})`,
    draw: (pen) => { cross(pen); points(pen, parts[0], parts[1], pen.colour.before, 2, true); },
    over: (pen, s) => rings(pen, parts[0], parts[1], [...sample.keys()].filter((i) => sample[i] === s)),
    pick: { x: parts[0], y: parts[1], sample, text: (i) => `${context.samples.id[sample[i]]}: ${digits(parts[0][i])}, ${digits(parts[1][i])} ${unit.name}` },
    csv: () => [['sample', `x [${unit.name}]`, `y [${unit.name}]`], ...Array.from(sample, (s, i) => [context.samples.id[s], parts[0][i], parts[1][i]])],
  });
}

export function sensorsSection(context: Context): Section {
  return section('residuals', 'Residuals of each sensor',
    `${context.result.kind ? 'Residuals:' : 'Residuals after the fit:'} predicted minus measured. Good: a round cloud without a pattern over the image, over range or over samples, and bars that follow the curve of the stated noise.`,
    (host) => {
      const all = sensorViews(context).filter((sensor) => sensor.rows.length);
      if (!all.length) return void host.append(missing('The residuals are not in this file (calibrated with --no-report?).'));
      const scenes = new Map((context.result.scene?.sensors ?? []).map((s) => [s.name, s]));
      host.append(...all.map((sensor) => {
        const scene = scenes.get(sensor.name);
        const of = context.result.sensors?.[sensor.name];
        const errors = of?.train?.points ? of.train : of?.test;
        const grid = h('div', { class: 'plots' });
        const part = h('div', { class: 'sensor', 'data-part': `sensor/${sensor.name}` }, h('h3', {}, sensor.name),
          h('p', { class: 'small' }, `${scene?.type.replace('_', ' ') ?? ''}${scene ? ', ' : ''}${plural(sensor.rows.length, sensor.d === 6 ? 'view' : 'point')} in ${plural(sensor.views.length, 'sample')}; RMS ${typeof errors?.rms_before === 'number' ? `${quantity(errors.rms_before, sensor.unit)} before, ${quantity(errors.rms, sensor.unit)} after` : quantity(errors?.rms, sensor.unit)}`), grid);
        grid.style.minHeight = '250px';
        lazily(grid, () => {
          grid.style.minHeight = '';
          if (sensor.unit === 'px' && context.residuals.has('measured_1')) {
            const image = overImage(context, sensor, scene);
            image.classList.add('large');
            grid.append(image);
          }
          else if (sensor.d !== 6) grid.append(...overPlace(context, sensor, scene));
          if (sensor.unit === 'px' && context.residuals.has('before_x')) grid.append(scatterBefore(context, sensor));
          grid.append(scatter(context, sensor, 'translation'));
          if (sensor.d === 6) grid.append(scatter(context, sensor, 'rotation'));
          grid.append(againstNoise(context, sensor), ...componentHistograms(context, sensor), bySample(context, sensor));
        });
        return part;
      }));
    }, 600);
}

// ---- samples
export function samplesSection(context: Context): Section {
  return section('samples', 'Sample by sample',
    'Size of the residuals of each sample relative to the stated noise; about 1 is right. If one sample is far above the others, it was logged wrongly or its target moved. Choose a sample by a click, in the list, or with the arrow keys ← →; all plots mark it.',
    (host) => {
      const lines = sampleLines(context);
      if (!lines.length) return void host.append(missing('The samples are not in this file.'));
      const xs = lines.map((l) => l.sample), ys = lines.map((l) => l.ratio);
      const held = lines.filter((l) => !l.train);
      const index = lines.filter((l) => Number.isFinite(l.ratio));
      if (index.length) host.append(plotFigure({
        title: 'Residuals of each sample against the stated noise', file: 'samples_plot', xLabel: 'sample, in the order of the file', yLabel: 'times the stated noise',
        x: padded([0, Math.max(1, lines.length - 1)], 0.02), y: [0, Math.max(1.5, extent(ys)[1] * 1.08)],
        draw: (pen) => {
          pen.c.strokeStyle = pen.colour.good;
          line(pen.c, pen.left, pen.y(1), pen.left + pen.width, pen.y(1));
          points(pen, xs, ys, pen.colour.after, 2.5);
          if (held.length) points(pen, held.map((l) => l.sample), held.map((l) => l.ratio), pen.colour.held, 4, true);
        },
        over: (pen, s) => rings(pen, xs, ys, [s]),
        pick: { x: xs, y: ys, sample: xs, text: (i) => `${lines[i].id}: ${digits(ys[i])} times, worst ${lines[i].worst}` },
        csv: () => [['sample', 'times the stated noise'], ...lines.map((l) => [l.id, l.ratio])],
        note: held.length ? 'Green frames: held out from the fit.' : undefined,
      }));
      host.append(dataTable([...lines].sort((a, b) => (b.ratio || 0) - (a.ratio || 0)), [
        { title: 'Sample', cell: (l) => h('button', { type: 'button', class: 'link', 'data-sample': l.sample, click: () => choose(l.sample, false) }, l.id) },
        { title: 'Used for', cell: (l) => (l.train ? 'fit' : 'held out') },
        { title: 'Points', cell: (l) => l.points, numeric: true },
        { title: 'Times the stated noise', cell: (l) => digits(l.ratio), value: (l) => l.ratio, numeric: true },
        { title: 'Worst sensor', cell: (l) => l.worst },
      ], { caption: 'Samples, the worst first.', file: 'samples', most: 10, row: (element, l) => { element.dataset.row = String(l.sample); } }));
    }, 400);
}

/** Errors of the chosen sample, or its views in a plan, for the strip at the window's edge. */
export function sampleText(context: Context, sample: number): string {
  const { kind, plan } = context.result;
  if (kind === 'plan') return viewsText(plan?.views?.[sample] ?? []);
  const parts = sensorViews(context).flatMap((sensor) => {
    const view = sensor.views.find((v) => v.sample === sample);
    return view ? [`${sensor.name} ${quantity(view.rms, sensor.unit)}`] : [];
  });
  return parts.length ? `RMS: ${parts.join(', ')}` : 'no residuals of this sample';
}

// ---- joints
export function jointUnit(context: Context, joint: string): { factor: number; name: string; error: { factor: number; name: string } } {
  const link = context.result.scene?.links.find((l) => l.joint === joint);
  return link?.type === 'prismatic' ? { factor: 1000, name: 'mm', error: shown('m') } : { factor: 180 / Math.PI, name: 'degrees', error: shown('rad') };
}
export const plain = (values: (number | null)[], factor: number) => Float64Array.from(values, (v) => (v === null ? NaN : v * factor));

export function jointsSection(context: Context): Section {
  return section('joints', 'Joint errors',
    'Estimated error of each joint reading, over the reading. Good: a level band around zero, about as wide as the stated noise (dashed). Two bands: backlash. A wave: an eccentric encoder or a bending link. A slope: a wrong gear.',
    (host) => {
      const errors = Object.entries(context.samples.errors ?? {});
      if (!errors.length) return void host.append(missing('No errors of joint readings were estimated: the rig states its joints as exact, or the noise mode does not estimate them.'));
      const grid = h('div', { class: 'plots' });
      for (const [joint, given] of errors) {
        const readings = context.samples.joints?.[joint];
        const unit = jointUnit(context, joint);
        // An axis of a floating joint has no reading of its own: its errors are in the order of the samples.
        const xs = readings ? plain(readings, unit.factor) : Float64Array.from(given.keys()), ys = plain(given, unit.error.factor);
        const level = context.result.noise_levels?.find((l) => l.of === `joint/${joint}`);
        const sigma = (level?.assumed ?? NaN) * unit.error.factor;
        const range = symmetric([ys, [2 * sigma]].filter((v) => Number.isFinite(v[0]) || v.length > 1));
        grid.append(plotFigure({
          title: joint, file: `joint_error_${joint}`, height: 190, xLabel: readings ? `reading (${unit.name})` : 'sample, in the order of the file', yLabel: `error (${unit.error.name})`,
          x: padded(extent(xs)), y: range,
          draw: (pen) => {
            pen.c.strokeStyle = pen.colour.faint;
            line(pen.c, pen.left, pen.y(0), pen.left + pen.width, pen.y(0));
            pen.c.setLineDash([4, 4]);
            for (const s of [-1, 1]) line(pen.c, pen.left, pen.y(s * sigma), pen.left + pen.width, pen.y(s * sigma));
            pen.c.setLineDash([]);
            points(pen, xs, ys, pen.colour.after, 2);
          },
          over: (pen, s) => rings(pen, xs, ys, [s]),
          pick: { x: xs, y: ys, sample: Array.from(xs.keys()), text: (i) => `${context.samples.id[i]}: ${digits(ys[i])} ${unit.error.name}` },
          csv: () => [['sample', `reading [${unit.name}]`, `error [${unit.error.name}]`], ...context.samples.id.map((id, i) => [id, xs[i], ys[i]])],
          note: level?.seen ? `Noise stated ${digits(level.assumed! * unit.error.factor)}, seen ${digits(level.seen * unit.error.factor)} ${unit.error.name}.` : undefined,
        }));
      }
      host.append(grid);
    }, 400);
}

export function byJointSection(context: Context): Section | null {
  const joints = Object.keys(context.samples.joints ?? {});
  if (!joints.length || !context.residuals.length) return null;
  return section('byjoint', 'Residuals by joint angle',
    'The mean residual of a sensor in each sample, over the reading of each joint. A slope, a wave or two levels over one joint: the error comes from that joint.',
    (host) => {
      const all = sensorViews(context).filter((sensor) => sensor.rows.length);
      // A pose has two choices: where it is, and how it is turned.
      const choices = all.flatMap((sensor) => [{ sensor, name: sensor.name, first: 0, unit: sensor.unit },
        ...(sensor.d === 6 ? [{ sensor, name: `${sensor.name} (rotation)`, first: 3, unit: 'rad' }] : [])]);
      const grid = h('div', { class: 'plots' });
      const legend = h('span', {});
      const draw = ({ sensor, name, first, unit: base }: (typeof choices)[0]) => {
        const unit = shown(base);
        const parts = residualParts.slice(first, first + 3).map((part, k) => ({ part, mean: Float64Array.from(sensor.views, (v) => v.mean[first + k] * unit.factor) }))
          .filter(({ mean }) => mean.some((v) => Number.isFinite(v)));
        legend.textContent = parts.map(({ part }, k) => `${['Filled blue', 'open orange', 'filled green'][k]}: ${part}`).join('; ');
        const range = symmetric(parts.map(({ mean }) => mean));
        const sample = sensor.views.map((v) => v.sample);
        grid.replaceChildren(...joints.flatMap((joint) => {
          const u = jointUnit(context, joint);
          const readings = context.samples.joints![joint];
          const xs = plain(sample.map((s) => readings[s]), u.factor);
          const [low, high] = extent(xs);
          if (!(high - low > 1e-9)) return [];                       // a joint that did not move shows nothing
          return [plotFigure({
            title: joint, file: `${name}_over_${joint}`, height: 180, xLabel: `reading (${u.name})`, yLabel: `mean (${unit.name})`,
            x: padded([low, high]), y: range,
            draw: (pen) => {
              pen.c.strokeStyle = pen.colour.faint;
              line(pen.c, pen.left, pen.y(0), pen.left + pen.width, pen.y(0));
              parts.forEach(({ mean }, k) => points(pen, xs, mean, [pen.colour.after, pen.colour.before, pen.colour.good][k], 2, k === 1));
            },
            over: (pen, s) => { const i = sample.indexOf(s); if (i >= 0) for (const { mean } of parts) rings(pen, xs, mean, [i]); },
            pick: { x: xs, y: parts[0]?.mean ?? xs, sample, text: (i) => `${context.samples.id[sample[i]]}: ${parts.map(({ mean }) => digits(mean[i])).join(', ')} ${unit.name}` },
            csv: () => [['sample', `reading [${u.name}]`, ...parts.map(({ part }) => `mean ${part} [${unit.name}]`)], ...sample.map((s, i) => [context.samples.id[s], xs[i], ...parts.map(({ mean }) => mean[i])])],
          })];
        }));
      };
      const select = h('select', { change: () => draw(choices[select.selectedIndex]) }, ...choices.map(({ name }) => h('option', {}, name)));
      host.append(h('p', { class: 'small' }, h('label', {}, 'Sensor: ', select), ' ', legend), grid);
      if (choices.length) draw(choices[0]);
      onPart((part) => {
        const i = choices.findIndex(({ sensor }) => part === `sensor/${sensor.name}`);
        if (i >= 0) { select.selectedIndex = i; draw(choices[i]); }
      });
    }, 300);
}
