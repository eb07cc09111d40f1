// Pages of what is no calibration: residuals at a rig's own values (kincal evaluate), and which mistakes its samples
// show (kincal check). They have a first screen of their own and the sections that their data fill.
import { capital, fitWord, nextSteps } from './advice';
import { chi2PerDof, type Context, type Finding, type Result } from './data';
import { dataTable, h, section, svg, type Child, type Section } from './dom';
import { actions, errorCard, fitCard, judgement, pooledErrors, type Look } from './first';
import { digits, list, none, plural } from './format';
import { coverageSection } from './numbers';
import { byJointSection, samplesSection, sensorsSection } from './residuals';
import { choose } from './state';
import { errorsSection, licencesSection, originSection } from './tables';
import { sampleLines } from './views';

// ---- evaluate
function worstSample(context: Context): HTMLElement {
  const lines = sampleLines(context).filter((line) => Number.isFinite(line.ratio));
  const worst = lines.reduce<(typeof lines)[0] | undefined>((w, line) => (!w || line.ratio > w.ratio ? line : w), undefined);
  return h('div', { class: 'card' }, h('h2', {}, 'Worst sample'), ...(worst ? [
    h('p', { class: 'figure' }, h('b', {}, `× ${digits(worst.ratio)}`)),
    h('p', {}, 'the stated noise: ', h('button', { type: 'button', class: 'link', click: () => choose(worst.sample, false) }, worst.id), `, most in ${worst.worst}`),
    h('p', { class: 'small' }, `Of ${plural(lines.length, 'sample')}. `, h('a', { href: '#samples' }, 'All samples'))]
    : [h('p', {}, 'No sample has residuals.')]));
}

function evaluationScreen(context: Context): HTMLElement {
  const { result } = context;
  const { word, ok } = fitWord(result);
  const look: Look = ok ? { use: 'good', sign: '✓', word: 'As good as the noise allows.', say: '' }
    : { use: 'doubts', sign: '?', word: 'Not as the rig states.', say: '' };
  look.say = 'Residuals at the rig’s own values; nothing was calibrated.';
  const steps = nextSteps(result);
  return h('div', { class: 'first', id: 'verdict' },
    judgement(look, `chi²/dof is ${digits(chi2PerDof(result))}: ${word}.`),
    h('div', { class: 'cards' },
      errorCard('Errors', ['explained', 'in use'], pooledErrors(context, (row) => [row.errors?.rms, row.errors?.rms_as_read]),
        'RMS; explained: errors of joint readings taken out; in use: as the robot’s own software sees it.'),
      fitCard(result), worstSample(context)),
    actions(steps, [], ok ? 'Nothing.' : 'Calibrate with these samples, or ask kincal check what is wrong.'));
}

// ---- check
const perDof = (chi2: number | null | undefined, dof: number | undefined) =>
  (typeof chi2 === 'number' && dof ? chi2 / dof : null);

function checkScreen(context: Context): HTMLElement {
  const { result } = context;
  const findings = result.findings ?? [];
  const look: Look = findings.length
    ? { use: 'no', sign: '✕', word: findings.length === 1 ? 'A mistake was found.' : `${plural(findings.length, 'mistake')} were found.`, say: 'Mend what is named, then check again.' }
    : result.explained ? { use: 'good', sign: '✓', word: 'Nothing found.', say: 'These samples can be calibrated with.' }
    : { use: 'doubts', sign: '?', word: 'None of the usual mistakes explains the data.', say: 'What is wrong is none of those that were looked for.' };
  const best = findings.find((finding) => typeof finding.chi2_corrected === 'number');
  const points = context.residuals.length;
  return h('div', { class: 'first', id: 'verdict' },
    judgement(look, capital(result.said ?? '')),
    h('div', { class: 'cards' },
      fitCard(result),
      h('div', { class: 'card' }, h('h2', {}, 'With what was found undone'),
        best ? h('p', { class: 'figure' }, h('b', {}, digits(perDof(best.chi2_corrected, result.dof))), h('span', {}, ' chi²/dof')) : h('p', {}, findings.length ? 'No fit is concerned.' : 'Nothing was found.'),
        best ? h('p', { class: 'small' }, `${best.id}; near 1: this was all that is wrong.`) : null),
      h('div', { class: 'card' }, h('h2', {}, 'Looked at'),
        h('p', { class: 'figure' }, h('b', {}, String(result.tested?.length ?? 0)), h('span', {}, ' kinds of mistakes')),
        h('p', {}, `${plural(context.samples.id.length, 'sample')}, ${plural(points, 'point')}, ${plural(context.sensors.length, 'sensor')}`),
        h('p', { class: 'small' }, h('a', { href: '#tested' }, 'Which')))),
    actions(findings.map((finding) => ({ text: capital(finding.text ?? ''), why: finding.id })), [],
      result.explained ? 'Calibrate: kincal calibrate.' : 'Look at the sensor and the samples that fit worst (kincal calibrate, then its report).'));
}

function bar(value: number | null, most: number): Child {
  return value === null ? null : svg('svg', { viewBox: '0 0 100 8', class: 'share', 'aria-hidden': 'true' },
    svg('rect', { x: 0, y: 1, width: Math.max(1, 100 * Math.log10(1 + value) / Math.log10(1 + most)), height: 6 }));
}

function findingsSection(result: Result): Section {
  return section('findings', 'What was found',
    'Each mistake was undone and the samples fitted again: the more chi²/dof falls, the surer it is. Near 1 it explains everything.',
    (host) => {
      const findings = result.findings ?? [];
      if (!findings.length) return void host.append(h('p', {}, capital(result.said ?? 'Nothing.')));
      const as = (finding: Finding) => perDof(finding.chi2_as_is, result.dof), undone = (finding: Finding) => perDof(finding.chi2_corrected, result.dof);
      const most = Math.max(...findings.map((finding) => as(finding) ?? 0), 1);
      host.append(dataTable(findings, [
        { title: 'Mistake', cell: (row) => row.id },
        { title: 'What, and what undoes it', cell: (row) => row.text },
        { title: 'Where', cell: (row) => list(row.where ?? []) || none },
        { title: 'chi²/dof as it is', cell: (row) => h('div', { class: 'barred' }, digits(as(row)), bar(as(row), most)), value: as, numeric: true },
        { title: 'undone', cell: (row) => h('div', { class: 'barred' }, digits(undone(row)), bar(undone(row), most)), value: undone, numeric: true },
      ], { caption: 'Findings, what explains most first; bars are logarithmic.', file: 'findings' }));
    });
}

function testedSection(result: Result): Section {
  return section('tested', 'What was looked for', 'Kinds of mistakes; what each means stands in docs/doctor.md. Something else may still be wrong.',
    (host) => {
      const found = new Set((result.findings ?? []).map((finding) => finding.id));
      const ids = [...new Set([...found, ...(result.tested ?? [])])];
      host.append(h('ul', { class: 'tested' }, ...ids.map((id) => h('li', {},
        h('span', { class: `chip ${found.has(id) ? 'no' : 'good'}` }, `${found.has(id) ? '✕' : '✓'} ${id}`)))));
    }, 60);
}

export function inputScreen(context: Context): HTMLElement {
  return context.result.kind === 'check' ? checkScreen(context) : evaluationScreen(context);
}

export function inputSections(of: Context): Section[] {
  const own = of.result.kind === 'check' ? [findingsSection(of.result), testedSection(of.result), coverageSection(of)]
    : [errorsSection(of), samplesSection(of), sensorsSection(of), byJointSection(of), coverageSection(of)];
  return [...own, originSection(of), licencesSection()].filter((s): s is Section => s !== null);
}
