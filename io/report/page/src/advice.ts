// What to do next, most useful first, out of what the program says. Pure functions: tested without a page.
import { chi2PerDof, components, type Component, type Result, type WeakDirection } from './data';
import { digits, list, plainName, plural, size } from './format';

export interface Advice { text: string; why?: string }

/** verdict.text is "why. What to do: actions; more actions". */
export function splitVerdict(text: string): { why: string; actions: string[] } {
  const at = text.search(/\.? ?What to do: /);
  if (at < 0) return { why: text, actions: [] };
  const actions = text.slice(at).replace(/^\.? ?What to do: /, '');
  return { why: text.slice(0, at), actions: actions.split(/;\s+/).map((s) => s.trim()).filter(Boolean) };
}

/** A short cure for each kind of warning, where its own text says only what is the case. */
const cures: Record<string, string> = {
  chi2: 'Look at the sensor that fits worst (Errors of each sensor, column "Against stated noise"): wrong intrinsics, board size, time shift or outliers; else state the noise that is seen.',
  joint_error: 'Look at the sample that is named: its joint readings may belong to another posture. Many samples of one joint: its zero, its gear or a link near it is wrong, or its stated noise is too small.',
  joint_noise: 'State the joint noise that is seen (--estimate-noise), or look for what the model lacks: backlash, a wrong gear, a bent link.',
  outlier_sample: 'Look at these samples; calibrate again with --reject.',
  outlier_view: 'Look at these views: a board seen from the wrong corner, or an image of another posture; --reject takes them out.',
  outlier_point: 'Look at these points; --reject takes them out.',
  sigma: 'Record more varied postures, above all ones that move what is named.',
  moved: 'Ask of each pose that is named: can it have been that far off? If not, something else is wrong.',
  prior: 'Data and prior contradict each other: check which of the two is wrong.',
  held_out: 'Use no more than the mounts until this is mended; record more postures.',
  unobservable: 'Hold one of the numbers that are named, give it a prior, or record what would tell it.',
  few_data: 'Record more postures, or estimate less.',
  duplicates: 'Leave out all copies but one.',
  outside_image: 'Check image_size and the detector.',
  implausible: 'Correct the numbers that are named first; everything else may follow from them.',
  rejected: 'Look at what was taken out: a fifth of the samples is too many for chance.',
  not_converged: 'Mend what the first finding names, then calibrate again.',
  minima: 'Give better starting values for what is named, or record more varied postures.',
  width: 'Look for a mistake that these numbers take up: a board size, a wrong link, the sign of a joint.',
  gears: 'Estimate the gear ratios, too (--group gears).',
  few_poses: 'State how accurate the robot is.',
  repeated: 'Let the robot move between pictures.',
  never_seen: 'Record samples that show it, or take it out of the rig.',
};

