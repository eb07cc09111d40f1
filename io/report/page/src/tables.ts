// Sections that are mostly tables: errors of sensors, validation, weak directions, groups, steps, inputs.
import { chi2PerDof, components, type Context, type SensorErrors, type WeakDirection } from './data';
import { dataTable, h, missing, section, svg, type Section } from './dom';
import { digits, none, plainName, quantity, seconds, shown, size, time } from './format';
import { badlyKnown, capital, isChosen, openDirections, sentence, weakSentence } from './advice';
import { lineFigure, logAxis } from './lines';
import { choose } from './state';
import { sensorViews } from './views';

interface ErrorRow { sensor: string; unit: string; errors: SensorErrors; rotation: boolean }
type Split = 'train' | 'test';

function errorRows(context: Context): ErrorRow[] {
  return Object.entries(context.result.sensors ?? {}).flatMap(([sensor, errors]) => {
    const rows: ErrorRow[] = [{ sensor, unit: errors.unit, errors, rotation: false }];
    if (errors.train?.rms_rotation !== undefined) rows.push({ sensor, unit: 'rad', errors, rotation: true });
    return rows;
  });
}
function error(row: ErrorRow, split: Split, kind: 'rms_before' | 'rms' | 'rms_as_read'): number | null {
  const of = row.errors[split];
  if (!of || !of.points) return null;
  const v = row.rotation ? of[kind.replace('rms', 'rms_rotation') as 'rms_rotation'] : of[kind];
  return v === null || v === undefined ? null : v * shown(row.unit).factor;
}
/** Largest ratio of noise seen and assumed over a sensor's parts. */
function noiseRatio(context: Context, sensor: string): number | null {
  const ratios = (context.result.noise_levels ?? [])
    .filter((level) => level.of === `sensor/${sensor}` && level.seen !== null && level.assumed)
    .map((level) => level.seen! / level.assumed!);
  if (ratios.length || !context.result.kind) return ratios.length ? Math.max(...ratios) : null;
  // An evaluation has no estimated noise: the size of its residuals in stated sigmas.
  const views = sensorViews(context).find((of) => of.name === sensor)?.views ?? [];
  const points = views.reduce((sum, view) => sum + view.n, 0);
  return points ? Math.sqrt(views.reduce((sum, view) => sum + view.n * view.ratio ** 2, 0) / points) : null;
}

