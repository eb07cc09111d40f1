// Pages without a calibration: residuals at the rig's own values (kincal evaluate), mistakes in samples (kincal check) and
// planned postures (kincal plan). Each has its own first screen and the sections for which it has data.
import { capital, fitWord, nextSteps } from './advice';
import { chi2PerDof, type Context, type Finding, type Result } from './data';
import { dataTable, h, section, svg, type Child, type Section } from './dom';
import { actions, errorCard, fitCard, judgement, pooledErrors, type Look } from './first';
import { digits, list, none, plural } from './format';
import { coverageSection } from './numbers';
import { planScreen, planSections } from './plans';
import { byJointSection, samplesSection, sensorsSection } from './residuals';
import { sceneSection } from './scene';
import { choose } from './state';
import { errorsSection, licencesSection, originSection } from './tables';
import { sampleLines } from './views';

// ---- evaluate
function worstSample(context: Context): HTMLElement {
  const lines = sampleLines(context).filter((line) => Number.isFinite(line.ratio));
  const worst = lines.reduce<(typeof lines)[0] | undefined>((w, line) => (!w || line.ratio > w.ratio ? line : w), undefined);
  return h('div', { class: 'card' }, h('h2', {}, 'Worst sample'), ...(worst ? [
    h('p', { class: 'figure' }, h('b', {}, `× ${digits(worst.ratio)}`)),
    h('p', {}, 'the stated noise: ', h('button', { type: 'button', class: 'link', click: () => choose(worst.sample, false) }, worst.id), `, mainly from ${worst.worst}`),
    h('p', { class: 'small' }, `Of ${plural(lines.length, 'sample')}. `, h('a', { href: '#samples' }, 'All samples'))]
    : [h('p', {}, 'No sample has residuals.')]));
}

function evaluationScreen(context: Context): HTMLElement {
  const { result } = context;
  const { word, ok } = fitWord(result);
  const ratio = chi2PerDof(result) ?? 0;
  const look: Look = {
    ...(ok ? { use: 'good', sign: '✓', word: 'As good as the noise allows.' }
      : ratio > 5 ? { use: 'no', sign: '✕', word: 'These values do not explain the samples.' }     // as a calibration's limit
      : { use: 'doubts', sign: '?', word: 'The residuals differ from the stated noise.' }),
  };
  const steps = nextSteps(result);
  return h('div', { class: 'first', id: 'verdict' },
    judgement(look, `chi²/dof is ${digits(chi2PerDof(result))}: ${word}.`, 'Residuals at the rig’s own values; nothing was calibrated.'),
    h('div', { class: 'cards' },
      errorCard('Errors', ['explained', 'in use'], pooledErrors(context, (row) => [row.errors?.rms, row.errors?.rms_as_read]),
        'RMS. Explained: errors of joint readings are estimated. In use: joint readings taken as exact, as the robot’s own software does.'),
      fitCard(result), worstSample(context)),
    actions('What to do next', steps, [], ok ? 'Nothing.' : 'Calibrate with these samples, or run kincal check to find the mistake.'));
}

// ---- check
// Sums of squares, not divided by degrees of freedom: a mistake may remove measurements from the fit, and their number is
// not in the data.
const expected = ({ dof }: Result) => (dof ? `About ${Number(dof.toPrecision(2)).toLocaleString('en-US')} is expected without other mistakes.` : '');

