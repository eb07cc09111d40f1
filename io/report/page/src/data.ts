// The data of a report, as the program writes them into the page. Every key may be missing: of an older program, of a
// run that ended early, or because it does not apply. Lengths are in m, angles in rad, pixels in px; poses are
// x y z qx qy qz qw, and a_T_b takes points of b to a.

export type Pose7 = number[];
export type Maybe = number | null;

export interface Verdict { use: 'good' | 'doubts' | 'no'; text: string; why?: string; next?: string[]; reasons?: string[]; notes?: string[]; see?: string[] }
export interface SplitErrors {
  points: number;
  rms_before: Maybe; rms: Maybe; rms_as_read: Maybe;
  rms_rotation_before?: Maybe; rms_rotation?: Maybe; rms_rotation_as_read?: Maybe;
}
export interface SensorErrors { unit: string; train?: SplitErrors; test?: SplitErrors }
export interface Step {
  step: string; status: string; iterations: number; chi2_initial: number; chi2: number; cost: number; dof: number;
  chi2_data?: number; dof_data?: number; seconds?: number; linear_solver?: string; history?: [number, number][];
  unused?: string[]; held_out?: string[];
}
export interface Parameter {
  unit?: string[]; initial?: number[]; value?: number[]; sigma?: Maybe[]; step?: string; components?: string[];
  pose?: { xyz: number[]; quat: number[] };
}
export interface Group {
  group: string; members: string[]; n: number; gamma: Maybe; unit: string; width: Maybe; start: Maybe; gain: Maybe;
  held: boolean;
}
export interface Held { parameter: string; reason: string; sigma: Maybe; text: string }
export interface LoopError {
  from: string; to: string; unit: string; points: number; rms_before: Maybe; rms: Maybe;
  test?: { points: number; rms_before: Maybe; rms: Maybe };
}
export interface NoiseLevel {
  of: string; part: string; unit: string; assumed: Maybe; used?: Maybe; seen: Maybe; uncertainty?: Maybe;
}
export interface WeakDirection {
  parameters: Record<string, number>; unit: string; sigma: Maybe; sigma_with_priors?: Maybe; reason: string;
  joints?: string[]; why: string; cure: string;
}
export interface Judged {
  unit: string; points: number; rms: Maybe; rms_as_read: Maybe; rms_as_read_95?: [number, number] | null;
  rms_95?: [number, number] | null; median?: Maybe; blocks?: number; by?: string;
  rms_rotation?: Maybe; rms_rotation_as_read?: Maybe;
}
export interface BaselineRow {
  sensor: string; unit: string; points: number; rig?: Maybe; mounts: Maybe; automatic: Maybe; ratio: Maybe;
  ratio_95?: [number, number] | null; worse?: boolean;
}
export interface StageRow {
  /** Groups of bending and curves that the line before lacks. */
  added?: string[]; sensor: string; unit: string; points?: number; blocks?: number; by?: string; rms: Maybe; ratio?: Maybe;
  ratio_95?: [number, number] | null;
}
export interface Deflection { samples?: number; mean?: Maybe; largest?: Maybe; sample?: string }
/** The error curve of a joint over its readings. */
export interface CurveOf { unit?: string; rms?: Maybe; reading?: number[]; error?: Maybe[]; sigma?: Maybe[] }
export interface Tried { group?: string; gain?: Maybe; outcome?: string }
export interface Predicted {
  postures: number;
  position?: Errors3; rotation?: Errors3; position_with_readings?: Errors3; rotation_with_readings?: Errors3;
}
export interface Errors3 { rms: Maybe; median: Maybe; worst: Maybe }
export interface Requirement {
  require: string; name: string; from: string; unit: string; limit: number; measured: Maybe; met: boolean; why?: string;
}
export interface Validation {
  held_out?: string[]; test?: Record<string, Judged>;
  cross_validation?: { by: string; folds: { held_out: string[]; status: string }[]; sensors: Record<string, Judged> };
  baselines?: { from: string; rows: BaselineRow[] }; stages?: { from?: string; rows?: StageRow[] };
  frames?: Record<string, { base: string; taken_as_exact?: string[]; workspaces: Record<string, Predicted> }>;
  requirements?: Requirement[];
}
/** Common to findings and warnings: a clause for the fact (`what`), one for the action (`cure`). */
export interface Notice {
  id: string; text: string; severity?: 'remark' | 'doubt' | 'fault'; what?: string; why?: string; cure?: string; otherwise?: string;
  in_verdict?: boolean; of_directions?: boolean;
}
export interface Warning extends Notice { names?: string[] }
export interface Finding extends Notice { where?: string[]; chi2_as_is?: Maybe; chi2_corrected?: Maybe }
export interface Leverage { sample: string; parameter: string; moved_sigmas: Maybe }