export function errorsSection(context: Context): Section {
  return section('errors', 'Errors of each sensor',
    (context.result.kind ? 'At the rig’s own values.' : 'Before: at the values of the rig.') +
    ' Explained: with the error of each joint reading estimated. In use: with joint readings taken as exact, as the robot’s own software does.' +
    (context.result.kind ? '' : ' Held-out errors far above those of the fit: too many parameters for these data.'),
    (host) => {
      const rows = errorRows(context);
      if (!rows.length) return void host.append(missing('The result has no errors of sensors.'));
      const all = rows.flatMap((row) => (['train', 'test'] as const).flatMap((split) =>
        (['rms_before', 'rms_as_read'] as const).map((kind) => error(row, split, kind)))).filter((v): v is number => !!v && v > 0);
      const low = Math.log10(Math.min(...all)), high = Math.log10(Math.max(...all));
      const x = (v: number) => 6 + ((Math.log10(v) - low) / (high - low || 1)) * 128;
      const drawing = (row: ErrorRow) => {
        const split: Split = row.errors.test?.points ? 'test' : 'train';
        const before = error(row, split, 'rms_before'), after = error(row, split, 'rms_as_read');
        return svg('svg', { viewBox: '0 0 140 14', class: 'dumbbell', 'aria-hidden': 'true' },
          before && after ? svg('line', { x1: x(before), x2: x(after), y1: 7, y2: 7 }) : null,
          before ? svg('rect', { x: x(before) - 4, y: 3, width: 8, height: 8, class: 'before' }) : null,
          after ? svg('circle', { cx: x(after), cy: 7, r: 4.5, class: 'after' }) : null);
      };
      const groupOf = context.result.kind ? { train: 'training samples', test: 'held-out samples' } : { train: 'on the data of the fit', test: 'on held-out data' };
      const cell = (split: Split, kind: 'rms_before' | 'rms' | 'rms_as_read') => ({
        cell: (row: ErrorRow) => digits(error(row, split, kind)), value: (row: ErrorRow) => error(row, split, kind), numeric: true,
        group: anyTest ? groupOf[split] : undefined,
      });
      const points = (split: Split) => ({
        title: 'Points', cell: (row: ErrorRow) => row.errors[split]?.points ?? 0, numeric: true, group: anyTest ? groupOf[split] : undefined,
      });
      const anyBefore = rows.some((row) => error(row, 'train', 'rms_before') !== null || error(row, 'test', 'rms_before') !== null);
      const anyNoise = rows.some((row) => noiseRatio(context, row.sensor) !== null);
      const anyTest = rows.some((row) => row.errors.test?.points);
      const cross = context.result.validation?.cross_validation?.sensors;
      const crossed = (row: ErrorRow) => {
        const of = cross?.[row.sensor];
        const v = row.rotation ? of?.rms_rotation_as_read : of?.rms_as_read;
        return v === null || v === undefined ? null : v * shown(row.unit).factor;
      };
      host.append(dataTable(rows, [
        { title: 'Sensor', cell: (row) => (row.rotation ? `${row.sensor} (rotation)` : row.sensor) },
        { title: 'Unit', cell: (row) => shown(row.unit).name },
        points('train'),
        ...(anyBefore ? [{ title: 'Before', ...cell('train', 'rms_before') }] : []),
        { title: 'Explained', ...cell('train', 'rms') },
        { title: 'In use', ...cell('train', 'rms_as_read') },
        ...(anyTest ? [
          points('test'),
          ...(anyBefore ? [{ title: 'Before', ...cell('test', 'rms_before') }] : []),
          { title: 'Explained', ...cell('test', 'rms') },
          { title: 'In use', ...cell('test', 'rms_as_read') },
        ] : []),
        ...(cross ? [{ title: 'Cross-validated, in use', cell: (row: ErrorRow) => digits(crossed(row)), value: crossed, numeric: true }] : []),
        ...(anyNoise ? [{ title: 'Against stated noise', cell: (row: ErrorRow) => { const r = row.rotation ? null : noiseRatio(context, row.sensor); return r === null ? none : `× ${digits(r, 2)}`; }, value: (row: ErrorRow) => noiseRatio(context, row.sensor), numeric: true, hint: 'Noise seen in the residuals over the noise stated in the rig; 1 is right' }] : []),
        ...(anyBefore ? [{ title: 'Before □ to in use ● (logarithmic)', cell: drawing, drawing: true }] : []),
      ], { caption: context.result.kind ? 'Root mean square error of each sensor.' : `Root mean square error of each sensor; ${anyTest ? 'the dots are of held-out data' : cross ? 'of the fit, and cross-validated' : 'nothing was held out'}.`, file: 'errors', row: (element, row) => { element.dataset.part = `sensor/${row.sensor}`; } }));
    });
}

