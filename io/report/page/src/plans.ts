// The page of planned postures (kincal plan): the forecast of the error, and the robot in each posture.
import { sentence, type Advice } from './advice';
import type { Context, Plan } from './data';
import { dataTable, h, missing, section, type Section } from './dom';
import { actions, judgement, type Look } from './first';
import { digits, list, none, plainList, plural, quantity } from './format';
import { lineFigure, logAxis } from './lines';
import { choose } from './state';

/** An error in the unit of the goal: a length, or yardsticks. */
const error = (plan: Plan, v: number | null | undefined) => (plan.unit === 'm' ? quantity(v, 'm') : digits(v));
const last = (plan: Plan) => plan.forecast?.[plan.forecast.length - 1];

function lookOf(plan: Plan, count: number): { look: Look; why: string } {
  const chosen = `${plural(count, 'posture')} chosen:`;
  const end = last(plan);
  const why = `the predicted error is ${error(plan, end?.planned)}; with as many random postures ${error(plan, end?.random)}`;
  if (plan.tolerance === null || plan.tolerance === undefined) return { look: { use: 'good', sign: '✓', word: chosen }, why: sentence(why) };
  const limit = error(plan, plan.tolerance);
  if (typeof plan.needed !== 'number')
    return { look: { use: 'no', sign: '✕', word: `No number of postures reaches ${limit}.` }, why: sentence(`For these ${count} ${why}`) };
  return plan.needed <= count ? { look: { use: 'good', sign: '✓', word: chosen }, why: `${sentence(why)} About ${plural(plan.needed, 'posture')} are needed for ${limit}, with the noise of the readings.` }
    : { look: { use: 'doubts', sign: '?', word: `About ${plural(plan.needed, 'posture')} are needed for ${limit}.` }, why: sentence(`For these ${count} ${why}`) };
}

export function planScreen(context: Context): HTMLElement {
  const plan = context.result.plan ?? {}, count = context.samples.id.length;
  const { look, why } = lookOf(plan, count);
  const end = last(plan);
  const steps: Advice[] = [
    { text: 'Check that no posture hits the surroundings, cables or anything that the robot carries: they are not modelled.' },
    { text: 'Record the postures in the order of the list, then calibrate.' },
  ];
  const names = plan.floor?.parameters ?? [];
  return h('div', { class: 'first', id: 'verdict' },
    judgement(look, why, `Goal: ${sentence(plan.goal ?? 'not given')}`),
    h('div', { class: 'cards' },
      h('div', { class: 'card' }, h('h2', {}, 'Predicted error of the calibration'),
        h('p', { class: 'figure' }, h('b', {}, error(plan, end?.planned))),
        h('p', {}, `after ${plural(end?.postures, 'posture')}; random ones: ${error(plan, end?.random)}`),
        plan.readings ? h('p', { class: 'small' }, `In use the noise of one reading of each joint adds ${error(plan, plan.readings)}.`) : null),
      h('div', { class: 'card' }, h('h2', {}, 'Postures that are enough'),
        h('p', { class: 'figure' }, h('b', {}, typeof plan.enough === 'number' ? String(plan.enough) : `more than ${count}`)),
        h('p', { class: 'small' }, 'Enough: three times as many would lower the error in use by less than a tenth.')),
      h('div', { class: 'card' }, h('h2', {}, 'Error that no posture reduces'),
        h('p', { class: 'figure' }, h('b', {}, error(plan, plan.floor?.error))),
        names.length ? h('p', { class: 'small' }, `Mostly from ${plainList(names)}.`) : null)),
    actions('What to do next', steps, [], 'Nothing.'));
}

