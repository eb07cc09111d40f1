// Sections about the estimated components and the coverage of the recording.
import { components, openPoses, type Component, type Context, type Result } from './data';
import { csvButton, dataTable, h, missing, section, svg, type Section } from './dom';
import { digits, none, plainName, plural, shown, size } from './format';
import { extent, histogram, rollPitchYaw } from './maths';
import { line, plotFigure } from './plot';
import { sensorViews, taken } from './views';
import { colours, onTheme } from './state';
import { weakness } from './advice';

// ---- changes
const unitTitles: Record<string, string> = { m: 'Lengths (mm)', rad: 'Angles (mrad)', px: 'Lens (px)', '': 'Scales and lens coefficients (no unit)' };

export function changesSection(context: Context): Section {
  return section('changes', 'Changes by the calibration',
    'Each estimated component against its value in the rig: the dot is the change, the thick bar one standard deviation, the thin bar three. If a bar crosses zero, the change may be chance. A long bar is an uncertain component.',
    (host) => {
      const open = openPoses(context.result);
      const all = components(context.result).filter((c) => c.sigma !== 0 && !open.has(c.parameter));
      for (const unit of ['m', 'rad', 'px', '']) {
        const rows = all.filter((c) => c.unit === unit).sort((a, b) => Math.abs(b.value - b.initial) - Math.abs(a.value - a.initial));
        if (rows.length) host.append(changeTable(rows, unit));
      }
      const found = openTable(context.result, open);
      if (found) host.append(found);
      if (!all.length && !found) host.append(missing('The result has no estimated parameters.'));
    }, 400);
}

/** Poses that the rig does not give: they have no change, only an estimate. */
function openTable(result: Result, open: Set<string>): HTMLElement | null {
  const rows = Object.entries(result.parameters ?? {}).filter(([name, p]) => open.has(name) && p.pose?.xyz?.length === 3 && p.pose.quat?.length === 4);
  if (!rows.length) return null;
  type Row = (typeof rows)[0];
  const links = new Map<string, number>([...(result.scene?.sensors ?? []).map((s) => [`sensor/${s.name}/pose`, s.link] as const), ...(result.scene?.targets ?? []).map((t) => [`target/${t.name}/pose`, t.link] as const)]);
  const sigma = ([, p]: Row, from: number) => {
    const of = (p.sigma ?? []).slice(from, from + 3);
    return of.length === 3 && of.every((s) => typeof s === 'number') ? Math.hypot(...(of as number[])) : null;
  };
  return dataTable(rows, [
    { title: 'Part', cell: ([name]) => h('span', { title: name }, name.split('/').slice(1, -1).join('/')) },
    { title: 'On link', cell: ([name]) => result.scene?.links[links.get(name)!]?.name ?? none },
    ...['x', 'y', 'z'].map((axis, i) => ({
      title: `${axis} (mm)`, numeric: true, cell: ([, p]: Row) => digits(p.pose!.xyz[i] * 1000, 4), value: ([, p]: Row) => p.pose!.xyz[i] * 1000,
    })),
    ...['roll', 'pitch', 'yaw'].map((angle, i) => ({
      title: `${angle} (°)`, numeric: true, cell: ([, p]: Row) => digits((rollPitchYaw(p.pose!.quat)[i] * 180) / Math.PI, 4), value: ([, p]: Row) => (rollPitchYaw(p.pose!.quat)[i] * 180) / Math.PI,
    })),
    { title: '± sigma', hint: 'One standard deviation of position and rotation', numeric: true, cell: (row) => [size(sigma(row, 0), 'm'), size(sigma(row, 3), 'rad')].join(', '), value: (row) => sigma(row, 0) },
  ], {
    caption: 'Poses without a value in the rig: found from the data alone, so there is no change.', file: 'found_poses',
    row: (element, [name]) => { element.dataset.part = name.slice(0, name.lastIndexOf('/')); },
  });
}

/** Rows have the name of their sensor or target, so that they are marked with it. */
const markPart = (element: HTMLElement, c: Component) => { element.dataset.part = c.parameter.slice(0, c.parameter.lastIndexOf('/')); };