export function validationSection(context: Context): Section | null {
  const validation = context.result.validation ?? {};
  if (!validation.baselines && !validation.frames && !validation.requirements) return null;
  return section('validation', 'Is it better on held-out data?',
    'Simpler calibrations on the same held-out data, required tolerances, and the predicted errors of chosen frames. A ratio above 1: the simpler calibration is better.',
    (host) => {
      if (validation.requirements)
        host.append(dataTable(validation.requirements, [
          { title: 'Required', cell: (row) => row.require },
          { title: 'Limit', cell: (row) => quantity(row.limit, row.unit), numeric: true },
          { title: 'Measured', cell: (row) => quantity(row.measured, row.unit), numeric: true },
          { title: 'Met', cell: (row) => (row.met ? '✓ yes' : '✕ no') },
          { title: 'Data', cell: (row) => (row.from ?? none).replace('_', ' ') },
        ], { caption: 'Tolerances.', file: 'tolerances' }));
      if (validation.baselines)
        host.append(dataTable(validation.baselines.rows, [
          { title: 'Sensor', cell: (row) => row.sensor },
          { title: 'Robot as it is', cell: (row) => quantity(row.rig, row.unit), value: (row) => row.rig, numeric: true },
          { title: 'Mounts alone', cell: (row) => quantity(row.mounts, row.unit), value: (row) => row.mounts, numeric: true },
          { title: 'This calibration', cell: (row) => quantity(row.automatic, row.unit), value: (row) => row.automatic, numeric: true },
          { title: 'This / mounts alone', cell: (row) => digits(row.ratio), value: (row) => row.ratio, numeric: true },
          { title: '95 % interval', cell: (row) => (row.ratio_95 ? `${digits(row.ratio_95[0])} to ${digits(row.ratio_95[1])}` : none) },
        ], { caption: 'Beside simpler calibrations: errors in use, on held-out data.', file: 'baselines' }));
      const frames = Object.entries(validation.frames ?? {}).flatMap(([frame, of]) =>
        Object.entries(of.workspaces).map(([workspace, p]) => ({ frame, base: of.base, workspace, p })));
      if (frames.length)
        host.append(dataTable(frames, [
          { title: 'Frame', cell: (row) => row.frame }, { title: 'Relative to', cell: (row) => row.base },
          { title: 'Postures', cell: (row) => `${row.p.postures} ${row.workspace === 'limits' ? 'within the limits' : 'of the samples'}` },
          { title: 'Position', cell: (row) => quantity(row.p.position?.rms, 'm'), numeric: true },
          { title: 'worst', cell: (row) => quantity(row.p.position?.worst, 'm'), numeric: true },
          { title: 'with noise of readings', cell: (row) => quantity(row.p.position_with_readings?.rms, 'm'), numeric: true },
          { title: 'Rotation', cell: (row) => quantity(row.p.rotation?.rms, 'rad'), numeric: true },
        ], { caption: 'Predicted uncertainty of frames (one standard deviation).', file: 'frames' }));
    });
}

export function weakSection(context: Context): Section {
  return section('weak', 'Poorly determined by the data',
    'Each card is a motion that changes hardly any measurement: these components can be wrong together by the amounts shown without effect on the residuals.',
    (host) => {
      const open = openDirections(context.result);
      const units = new Map(components(context.result).map((c) => [c.name, c.unit]));
      const card = (w: WeakDirection) => weakCard(w, units);
      const chosen = (context.result.weak_directions ?? []).filter(isChosen);
      if (!open.length)
        host.append(missing(badlyKnown(context.result).length
          ? 'The data determine all directions; components worse than 1 cm, 1° or 1 % are listed first in the next section.'
          : `No weak direction${chosen.length ? ' except the chosen ones below' : ''}: every estimated component is better than 1 cm, 1° or 1 %.`));
      host.append(h('div', { class: 'weak' }, ...open.map(card)));
      if (chosen.length) host.append(h('h3', {}, 'Chosen, not measured'),
        h('p', { class: 'small' }, 'No data distinguish these, for example the position of the base frame or the rotation of a part about the last axis. A prior makes the choice; nothing has to be done.'),
        h('div', { class: 'weak' }, ...chosen.map(card)));
    });
}
function weakCard(w: WeakDirection, units: Map<string, string>): HTMLElement {
  const parts = Object.entries(w.parameters ?? {}).slice(0, 10);
  // Change of each component for one standard deviation; if that is not determined, for 1 mm or mrad.
  const along = (name: string, v: number) => {
    const unit = units.get(name) ?? '';
    return typeof w.sigma === 'number' ? size(v * w.sigma, unit) : quantity(v / shown(w.unit).factor, unit, 2);
  };
  const most = Math.max(...parts.map(([, v]) => Math.abs(v)), 1e-12);
  const priors = w.sigma_with_priors !== undefined && w.sigma_with_priors !== null && w.sigma_with_priors !== w.sigma;
  const chosen = isChosen(w);
  return h('article', { class: 'card' },
    h('h3', {}, chosen ? `${plainName(Object.keys(w.parameters ?? {})[0] ?? '')}: chosen to ± ${size(w.sigma_with_priors!, w.unit)}` : weakSentence(w)),
    h('p', {}, h('b', {}, 'Why: '), sentence(capital(w.why ?? ''))),
    h('p', {}, h('b', {}, chosen ? 'To choose otherwise: ' : 'What helps: '), sentence(capital(w.cure ?? ''))),
    h('table', { class: 'plain' }, h('caption', {}, typeof w.sigma === 'number' ? 'Components that move together, by one standard deviation' : 'Components that move together'), h('tbody', {}, ...parts.map(([name, v]) =>
      h('tr', {}, h('th', { scope: 'row', title: name }, plainName(name)),
        h('td', { class: 'n' }, along(name, v)),
        h('td', {}, svg('svg', { viewBox: '-50 0 100 10', class: 'coefficient', 'aria-hidden': 'true' },
          svg('line', { x1: 0, x2: 0, y1: 0, y2: 10 }),
          svg('rect', { x: Math.min(0, (v / most) * 48), y: 2, width: Math.abs(v / most) * 48, height: 6 }))))))),
    priors && !chosen ? h('p', { class: 'small' }, `With the priors: ± ${size(w.sigma_with_priors!, w.unit)}.`) : null);
}

