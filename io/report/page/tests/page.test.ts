// Proves the functions that the page is made of: numbers and names as text, statistics, rigid motions and kinematics,
// what is told first, the order of an overview. Does not prove what a browser draws: tests/browser.mjs does.
import { describe, expect, test } from 'vitest';
import { badlyKnown, fitWord, heldLines, heldSentence, leastKnown, nextSteps, openDirections, sentence, weakSentence } from '../src/advice';
import { curveAt, stageName } from '../src/bending';
import { componentNames, components, context, judged, openPoses, table, type Link, type Report, type Result } from '../src/data';
import { pooled } from '../src/first';
import { csv, digits, list, plainList, plainName, quantity, size, time } from '../src/format';
import { aboutAxis, chiDensity, compose, eigen3, histogram, identity, inverse, linkPoses, magnified, quantile, rollPitchYaw, rotate, ticks } from '../src/maths';
import { strongest } from '../src/numbers';
import { safeLink, worstFirst } from '../src/overview';
import { viewsText } from '../src/plans';
import { sampleLines, sensorViews } from '../src/views';

const near = (a: number[], b: number[], tolerance = 1e-12) => a.forEach((v, i) => expect(Math.abs(v - b[i])).toBeLessThan(tolerance));

describe('text', () => {
  test('numbers keep three digits, a proper minus, and no exponent where none is needed', () => {
    expect([0.1234, 12.34, 123.4, 1234.4, 0, -0.5, 9.996, 1e-6, 2.5e7].map((v) => digits(v)))
      .toEqual(['0.123', '12.3', '123', '1234', '0', '−0.500', '10.0', '1.00e-6', '2.50e7']);
    expect([null, undefined, NaN].map((v) => digits(v))).toEqual(['–', '–', '–']);
  });
  test('units are those of people', () => {
    expect(quantity(0.00123, 'm')).toBe('1.23 mm');
    expect(quantity(0.2, 'px')).toBe('0.200 px');
    expect(size(0.108, 'rad')).toBe('6.2°');
    expect(size(0.001, 'rad')).toBe('1.0 mrad');
  });
  test('names of parameters become words, other names stay', () => {
    expect(plainName('joint/elbow/origin.rz')).toBe('elbow: origin, turn about z');
    expect(plainName('sensor/a/b/pose.x')).toBe('a/b: mount x');
    expect(plainName('<img src=x>')).toBe('<img src=x>');
  });
  test('in lists the numbers of one pose stand together, and those left out are counted', () => {
    const names = ['joint/a/origin.x', 'joint/a/origin.rz', 'joint/b/offset', 'sensor/c/pose.y', 'sensor/d/pose.x', 'sensor/d/pose.y', 'sensor/e/pose.x'];
    expect(plainList(names.slice(0, 3))).toBe('a: origin x, turn about z; b: zero offset');
    expect(plainList(['x', 'y', 'rx', 'ry', 'rz'].map((part) => `joint/a/origin.${part}`))).toBe('a: origin x, y, turn about x, y, z');
    expect(plainList(names, 3)).toBe('a: origin x, turn about z; b: zero offset; c: mount y and 3 more');
  });
  test('stages and views in words', () => {
    expect(stageName([])).toBe('rigid');
    expect(stageName(['compliance', 'curve/a'])).toBe('+ bending about the joint axes and error curve of a');
    expect(stageName(['curve/a', 'curve/b'])).toBe('+ error curves of 2 joints');
    expect(viewsText([['left', 'board'], ['tracker', 'ball'], ['right', 'board']])).toBe('board: left and right; ball: tracker');
  });
  test('CSV quotes what it has to and starts no formula', () => {
    expect(csv([['a,b', 'say "x"', '=1+1', 2, null, NaN]])).toBe('"a,b","say ""x""",\'=1+1,2,,\r\n');
    expect(csv([[-0.5]])).toBe('-0.5\r\n');
  });
  test('lists and times', () => {
    expect(list(['a', 'b', 'c'])).toBe('a, b and c');
    expect(list(['a', 'b', 'c', 'd', 'e'], 2)).toBe('a, b and 3 more');
    expect(time('2026-01-02T03:04:05Z')).toBe('2026-01-02 03:04 UTC');
    expect(time('last week')).toBe('last week');
    expect(time('2026-03-01')).toBe('2026-03-01');
  });
});

