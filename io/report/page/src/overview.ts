// Several results side by side: the worst first, errors over time, links to each report.
import type { Overview, OverviewRow } from './data';
import { dataTable, h, section, svg, type Section } from './dom';
import { digits, none, plainName, plural, quantity, shown, time } from './format';
import { lineFigure, logAxis } from './lines';

const mostLines = 5;
const rank = { no: 0, doubts: 1, good: 2 };
const words = { good: '✓ good', doubts: '? doubts', no: '✕ do not use' };

/** Failed first, then by verdict, then by how far chi2/dof is above 1. */
export function worstFirst(rows: OverviewRow[]): OverviewRow[] {
  const key = (row: OverviewRow) => (row.verdict && row.status !== 'failed' ? rank[row.verdict.use] : -1);
  return [...rows].sort((a, b) => key(a) - key(b) || Math.abs(Math.log(b.chi2_dof || 1)) - Math.abs(Math.log(a.chi2_dof || 1))
    || a.folder.localeCompare(b.folder, 'en'));
}
/** Seconds since 1970, or null. */
export function stamp(t: string | number | undefined): number | null {
  if (t === undefined || t === null || t === '') return null;
  const s = typeof t === 'number' ? t : Date.parse(t) / 1000;
  return Number.isFinite(s) ? s : null;
}
/** Links lead to files beside this one, never to another scheme ("javascript:", "https:"). */
export function safeLink(link: string | null | undefined): string | null {
  if (!link || /^[a-z][a-z0-9+.-]*:/i.test(link.trim()) || link.trim().startsWith('//')) return null;
  return link.split('/').map(encodeURIComponent).join('/');
}

function bar(value: number | null, most: number, kind: string) {
  return svg('svg', { viewBox: '0 0 100 8', class: `share ${kind}`, 'aria-hidden': 'true' },
    svg('rect', { x: 0, y: 1, width: value && most ? (100 * value) / most : 0, height: 6 }));
}

/** Dates as everywhere: 2026-03-01; with the hour where the axis is shorter than some days. */
function dates(at: number[]): string[] {
  const long = at[at.length - 1] - at[0] > 2 * 86400;
  return at.map((t) => new Date(t * 1000).toISOString().slice(0, long ? 10 : 16).replace('T', ' '));
}

/** For a few robots two lines each (serial number, else folder): dashed before, solid after. For a fleet only points before
 *  and after, because so many colours cannot be told apart. */
function timePlot(host: HTMLElement, sensor: string, rows: OverviewRow[], wide: boolean): void {
  const points = rows.flatMap((row) => { const t = stamp(row.time), s = row.sensors?.[sensor]; return t !== null && s ? [{ t, s, row }] : []; })
    .sort((a, b) => a.t - b.t);
  if (points.length < 2) return;
  const unit = shown(points[0].s.unit);
  const serials = [...new Set(points.map((p) => p.row.serial ?? ''))];
  const few = serials.length <= mostLines, one = !few || serials.length === 1;
  const value = (v: number | null) => (v !== null && v > 0 ? v * unit.factor : null);
  const lines = (few ? serials : ['']).flatMap((robot, i) => (['before', 'after'] as const).map((kind) => ({
    kind, i, label: one ? kind : `${robot || 'no serial'} ${kind}`,
    data: points.map((p) => (!few || (p.row.serial ?? '') === robot ? value(p.s[kind]) : null)),
  })));
  lineFigure(host, {
    title: `${sensor} (${unit.name})`, file: `time_${sensor}`, height: 230, wide, live: false,
    csv: () => [['folder', 'serial', 'time', `before [${unit.name}]`, `after [${unit.name}]`], ...points.map((p) => [p.row.folder, p.row.serial, time(p.row.time), value(p.s.before), value(p.s.after)])],
    data: [points.map((p) => p.t), ...lines.map((line) => line.data)],
    options: (c) => {
      const tones = [c.after, c.other, c.good, c.text, c.faint];
      const tone = (line: (typeof lines)[0]) => (one && line.kind === 'before' ? c.before : tones[line.i]);
      return {
        scales: { y: { distr: 3 } }, axes: [{ space: 84, values: (_, at) => dates(at) }, logAxis()],
        series: [{ value: (_, t) => (t === null ? none : time(t)) }, ...lines.map((line) => ({
          label: line.label, stroke: tone(line), width: line.kind === 'after' ? 2 : 1.2, spanGaps: true, dash: line.kind === 'before' ? [5, 4] : undefined,
          ...(few ? {} : { paths: () => null }), points: { show: true, size: 7, dash: [], fill: line.kind === 'after' ? tone(line) : c.ground },
          value: (_: unknown, v: number | null) => digits(v),
        }))],
      };
    },
  });
}

function change(row: OverviewRow): string {
  const c = row.largest_change;
  if (!c) return none;
  return `${plainName(c.parameter ?? c.name ?? '')} ${quantity(c.value, c.unit ?? '')}`;
}

/** The name of a result; short ones are not broken at their hyphens. */
function folder(row: OverviewRow): HTMLElement {
  const name = row.folder || row.title || none;
  return h('span', { class: name.length < 30 ? 'nowrap' : undefined }, name);
}

