// State of the whole page: the chosen sample, the chosen part and the theme. Plots and tables register for changes.

let chosen = -1;
const choosers = new Set<(sample: number) => void>();

/** Index of the chosen sample, -1: none. */
export function chosenSample(): number {
  return chosen;
}
/** Chooses a sample; the same one again lets it go. */
export function choose(sample: number, toggle = true): void {
  const next = toggle && sample === chosen ? -1 : sample;
  if (next === chosen) return;
  chosen = next;
  for (const tell of choosers) tell(chosen);
}
export function onChoice(tell: (sample: number) => void): void {
  choosers.add(tell);
}

// The chosen part of the robot: "sensor/NAME" or "target/NAME", ''; it lives beside the chosen sample.
let part = '';
const partChoosers = new Set<(part: string, point: number) => void>();
/** Chooses a part, and a point of a target (-1: none); the same part again lets it go. */
export function choosePart(name: string, point = -1): void {
  part = name === part && point < 0 ? '' : name;
  for (const tell of partChoosers) tell(part, point);
}
export function onPart(tell: (part: string, point: number) => void): void {
  partChoosers.add(tell);
}

export interface Theme {
  text: string; faint: string; line: string; ground: string; panel: string; before: string; after: string;
  chosen: string; good: string; other: string; held: string;
}
let theme: Theme | undefined;
const painters = new Set<() => void>();

/** Colours of the theme for what is drawn on canvas; the style sheet has them (Okabe and Ito, safe for colour-blind). */
export function colours(): Theme {
  if (!theme) {
    const style = getComputedStyle(document.documentElement);
    const get = (name: string) => style.getPropertyValue(`--${name}`).trim();
    theme = {
      text: get('text'), faint: get('faint'), line: get('line'), ground: get('ground'), panel: get('panel'),
      before: get('before'), after: get('after'), chosen: get('chosen'), good: get('good'), other: get('other'),
      held: get('held'),
    };
  }
  return theme;
}
export function onTheme(paint: () => void): void {
  painters.add(paint);
}
/** light, dark, or null: as the system's setting. */
export function setTheme(name: string | null): void {
  if (name) document.documentElement.dataset.theme = name;
  else delete document.documentElement.dataset.theme;
  theme = undefined;                                       // read again at the next use
  for (const paint of painters) paint();
}
export function isDark(): boolean {
  const given = document.documentElement.dataset.theme;
  return given ? given === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
}