/** A link of the drawing, parents first: `parent` is an index (-1: root), `before` and `after` are parent_T_joint. */
export interface Link {
  /** Of the root only name and parent are there; of a joint without motion no axis. */
  name: string; parent: number; joint?: string; type?: string; axis?: number[]; before?: Pose7; after?: Pose7;
  /** No link of the robot: between the axes that a floating joint was opened into. */
  between_axes?: boolean;
  limits?: [number, number] | null;
  mimic?: { joint: string; multiplier: number; offset: number };
  /** Gear [before, after]: position = scale * reading; absent: 1. */
  scale?: [number, number];
  boxes?: { pose: Pose7; size: number[] }[];
}
/** `link` is an index, `before` and `after` are link_T_sensor. `covariance`: [xx, xy, xz, yy, yz, zz] in m²
 * of the position relative to the base, at the first sample's readings. */
export interface SceneSensor {
  name: string; type: string; link: number; before: Pose7 | null; after: Pose7 | null;
  image_size?: [number, number] | null; intrinsics?: number[] | null; baseline?: unknown; covariance?: number[];
}
/** `link`: -1 if the target is free; `points`: the first 500; `covariance` as of a sensor. */
export interface SceneTarget {
  name: string; type?: string; link: number; before: Pose7 | null; after: Pose7 | null; points?: number[][]; covariance?: number[];
}
export interface Scene {
  base: number; links: Link[]; sensors: SceneSensor[]; targets: SceneTarget[];
  /** Links that the URDF draws by meshes alone that cannot be read here. */
  meshes_left_out?: number;
}

/** What `kincal plan` forecasts; the samples of its page are the postures. */
export interface Plan {
  goal?: string; unit?: string; tolerance?: Maybe; forecast?: { postures: number; planned: Maybe; random: Maybe }[]; readings?: Maybe;
  floor?: { error: Maybe; parameters?: string[] }; enough?: Maybe; needed?: Maybe; candidates?: number;
  left_out?: Record<string, number>; notes?: string[];
  /** By posture: sensor and target of each view. */
  views?: [string, string][][];
}

export interface Result {
  /** Absent: a calibration. A check also has the tested mistakes and its verdict (`said`). */
  kind?: 'evaluation' | 'check' | 'plan'; plan?: Plan; tested?: string[]; said?: string; explained?: boolean;
  verdict?: Verdict; kincal?: string; status?: string; noise?: string; chi2?: Maybe; dof?: number; chi2_data?: Maybe;
  dof_data?: number; cost?: Maybe;
  /** Only where sigmas were estimated from the data; `stated`: chi2/dof with the rig's own. */
  noise_estimated?: { rounds?: number; converged?: boolean; stated?: number | null } | null;
  input?: { command?: string; rig?: string; samples?: string; urdf?: string; date?: string };
  serial?: string; time?: string | number;
  steps?: Step[]; parameters?: Record<string, Parameter>; sensors?: Record<string, SensorErrors>;
  automatic?: Group[]; held?: Held[]; loops?: LoopError[]; validation?: Validation;
  unobservable?: Record<string, number>[]; noise_levels?: NoiseLevel[]; weak_directions?: WeakDirection[];
  prior_decides?: { parameter: string; unit: string; prior: number; sigma: Maybe }[];
  correlations?: { a: string; b: string; correlation: number }[];
  rejected?: { sample: string; sensor?: string; target?: string; ids?: number[]; reason: string }[];
  restarts?: { count: number; failed?: number; not_converged?: number; minima?: { cost: number; chi2: number; count: number }[] };
  bending?: Record<string, Deflection>; curves?: Record<string, CurveOf>; tried?: Tried[];
  leverage?: Leverage[]; warnings?: Warning[]; findings?: Finding[]; scene?: Scene;
  /** loops.csv has the points of one sample in `every`. */
  loops_csv?: { every?: number };
}

/** Columns of equal length; a column of only nulls may be missing. */
export type Columns = Record<string, Maybe[] | undefined>;