export function overviewSections(data: Overview): Section[] {
  const rows = worstFirst(data.overview);
  const sensors = [...new Set(rows.flatMap((row) => Object.keys(row.sensors ?? {})))];
  const after = (row: OverviewRow, sensor: string) => { const s = row.sensors?.[sensor]; return s?.after == null ? null : s.after * shown(s.unit).factor; };
  const most = new Map(sensors.map((sensor) => [sensor, Math.max(...rows.map((row) => after(row, sensor) ?? 0))]));
  const unitOf = (sensor: string) => shown(rows.find((row) => row.sensors?.[sensor])!.sensors![sensor].unit).name;
  const useOf = (row: OverviewRow) => (row.status === 'failed' ? undefined : row.verdict?.use);
  const word = (row: OverviewRow) => { const use = useOf(row); return use ? words[use] : '✕ no result'; };
  const counts = (['no', 'doubts', 'good'] as const).map((use) => rows.filter((row) => useOf(row) === use).length);
  const failed = rows.length - counts[0] - counts[1] - counts[2];
  const told = [[counts[2], 'good'], [counts[1], 'with doubts'], [counts[0], 'not to be used'], [failed, 'without a result']].filter(([n]) => n).map(([n, what]) => `${n} ${what}`);
  const head = section('verdict', `${plural(rows.length, 'calibration')}: ${told.join(', ')}`,
    'The worst first. Robots of one kind should have similar errors; look at any that differ. The columns of the sensors have the RMS after the calibration, with joint readings taken as they come.',
    (host) => host.append(dataTable(rows, [
      { title: 'Result', cell: (row) => { const to = safeLink(row.link); return h('span', { class: 'nowrap' }, to ? h('a', { href: to }, row.folder || row.title) : row.folder || row.title); }, value: (row) => row.folder },
      { title: 'Serial', cell: (row) => h('span', { class: 'nowrap' }, row.serial ?? none) },
      { title: 'Date', cell: (row) => h('span', { class: 'nowrap' }, time(row.time).slice(0, 10)), value: (row) => stamp(row.time) },
      { title: 'Verdict', cell: (row) => h('span', { class: `chip ${row.verdict?.use ?? 'unknown'}`, title: row.verdict?.text ?? '' }, word(row)), value: word },
      { title: 'chi²/dof', cell: (row) => digits(row.chi2_dof), value: (row) => row.chi2_dof, numeric: true },
      ...sensors.map((sensor) => ({
        title: `${sensor} (${unitOf(sensor)})`, numeric: true, value: (row: OverviewRow) => after(row, sensor),
        cell: (row: OverviewRow) => h('div', { class: 'barred' }, digits(after(row, sensor)), after(row, sensor) === null ? null : bar(after(row, sensor), most.get(sensor)!, 'after')),
      })),
      { title: 'Largest change', cell: change },
    ], { caption: 'All results, the worst first.', file: 'overview', most: 200 })), 100);
  const doubts = rows.filter((row) => row.verdict?.use !== 'good');
  const why = section('why', 'Problems', 'The program’s verdict for every result that is not good.',
    (host) => host.append(dataTable(doubts, [
      { title: 'Result', cell: (row) => folder(row), value: (row) => row.folder },
      { title: 'Verdict', cell: (row) => h('span', { class: 'nowrap' }, word(row)), value: word },
      { title: 'Why, and what to do', cell: (row) => row.verdict?.text ?? none },
    ], { caption: 'Doubts and failures.', file: 'doubts', most: 100 })));
  const where = section('origins', 'Source of the errors', 'Errors on held-out data are fair; errors on the data of the fit are too small.',
    (host) => host.append(dataTable(rows.flatMap((row) => Object.entries(row.sensors ?? {}).map(([sensor, s]) => ({ row, sensor, s }))), [
      { title: 'Result', cell: (r) => folder(r.row), value: (r) => r.row.folder }, { title: 'Sensor', cell: (r) => r.sensor },
      { title: 'Before', cell: (r) => quantity(r.s.before, r.s.unit), value: (r) => r.s.before, numeric: true },
      { title: 'After', cell: (r) => quantity(r.s.after, r.s.unit), value: (r) => r.s.after, numeric: true },
      { title: 'On', cell: (r) => ({ test: 'held-out samples', cross_validation: 'cross-validated', train: 'the fit’s own data' })[r.s.from] ?? r.s.from },
    ], { caption: 'Errors before and after.', file: 'overview_errors' })));
  const sections = doubts.length ? [head, why] : [head];
  if (rows.filter((row) => stamp(row.time) !== null).length > 1)
    sections.push(section('drift', 'Over time', 'Errors of each robot before (dashed, open) and after the calibration (solid, filled), on a logarithmic scale; for more than five robots only points. A rising dashed line: the robot drifts or wears.',
      (host) => { const grid = h('div', sensors.length === 1 ? {} : { class: 'plots' }); host.append(grid); for (const sensor of sensors) timePlot(grid, sensor, rows, sensors.length === 1); }, 300));
  return [...sections, where];
}
