// Joints that bend and joints with error curves: how far, how certain, what each of them gains on held-out data, and what
// else was tried.
import type { Context, CurveOf, StageRow } from './data';
import { dataTable, h, missing, section, type Section } from './dom';
import { digits, list, none, plural, quantity } from './format';
import { line, padded, plotFigure, rings } from './plot';
import { jointUnit, plain } from './residuals';
import { choose } from './state';

const groupWords: Record<string, string> = {
  compliance: 'bending about the joint axes', 'compliance across': 'bending across the joint axes', loads: 'loads of the links',
};
/** A group of bending or curves in words; other names stay. */
export function furtherName(group = ''): string {
  return groupWords[group] ?? (group.startsWith('curve/') ? `error curve of ${group.slice(6)}` : group || none);
}
/** "rigid", "+ bending across the joint axes", "+ error curves of 6 joints". */
export function stageName(added: string[]): string {
  if (!added.length) return 'rigid';
  const curves = added.filter((name) => name.startsWith('curve/')), rest = added.filter((name) => !name.startsWith('curve/'));
  const words = rest.map(furtherName);
  if (curves.length === 1) words.push(furtherName(curves[0]));
  else if (curves.length) words.push(`error curves of ${plural(curves.length, 'joint')}`);
  return `+ ${list(words, 9)}`;
}
const outcomes: Record<string, string> = {
  kept: 'kept', no_evidence: 'dropped: the data give no evidence for it', no_better_held_out: 'dropped: samples left out of the fit are not predicted better',
  too_few_samples: 'dropped: too few samples to leave some out', lost: 'dropped: no evidence after a calibration with it',
};

/** The curve at a reading, by linear interpolation; NaN outside. */
export function curveAt(curve: CurveOf, reading: number): number {
  const { reading: x = [], error: y = [] } = curve;
  const i = x.findIndex((v, k) => k > 0 && reading >= x[k - 1] && reading <= v);
  if (i < 0) return NaN;
  const t = x[i] > x[i - 1] ? (reading - x[i - 1]) / (x[i] - x[i - 1]) : 0;
  return (y[i - 1] ?? NaN) * (1 - t) + (y[i] ?? NaN) * t;
}

function curvePlot(context: Context, joint: string, curve: CurveOf): HTMLElement {
  const unit = jointUnit(context, joint), factor = unit.error.factor;
  const xs = plain(curve.reading ?? [], unit.factor), ys = plain(curve.error ?? [], factor), sigma = plain(curve.sigma ?? [], factor);
  const readings = context.samples.joints?.[joint] ?? [];
  const at = plain(readings, unit.factor), on = Float64Array.from(readings, (v) => (v === null ? NaN : curveAt(curve, v) * factor));
  const most = Math.max(1e-9, ...Array.from(ys, (y, i) => Math.abs(y) + (sigma[i] || 0)).filter(Number.isFinite)) * 1.08;
  const used = Array.from(at, (v, i) => (context.samples.train?.[i] === 0 ? NaN : v));
  return plotFigure({
    title: joint, file: `curve_${joint}`, height: 210, xLabel: `reading (${unit.name})`, yLabel: `error (${unit.error.name})`,
    x: padded([xs[0] ?? 0, xs[xs.length - 1] ?? 1], 0.01), y: [-most, most],
    draw: (pen) => {
      const { c } = pen;
      c.fillStyle = c.strokeStyle = pen.colour.after;
      c.globalAlpha = 0.22;
      for (let from = 0, i = 0; i <= xs.length; i++) {        // a polygon for each run that has a sigma
        if (Number.isFinite(ys[i] + sigma[i])) continue;
        c.beginPath();
        for (let k = from; k < i; k++) c.lineTo(pen.x(xs[k]), pen.y(ys[k] + sigma[k]));
        for (let k = i - 1; k >= from; k--) c.lineTo(pen.x(xs[k]), pen.y(ys[k] - sigma[k]));
        c.fill();
        from = i + 1;
      }
      c.globalAlpha = 1;
      c.lineWidth = 1.5;
      c.beginPath();
      xs.forEach((x, i) => c.lineTo(pen.x(x), pen.y(ys[i])));
      c.stroke();
      c.strokeStyle = pen.colour.text;
      c.lineWidth = 1;
      for (const v of used) if (Number.isFinite(v)) line(c, pen.x(v), pen.top + pen.height, pen.x(v), pen.top + pen.height - 7);
    },
    over: (pen, s) => rings(pen, at, on, [s]),
    pick: { x: at, y: on, sample: Array.from(at.keys()), text: (i) => `${context.samples.id[i]}: ${digits(on[i])} ${unit.error.name}` },
    csv: () => [[`reading [${unit.name}]`, `error [${unit.error.name}]`, 'sigma'], ...Array.from(xs, (x, i) => [x, ys[i], sigma[i]])],
    note: `RMS over the samples: ${digits((curve.rms ?? NaN) * factor)} ${unit.error.name}.`,
  });
}

