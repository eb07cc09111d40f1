// Elements of the page. Text goes in as text, never as markup: names of a rig are shown, not run.
import { csv, type Rows } from './format';

export type Child = Node | string | number | null | undefined | false;
type Attributes = Record<string, string | number | boolean | undefined | ((event: Event) => void)>;

function fill<E extends Element>(element: E, attributes: Attributes, children: Child[]): E {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === false) continue;
    if (typeof value === 'function') element.addEventListener(name, value);
    else element.setAttribute(name, value === true ? '' : String(value));
  }
  for (const child of children)
    if (child !== null && child !== undefined && child !== false)
      element.append(child instanceof Node ? child : document.createTextNode(String(child)));
  return element;
}
export function h<K extends keyof HTMLElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]) {
  return fill(document.createElement(tag), attributes, children);
}
export function svg<K extends keyof SVGElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]) {
  return fill(document.createElementNS('http://www.w3.org/2000/svg', tag), attributes, children);
}

/** Offers a text as a file. */
export function download(name: string, text: string): void {
  const address = URL.createObjectURL(new Blob([text], { type: 'text/csv' }));
  const link = h('a', { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}
export function csvButton(name: string, rows: () => Rows): HTMLElement {
  const file = `${name.replace(/[^A-Za-z0-9._-]+/g, '_').slice(0, 80)}.csv`;
  return h('button', {
    type: 'button', class: 'csv', title: `Download the data: ${file}`, 'aria-label': `Download ${file}`,
    click: () => download(file, csv(rows())),
  }, 'CSV');
}

// ---- parts that are drawn only when they come near the window
const waiting = new Map<Element, () => void>();
const observers = new Map<string, IntersectionObserver>();

function drawNow(element: Element): void {
  const draw = waiting.get(element);
  if (!draw) return;
  waiting.delete(element);
  for (const observer of observers.values()) observer.unobserve(element);
  draw();
}
/** Calls `draw` once, when the element comes near the window; before printing (drawAll) in any case. */
export function lazily(element: Element, draw: () => void, margin = '300px'): void {
  let observer = observers.get(margin);
  if (!observer) {
    observer = new IntersectionObserver((entries) => {
      for (const entry of entries) if (entry.isIntersecting) drawNow(entry.target);
    }, { rootMargin: margin });
    observers.set(margin, observer);
  }
  waiting.set(element, draw);
  observer.observe(element);
}
let onPaper = false;                                         // tables that are made for print are whole at once
export function drawAll(): void {
  onPaper = true;
  while (waiting.size) for (const element of [...waiting.keys()]) drawNow(element);
}

// ---- sections
export interface Section { id: string; title: string; element: HTMLElement }

/** A section: heading, instructions for reading it, and a body that is made when it comes near the window. */
export function section(id: string, title: string, how: string, body: (host: HTMLElement) => void,
                        height = 200, margin?: string): Section {
  const host = h('div', { class: 'body', style: `min-height:${height}px` });
  const element = h('section', { id, 'aria-labelledby': `${id}-title` },
    h('h2', { id: `${id}-title` }, title), h('p', { class: 'how' }, how), host);
  lazily(host, () => {
    host.style.minHeight = '';
    // An error in one section must not remove the others.
    try {
      body(host);
    } catch (error) {
      console.error(error);
      host.append(missing(`This section cannot be drawn: ${error instanceof Error ? error.message : error}.`));
    }
  }, margin);
  return { id, title, element };
}
export function missing(text: string): HTMLElement {
  return h('p', { class: 'missing' }, text);
}

// ---- tables
export interface Column<R> {
  title: string;
  /** The shown content. */
  cell: (row: R) => Child;
  /** The value for sorting and CSV; default: the shown text. */
  value?: (row: R) => string | number | null | undefined;
  numeric?: boolean;
  hint?: string;
  /** A common heading above neighbouring columns. */
  group?: string;
  /** Left out of CSV (a drawing). */
  drawing?: boolean;
}
export interface TableOptions<R> {
  caption: string; file: string; most?: number;
  /** Called with each new row, to mark or link it. */
  row?: (element: HTMLTableRowElement, row: R) => void;
}

function compare(a: unknown, b: unknown): number {
  if (typeof a === 'number' && typeof b === 'number') return a - b;
  if (a === null || a === undefined || Number.isNaN(a)) return -1;
  if (b === null || b === undefined || Number.isNaN(b)) return 1;
  return String(a).localeCompare(String(b), 'en');
}

/** A table that sorts by a click on a heading, shows the first rows and all on demand, and gives its CSV. */
export function dataTable<R>(rows: R[], columns: Column<R>[], options: TableOptions<R>): HTMLElement {
  const most = options.most ?? 25;
  const whole = rows.length <= 200;                          // on paper: longer ones would fill a book
  let all = rows.length <= most + 3 || (onPaper && whole);
  let order = rows;
  let by = -1, down = true;
  const body = h('tbody');
  const more = h('button', { type: 'button', class: 'more', click: () => { all = true; draw(); } });
  const value = (column: Column<R>, row: R) => {
    if (column.value) return column.value(row);
    const cell = column.cell(row);
    return cell instanceof Node ? cell.textContent : cell === false ? '' : cell;
  };
  const starts = (column: Column<R>, i: number) => column.group !== undefined && columns[i - 1]?.group !== column.group;
  const kind = (column: Column<R>, i: number) => [column.numeric ? 'n' : '', starts(column, i) ? 'first-of-group' : ''].join(' ').trim() || undefined;
  const headings = columns.map((column, i) => h('th', { scope: 'col', class: kind(column, i) },
    column.drawing ? column.title : h('button', {
      type: 'button', class: 'sort', title: column.hint ?? `Sort by ${column.title}`,
      click: () => {
        down = by === i ? !down : column.numeric === true;
        by = i;
        const sign = down ? -1 : 1;
        order = [...rows].sort((a, b) => sign * compare(value(column, a), value(column, b)));
        draw();
      },
    }, column.title)));
  function draw(): void {
    const shown = all ? order : order.slice(0, most);
    body.replaceChildren(...shown.map((row) => {
      const element = h('tr', {}, ...columns.map((column, i) => i === 0
        ? h('th', { scope: 'row' }, column.cell(row))
        : h('td', { class: kind(column, i) }, column.cell(row))));
      options.row?.(element, row);
      return element;
    }));
    headings.forEach((th, i) => {
      if (i === by) th.setAttribute('aria-sort', down ? 'descending' : 'ascending');
      else th.removeAttribute('aria-sort');
    });
    more.hidden = all;
    more.textContent = `Show all ${rows.length}`;
  }
  draw();
  const groups = columns.some((column) => column.group !== undefined)
    ? h('tr', { class: 'groups' }, ...columns.flatMap((column, i) => {
      if (column.group === undefined) return [h('td', {})];
      if (!starts(column, i)) return [];
      const after = columns.slice(i).findIndex((other) => other.group !== column.group);
      return [h('th', { scope: 'colgroup', class: 'first-of-group', colspan: after < 0 ? columns.length - i : after }, column.group)];
    })) : null;
  const kept = columns.filter((column) => !column.drawing);
  const everything = () => [kept.map((c) => (c.group === undefined ? c.title : `${c.group}: ${c.title}`)), ...order.map((row) => kept.map((c) => value(c, row)))] as Rows;
  addEventListener('beforeprint', () => { if (!all && whole) { all = true; draw(); } });
  return h('div', { class: rows.length <= 16 ? 'table short' : 'table' },
    h('p', { class: 'caption' }, options.caption),
    h('div', { class: 'scroll', tabindex: 0, role: 'region', 'aria-label': options.caption },
      h('table', { 'aria-label': options.caption }, h('thead', {}, groups, h('tr', {}, ...headings)), body)),
    h('div', { class: 'tools' }, more, csvButton(options.file, everything)));
}