export function groupsSection(context: Context): Section | null {
  const groups = context.result.automatic;
  if (!groups?.length) return null;
  return section('groups', 'Estimated and fixed groups',
    'For each group of parameters the program computes the evidence of errors in it. Evidence above 3: estimated. "Width" is the standard deviation of the errors found in the group.',
    (host) => host.append(dataTable(groups, [
      { title: 'Group', cell: (row) => row.group },
      { title: 'Decision', cell: (row) => (row.held ? 'fixed at the nominal value' : 'estimated') },
      { title: 'Components', cell: (row) => row.n, numeric: true },
      { title: 'Determined by the data', cell: (row) => digits(row.gamma === null ? null : Math.max(0, row.gamma), 2), value: (row) => row.gamma, numeric: true },
      { title: 'Usual error', cell: (row) => quantity(row.start, row.unit), value: (row) => row.start, numeric: true },
      { title: 'Width found', cell: (row) => quantity(row.width, row.unit), value: (row) => row.width, numeric: true },
      { title: 'Evidence', cell: (row) => digits(row.gain !== null && Math.abs(row.gain) < 0.005 ? 0 : row.gain), value: (row) => row.gain, numeric: true, hint: 'Log of the ratio of probabilities' },
    ], { caption: 'Groups of parameters that may be wrong.', file: 'groups' })));
}

function costPlot(host: HTMLElement, context: Context): void {
  const steps = (context.result.steps ?? []).filter((step) => step.history?.length);
  if (!steps.length) return;
  const length = steps.reduce((sum, step) => sum + step.history!.length, 0);
  let at = 0;
  const series = steps.map((step) => {
    const ys: (number | null)[] = new Array(length).fill(null);
    for (const [chi2] of step.history!) ys[at++] = chi2 > 0 ? chi2 : null;
    return ys;
  });
  lineFigure(host, {
    title: 'Sum of squared residuals (chi²) after each iteration, all steps one after the other', file: 'iterations', wide: true, height: 240,
    csv: () => [['step', 'iteration', 'chi2', 'damping'], ...steps.flatMap((step) => step.history!.map(([chi2, damping], i) => [step.step, i, chi2, damping]))],
    data: [Array.from({ length }, (_, i) => i), ...series],
    options: (c) => {
      const tones = [c.after, c.before, c.good, c.other, c.chosen, c.faint];
      return {
        scales: { x: { time: false }, y: { distr: 3 } }, axes: [{ incrs: [1, 2, 5, 10, 20, 50, 100] }, logAxis()],
        series: [{ label: 'iteration', value: (_: unknown, v: number | null) => (v === null ? '' : String(v)) }, ...steps.map((step, i) => ({
          label: step.step, stroke: tones[i % tones.length], width: 2, points: { show: true, size: 5 }, spanGaps: false,
          dash: i >= tones.length ? [4, 3] : undefined, value: (_: unknown, v: number | null) => (v === null ? '' : digits(v)),
        }))],
      };
    },
  });
}