export interface Samples {
  id: string[]; train?: number[]; joints?: Record<string, Maybe[]>; errors?: Record<string, Maybe[]>;
  targets?: Record<string, (Pose7 | null)[]>;
}
export interface Report {
  version: number; title?: string; result?: Result; names?: { sensors: string[]; targets: string[] };
  samples?: Samples; residuals?: Columns | null;
  /** `every` = n: only the points of one sample in n are here. */
  loops?: (Omit<Columns, 'every'> & { every?: number }) | null;
  covariance?: { names?: string[]; sigma?: Maybe[]; correlation?: Maybe[][] } | null;
}

export interface OverviewSensor { unit: string; before: Maybe; after: Maybe; from: string }
export interface OverviewRow {
  folder: string; title?: string; serial?: string; time?: string | number; verdict?: Verdict; status?: string;
  chi2_dof?: Maybe; sensors?: Record<string, OverviewSensor>;
  largest_change?: { name?: string; parameter?: string; value?: Maybe; unit?: string; sigma?: Maybe } | null;
  link?: string | null;
}
export interface Overview { version: number; title?: string; overview: OverviewRow[] }

export type PageData = Report | Overview | { 'kincal-report-data': null };

/** A report with its columns as typed arrays (made at the first use, null becomes NaN) and rows found by sample. */
export interface Table {
  length: number;
  column(name: string): Float64Array;
  has(name: string): boolean;
  ints(name: string): Int32Array;
  rowsOf(sample: number): Int32Array;
}

export function table(columns: Columns | null | undefined): Table {
  const source = columns ?? {};
  const length = source.sample?.length ?? 0;
  const floats = new Map<string, Float64Array>();
  const integers = new Map<string, Int32Array>();
  let starts: Int32Array | undefined;
  let order: Int32Array | undefined;
  const column = (name: string): Float64Array => {
    let made = floats.get(name);
    if (!made) {
      const given = source[name];
      made = new Float64Array(length).fill(NaN);
      if (given) for (let i = 0; i < length; i++) made[i] = given[i] ?? NaN;
      floats.set(name, made);
    }
    return made;
  };
  const ints = (name: string): Int32Array => {
    let made = integers.get(name);
    if (!made) {
      made = new Int32Array(length);
      const given = source[name];
      for (let i = 0; i < length; i++) made[i] = given?.[i] ?? -1;
      integers.set(name, made);
    }
    return made;
  };
  // Rows sorted by sample (a counting sort), so that a chosen sample's rows are found without a search.
  const rowsOf = (sample: number): Int32Array => {
    if (!starts || !order) {
      const of = ints('sample');
      let most = -1;
      for (let i = 0; i < length; i++) if (of[i] > most) most = of[i];
      starts = new Int32Array(most + 2);
      for (let i = 0; i < length; i++) starts[of[i] + 1]++;
      for (let s = 0; s <= most; s++) starts[s + 1] += starts[s];
      const next = starts.slice();
      order = new Int32Array(length);
      for (let i = 0; i < length; i++) order[next[of[i]]++] = i;
    }
    return sample >= 0 && sample + 1 < starts.length ? order.subarray(starts[sample], starts[sample + 1])
                                                     : new Int32Array(0);
  };
  return { length, column, ints, rowsOf, has: (name) => source[name] !== undefined };
}

/** The data that all sections of a report use. */
export interface Context {
  report: Report; result: Result; sensors: string[]; targets: string[]; samples: Samples; residuals: Table; loops: Table;
}

export function context(report: Report): Context {
  const result = report.result ?? {};
  const sensors = report.names?.sensors ?? Object.keys(result.sensors ?? {});
  const whole = (columns: Columns | null | undefined, needed: string[]) =>
    table(columns && needed.every((name) => columns[name]) ? columns : null);
  return {
    report, result, sensors,
    targets: report.names?.targets ?? [],
    samples: { ...report.samples, id: report.samples?.id ?? [] },
    // A check predicts nothing: its rows have measurements only.
    residuals: whole(report.residuals, result.kind === 'check' ? ['sample', 'sensor'] : ['sample', 'sensor', 'x', 'y', 'whitened']),
    loops: whole(report.loops as Columns, ['sample', 'from', 'to', 'x', 'y']),
  };
}

export function isOverview(data: PageData): data is Overview {
  return Array.isArray((data as Overview).overview);
}
export function isEmpty(data: PageData): data is { 'kincal-report-data': null } {
  return 'kincal-report-data' in data;
}