function stageTable(rows: StageRow[], from: string): HTMLElement {
  return dataTable(rows, [
    { title: 'Sensor', cell: (row) => (row.unit === 'rad' && rows.some((other) => other.sensor === row.sensor && other.unit !== 'rad') ? `${row.sensor} (rotation)` : row.sensor) },
    { title: 'Calibration', cell: (row) => stageName(row.added ?? []) },
    { title: 'Error in use', cell: (row) => quantity(row.rms, row.unit), value: (row) => row.rms, numeric: true },
    { title: 'Times the line above', cell: (row) => digits(row.ratio), value: (row) => row.ratio, numeric: true },
    { title: '95 % interval', cell: (row) => (row.ratio_95 ? `${digits(row.ratio_95[0])} to ${digits(row.ratio_95[1])}` : none) },
    { title: 'Over', cell: (row) => plural(row.blocks, row.by ?? 'sample') },
  ], { caption: `RMS ${from === 'test' ? 'on held-out samples' : 'by cross-validation'}, each line with one model more. The interval compares both on the same samples.`, file: 'stages' });
}

export function curvesSection(context: Context): Section | null {
  const { bending, curves, tried, validation } = context.result;
  const stages = validation?.stages;
  if (!bending && !curves && !tried?.length && !stages) return null;
  return section('curves', 'Joints: curves and bending',
    `Errors that a URDF cannot express: joints that bend under weight, and joints whose error is a curve over the angle. ${tried?.length ? 'A model is kept only if it improves the prediction of samples left out of the fit. ' : ''}rig.yaml has them; kincal compensate corrects readings for them.`,
    (host) => {
      if (stages?.rows?.length) host.append(stageTable(stages.rows, stages.from ?? 'test'));
      else if (tried?.some((one) => one.outcome === 'kept')) host.append(missing('No samples were held out, so the gain of each model is not known: calibrate with --holdout 4 or --cross-validate 5.'));
      const frames = Object.entries(bending ?? {});
      const index = new Map(context.samples.id.map((id, i) => [id, i]));
      if (frames.length) host.append(dataTable(frames, [
        { title: 'Sensor or target', cell: ([name]) => name.split('/').slice(1).join('/') },
        { title: 'Mean displacement', cell: ([, of]) => quantity(of.mean, 'm'), value: ([, of]) => of.mean, numeric: true },
        { title: 'Largest', cell: ([, of]) => quantity(of.largest, 'm'), value: ([, of]) => of.largest, numeric: true },
        { title: 'In sample', value: ([, of]) => of.sample, cell: ([, of]) => {
          const i = index.get(of.sample ?? '');
          return i === undefined ? (of.sample ?? none) : h('button', { type: 'button', class: 'link', click: () => choose(i, false) }, of.sample);
        } },
      ], { caption: `Displacement by bending, relative to the base, over ${plural(frames[0][1].samples, 'sample')}.`, file: 'bending', row: (element, [name]) => { element.dataset.part = name; } }));
      const joints = Object.entries(curves ?? {});
      if (joints.length) host.append(h('h3', {}, 'Error curves'),
        h('p', { class: 'small' }, 'Error of the reading over the reading; the band is one standard deviation. Ticks at the lower edge: readings of the samples of the fit. Where there are none, the data do not determine the curve, and the band is wide.'),
        h('div', { class: 'plots' }, ...joints.map(([joint, curve]) => curvePlot(context, joint, curve))));
      if (tried?.length) host.append(dataTable(tried, [
        { title: 'Tried', cell: (row) => h('span', { title: row.group }, furtherName(row.group)), value: (row) => row.group },
        { title: 'Evidence', cell: (row) => digits(row.gain), value: (row) => row.gain, numeric: true, hint: 'Log of the ratio of probabilities, when it was tried' },
        { title: 'Result', cell: (row) => outcomes[row.outcome ?? ''] ?? row.outcome ?? none },
      ], { caption: 'Models that were tried; evidence of at least 3 is needed.', file: 'tried' }));
    }, 300);
}
