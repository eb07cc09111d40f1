// Lines over iterations or time, by uPlot. uPlot takes its colours when it is made: another theme makes it anew.
import uPlot from 'uplot';
import { csvButton, h } from './dom';
import { digits, type Rows } from './format';
import { colours, onTheme, type Theme } from './state';

export interface Lines {
  title: string; file: string; wide?: boolean; live?: boolean; height: number; csv: () => Rows;
  data: uPlot.AlignedData;
  /** Axes get the theme's colours besides what is given here. */
  options: (c: Theme) => { series: uPlot.Series[]; axes: uPlot.Axis[]; scales: uPlot.Scales };
}

export function lineFigure(host: HTMLElement, lines: Lines): void {
  const place = h('div', { class: 'uplot-host', role: 'img', 'aria-label': lines.title });
  host.append(h('figure', { class: lines.wide ? 'plot wide' : 'plot' },
    h('figcaption', {}, h('span', {}, lines.title), csvButton(lines.file, lines.csv)), place));
  let plot: uPlot | undefined;
  const draw = () => {
    plot?.destroy();
    const c = colours();
    const axis = { stroke: c.faint, grid: { stroke: c.line, width: 1 }, ticks: { stroke: c.line, width: 1 }, font: '11px system-ui', labelFont: '11px system-ui' };
    const { series, axes, scales } = lines.options(c);
    plot = new uPlot({ width: place.clientWidth || 320, height: lines.height, series, scales, axes: axes.map((a) => ({ ...axis, ...a, grid: { ...axis.grid, ...a.grid }, ticks: { ...axis.ticks, ...a.ticks } })), legend: { live: lines.live ?? true } }, lines.data, place);
  };
  draw();
  onTheme(draw);
  new ResizeObserver(() => {
    if (plot && place.clientWidth && Math.abs(plot.width - place.clientWidth) > 2) plot.setSize({ width: place.clientWidth, height: lines.height });
  }).observe(place);
}

/** An axis of a logarithmic scale: one tick a decade; 1, 2, 5 where there are few. */
export function logAxis(): uPlot.Axis {
  const filter = (_: uPlot, at: number[]) => {
    const decades = Math.log10(at[at.length - 1] / at[0]);
    return at.map((v) => {
      const lead = Number((v / 10 ** Math.floor(Math.log10(v) + 1e-9)).toPrecision(3));
      return lead === 1 || (decades < 2.5 && (lead === 2 || lead === 5)) ? v : null;
    });
  };
  const text = (v: number) => (v >= 1e5 ? v.toExponential(0).replace('e+', 'e') : digits(v, 1));
  return { size: 52, values: (_, at) => at.map((v) => (v === null ? '' : text(v))), filter, grid: { filter }, ticks: { filter } };
}