describe('mathematics', () => {
  test('the chi density has area one and the right mean square', () => {
    for (const k of [1, 2, 3, 6]) {
      let area = 0, square = 0;
      for (let x = 0.0005; x < 12; x += 0.001) { area += chiDensity(x, k) * 0.001; square += x * x * chiDensity(x, k) * 0.001; }
      expect(area).toBeCloseTo(1, 5);
      expect(square).toBeCloseTo(k, 4);
    }
  });
  test('a curve between its places, and nothing outside', () => {
    const curve = { reading: [0, 1, 3], error: [0, 2, 4] };
    expect([0, 0.5, 2, 3].map((v) => curveAt(curve, v))).toEqual([0, 1, 3, 4]);
    expect([-0.1, 3.1, NaN].every((v) => Number.isNaN(curveAt(curve, v))) && Number.isNaN(curveAt({}, 0))).toBe(true);
  });
  test('quantiles, histograms and ticks', () => {
    expect(quantile([3, 1, 2, NaN], 0.5)).toBe(2);
    expect([...histogram([0, 0.1, 0.9, 1, 5, -3, NaN], 0, 1, 2)]).toEqual([3, 3]);
    expect(ticks(0, 1, 5)).toEqual([0, 0.2, 0.4, 0.6000000000000001, 0.8, 1]);
    expect(ticks(3, 3, 5)).toEqual([3]);
    for (let a = 0.1; a < 100; a *= 1.07) expect(ticks(-a, a, 2).length, String(a)).toBeGreaterThanOrEqual(3);
  });
  test('a motion and its inverse are the identity', () => {
    const a = [1, 2, 3, ...aboutAxis([1, 2, -1], 0.7)];
    near(compose(a, inverse(a)), identity);
    near(rotate(aboutAxis([0, 0, 1], Math.PI / 2), [1, 0, 0]), [0, 1, 0]);
  });
  test('a turn as the angles of a URDF makes the turn again, at the pole too', () => {
    for (const [axis, angle] of [[[1, 2, -1], 2.8], [[0, 1, 0], Math.PI / 2], [[0.3, -1, 0.1], 1.4], [[1, 0, 0], -3]] as [number[], number][]) {
      const q = aboutAxis(axis, angle), [roll, pitch, yaw] = rollPitchYaw(q);
      const turn = (axis: number[], angle: number) => [0, 0, 0, ...aboutAxis(axis, angle)];
      const again = compose(turn([0, 0, 1], yaw), compose(turn([0, 1, 0], pitch), turn([1, 0, 0], roll))).slice(3);
      near(rotate(again, [1, 2, 3]), rotate(q, [1, 2, 3]), 1e-6);
    }
  });
  test('magnified by 1 is before, by 0 is after, by 10 turns ten times as far', () => {
    const after = [1, 0, 0, ...aboutAxis([0, 1, 0], 0.3)];
    const before = compose(after, [0, 0, 0, ...aboutAxis([1, 0, 0], 0.02)]);
    near(magnified(after, before, 1), before);
    near(magnified(after, before, 0), after);
    near(magnified(after, before, 10), compose(after, [0, 0, 0, ...aboutAxis([1, 0, 0], 0.2)]));
    near(magnified(after, [...before.slice(0, 3), ...before.slice(3).map((v) => -v)], 1).slice(0, 3), before.slice(0, 3));
  });
  test('kinematics: revolute, prismatic, mimic, and a base that is not the root', () => {
    const links: Link[] = [
      { name: 'root', parent: -1, joint: '', type: 'root', axis: [0, 0, 1], before: identity, after: identity },
      { name: 'a', parent: 0, joint: 'j', type: 'revolute', axis: [0, 0, 2], before: [1, 0, 0, 0, 0, 0, 1], after: [1, 0, 0.1, 0, 0, 0, 1] },
      { name: 'b', parent: 1, joint: 'k', type: 'prismatic', axis: [1, 0, 0], before: [1, 0, 0, 0, 0, 0, 1], after: [1, 0, 0, 0, 0, 0, 1] },
      { name: 'c', parent: 2, joint: 'm', type: 'continuous', axis: [0, 0, 1], before: identity, after: identity, mimic: { joint: 'j', multiplier: -1, offset: 0 } },
    ];
    const position = (joint: string) => ({ j: Math.PI / 2, k: 0.5 })[joint] ?? 0;
    near(linkPoses(links, 0, position, 'after')[3], [1, 1.5, 0.1, 0, 0, 0, 1]);
    near(linkPoses(links, 1, position, 'before')[0].slice(0, 3), [0, 1, 0]);
    links[2].scale = [1, 2];                              // a gear: position = scale * reading
    near(linkPoses(links, 0, position, 'after')[3].slice(0, 3), [1, 2, 0.1]);
  });
  test('eigenvectors give the matrix again', () => {
    const m = [4, 1, 0.5, 3, -0.2, 2];
    const { values, vectors } = eigen3(m);
    expect(values[0]).toBeGreaterThan(values[1]);
    const again = (i: number, j: number) => values.reduce((sum, v, k) => sum + v * vectors[k][i] * vectors[k][j], 0);
    near([again(0, 0), again(0, 1), again(0, 2), again(1, 1), again(1, 2), again(2, 2)], m, 1e-12);
  });
  test('the strongest correlations come first', () => {
    expect(strongest([[1000], [200, 1000], [-990, null, 1000], [700, 600, 10, 1000]], 2)).toEqual([[2, 0, -990], [3, 0, 700]]);
  });
});