function changeTable(rows: Component[], unit: string): HTMLElement {
  const u = shown(unit);
  const change = (c: Component) => (c.value - c.initial) * u.factor;
  const significance = (c: Component) => (c.sigma ? Math.abs(c.value - c.initial) / c.sigma : NaN);
  // The scale covers the changes; bars that are far longer are cut.
  const most = Math.max(...rows.map((c) => Math.abs(change(c))), 1e-12) * 1.05;
  const x = (v: number) => 100 + Math.max(-1.02, Math.min(1.02, v / most)) * 96;
  const drawing = (c: Component) => {
    const v = change(c), s = (c.sigma ?? Infinity) * u.factor;
    const bar = (k: number, y: number, height: number, kind: string) => svg('rect', {
      x: x(v - k * s), y, width: Math.max(0.6, x(v + k * s) - x(v - k * s)), height, class: kind });
    return svg('svg', { viewBox: '0 0 200 14', class: 'forest', 'aria-hidden': 'true' },
      svg('line', { x1: 100, x2: 100, y1: 0, y2: 14 }), bar(3, 6.2, 1.6, 'three'), bar(1, 4.5, 5, 'one'),
      svg('circle', { cx: x(v), cy: 7, r: 3 }));
  };
  return dataTable(rows, [
    { title: unitTitles[unit] ?? unit, cell: (c) => h('span', { title: c.name }, plainName(c.name)), value: (c) => c.name },
    { title: 'Before', cell: (c) => digits(c.initial * u.factor, 4), value: (c) => c.initial * u.factor, numeric: true },
    { title: 'After', cell: (c) => digits(c.value * u.factor, unit === 'px' ? 6 : 4), value: (c) => c.value * u.factor, numeric: true },
    { title: 'Change', cell: (c) => digits(change(c)), value: (c) => Math.abs(change(c)), numeric: true },
    { title: '± sigma', cell: (c) => (c.sigma === null ? 'not determined' : digits(c.sigma * u.factor, 2)), value: (c) => c.sigma === null ? null : c.sigma * u.factor, numeric: true },
    { title: 'Change in sigmas', cell: (c) => digits(significance(c), 2), value: significance, numeric: true },
    { title: `−${digits(most, 2)} … 0 … ${digits(most, 2)} ${u.name}`, cell: drawing, drawing: true },
  ], { caption: `${unitTitles[unit] ?? unit}, the largest change first. A mount is shown as a motion from its nominal pose, in its own axes.`, file: `changes_${unit || 'other'}`, most: 16, row: markPart });
}

export function sigmasSection(context: Context): Section {
  return section('sigmas', 'Uncertainty of each component',
    'The least certain components, as one standard deviation, against the limits for weak components: 1 cm, 1°, 1 % and 1 px. Model errors are not included.',
    (host) => {
      const all = components(context.result).filter((c) => c.sigma !== 0 && !/\/distortion\./.test(c.name));
      if (!all.length) return void host.append(missing('The result has no estimated parameters.'));
      const rank = (c: Component) => (c.sigma === null ? Infinity : weakness(c.sigma, c.unit));
      const rows = [...all].sort((a, b) => rank(b) - rank(a));
      host.append(dataTable(rows, [
        { title: 'Component', cell: (c) => h('span', { title: c.name }, plainName(c.name)), value: (c) => c.name },
        { title: '± sigma', cell: (c) => (c.sigma === null ? 'not determined' : size(c.sigma, c.unit, 3)), value: (c) => c.sigma, numeric: true },
        { title: 'Share of the limit', cell: (c) => (c.sigma === null ? none : `${digits(100 * rank(c), 2)} %`), value: rank, numeric: true },
        { title: '', cell: (c) => svg('svg', { viewBox: '0 0 100 10', class: 'share', 'aria-hidden': 'true' },
          svg('rect', { x: 0, y: 1, width: Math.min(100, 100 * rank(c)), height: 8 })), drawing: true },
      ], { caption: 'Standard deviations, the weakest first.', file: 'sigmas', most: 12, row: markPart }));
    }, 300);
}

// ---- correlations
/** Pairs of the largest correlations: [i, j, r], r in thousandths. */
export function strongest(correlation: (number | null)[][], count: number): [number, number, number][] {
  const pairs: [number, number, number][] = [];
  let least = 500;
  for (let i = 0; i < correlation.length; i++)
    for (let j = 0; j < i; j++) {
      const r = correlation[i][j];
      if (r === null || Math.abs(r) <= least) continue;
      pairs.push([i, j, r]);
      if (pairs.length > 4 * count) {
        pairs.sort((a, b) => Math.abs(b[2]) - Math.abs(a[2]));
        pairs.length = count;
        least = Math.abs(pairs[count - 1][2]);
      }
    }
  return pairs.sort((a, b) => Math.abs(b[2]) - Math.abs(a[2])).slice(0, count);
}