function checkScreen(context: Context): HTMLElement {
  const { result } = context;
  const findings = result.findings ?? [];
  const look: Look = findings.length
    ? { use: 'no', sign: '✕', word: findings.length === 1 ? 'A mistake was found.' : `${plural(findings.length, 'mistake')} were found.` }
    : result.explained ? { use: 'good', sign: '✓', word: 'Nothing found.' }
    : { use: 'doubts', sign: '?', word: 'None of the usual mistakes explains the data.' };
  const todo = { good: 'These samples can be used for a calibration.', no: 'Correct the findings, then check again.', doubts: 'There is a mistake that is not among the usual ones.', unknown: '' };
  const best = findings.find((finding) => typeof finding.chi2_corrected === 'number');
  const points = context.residuals.length;
  return h('div', { class: 'first', id: 'verdict' },
    judgement(look, capital(result.said ?? ''), todo[look.use]),
    h('div', { class: 'cards' },
      chi2PerDof(result) === null ? h('div', { class: 'card' }, h('h2', {}, 'Residuals against the stated noise'), h('p', {}, 'No fit can start with these samples.')) : fitCard(result),
      findings.length === 0 ? null : h('div', { class: 'card' }, h('h2', {}, 'With the findings corrected'),
        best ? h('p', { class: 'figure' }, h('b', {}, digits(best.chi2_corrected)), h('span', {}, ' chi²')) : h('p', {}, 'The findings were made without a fit.'),
        best ? h('p', { class: 'small' }, `${best.id}. ${typeof best.chi2_as_is === 'number' ? `${digits(best.chi2_as_is)} before. ` : ''}${expected(result)}`) : null),
      h('div', { class: 'card' }, h('h2', {}, 'Tested'),
        h('p', { class: 'figure' }, h('b', {}, String(result.tested?.length ?? 0)), h('span', {}, ' kinds of mistakes')),
        h('p', {}, `${plural(context.samples.id.length, 'sample')}, ${plural(points, 'point')}, ${plural(context.sensors.length, 'sensor')}`),
        h('p', { class: 'small' }, h('a', { href: '#tested' }, 'List')))),
    actions('What to do next', findings.map((finding) => ({ text: capital(finding.text ?? ''), why: finding.id })), [],
      result.explained ? 'Calibrate: kincal calibrate.' : 'Look at the sensor and the samples that fit worst (kincal calibrate, then its report).'));
}

function bar(value: number | null, most: number): Child {
  return value === null ? null : svg('svg', { viewBox: '0 0 100 8', class: 'share', 'aria-hidden': 'true' },
    svg('rect', { x: 0, y: 1, width: Math.max(1, 100 * Math.log10(1 + value) / Math.log10(1 + most)), height: 6 }));
}

function findingsSection(result: Result): Section {
  return section('findings', 'Findings',
    `Each mistake was corrected and the samples were fitted again. The more the sum of squared residuals (chi²) falls, the more certain the finding. ${expected(result)}`,
    (host) => {
      const findings = result.findings ?? [];
      if (!findings.length) return void host.append(h('p', {}, capital(result.said ?? 'Nothing.')));
      const as = (finding: Finding) => finding.chi2_as_is ?? null, undone = (finding: Finding) => finding.chi2_corrected ?? null;
      const most = Math.max(...findings.map((finding) => as(finding) ?? 0), 1);
      host.append(dataTable(findings, [
        { title: 'Mistake', cell: (row) => h('span', { class: 'nowrap' }, row.id), value: (row) => row.id },
        { title: 'Finding and correction', cell: (row) => row.text },
        { title: 'Where', cell: (row) => list(row.where ?? []) || none },
        { title: 'chi² before', cell: (row) => h('div', { class: 'barred' }, digits(as(row)), bar(as(row), most)), value: as, numeric: true },
        { title: 'chi² corrected', cell: (row) => h('div', { class: 'barred' }, digits(undone(row)), bar(undone(row), most)), value: undone, numeric: true },
      ], { caption: 'Findings, those that explain most first; bars are logarithmic.', file: 'findings' }));
    });
}

function testedSection(result: Result): Section {
  return section('tested', 'Mistakes tested', 'Kinds of mistakes, described in docs/reference.md. Other mistakes are possible.',
    (host) => {
      const found = new Set((result.findings ?? []).map((finding) => finding.id));
      const ids = [...new Set([...found, ...(result.tested ?? [])])];
      host.append(h('ul', { class: 'tested' }, ...ids.map((id) => h('li', {},
        h('span', { class: `chip ${found.has(id) ? 'no' : 'good'}` }, `${found.has(id) ? '✕' : '✓'} ${id}`)))));
    }, 60);
}

export function inputScreen(context: Context): HTMLElement {
  const { kind } = context.result;
  return kind === 'plan' ? planScreen(context) : kind === 'check' ? checkScreen(context) : evaluationScreen(context);
}

export function inputSections(of: Context): Section[] {
  const [forecast, postures] = planSections(of);
  const own = of.result.kind === 'plan' ? [forecast, sceneSection(of), postures, coverageSection(of)] : of.result.kind === 'check' ? [findingsSection(of.result), testedSection(of.result), coverageSection(of)]
    : [errorsSection(of), samplesSection(of), sensorsSection(of), byJointSection(of), coverageSection(of)];
  return [...own, originSection(of), licencesSection()].filter((s): s is Section => s !== null);
}
