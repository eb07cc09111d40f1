// The first screen: the verdict, the three most important figures, what to do next, the fixed parameters.
import { type Advice, type HeldLine, badlyKnown, capital, fitWord, heldLines, heldSentence, leastKnown, nextSteps, openDirections, sentence } from './advice';
import { chi2PerDof, judged, type BeforeAfter, type Context, type Result } from './data';
import { h, svg, type Child } from './dom';
import { digits, none, plainName, plural, shown, size, time } from './format';

const titles = { evaluation: 'Residuals of', check: 'Check of', plan: 'Planned postures of' };
const words = {
  good: { sign: '✓', word: 'Good:' },
  doubts: { sign: '?', word: 'Usable, with doubts:' },
  no: { sign: '✕', word: 'Do not use:' },
};

export function titleOf({ result, report }: Context): string {
  return `${result.kind ? titles[result.kind] : 'Calibration of'} ${report.title || 'a robot'}`;
}

export function masthead(context: Context, buttons: Child[]): HTMLElement {
  const { result } = context;
  const facts = [
    result.serial ? `Serial ${result.serial}` : 'no serial number given',
    time(result.time ?? result.input?.date) === none ? 'no date given' : time(result.time ?? result.input?.date),
    plural(context.samples.id.length, result.kind === 'plan' ? 'posture' : 'sample'),
    result.kincal ? `kincal ${result.kincal}` : null,
  ].filter((fact) => fact !== null);
  const { rig, samples, urdf } = result.input ?? {};
  const hashes = [['rig.yaml', rig], ['samples', samples], ['URDF', urdf]].flatMap(([name, hash]) => (hash ? [`${name} ${hash.slice(0, 16)}`] : []));
  return h('header', { class: 'masthead' },
    h('div', {}, h('h1', {}, titleOf(context)), h('p', { class: 'facts' }, facts.join(' · ')),
      hashes.length ? h('p', { class: 'facts paper-only' }, `SHA-256 begins: ${hashes.join(' · ')}`) : null),
    h('div', { class: 'buttons' }, ...buttons));
}

const families: [RegExp, string][] = [
  [/camera/, 'Cameras'], [/tilting_laser/, 'Tilting laser'], [/point/, 'Tracker'], [/pose/, 'Poses'],
  [/chain/, 'Arms holding a target'],
];
interface Line { name: string; unit: string; before: number | null; after: number | null; count: number }

/** Sensors of one kind and unit together: the root mean square over all their points. */
export function pooled(rows: BeforeAfter[], typeOf: (sensor: string) => string | undefined): Line[] {
  const groups = new Map<string, BeforeAfter[]>();
  for (const row of rows) {
    const type = typeOf(row.sensor);
    const name = rows.length <= 3 ? row.sensor
      : (families.find(([pattern]) => type && pattern.test(type))?.[1] ?? (row.unit === 'px' ? 'Cameras' : 'Other sensors'));
    groups.set(`${name}\n${row.unit}`, [...(groups.get(`${name}\n${row.unit}`) ?? []), row]);
  }
  const pool = (of: BeforeAfter[], value: (row: BeforeAfter) => number | null) => {
    let sum = 0, n = 0;
    for (const row of of) {
      const v = value(row);
      if (v === null || !row.points) continue;
      sum += v * v * row.points;
      n += row.points;
    }
    return n ? Math.sqrt(sum / n) : null;
  };
  return [...groups].map(([key, of]) => ({
    name: of.length === 1 ? of[0].sensor : key.split('\n')[0], unit: of[0].unit, count: of.length,
    before: pool(of, (row) => row.before), after: pool(of, (row) => row.after),
  }));
}

const sources = {
  test: 'on data held out from the fit', cross_validation: 'cross-validated: each sample is tested with a fit that lacks it',
  train: 'on the data of the fit itself; nothing was held out',
};

/** Sensors pooled, with the two errors of each that `of` chooses. */
export function pooledErrors(context: Context, of: (row: BeforeAfter) => (number | null | undefined)[]): Line[] {
  const types = new Map((context.result.scene?.sensors ?? []).map((s) => [s.name, s.type]));
  const rows = judged(context.result).map((row) => { const [before, after] = of(row); return { ...row, before: before ?? null, after: after ?? null }; });
  return pooled(rows, (sensor) => types.get(sensor));
}