function matrix(names: string[], correlation: (number | null)[][]): HTMLElement {
  const n = names.length;
  const canvas = h('canvas', { class: 'matrix', role: 'img', tabindex: 0, 'aria-label': `Correlation matrix of ${n} components. The strongest pairs are in the table below.` });
  const reading = h('p', { class: 'small reading' }, 'Point at a cell to read it.');
  const at = (i: number, j: number) => (i >= j ? correlation[i]?.[j] : correlation[j]?.[i]) ?? null;
  const draw = () => {
    const cell = Math.max(2, Math.floor(900 / n));
    canvas.width = canvas.height = cell * n;
    const c = canvas.getContext('2d')!;
    const t = colours();
    c.fillStyle = t.panel;
    c.fillRect(0, 0, cell * n, cell * n);
    for (let i = 0; i < n; i++)
      for (let j = 0; j < n; j++) {
        const r = at(i, j);
        if (r === 0) continue;
        c.globalAlpha = r === null ? 0.25 : Math.min(1, Math.abs(r) / 1000) ** 0.8;
        c.fillStyle = r === null ? t.faint : r > 0 ? t.after : t.before;
        c.fillRect(j * cell, i * cell, cell, cell);
      }
    c.globalAlpha = 1;
    // A line where the parameter changes, so that the blocks of poses are seen.
    c.fillStyle = t.line;
    for (let i = 1; i < n; i++)
      if (names[i].split('.')[0] !== names[i - 1].split('.')[0]) { c.fillRect(i * cell, 0, 1, cell * n); c.fillRect(0, i * cell, cell * n, 1); }
  };
  canvas.addEventListener('mousemove', (event) => {
    const box = canvas.getBoundingClientRect();
    const j = Math.floor(((event.clientX - box.left) / box.width) * n), i = Math.floor(((event.clientY - box.top) / box.height) * n);
    if (i < 0 || j < 0 || i >= n || j >= n) return;
    const r = at(i, j);
    reading.textContent = `${plainName(names[i])} with ${plainName(names[j])}: ${r === null ? 'not known' : digits(r / 1000, 3)}`;
  });
  draw();
  onTheme(draw);
  return h('div', { class: 'matrix-host' }, canvas, reading);
}

export function correlationSection(context: Context): Section {
  return section('correlation', 'Correlations',
    'Correlations of the estimated components: blue positive, orange negative, pale independent. A strong correlation of two well-determined components does no harm if both are used. Of two poorly determined ones, fix one.',
    (host) => {
      const covariance = context.report.covariance;
      if (!covariance?.names?.length || !covariance.correlation) return void host.append(missing('The correlations are not in this file.'));
      const { names, correlation } = covariance;
      const pairs = strongest(correlation, 40);
      const csv = () => [['', ...names], ...names.map((name, i) => [name, ...(correlation[i] ?? []).map((r) => (r === null ? null : r / 1000))])];
      host.append(h('div', { class: 'side' }, h('figure', { class: 'plot' }, h('figcaption', {}, h('span', {}, `${plural(names.length, 'component')}, in the order of covariance.csv`), csvButton('correlations', csv)), matrix(names, correlation)),
        pairs.length ? dataTable(pairs, [
          { title: 'Component', cell: ([i]) => h('span', { title: names[i] }, plainName(names[i])), value: ([i]) => names[i] },
          { title: 'with', cell: ([, j]) => h('span', { title: names[j] }, plainName(names[j])), value: ([, j]) => names[j] },
          { title: 'Correlation', cell: ([, , r]) => digits(r / 1000, 3), value: ([, , r]) => r / 1000, numeric: true },
        ], { caption: 'The strongest pairs (above 0.5 in size).', file: 'strong_correlations', most: 14 })
          : missing('No two components are correlated above 0.5.')));
    }, 400);
}

