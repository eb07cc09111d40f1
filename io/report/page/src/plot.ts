// Plots on canvas: axes, points, a layer for the chosen sample on top, and a click that chooses.
// Two canvases lie on each other: one is drawn once, the upper one changes with the chosen sample.
import { csvButton, h, lazily } from './dom';
import { digits, type Rows } from './format';
import { ticks } from './maths';
import { choose, chosenSample, colours, onChoice, onTheme, type Theme } from './state';

/** The means to draw a plot: places on the canvas (px) from values. */
export interface Pen {
  c: CanvasRenderingContext2D; colour: Theme; x: (v: number) => number; y: (v: number) => number;
  left: number; top: number; width: number; height: number;
}
export interface Plot {
  title: string; file: string; xLabel: string; yLabel: string;
  x: [number, number]; y: [number, number];
  /** Height in px, or the ratio height / width of the drawn area where that has to be so. */
  height?: number; aspect?: number;
  yDown?: boolean; xTicks?: { at: number; text: string }[]; noYTicks?: boolean;
  draw: (pen: Pen) => void;
  /** Drawn over it for a chosen sample. */
  over?: (pen: Pen, sample: number) => void;
  /** Points that can be clicked and hovered. */
  pick?: { x: ArrayLike<number>; y: ArrayLike<number>; sample: ArrayLike<number>; text?: (i: number) => string };
  csv: () => Rows;
  note?: string;
}
const font = '11px system-ui, sans-serif';
/** More points than these are thinned out where they are drawn; never in CSV or in sums. */
export const mostPoints = 30000;

function frame(plot: Plot, pen: Pen): void {
  const { c, colour, left, top, width, height } = pen;
  c.font = font;
  c.lineWidth = 1;
  c.textBaseline = 'top';
  c.textAlign = 'center';
  const xs = plot.xTicks ?? ticks(plot.x[0], plot.x[1], width / 56).map((at) => ({ at, text: tickText(at) }));
  for (const { at, text } of xs) {
    const x = Math.round(pen.x(at)) + 0.5;
    c.strokeStyle = colour.line;
    line(c, x, top, x, top + height);
    c.fillStyle = colour.faint;
    const half = c.measureText(text).width / 2;
    c.fillText(text, Math.min(Math.max(x, half), left + width + 14 - half), top + height + 4);
  }
  c.textAlign = 'right';
  c.textBaseline = 'middle';
  if (!plot.noYTicks)
    for (const at of ticks(plot.y[0], plot.y[1], height / 32)) {
      const y = Math.round(pen.y(at)) + 0.5;
      c.strokeStyle = colour.line;
      line(c, left, y, left + width, y);
      c.fillStyle = colour.faint;
      c.fillText(tickText(at), left - 5, y);
    }
  c.fillStyle = colour.text;
  c.textAlign = 'center';
  c.textBaseline = 'bottom';
  c.fillText(plot.xLabel, left + width / 2, top + height + 33, width + left);
  c.save();
  c.translate(2, top + height / 2);
  c.rotate(-Math.PI / 2);
  c.textBaseline = 'top';
  c.fillText(plot.yLabel, 0, 0, height + 20);
  c.restore();
}
function tickText(v: number): string {
  const short = Number(v.toPrecision(6));
  if (short !== 0 && (Math.abs(short) < 1e-3 || Math.abs(short) >= 1e6)) return short.toExponential().replace('e+', 'e').replace(/^-/, '−');
  return digits(short, 6).replace(/(\.\d*?)0+$/, '$1').replace(/\.$/, '');
}
const ruler = () => (measure ??= document.createElement('canvas').getContext('2d')!);
let measure: CanvasRenderingContext2D | undefined;
/** Room left of the axis: its widest number and the label. */
function leftMargin(plot: Plot, height: number): number {
  if (plot.noYTicks) return 20;
  ruler().font = font;
  return 22 + Math.max(12, ...ticks(plot.y[0], plot.y[1], height / 32).map((v) => ruler().measureText(tickText(v)).width));
}
export function line(c: CanvasRenderingContext2D, x0: number, y0: number, x1: number, y1: number): void {
  c.beginPath();
  c.moveTo(x0, y0);
  c.lineTo(x1, y1);
  c.stroke();
}
/** Points as small squares (many) or discs (few); rows that are not numbers are left out. Returns how many it drew. */
export function points(pen: Pen, xs: ArrayLike<number>, ys: ArrayLike<number>, colour: string, size = 2,
                       hollow = false): number {
  const { c } = pen;
  const stride = Math.max(1, Math.ceil(xs.length / mostPoints));
  c.fillStyle = c.strokeStyle = colour;
  c.lineWidth = 1;
  c.globalAlpha = xs.length > 2000 ? 0.45 : 0.75;
  let drawn = 0;
  for (let i = 0; i < xs.length; i += stride) {
    const x = pen.x(xs[i]), y = pen.y(ys[i]);
    if (!(x >= pen.left - 3 && x <= pen.left + pen.width + 3 && y >= pen.top - 3 && y <= pen.top + pen.height + 3)) continue;
    drawn++;
    if (hollow) c.strokeRect(x - size, y - size, 2 * size, 2 * size);
    else c.fillRect(x - size, y - size, 2 * size, 2 * size);
  }
  c.globalAlpha = 1;
  return drawn;
}
/** The rows of the chosen sample: larger and ringed, because not everybody distinguishes the colours. */
export function rings(pen: Pen, xs: ArrayLike<number>, ys: ArrayLike<number>, rows: Iterable<number>): void {
  const { c } = pen;
  for (const i of rows) {
    const x = pen.x(xs[i]), y = pen.y(ys[i]);
    if (Number.isNaN(x) || Number.isNaN(y)) continue;
    c.beginPath();
    c.arc(x, y, 4, 0, 2 * Math.PI);
    c.fillStyle = pen.colour.chosen;
    c.strokeStyle = pen.colour.text;
    c.lineWidth = 1.2;
    c.fill();
    c.stroke();
  }
}