export function stepsSection(context: Context): Section {
  return section('steps', 'How the fit went', 'Each step starts at the values of the one before. Good: chi² falls quickly, then stays level. If it falls slowly over dozens of iterations, the step is nearly undetermined or started far away.',
    (host) => {
      const steps = context.result.steps ?? [];
      if (!steps.length) return void host.append(missing('The result has no steps.'));
      costPlot(host, context);
      const restarts = context.result.restarts;
      if (restarts) host.append(dataTable(restarts.minima ?? [], [
        { title: 'Cost', cell: (row) => digits(row.cost, 5), value: (row) => row.cost, numeric: true },
        { title: 'chi²', cell: (row) => digits(row.chi2, 5), value: (row) => row.chi2, numeric: true },
        { title: 'Restarts that ended there', cell: (row) => row.count, numeric: true },
      ], { caption: `${restarts.count} restarts from other values; the first line is this result. ${restarts.failed ?? 0} failed.`, file: 'restarts' }));
      const total = steps.reduce((sum, step) => sum + (step.seconds ?? 0), 0);
      host.append(dataTable(steps, [
        { title: 'Step', cell: (row) => row.step },
        { title: 'Ended', cell: (row) => (row.status ?? none).replace('_', ' ') },
        { title: 'Iterations', cell: (row) => row.iterations, numeric: true },
        { title: 'chi² at the start', cell: (row) => digits(row.chi2_initial), value: (row) => row.chi2_initial, numeric: true },
        { title: 'chi² at the end', cell: (row) => digits(row.chi2), value: (row) => row.chi2, numeric: true },
        { title: 'Degrees of freedom', cell: (row) => row.dof, numeric: true },
        { title: 'chi²/dof', cell: (row) => digits(chi2PerDof(row)), value: (row) => chi2PerDof(row), numeric: true },
        { title: 'Time', cell: (row) => seconds(row.seconds), value: (row) => row.seconds, numeric: true },
        { title: 'Share of time', cell: (row) => svg('svg', { viewBox: '0 0 100 10', class: 'share', 'aria-hidden': 'true' },
          svg('rect', { x: 0, y: 1, width: total ? (100 * (row.seconds ?? 0)) / total : 0, height: 8 })), drawing: true },
      ], { caption: `Steps of the fit; ${seconds(total)} of solving in all.`, file: 'steps' }));
    });
}

