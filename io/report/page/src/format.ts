// Numbers, units and names in readable form.
import type { Maybe } from './data';

/** Shown for a missing number. */
export const none = '–';

/** Largest n with 10^n <= x. */
const power = (x: number) => Math.floor(Math.log10(x) + 1e-12);

/** x with this number of significant digits, without exponents between 1e-4 and 1e6. */
export function digits(x: Maybe | undefined, significant = 3): string {
  if (x === null || x === undefined || Number.isNaN(x)) return none;
  if (x === 0) return '0';
  if (!Number.isFinite(x)) return x > 0 ? '∞' : '−∞';
  const size = Math.abs(x);
  const text = size >= 1e6 || size < 1e-4 ? x.toExponential(significant - 1).replace('e+', 'e')
    : size >= 10 ** (significant - 1) ? Math.round(x).toString()
    : Number(x.toPrecision(significant)).toFixed(Math.max(0, significant - 1 - power(Number(size.toPrecision(significant)))));
  return text.replace('-', '−').replace('e−', 'e-');
}

export interface Unit { factor: number; name: string }

/** The unit that a quantity is shown in: mm for m, mrad for rad. */
export function shown(unit: string | undefined): Unit {
  if (unit === 'm') return { factor: 1000, name: 'mm' };
  if (unit === 'rad') return { factor: 1000, name: 'mrad' };
  return { factor: 1, name: unit ?? '' };
}

/** Number and unit: "1.2 mm". */
export function quantity(x: Maybe | undefined, unit: string, significant = 3): string {
  if (x === null || x === undefined || Number.isNaN(x)) return none;
  const u = shown(unit);
  return `${digits(x * u.factor, significant)}${u.name ? ' ' + u.name : ''}`;
}

/** As quantity, but angles from one degree on in degrees. */
export function size(x: Maybe | undefined, unit: string, significant = 2): string {
  if (unit === 'rad' && x !== null && x !== undefined && Math.abs(x) >= Math.PI / 180)
    return `${digits((x * 180) / Math.PI, significant)}°`;
  return quantity(x, unit, significant);
}

const kinds: Record<string, string> = {
  offset: 'zero offset', scale: 'gear scale', origin: 'origin', pose: 'mount', intrinsics: 'lens',
  distortion: 'distortion', baseline: 'baseline', square: 'board size', warp: 'board warp', points: 'point',
};
const parts: Record<string, string> = {
  x: 'x', y: 'y', z: 'z', rx: 'turn about x', ry: 'turn about y', rz: 'turn about z',
};

/** joint/elbow/origin.rz as { of: "elbow: origin", part: "turn about z" }; what is no name of a parameter stays as it is. */
function taken(name: string): { of: string; part: string } {
  const match = /^(joint|sensor|target)\/(.+)\/([a-z_]+)(?:\.(.+))?$/.exec(name);
  if (!match) return { of: name, part: '' };
  const [, what, who, kind, part] = match;
  return { of: `${who}: ${what === 'target' && kind === 'pose' ? 'pose' : (kinds[kind] ?? kind)}`, part: part ? (parts[part] ?? part) : '' };
}
/** joint/elbow/origin.x as "elbow: origin x", .rz as "elbow: origin, turn about z". */
export function plainName(name: string): string {
  const { of, part } = taken(name);
  return part ? `${of}${part.includes(' ') ? ', ' : ' '}${part}` : of;
}
/** Names as a list, the components of one pose or lens together: "turn: origin x, y; bend: zero offset and 3 more" (components). */
export function plainList(names: string[], most = 3): string {
  const groups = new Map<string, string[]>();
  for (const name of names) {
    const { of, part } = taken(name);
    groups.set(of, [...(groups.get(of) ?? []), part]);
  }
  const all = [...groups], told = all.slice(0, all.length > most + 1 ? most : undefined);
  const rest = names.length - told.reduce((sum, [, of]) => sum + of.length, 0);
  // "turn about x, y": the words once.
  const numbers = (its: string[]) => its.filter(Boolean).join(', ').replace(/(turn about .)((?:, turn about .)+)/, (_, first, more) => first + more.replaceAll('turn about ', ''));
  return told.map(([of, its]) => [of, numbers(its)].filter(Boolean).join(' ')).join('; ') + (rest ? ` and ${rest} more` : '');
}

export function seconds(s: number | undefined): string {
  if (s === undefined) return none;
  return s < 1 ? `${digits(s * 1000, 2)} ms` : s < 120 ? `${digits(s, 3)} s` : `${digits(s / 60, 3)} min`;
}

/** A time as given (ISO text, or seconds since 1970) to the minute, in UTC: the same on every machine. */
export function time(t: string | number | undefined): string {
  if (t === undefined || t === null || t === '') return none;
  if (typeof t === 'string' && /^\d{4}-\d\d-\d\d$/.test(t)) return t;
  const date = new Date(typeof t === 'number' ? t * 1000 : t);
  if (Number.isNaN(date.getTime())) return String(t);
  return `${date.toISOString().slice(0, 16).replace('T', ' ')} UTC`;
}

/** "a, b, c and 4 more" */
export function list(names: string[], most = 4): string {
  if (names.length <= most + 1) return names.length < 2 ? names.join('')
    : `${names.slice(0, -1).join(', ')} and ${names[names.length - 1]}`;
  return `${names.slice(0, most).join(', ')} and ${names.length - most} more`;
}

export function plural(n: number | undefined, word: string, words = `${word}s`): string {
  if (n === undefined) return `${none} ${words}`;
  return `${n.toLocaleString('en-US')} ${n === 1 ? word : words}`;
}

/** One field of a CSV file (RFC 4180). A text that a spreadsheet would run as a formula gets a leading apostrophe. */
export function csvField(value: string | number | null | undefined): string {
  if (value === null || value === undefined || (typeof value === 'number' && Number.isNaN(value))) return '';
  if (typeof value === 'number') return String(value);
  const safe = /^[=+\-@\t\r]/.test(value) ? `'${value}` : value;
  return /[",\n\r]/.test(safe) ? `"${safe.replace(/"/g, '""')}"` : safe;
}
export type Rows = (string | number | null | undefined)[][];
export function csv(rows: Rows): string {
  return rows.map((row) => row.map(csvField).join(',')).join('\r\n') + '\r\n';
}