// ---- coverage
export function coverageSection(context: Context): Section {
  const plan = context.result.kind === 'plan';
  return section('coverage', plan ? 'Joint ranges' : 'Coverage of the recording',
    plan ? 'Joint ranges that the planned postures use, and the limits of the joints (dashed).' :
    'Joint ranges and image regions covered by the samples. In empty parts of a joint’s range (limits dashed) and in empty cells of an image the calibration extrapolates.',
    (host) => {
      const joints = Object.entries(context.samples.joints ?? {});
      const links = new Map((context.result.scene?.links ?? []).map((l) => [l.joint, l]));
      const plots = h('div', { class: 'plots narrow' });
      for (const [joint, readings] of joints) {
        const link = links.get(joint);
        const straight = link?.type === 'prismatic';
        const factor = straight ? 1000 : 180 / Math.PI, unit = straight ? 'mm' : 'degrees';
        const values = Float64Array.from(readings, (v) => (v === null ? NaN : v * factor)).filter((v) => !Number.isNaN(v));
        if (!values.length) continue;
        const seen = extent(values);
        const limits = link?.limits?.map((v) => v * factor);
        let low = Math.min(seen[0], limits?.[0] ?? Infinity), high = Math.max(seen[1], limits?.[1] ?? -Infinity);
        if (high - low < 1e-6) { low -= 1; high += 1; }
        const air = (high - low) * 0.02;
        const bins = 24, counts = histogram(values, low, high, bins), step = (high - low) / bins;
        const share = limits ? Math.min(1, (seen[1] - seen[0]) / (limits[1] - limits[0] || 1)) : null;
        plots.append(plotFigure({
          title: joint, file: `coverage_${joint}`, height: 130, xLabel: unit, yLabel: plan ? 'postures' : 'samples', x: [low - air, high + air], y: [0, Math.max(...counts) * 1.1],
          draw: (pen) => {
            pen.c.fillStyle = pen.colour.after;
            counts.forEach((v, i) => v && pen.c.fillRect(pen.x(low + i * step), pen.y(v), Math.max(1, pen.x(low + step) - pen.x(low) - 1), pen.y(0) - pen.y(v)));
            pen.c.strokeStyle = pen.colour.before;
            pen.c.lineWidth = 2;
            pen.c.setLineDash([4, 3]);
            for (const l of limits ?? []) line(pen.c, pen.x(l), pen.top, pen.x(l), pen.top + pen.height);
            pen.c.setLineDash([]);
          },
          over: (pen, s) => {
            const v = readings[s];
            if (v === null || v === undefined) return;
            pen.c.strokeStyle = pen.colour.chosen;
            pen.c.lineWidth = 3;
            line(pen.c, pen.x(v * factor), pen.top, pen.x(v * factor), pen.top + pen.height);
          },
          csv: () => [['from', 'to', 'samples'], ...Array.from(counts, (v, i) => [low + i * step, low + (i + 1) * step, v])],
          note: share !== null ? `${digits(100 * share, 2)} % of the range between its limits` : link?.type === 'continuous' ? 'turns without limits' : 'limits not in this file',
        }));
      }
      if (plots.childElementCount) host.append(h('h3', {}, 'Joints'), plots);
      else host.append(missing('The joint readings are not in this file.'));
      const images = h('div', { class: 'plots' });
      for (const sensor of sensorViews(context)) {
        const scene = context.result.scene?.sensors.find((s) => s.name === sensor.name);
        if (sensor.unit !== 'px' || !sensor.rows.length || !scene?.image_size || !context.residuals.has('measured_1')) continue;
        const [w, hgt] = scene.image_size, across = 12, down = Math.max(1, Math.round((across * hgt) / w));
        const [u, v] = ['measured_1', 'measured_2'].map((c) => taken(context.residuals.column(c), sensor.rows));
        const cells = new Float64Array(across * down);
        for (let i = 0; i < u.length; i++) {
          const a = Math.floor((u[i] / w) * across), b = Math.floor((v[i] / hgt) * down);
          if (a >= 0 && b >= 0 && a < across && b < down) cells[b * across + a]++;
        }
        const most = Math.max(...cells, 1), empty = cells.filter((n) => !n).length;
        images.append(plotFigure({
          title: sensor.name, file: `coverage_${sensor.name}`, x: [0, w], y: [0, hgt], yDown: true, aspect: hgt / w, xLabel: 'u (px)', yLabel: 'v (px)',
          draw: (pen) => {
            cells.forEach((n, i) => {
              const a = i % across, b = Math.floor(i / across);
              const x0 = pen.x((a * w) / across), y0 = pen.y((b * hgt) / down);
              const cw = pen.width / across, ch = pen.height / down;
              pen.c.globalAlpha = n ? 0.15 + 0.75 * Math.sqrt(n / most) : 1;
              pen.c.fillStyle = n ? pen.colour.after : pen.colour.ground;
              pen.c.fillRect(x0, y0, cw - 1, ch - 1);
              pen.c.globalAlpha = 1;
              if (!n) { pen.c.strokeStyle = pen.colour.faint; line(pen.c, x0 + cw / 2 - 3, y0 + ch / 2 - 3, x0 + cw / 2 + 3, y0 + ch / 2 + 3); line(pen.c, x0 + cw / 2 - 3, y0 + ch / 2 + 3, x0 + cw / 2 + 3, y0 + ch / 2 - 3); }
            });
          },
          csv: () => [['row', 'column', 'points'], ...Array.from(cells, (n, i) => [Math.floor(i / across), i % across, n])],
          note: empty ? `${plural(empty, 'cell')} of ${across * down} without a point (crosses); darkest: ${most} points` : `no cell is empty; darkest: ${most} points`,
        }));
      }
      if (images.childElementCount) host.append(h('h3', {}, 'Images'), images);
    }, 400);
}