describe('what is told first', () => {
  const weak = { parameters: { 'sensor/arm/pose.z': 1 }, unit: 'm', sigma: 0.05, reason: 'joint_noise', why: 'w', cure: 'hold it' };
  test('what the verdict says is next comes first, then the cures of findings and warnings; nothing twice', () => {
    const result: Result = {
      verdict: { use: 'no', text: 't', why: 'x is wrong', next: ['undo the mirroring'] },
      findings: [{ id: 'f', text: 't', what: 'the board is mirrored', cure: 'undo the mirroring', in_verdict: true }], weak_directions: [weak],
      warnings: [{ id: 'sigma', text: 's', what: 'known badly', cure: 'record more', of_directions: true }, { id: 'chi2', text: 'c', what: 'too large', cure: 'Undo the mirroring' }],
    };
    expect(nextSteps(result)).toEqual([{ text: 'Undo the mirroring.', why: undefined }, { text: 'Hold it.', why: weakSentence(weak) }]);
  });
  test('the cure of each warning once, behind it what is the case', () => {
    const outlier = { text: '', cure: 'look at what was recorded there, or leave it out' };
    const result: Result = {
      verdict: { use: 'doubts', text: 't', next: [outlier.cure] },
      warnings: [{ id: 'outlier_sample', ...outlier, what: '3 samples', in_verdict: true }, { id: 'outlier_view', ...outlier, what: 'two views' },
        { id: 'joint_noise', text: '', what: 'joint a is noisier', cure: 'state its noise' }, { id: 'minima', text: 'no cure' }],
      validation: { test: {} },
    };
    expect(nextSteps(result)).toEqual([{ text: 'Look at what was recorded there, or leave it out.', why: undefined }, { text: 'State its noise.', why: 'joint a is noisier' }]);
  });
  test('a direction that a prior closes is a choice, not advice, and not the weakest', () => {
    const weak = (name: string, withPriors: number | null) => ({ parameters: { [name]: 1, 'target/t/pose.rz': -1 }, unit: 'rad', sigma: null, sigma_with_priors: withPriors, reason: 'same_axis', why: '', cure: `Hold ${name}` });
    const result: Result = { verdict: { use: 'good', text: 'converged', next: [] }, weak_directions: [weak('joint/turn/offset', 0.0005), weak('joint/b/offset', null)], validation: { test: {} } };
    expect(openDirections(result).map((w) => Object.keys(w.parameters)[0])).toEqual(['joint/b/offset']);
    expect(nextSteps(result).map((s) => s.text).join()).not.toMatch(/Hold/);
    const p = (sigma: number | null, unit: string) => ({ unit: [unit], initial: [0], value: [0], sigma: [sigma] });
    expect(leastKnown({ ...result, parameters: { 'joint/turn/offset': p(0.0005, 'rad'), 'joint/c/offset': p(0.0001, 'rad') } })!.name).toBe('joint/c/offset');
  });
  test('a good result without held-out data is asked for them', () => {
    expect(nextSteps({ verdict: { use: 'good', text: 'converged' } }).map((s) => s.text).join()).toMatch(/--holdout/);
  });
  test('chi2/dof in words, with what chance allows', () => {
    expect(fitWord({ chi2_data: 1000, dof_data: 1000 }).ok).toBe(true);
    expect(fitWord({ chi2_data: 13, dof_data: 10 }).ok).toBe(true);
    expect(fitWord({ chi2_data: 4000, dof_data: 1000 })).toEqual({ word: 'residuals are 2.0 times larger than the stated noise', ok: false });
    expect(fitWord({}).word).toBe('not known');
  });
  test('what is known worst: not determined before all, then by 1 cm, 1 degree', () => {
    const p = (sigma: number | null, unit: string) => ({ unit: [unit], initial: [0], value: [0], sigma: [sigma] });
    expect(leastKnown({ parameters: { 'joint/a/offset': p(0.001, 'rad'), 'sensor/b/baseline': p(0.002, 'm') } })!.name).toBe('sensor/b/baseline');
    expect(leastKnown({ parameters: { 'joint/a/offset': p(null, 'rad'), 'sensor/b/baseline': p(0.002, 'm') } })!.name).toBe('joint/a/offset');
  });
  test('what is known badly is counted, held numbers and lens coefficients are not', () => {
    const p = (sigma: number | null, unit: string) => ({ unit: [unit], initial: [0], value: [0], sigma: [sigma] });
    const parameters = { 'joint/a/offset': p(0.05, 'rad'), 'joint/b/offset': p(0.001, 'rad'), 'joint/c/offset': p(0, 'rad'), 'target/t/square': p(null, 'm') };
    expect(badlyKnown({ parameters }).map((c) => c.name)).toEqual(['joint/a/offset', 'target/t/square']);
  });
  test('of several directions with one reason the first is said', () => {
    const weak = (name: string) => ({ parameters: { [name]: 1 }, unit: 'm', sigma: 0.1, reason: 'free_targets', why: '', cure: `more samples; or hold ${name}` });
    const texts = nextSteps({ verdict: { use: 'no', text: 'x' }, weak_directions: [weak('a'), weak('b')], warnings: [{ id: 'sigma', text: 'far', of_directions: true }] }).map((s) => s.text);
    expect(texts).toEqual(['More samples; or hold a.']);
  });
  test('a sentence ends with one full stop', () => {
    expect([sentence('one'), sentence('one.'), sentence('is it?')]).toEqual(['one.', 'one.', 'is it?']);
  });
  test('held numbers are counted by reason', () => {
    const held = [{ parameter: 'a', reason: 'no_gain', sigma: 0, text: '' }, { parameter: 'b', reason: 'undetermined', sigma: 0, text: '' }];
    expect(heldLines({ held }).map((line) => line.names)).toEqual([['b'], ['a']]);
  });
  test('of a rig with steps the kinds of numbers are named that no step frees', () => {
    const joint = (name: string, axis?: number[]) => ({ name: `l_${name}`, parent: 0, joint: name, axis });
    const p = { unit: ['rad'], initial: [0], value: [0], sigma: [0.001] };
    const scene = {
      base: 0, links: [{ name: 'base', parent: -1 }, joint('a', [0, 0, 1]), joint('b', [0, 0, 1]), joint('fixed')],
      sensors: [{ name: 'c', type: 'camera', link: 1, before: null, after: null, intrinsics: [1, 1, 0, 0] }], targets: [{ name: 't', type: 'chessboard', link: -1, before: null, after: null }],
    };
    const line = heldLines({ scene, parameters: { 'joint/a/offset': p, 'sensor/c/pose': p, 'target/t/square': p } })[0];
    expect(heldSentence(line)).toBe('No step of the rig estimates the gear scales, joint origins, lenses and other zero offsets: they count as exact.');
    expect(heldLines({})[0].text).toBe('Parameters that no step of the rig estimates count as exact');
  });
});