/** A name that may be broken behind its underscores. */
function breakable(name: string): Child[] {
  return name.split(/(?<=_)/).flatMap((part, i) => (i ? [h('wbr'), part] : [part]));
}

export function errorCard(title: string, heads: [string, string], lines: Line[], small: string): HTMLElement {
  return h('div', { class: 'card errors' },
    h('h2', {}, title),
    lines.length === 0 ? h('p', {}, 'No sensor has data.') : h('table', { class: 'big' },
      h('thead', {}, h('tr', {}, h('th', {}, ''), ...heads.map((head) => h('th', { class: 'n' }, head)))),
      h('tbody', {}, ...lines.map((line) => {
        const unit = shown(line.unit);
        const text = (v: number | null) => (v === null ? none : digits(v * unit.factor));
        return h('tr', {}, h('th', { scope: 'row' }, ...breakable(line.count > 1 ? `${line.name} (${line.count})` : line.name)),
          h('td', { class: heads[0] === 'before' ? 'n before' : 'n' }, text(line.before)),
          h('td', { class: 'n after' }, h('b', {}, text(line.after)), ` ${unit.name}`));
      }))),
    h('p', { class: 'small' }, small));
}

function beforeAfterCard(context: Context): HTMLElement {
  const kinds = [...new Set(judged(context.result).map((row) => row.source))];
  return errorCard('Error before and after', ['before', 'after'], pooledErrors(context, (row) => [row.before, row.after]),
    `RMS, joint readings taken as they come; ${kinds.map((kind) => sources[kind]).join('; ')}.`);
}

/** chi2/dof on a logarithmic line; the band is what the stated noise allows. */
function gauge(ratio: number, ok: boolean): SVGElement {
  const x = (v: number) => 10 + (Math.log10(Math.min(1000, Math.max(0.01, v))) + 2) / 5 * 240;
  return svg('svg', { viewBox: '-4 0 272 40', class: 'gauge', role: 'img', 'aria-label': `chi2/dof ${digits(ratio)}; 1 is right` },
    svg('rect', { x: 10, y: 12, width: 240, height: 8, class: 'track' }),
    svg('rect', { x: x(0.8), y: 12, width: x(1.25) - x(0.8), height: 8, class: 'band' }),
    ...[0.01, 0.1, 1, 10, 100, 1000].map((v) => svg('text', { x: x(v), y: 36 }, String(v))),
    svg('path', { d: `M${x(ratio)} 22 l-6 -16 h12 z`, class: ok ? 'needle ok' : 'needle' }));
}

export function fitCard(result: Result): HTMLElement {
  const ratio = chi2PerDof(result);
  const { word, ok } = fitWord(result);
  const noise = result.noise_estimated;
  return h('div', { class: 'card' },
    h('h2', {}, noise ? 'Residuals against the estimated noise' : 'Residuals against the stated noise'),
    h('p', { class: 'figure' }, h('b', {}, digits(ratio)), h('span', {}, ' chi²/dof')),
    ratio !== null ? gauge(ratio, ok) : null,
    h('p', { class: 'small' }, noise
      ? `1 is right: residuals as large as the noise. The noise was estimated from the same data, so a value near 1 proves little${noise.stated == null ? '' : `; with the noise stated in the rig, chi²/dof is ${digits(noise.stated)}`}.`
      : `1 is right: residuals as large as the noise stated in the rig.${ok ? '' : ` Here ${word}.`}`));
}

/** Sigmas assume the stated noise: where the residuals are larger, the uncertainty is larger as well. */
function beliefInSigmas(result: Result): Child {
  const ratio = chi2PerDof(result);
  if (ratio === null || fitWord(result).ok) return null;
  return h('p', { class: 'small' }, h('b', {}, ratio > 1 ? `Too small, by a factor of ${digits(Math.sqrt(ratio), 2)} or more: ` : 'Probably too large: '),
    'it assumes the noise stated in the rig.');
}