function sized(canvas: HTMLCanvasElement, width: number, height: number): CanvasRenderingContext2D {
  const ratio = Math.max(1, Math.min(3, devicePixelRatio || 1));
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.height = `${height}px`;
  const c = canvas.getContext('2d')!;
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  return c;
}

let tip: HTMLElement | undefined;
function showTip(text: string, x: number, y: number): void {
  if (!tip) document.body.append((tip = h('div', { class: 'tip' })));
  tip.hidden = !text;
  tip.textContent = text;
  tip.style.left = `${Math.min(x + 14, innerWidth - 230)}px`;
  tip.style.top = `${y + 14}px`;
}

/** The plot as a figure; drawn when it comes near the window. */
export function plotFigure(plot: Plot): HTMLElement {
  const base = h('canvas', { role: 'img', 'aria-label': `${plot.title}. ${plot.xLabel}; ${plot.yLabel}.` });
  const top = h('canvas', { class: 'over', 'aria-hidden': 'true' });
  const holder = h('div', { class: 'canvas' }, base, top);
  const figure = h('figure', { class: 'plot' },
    h('figcaption', {}, h('span', {}, plot.title), csvButton(plot.file, plot.csv)), holder,
    plot.note ? h('p', { class: 'note' }, plot.note) : null);
  let pen: Pen | undefined;
  const layout = (): Omit<Pen, 'c' | 'colour'> & { total: number; whole: number } => {
    const whole = Math.max(140, holder.clientWidth || 320);
    const right = 14, above = 8, below = 36;
    const left = leftMargin(plot, plot.aspect ? (whole - 60) * plot.aspect : (plot.height ?? 220) - above - below);
    const width = whole - left - right;
    const height = plot.aspect ? width * plot.aspect : (plot.height ?? 220) - above - below;
    const [x0, x1] = plot.x, [y0, y1] = plot.y;
    return {
      whole, total: height + above + below, left, top: above, width, height,
      x: (v) => left + ((v - x0) / (x1 - x0 || 1)) * width,
      y: (v) => above + (plot.yDown ? (v - y0) / (y1 - y0 || 1) : 1 - (v - y0) / (y1 - y0 || 1)) * height,
    };
  };
  const clipped = (p: Pen, work: () => void) => {
    p.c.save();
    p.c.beginPath();
    p.c.rect(p.left - 4, p.top - 4, p.width + 8, p.height + 8);
    p.c.clip();
    work();
    p.c.restore();
  };
  const drawOver = () => {
    if (!pen || !plot.over) return;
    const { whole, total, ...rest } = layout();
    const p = { ...rest, c: sized(top, whole, total), colour: colours() };
    if (chosenSample() >= 0) clipped(p, () => plot.over!(p, chosenSample()));
  };
  const draw = () => {
    const { whole, total, ...rest } = layout();
    pen = { ...rest, c: sized(base, whole, total), colour: colours() };
    frame(plot, pen);
    clipped(pen, () => plot.draw(pen!));
    drawOver();
  };
  const nearest = (event: MouseEvent): number => {
    if (!plot.pick || !pen) return -1;
    const box = holder.getBoundingClientRect();
    const mx = event.clientX - box.left, my = event.clientY - box.top;
    let best = -1, least = 14 * 14;
    for (let i = 0; i < plot.pick.sample.length; i++) {
      const dx = pen.x(plot.pick.x[i]) - mx, dy = pen.y(plot.pick.y[i]) - my;
      const d = dx * dx + dy * dy;
      if (d < least) { least = d; best = i; }
    }
    return best;
  };
  if (plot.pick) {
    holder.classList.add('picks');
    holder.addEventListener('click', (event) => {
      const i = nearest(event);
      if (i >= 0) choose(plot.pick!.sample[i]);
    });
    holder.addEventListener('mousemove', (event) => {
      const i = plot.pick!.sample.length > 60000 ? -1 : nearest(event);
      showTip(i < 0 ? '' : (plot.pick!.text?.(i) ?? ''), event.clientX, event.clientY);
    });
    holder.addEventListener('mouseleave', () => showTip('', 0, 0));
  }
  holder.style.minHeight = plot.aspect ? '160px' : `${plot.height ?? 220}px`;
  lazily(holder, () => {
    draw();
    onTheme(draw);
    if (plot.over) onChoice(drawOver);
    let last = holder.clientWidth;
    new ResizeObserver(() => {
      if (holder.clientWidth && holder.clientWidth !== last) { last = holder.clientWidth; draw(); }
    }).observe(holder);
  });
  return figure;
}

/** [low, high] with some air on both sides; of equal numbers something around them. */
export function padded([low, high]: [number, number], share = 0.06): [number, number] {
  const air = (high - low) * share || Math.abs(high) * 0.1 || 1;
  return [low - air, high + air];
}