export function noiseSection(context: Context): Section | null {
  const levels = (context.result.noise_levels ?? []).filter((level) => level.of);
  if (!levels.length) return null;
  return section('noise', 'Noise: stated and seen',
    'Noise stated in the rig and noise estimated from the residuals, for each sensor and joint. Seen well above stated: it is noisier, or the model lacks an effect (a lens, backlash, a bent link). Well below: state a smaller sigma, and the sigmas of the result shrink.',
    (host) => {
      const name = (l: (typeof levels)[0]) => l.of.replace(/^(sensor|joint)\//, '') + (l.part ? `, ${l.part}` : '');
      const ratio = (l: (typeof levels)[0]) => (l.seen === null || l.seen === undefined || !l.assumed ? NaN : l.seen / l.assumed);
      const x = (v: number) => 70 + Math.max(-1, Math.min(1, Math.log10(v))) * 64;
      host.append(dataTable(levels, [
        { title: 'Sensor or joint', cell: name },
        { title: 'Stated', cell: (l) => quantity(l.assumed, l.unit), value: (l) => l.assumed, numeric: true },
        { title: 'Seen', cell: (l) => (l.seen === null ? 'not determined' : quantity(l.seen, l.unit)), value: (l) => l.seen, numeric: true },
        { title: '±', cell: (l) => (l.uncertainty ? `${digits(100 * l.uncertainty, 2)} %` : none), value: (l) => l.uncertainty, numeric: true },
        { title: 'Seen / stated', cell: (l) => digits(ratio(l), 2), value: ratio, numeric: true },
        { title: '0.1 … 1 … 10', cell: (l) => svg('svg', { viewBox: '0 0 140 14', class: 'dumbbell', 'aria-hidden': 'true' },
          svg('line', { x1: 70, x2: 70, y1: 0, y2: 14 }), Number.isNaN(ratio(l)) ? null : svg('circle', { cx: x(ratio(l)), cy: 7, r: 4.5, class: 'after' })), drawing: true },
      ], { caption: 'Standard deviations.', file: 'noise', most: 12, row: (element, l) => { element.dataset.part = l.of; } }));
    });
}

export function influenceSection(context: Context): Section {
  return section('influence', 'Influential samples',
    'Change of the component without the sample, in its standard deviations. A few values slightly above 1 are normal; above 3 the component depends on one posture: check that sample, then record more like it. Click a row to see the sample everywhere.',
    (host) => {
      const leverage = context.result.leverage ?? [];
      const rejected = context.result.rejected ?? [];
      const index = new Map(context.samples.id.map((id, i) => [id, i]));
      const link = (row: { sample: string }) => {
        const i = index.get(row.sample);
        return i === undefined ? row.sample
          : h('button', { type: 'button', class: 'link', 'data-sample': i, click: () => choose(i, false) }, row.sample);
      };
      if (!leverage.length) host.append(missing('No sample moves any component by more than one standard deviation.'));
      else host.append(dataTable(leverage, [
        { title: 'Sample', cell: link },
        { title: 'Component', cell: (row) => h('span', { title: row.parameter }, plainName(row.parameter)), value: (row) => row.parameter },
        { title: 'Moves by (sigmas)', cell: (row) => (row.moved_sigmas === null ? 'not determined without it' : digits(row.moved_sigmas)), value: (row) => Math.abs(row.moved_sigmas ?? Infinity), numeric: true },
        { title: '', cell: (row) => svg('svg', { viewBox: '0 0 100 10', class: 'share', 'aria-hidden': 'true' },
          svg('rect', { x: 0, y: 1, width: Math.min(100, 20 * Math.abs(row.moved_sigmas ?? 5)), height: 8 }),
          svg('line', { x1: 60, x2: 60, y1: 0, y2: 10 })), drawing: true },
      ], { caption: 'Samples by influence, largest first (line in the bar: 3 sigmas).', file: 'influence', most: 12, row: markRow(index) }));
      if (rejected.length) host.append(dataTable(rejected, [
        { title: 'Sample', cell: link }, { title: 'Sensor', cell: (row) => row.sensor ?? 'all' },
        { title: 'Target', cell: (row) => row.target ?? 'all' }, { title: 'Points', cell: (row) => row.ids?.length ?? 'all', numeric: true },
        { title: 'Reason', cell: (row) => row.reason },
      ], { caption: 'Removed as gross outliers before the fit.', file: 'rejected', row: markRow(index) }));
    });
}
function markRow(index: Map<string, number>) {
  return (element: HTMLTableRowElement, row: { sample: string }) => {
    element.dataset.row = String(index.get(row.sample) ?? -1);
  };
}

export function originSection(context: Context): Section {
  const { result } = context;
  const rows: [string, string][] = [
    ['Robot', context.report.title || none], ['Serial number', result.serial ?? 'not given'],
    ['Date', time(result.time ?? result.input?.date)], ['Program', result.kincal ? `kincal ${result.kincal}` : none],
    ...(result.kind ? [] : [['Status', result.status?.replace('_', ' ') ?? none], ['Joint readings', `noise mode "${result.noise ?? 'unknown'}"`],
      ['Components estimated', String(components(result).filter((c) => c.sigma !== 0).length)]] as [string, string][]),
    ['Command', result.input?.command ?? none], ['rig.yaml (SHA-256)', result.input?.rig ?? none],
    ['Samples (SHA-256)', result.input?.samples ?? none], ['URDF (SHA-256)', result.input?.urdf ?? none],
  ];
  const warnings = result.warnings ?? [];
  const findings = result.findings ?? [];
  return section('origin', 'Where this comes from', 'To file with the robot: the same inputs and the same program give the same result.',
    (host) => {
      if (findings.length || warnings.length) host.append(dataTable(
        [...findings.map((f) => ({ kind: 'finding', id: f.id, text: f.text })), ...warnings.map((w) => ({ kind: 'warning', id: w.id, text: w.text }))],
        [{ title: 'Kind', cell: (row) => row.kind }, { title: 'Id', cell: (row) => row.id }, { title: 'Text', cell: (row) => row.text }],
        { caption: 'Warnings of the program.', file: 'warnings' }));
      host.append(h('table', { class: 'origin' }, h('caption', {}, 'Inputs'), h('tbody', {}, ...rows.map(([name, value]) =>
        h('tr', {}, h('th', { scope: 'row' }, name), h('td', {}, value))))));
    });
}

export function licencesSection(): Section {
  return section('licences', 'Licences', 'This page contains code of other projects under these licences.', (host) => {
    host.append(h('details', {}, h('summary', {}, 'three.js and uPlot (MIT)'),
      h('pre', { class: 'licence' }, document.getElementById('licence-texts')?.textContent?.trim() ?? '')));
  }, 40);
}