describe('data', () => {
  const errors = (points: number, before: number, read: number) => ({ points, rms_before: before, rms: read / 2, rms_as_read: read });
  test('held-out errors are preferred to cross-validated ones, these to training', () => {
    const result: Result = {
      sensors: {
        a: { unit: 'px', train: errors(10, 5, 1), test: errors(4, 6, 2) }, b: { unit: 'px', train: errors(10, 5, 1), test: errors(0, 0, 0) },
        c: { unit: 'm', train: errors(10, 5, 1) },
      },
      validation: { cross_validation: { by: 'sample', folds: [], sensors: { b: { unit: 'px', points: 10, rms: 1, rms_as_read: 3 } } } },
    };
    expect(judged(result).map((row) => [row.source, row.before, row.after])).toEqual([['test', 6, 2], ['cross_validation', 5, 3], ['train', 5, 1]]);
  });
  test('sensors of a kind are pooled by points', () => {
    const row = (sensor: string, points: number, after: number) => ({ sensor, unit: 'px', points, before: null, after, source: 'train' as const, beforeSource: 'train' as const });
    const lines = pooled([row('a', 1, 1), row('b', 3, 3), row('c', 0, 9), row('d', 0, 9)], () => 'camera');
    expect(lines).toEqual([{ name: 'Cameras', unit: 'px', count: 4, before: null, after: Math.sqrt(7) }]);
  });
  test('components of parameters have their names', () => {
    expect(componentNames('sensor/c/intrinsics', 4)[2]).toBe('sensor/c/intrinsics.cx');
    expect(componentNames('sensor/c/distortion', 5)[4]).toBe('sensor/c/distortion.k3');
    expect(componentNames('target/t/points', 6)[4]).toBe('target/t/points.1.y');
    expect(components({ parameters: { 'joint/j/offset': { unit: ['rad'], initial: [0], value: [0.1], sigma: [null] } } })[0].name).toBe('joint/j/offset');
  });
  test('a lens of another kind names its components', () => {
    const p = { unit: ['', ''], initial: [0, 0.5], value: [-0.2, 0.6], sigma: [null, null], components: ['xi', 'alpha'] };
    expect(components({ parameters: { 'sensor/c/distortion': p } }).map((c) => c.name)).toEqual(['sensor/c/distortion.xi', 'sensor/c/distortion.alpha']);
  });
  test('what only rounding moved did not move, and a pose that the rig leaves open has no change', () => {
    const p = (value: number, sigma: number | null) => ({ unit: ['rad'], initial: [0], value: [value], sigma: [sigma] });
    expect(components({ parameters: { 'joint/a/offset': p(-1.7e-17, 5e-4), 'joint/b/offset': p(1e-9, null) } }).map((c) => c.value)).toEqual([0, 1e-9]);
    const part = (name: string, link: number, before: number[] | null) => ({ name, type: 'camera', link, before, after: identity });
    expect([...openPoses({ scene: { base: 0, links: [], sensors: [part('a', 1, null), part('b', 1, identity)], targets: [part('t', 0, null), part('free', -1, null)] } })])
      .toEqual(['sensor/a/pose', 'target/t/pose']);
  });
  test('rows are found by sample, missing columns are not numbers', () => {
    const t = table({ sample: [1, 0, 1], x: [1, null, 3] });
    expect([...t.rowsOf(1)]).toEqual([0, 2]);
    expect([...t.rowsOf(7)]).toEqual([]);
    expect(Number.isNaN(t.column('x')[1]) && Number.isNaN(t.column('z')[0])).toBe(true);
    expect(table(null).length).toBe(0);
    expect(context({ version: 1, residuals: { sample: [0], x: [1] } }).residuals.length).toBe(0);
  });
  test('residuals by sensor and sample, against the stated noise', () => {
    const report: Report = {
      version: 1, names: { sensors: ['c', 'p'], targets: [] }, samples: { id: ['s', 't'], train: [1, 0] },
      residuals: { sample: [0, 0, 1, 1], sensor: [0, 0, 0, 1], x: [3, 0, 1, 1], y: [4, 0, 0, 2], z: [null, null, null, 2], whitened: [2, 2, Math.SQRT2, Math.sqrt(3)] },
    };
    const of = context(report);
    expect(sensorViews(of).map((s) => s.d)).toEqual([2, 3]);
    expect(sensorViews(of)[0].views.map((v) => [v.n, v.rms, v.ratio])).toEqual([[2, Math.sqrt(12.5), Math.SQRT2], [1, 1, 1]]);
    const lines = sampleLines(of);
    expect(lines.map((l) => [l.train, l.worst])).toEqual([[true, 'c'], [false, 'c']]);
    expect(lines[1].ratio).toBeCloseTo(1);
  });
  test('an overview shows the worst first and follows no link to elsewhere', () => {
    const row = (folder: string, use: 'good' | 'doubts' | 'no', chi2_dof: number) => ({ folder, verdict: { use, text: '' }, chi2_dof });
    expect(worstFirst([row('a', 'good', 1), row('b', 'no', 5), row('c', 'doubts', 2), row('d', 'doubts', 9), { ...row('e', 'no', 1), status: 'failed' }]).map((r) => r.folder))
      .toEqual(['e', 'b', 'd', 'c', 'a']);
    expect(['javascript:alert(1)', ' https://x', '//x/y', '', null].map(safeLink)).toEqual([null, null, null, null, null]);
    expect(safeLink('a b/report.html')).toBe('a%20b/report.html');
  });
});