function weakCard(result: Result): HTMLElement {
  const weak = openDirections(result)[0];
  const least = leastKnown(result);
  const title = h('h2', {}, 'Weakest direction');
  if (weak) {
    const names = Object.keys(weak.parameters ?? {});
    return h('div', { class: 'card' }, title,
      h('p', { class: 'figure' }, weak.sigma === null || weak.sigma === undefined ? h('b', {}, 'not determined')
        : h('b', {}, `± ${size(weak.sigma, weak.unit)}`)),
      h('p', { title: names[0] }, plainName(names[0] ?? ''),
        names.length > 1 ? ` (with ${plural(names.length - 1, 'other')} that change together)` : ''),
      h('p', { class: 'small' }, weak.sigma === null ? 'The data do not determine this component at all. '
        : 'One standard deviation, from the data alone. ', h('a', { href: '#weak' }, 'Why, and what helps')), beliefInSigmas(result));
  }
  if (!least) return h('div', { class: 'card' }, title, h('p', {}, 'No parameter was estimated.'));
  return h('div', { class: 'card' }, title,
    h('p', { class: 'figure' }, h('b', {}, least.sigma === null ? 'not determined' : `± ${size(least.sigma, least.unit)}`)),
    h('p', { title: least.name }, plainName(least.name)),
    h('p', { class: 'small' }, least.sigma === null ? 'The data do not determine this component. '
      : badlyKnown(result).length ? `The least certain component (one standard deviation); ${plural(badlyKnown(result).length, 'component')} worse than 1 cm, 1° or 1 %. `
      : 'The least certain component (one standard deviation). All are better than 1 cm, 1° or 1 %. ', h('a', { href: '#sigmas' }, 'All components')), beliefInSigmas(result));
}

/** Two lines in the colour of the verdict: whether to use the result and why; what to do. */
export interface Look { use: 'good' | 'doubts' | 'no' | 'unknown'; sign: string; word: string }
export function judgement(look: Look, why: string, todo: string): HTMLElement {
  return h('div', { class: `verdict ${look.use}`, role: 'status' },
    h('span', { class: 'sign', 'aria-hidden': 'true' }, look.sign),
    h('div', {}, h('p', { class: 'why' }, h('b', { class: 'word' }, look.word), ` ${why}`), h('p', { class: 'why' }, todo)));
}

/** The steps to do (`nothing` if there are none), and the fixed parameters, if any are listed. */
export function actions(title: string, steps: Advice[], held: HeldLine[], nothing: string): HTMLElement {
  return h('div', { class: 'two' },
    h('div', {}, h('h2', {}, title),
      steps.length ? h('ol', { class: 'todo' }, ...steps.slice(0, 6).map((step) =>
        h('li', {}, step.text, step.why ? h('span', { class: 'small' }, ` (${step.why})`) : null)))
        : h('p', {}, nothing)),
    held.length ? h('div', {}, h('h2', {}, 'Fixed parameters, and why'),
      h('ul', { class: 'held' }, ...held.map((line) => h('li', {}, heldSentence(line),
        line.names.length > 4 ? h('details', {}, h('summary', {}, 'all names, as in the rig'),
          h('p', { class: 'names' }, line.names.join(', '))) : null)))) : null);
}

export function firstScreen(context: Context): HTMLElement {
  const { result } = context;
  const verdict = result.verdict;
  const why = verdict?.why ?? verdict?.text ?? '';
  const held = heldLines(result);
  const first = verdict?.next?.[0];
  const reasons = verdict?.reasons ?? [];
  return h('div', { class: 'first', id: 'verdict' },
    judgement(verdict ? { use: verdict.use, ...words[verdict.use] } : { use: 'unknown', sign: '…', word: 'No verdict.' },
      why ? sentence(why) : `Status: ${result.status ?? 'unknown'}.`, `What to do: ${sentence(first ?? 'nothing')}`),
    h('div', { class: 'cards' }, beforeAfterCard(context), fitCard(result), weakCard(result)),
    reasons.length ? h('div', { class: 'reasons' }, h('h2', {}, 'Why'), h('ul', { class: 'held' }, ...reasons.map((reason) => h('li', {}, sentence(capital(reason)))))) : null,
    actions('Next steps', nextSteps(result).slice(first ? 1 : 0), held.length ? held : [{ text: 'No parameter was fixed', names: [] }], 'Nothing else.'));
}