function forecastSection(plan: Plan): Section {
  return section('forecast', 'Predicted error',
    'Predicted error of the calibration after each number of postures. Where the curve is level, more postures are not worth it.',
    (host) => {
      const rows = (plan.forecast ?? []).filter((row) => typeof row.planned === 'number');
      if (!rows.length) return void host.append(missing('The forecast is not in this file.'));
      const factor = plan.unit === 'm' ? 1000 : 1, unit = plan.unit === 'm' ? 'mm' : 'yardsticks';
      // Whole decades of the curves; a level far below them is in the card above only.
      const shownErrors = rows.flatMap((row) => [row.planned, row.random]).concat(plan.readings ?? null).filter((v): v is number => typeof v === 'number' && v > 0).map((v) => Math.log10(v * factor));
      const decades: [number, number] = [10 ** Math.floor(Math.min(...shownErrors)), 10 ** Math.ceil(Math.max(...shownErrors))];
      const level = (v: number | null | undefined) => rows.map(() => (typeof v === 'number' && v > 0 ? v * factor : null));
      const value = (_: unknown, v: number | null) => digits(v);
      lineFigure(host, {
        title: `Predicted error (${unit})`, file: 'forecast', wide: true, height: 260,
        csv: () => [['postures', `planned [${unit}]`, 'random'], ...rows.map((row) => [row.postures, row.planned! * factor, typeof row.random === 'number' ? row.random * factor : null])],
        data: [rows.map((row) => row.postures), rows.map((row) => row.planned! * factor || null), rows.map((row) => (typeof row.random === 'number' ? row.random * factor || null : null)),
          level(plan.floor?.error), level(plan.readings)],
        options: (c) => ({
          scales: { x: { time: false }, y: { distr: 3, range: decades } }, axes: [{}, logAxis()],
          series: [{ label: 'postures', value: (_: unknown, v: number | null) => (v === null ? '' : String(v)) },
            { label: 'planned', stroke: c.after, width: 2, points: { show: true, size: 6 }, value },
            { label: 'random', stroke: c.before, width: 1.5, dash: [5, 4], points: { show: true, size: 5, dash: [], fill: c.ground }, value },
            { label: 'no posture reduces this', stroke: c.good, width: 1.5, dash: [2, 3], points: { show: false }, value },
            { label: 'noise of one reading', stroke: c.faint, width: 1.5, dash: [8, 4], points: { show: false }, value }],
        }),
      });
      host.append(dataTable(rows, [
        { title: 'Postures', cell: (row) => row.postures },
        { title: 'Planned', cell: (row) => error(plan, row.planned), value: (row) => row.planned, numeric: true },
        { title: 'Random', cell: (row) => error(plan, row.random), value: (row) => row.random, numeric: true },
      ], { caption: 'Planned postures in the order in which they were chosen; random ones: the mean of ten choices.', file: 'forecast_table' }));
    }, 400);
}

/** "board: left, right; ball: tracker": the sensors that see each target. */
export function viewsText(views: [string, string][]): string {
  const targets = [...new Set(views.map(([, target]) => target))];
  return targets.map((target) => `${target}: ${list(views.flatMap(([sensor, of]) => (of === target ? [sensor] : [])), 9)}`).join('; ');
}

function posturesSection(context: Context): Section {
  const plan = context.result.plan ?? {};
  return section('postures', 'Postures', 'In the order of the file, with short moves. Choose one to see the robot in it.',
    (host) => {
      const rows = context.samples.id.map((id, i) => ({ id, i, views: plan.views?.[i] ?? [] }));
      if (!rows.length) return void host.append(missing('The postures are not in this file.'));
      host.append(dataTable(rows, [
        { title: 'Posture', cell: (row) => h('button', { type: 'button', class: 'link nowrap', 'data-sample': row.i, click: () => choose(row.i, false) }, row.id), value: (row) => row.id },
        { title: 'Order', cell: (row) => row.i + 1, numeric: true },
        { title: 'Targets, and the sensors that see them', cell: (row) => viewsText(row.views) || none },
      ], { caption: 'Planned postures.', file: 'postures', row: (element, row) => { element.dataset.row = String(row.i); } }));
      const left = Object.entries(plan.left_out ?? {}).sort((a, b) => b[1] - a[1]);
      if (left.length) host.append(dataTable(left, [
        { title: 'Reason', cell: ([why]) => why }, { title: 'Candidates', cell: ([, n]) => n, numeric: true },
      ], { caption: `Rejected of ${plural(plan.candidates, 'candidate')}.`, file: 'rejected' }));
      for (const note of plan.notes ?? []) host.append(h('p', { class: 'small' }, sentence(note)));
    }, 200);
}

export function planSections(context: Context): Section[] {
  return [forecastSection(context.result.plan ?? {}), posturesSection(context)];
}
