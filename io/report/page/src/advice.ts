// What to do next, most useful first, from the program's findings and warnings. Pure functions: tested without a page.
import { chi2PerDof, components, type Component, type Result, type WeakDirection } from './data';
import { digits, list, plainList, plainName, plural, size } from './format';

export interface Advice { text: string; why?: string }

/** A sentence begins with a capital; a name stays as it is. */
export function capital(text: string): string {
  return /^[a-z]+([ ,;:']|$)/.test(text) ? text.charAt(0).toUpperCase() + text.slice(1) : text;
}

/** With one full stop at its end. */
export function sentence(text: string): string {
  return /[.?!]$/.test(text) ? text : `${text}.`;
}

const normal = (text: string) => text.toLowerCase().replace(/[^a-z0-9]+/g, ' ').trim();

/** A direction that the data do not determine but a prior, or the usual error of a group, does: the position of the base
 *  frame, the rotation of a camera about the last axis. A prior makes the choice; nothing has to be done. */
export function isChosen(weak: WeakDirection): boolean {
  const sigma = weak.sigma_with_priors;
  return typeof sigma === 'number' && sigma !== weak.sigma && weakness(sigma, weak.unit) <= 1;
}
/** Weak directions that something can be done about, the worst first. */
export function openDirections(result: Result): WeakDirection[] {
  return (result.weak_directions ?? []).filter((weak) => !isChosen(weak));
}

/** The next steps of the verdict, then the cure of each finding and warning, each cure once. Nothing else is advice, so
 *  that it never contradicts the verdict. */
export function nextSteps(result: Result): Advice[] {
  const steps: Advice[] = [];
  const known = new Set<string>();
  const add = (text: string | undefined, why?: string) => {
    if (!text || known.has(normal(text))) return;
    known.add(normal(text));
    steps.push({ text: sentence(capital(text)), why });
  };
  for (const step of result.verdict?.next ?? []) add(step);
  for (const notice of [...(result.findings ?? []), ...(result.warnings ?? [])]) {
    if (notice.in_verdict) continue;   // its cure is a next step of the verdict
    const open = openDirections(result);
    if (notice.of_directions && open.length) {
      const told = new Set<string>();   // of several with one reason the first
      for (const weak of open) {
        const reason = [weak.reason, ...(weak.joints ?? [])].join();
        if (!told.has(reason)) add(weak.cure, weakSentence(weak));
        told.add(reason);
      }
      continue;
    }
    add(notice.otherwise ? `${notice.cure}; ${notice.otherwise}` : notice.cure, notice.what);
  }
  if (result.verdict?.use === 'good')
    add('Use it: copy robot.urdf to the robot; changes.yaml has the same values for a robot built from xacro.');
  const validation = result.validation ?? {};
  if (!result.kind && result.verdict?.use !== 'no' && !validation.test && !validation.cross_validation)
    add('Check it on held-out data: --holdout 4 or --cross-validate 5. So far nothing is held out.');
  return steps;
}

export function weakSentence(weak: WeakDirection): string {
  const first = Object.keys(weak.parameters ?? {})[0] ?? '';
  return weak.sigma === null || weak.sigma === undefined ? `${plainName(first)} is not determined by the data`
    : `${plainName(first)} is uncertain: ± ${size(weak.sigma, weak.unit)}`;
}

/** A sigma relative to the limit above which the program calls a component weak: 1 cm, 1 degree, 1 % or 1 px. */
export function weakness(sigma: number, unit: string): number {
  const yardstick: Record<string, number> = { m: 0.01, rad: Math.PI / 180, px: 1, '': 0.01 };
  return sigma / (yardstick[unit] ?? 1);
}

function judgedComponents(result: Result): Component[] {
  const chosen = new Set((result.weak_directions ?? []).filter(isChosen).flatMap((weak) => Object.keys(weak.parameters ?? {})));
  return components(result).filter((c) => c.sigma !== 0 && !/\/(distortion|intrinsics)\./.test(c.name) && !chosen.has(c.name));
}
/** The least certain estimated component; one that the data do not determine comes before all others. */
export function leastKnown(result: Result): Component | undefined {
  // Lens coefficients and image points have no yardstick of their own; a pose, an angle or a size has.
  const candidates = judgedComponents(result);
  const rank = (c: Component) => (c.sigma === null ? Infinity : weakness(c.sigma, c.unit));
  return candidates.reduce<Component | undefined>((worst, c) => (!worst || rank(c) > rank(worst) ? c : worst), undefined);
}

/** Components worse than 1 cm, 1 degree, 1 % or 1 px, or not determined. */
export function badlyKnown(result: Result): Component[] {
  return judgedComponents(result).filter((c) => c.sigma === null || weakness(c.sigma, c.unit) > 1);
}

/** Fixed parameters and the reason: one line for each reason. */
export interface HeldLine { text: string; names: string[] }
export function heldLines(result: Result): HeldLine[] {
  const lines: HeldLine[] = [];
  const of = (reason: string) => (result.held ?? []).filter((held) => held.reason === reason).map((held) => held.parameter);
  const undetermined = of('undetermined'), noGain = of('no_gain');
  const others = (result.held ?? []).filter((h) => h.reason !== 'undetermined' && h.reason !== 'no_gain');
  if (undetermined.length)
    lines.push({ text: `These data do not determine ${plural(undetermined.length, 'parameter')}, which keep their nominal values`, names: undetermined });
  if (noGain.length)
    lines.push({ text: `There is no evidence of error in ${plural(noGain.length, 'parameter')}, which keep their nominal values`, names: noGain });
  if (others.length) lines.push({ text: `${plural(others.length, 'parameter')} fixed`, names: others.map((h) => h.parameter) });
  if (!result.held) {
    const zero = components(result).filter((c) => c.sigma === 0).map((c) => c.name);
    if (zero.length) lines.push({ text: `${plural(zero.length, 'component')} fixed in the last step (partly estimated, or estimated in earlier steps)`, names: zero });
    const unused = [...new Set((result.steps ?? []).flatMap((step) => step.unused ?? []))];
    if (unused.length) lines.push({ text: `${plural(unused.length, 'parameter')} without effect: no measurement depends on them`, names: unused });
    const kinds = heldKinds(result);
    if (kinds) lines.push({ text: `No step of the rig estimates the ${kinds}: they count as exact`, names: [] });
    else if (!result.scene) lines.push({ text: 'Parameters that no step of the rig estimates count as exact', names: [] });
  }
  return lines;
}

/** Kinds of parameters that no step estimates, or not all of them: "gear scales, lenses and the other zero offsets". */
function heldKinds(result: Result): string {
  const { links = [], sensors = [], targets = [] } = result.scene ?? {};
  const joints = links.filter((link) => link.joint && !link.between_axes);
  const moving = joints.filter((link) => link.axis && !link.mimic);
  const kinds: [string, string[]][] = [
    ['zero offsets', moving.map((link) => `joint/${link.joint}/offset`)],
    ['gear scales', moving.map((link) => `joint/${link.joint}/scale`)],
    ['joint origins', joints.map((link) => `joint/${link.joint}/origin`)],
    ['mounts of sensors', sensors.map((sensor) => `sensor/${sensor.name}/pose`)],
    ['lenses', sensors.filter((sensor) => sensor.intrinsics).map((sensor) => `sensor/${sensor.name}/intrinsics`)],
    ['board sizes', targets.filter((target) => /board|charuco|grid/.test(target.type ?? '')).map((target) => `target/${target.name}/square`)],
  ];
  const freed = (name: string) => result.parameters?.[name] !== undefined;
  const open = kinds.filter(([, names]) => !names.every(freed));
  return list([...open.filter(([, names]) => !names.some(freed)).map(([kind]) => kind),
    ...open.filter(([, names]) => names.some(freed)).map(([kind]) => `other ${kind}`)], 9);
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
  return line.names.length ? `${line.text}: ${plainList(line.names)}.` : `${line.text}.`;
}