/** A sentence begins with a capital; a name stays as it is. */
export function capital(text: string): string {
  return /^[a-z]+([ ,;:']|$)/.test(text) ? text.charAt(0).toUpperCase() + text.slice(1) : text;
}

const normal = (text: string) => text.toLowerCase().replace(/[^a-z0-9]+/g, ' ').trim();

export function nextSteps(result: Result): Advice[] {
  const steps: Advice[] = [];
  const known: string[] = [];
  // What is contained in something said before, or contains a whole sentence of it, is not said again.
  const add = (text: string, why?: string) => {
    const key = normal(text);
    if (!key || known.some((k) => k.includes(key) || (k.length > 20 && key.includes(k)))) return;
    known.push(key);
    steps.push({ text: capital(text), why });
  };
  const { why, actions } = splitVerdict(result.verdict?.text ?? '');
  known.push(normal(why));
  for (const finding of result.findings ?? []) add(finding.text ?? '', 'explains the data');
  for (const action of actions) if (!/^see also/.test(action) && !/^nothing, for/.test(action)
    && !/numbers? (are|is) as the rig has/.test(action)) add(action);
  for (const weak of result.weak_directions ?? []) add(weak.cure ?? '', weakSentence(weak));
  const weak = (result.weak_directions ?? []).length > 0, found = (result.findings ?? []).length > 0;
  for (const warning of result.warnings ?? []) {
    // What findings and weak directions have said better.
    if (found && ['not_converged', 'unexplained'].includes(warning.id)) continue;
    if (weak && ['sigma', 'unobservable'].includes(warning.id)) continue;
    const small = warning.id === 'chi2' && (chi2PerDof(result) ?? 1) < 1 && !warning.names?.length;
    const cure = small ? 'State the noise that is seen (--estimate-noise): the errors are smaller than stated, and so are the true uncertainties.'
      : cures[warning.id];
    if (cure) add(cure, splitVerdict(warning.text ?? '').why);
    else add(warning.text ?? '');
  }
  const validation = result.validation ?? {};
  if (result.verdict?.use !== 'no' && !validation.test && !validation.cross_validation)
    add('Check it on data that the fit has not seen: --holdout 4 or --cross-validate 5. So far nothing is held out.');
  if (result.verdict?.use === 'good')
    add('Use it: copy robot.urdf to the robot; changes.yaml has the same numbers for a robot from xacro.');
  return steps;
}

export function weakSentence(weak: WeakDirection): string {
  const first = Object.keys(weak.parameters ?? {})[0] ?? '';
  return weak.sigma === null || weak.sigma === undefined ? `${plainName(first)} is not determined by the data`
    : `${plainName(first)} is known to ± ${size(weak.sigma, weak.unit)} only`;
}

/** How bad a sigma is: 1 is 1 cm, 1 degree, 1 % or 1 px, from where on the program calls a number weak. */
export function weakness(sigma: number, unit: string): number {
  const yardstick: Record<string, number> = { m: 0.01, rad: Math.PI / 180, px: 1, '': 0.01 };
  return sigma / (yardstick[unit] ?? 1);
}

/** The estimated number that is known worst; one that the data do not determine before all others. */
export function leastKnown(result: Result): Component | undefined {
  // Lens coefficients and image points have no yardstick of their own; a pose, an angle or a size has.
  const candidates = components(result).filter((c) => c.sigma !== 0 && !/\/(distortion|intrinsics)\./.test(c.name));
  const rank = (c: Component) => (c.sigma === null ? Infinity : weakness(c.sigma, c.unit));
  return candidates.reduce<Component | undefined>((worst, c) => (!worst || rank(c) > rank(worst) ? c : worst), undefined);
}

/** Numbers that are known to no better than 1 cm, 1 degree, 1 % or 1 px, or not at all. */
export function badlyKnown(result: Result): Component[] {
  return components(result).filter((c) => c.sigma !== 0 && !/\/(distortion|intrinsics)\./.test(c.name)
    && (c.sigma === null || weakness(c.sigma, c.unit) > 1));
}

/** What was held, and why: one line a reason. */
export interface HeldLine { text: string; names: string[] }
export function heldLines(result: Result): HeldLine[] {
  const lines: HeldLine[] = [];
  const of = (reason: string) => (result.held ?? []).filter((held) => held.reason === reason).map((held) => held.parameter);
  const undetermined = of('undetermined'), noGain = of('no_gain');
  const others = (result.held ?? []).filter((h) => h.reason !== 'undetermined' && h.reason !== 'no_gain');
  if (undetermined.length)
    lines.push({ text: `${plural(undetermined.length, 'number')} stay as the rig has them: these data do not determine them`, names: undetermined });
  if (noGain.length)
    lines.push({ text: `${plural(noGain.length, 'number')} stay as the rig has them: nothing speaks against their nominal values`, names: noGain });
  if (others.length) lines.push({ text: `${plural(others.length, 'number')} held`, names: others.map((h) => h.parameter) });
  if (!result.held) {
    const zero = components(result).filter((c) => c.sigma === 0).map((c) => c.name);
    if (zero.length) lines.push({ text: `${plural(zero.length, 'component')} of what was freed: the last step held them`, names: zero });
    const unused = [...new Set((result.steps ?? []).flatMap((step) => step.unused ?? []))];
    if (unused.length) lines.push({ text: `${plural(unused.length, 'name')} freed in vain: no measurement depends on them`, names: unused });
    lines.push({ text: lines.length ? 'Everything else that no step of the rig frees: it counts as exact'
      : 'Everything that no step of the rig frees: it counts as exact', names: [] });
  }
  return lines;
}

/** chi2/dof in a word. The limits are those of the program's own warning. */
export function fitWord(result: Result): { word: string; ok: boolean } {
  const ratio = chi2PerDof(result);
  if (ratio === null) return { word: 'not known', ok: false };
  const dof = result.dof_data ?? result.dof ?? 1;
  const chance = 4 * Math.sqrt(2 / dof);
  if ((ratio > 1.25 && ratio - 1 > chance) || (ratio < 0.8 && 1 - ratio > chance)) {
    const times = Math.sqrt(ratio);
    return ratio > 1
      ? { word: `residuals are ${digits(times, 2)} times larger than the stated noise`, ok: false }
      : { word: `residuals are ${digits(1 / times, 2)} times smaller than the stated noise`, ok: false };
  }
  return { word: 'residuals are as large as the stated noise', ok: true };
}

export function heldSentence(line: HeldLine): string {
  return line.names.length ? `${line.text}: ${list(line.names.map(plainName), 3)}.` : `${line.text}.`;
}