/** chi2 per degree of freedom of measurements and joint errors, without priors; null if there is none. */
export function chi2PerDof(result: Result): Maybe {
  const chi2 = result.chi2_data ?? result.chi2;
  const dof = result.dof_data ?? result.dof;
  return typeof chi2 === 'number' && typeof dof === 'number' && dof > 0 ? chi2 / dof : null;
}

/** Where an error after the calibration comes from: held-out data if there are any, else cross-validation, else training. */
export type Source = 'test' | 'cross_validation' | 'train';
export interface BeforeAfter {
  sensor: string; unit: string; points: number; before: Maybe; after: Maybe; interval?: [number, number] | null;
  /** All errors on these data; of cross-validation there are none. */
  errors?: SplitErrors;
  source: Source; beforeSource: Source;
}

/** One row a sensor (translation in m of poses), judged on the best data there are; errors as read. */
export function judged(result: Result): BeforeAfter[] {
  return Object.entries(result.sensors ?? {}).map(([sensor, errors]) => {
    const test = result.validation?.test?.[sensor];
    const cross = result.validation?.cross_validation?.sensors?.[sensor];
    const train = errors.train;
    if (errors.test && errors.test.points > 0)
      return {
        sensor, unit: errors.unit ?? '', points: errors.test.points, before: errors.test.rms_before,
        after: errors.test.rms_as_read, interval: test?.rms_as_read_95, source: 'test', beforeSource: 'test', errors: errors.test,
      };
    if (cross && cross.points > 0)
      return {
        sensor, unit: errors.unit ?? '', points: cross.points, before: train?.rms_before ?? null, after: cross.rms_as_read,
        interval: cross.rms_as_read_95, source: 'cross_validation', beforeSource: 'train',
      };
    return {
      sensor, unit: errors.unit ?? '', points: train?.points ?? 0, before: train?.rms_before ?? null,
      after: train?.rms_as_read ?? null, source: 'train', beforeSource: 'train', errors: train,
    };
  });
}

/** Names of poses that the rig does not give: they have no value before. */
export function openPoses(result: Result): Set<string> {
  const open = (kind: string, all: { name: string; link?: number; before?: Pose7 | null }[] | undefined) =>
    (all ?? []).filter((part) => (part.link ?? -1) >= 0 && part.before === null).map((part) => `${kind}/${part.name}/pose`);
  return new Set([...open('sensor', result.scene?.sensors), ...open('target', result.scene?.targets)]);
}

/** Components of all parameters as flat rows. */
export interface Component {
  name: string; parameter: string; unit: string; initial: number; value: number; sigma: Maybe; step: string;
}
const poseComponents = ['x', 'y', 'z', 'rx', 'ry', 'rz'];
const intrinsicComponents = ['fx', 'fy', 'cx', 'cy'];
const distortionComponents: Record<number, string[]> = {
  4: ['k1', 'k2', 'k3', 'k4'], 5: ['k1', 'k2', 'p1', 'p2', 'k3'],
  8: ['k1', 'k2', 'p1', 'p2', 'k3', 'k4', 'k5', 'k6'],
};

export function componentNames(parameter: string, size: number): string[] {
  if (size === 1) return [parameter];
  const kind = parameter.slice(parameter.lastIndexOf('/') + 1);
  const parts = kind === 'intrinsics' ? intrinsicComponents
    : kind === 'distortion' ? distortionComponents[size]
    : kind === 'points' ? Array.from({ length: size }, (_, i) => `${Math.floor(i / 3)}.${'xyz'[i % 3]}`)
    : poseComponents;
  return Array.from({ length: size }, (_, i) => `${parameter}.${parts?.[i] ?? i}`);
}

export function components(result: Result): Component[] {
  return Object.entries(result.parameters ?? {}).flatMap(([parameter, p]) =>
    (p.components?.map((c) => `${parameter}.${c}`) ?? componentNames(parameter, p.value?.length ?? 0)).map((name, i) => {
      const initial = p.initial?.[i] ?? 0, sigma = p.sigma?.[i] ?? null;
      // A change by rounding alone is no change.
      const value = Math.abs(p.value![i] - initial) < 1e-9 * (sigma || 1) ? initial : p.value![i];
      return { name, parameter, unit: p.unit?.[i] ?? '', initial, value, sigma, step: p.step ?? '' };
    }));
}
