// Puts the page together: the first screen at once, everything else when the reader comes to it.
import './style.css';
import 'uplot/dist/uPlot.min.css';
import { curvesSection } from './bending';
import { context, isEmpty, isOverview, type Context, type PageData } from './data';
import { drawAll, h, missing, type Section } from './dom';
import { firstScreen, masthead, titleOf } from './first';
import { inputScreen, inputSections } from './inputs';
import { changesSection, correlationSection, coverageSection, sigmasSection } from './numbers';
import { overviewSections } from './overview';
import { byJointSection, jointsSection, loopsSection, sampleText, samplesSection, sensorsSection } from './residuals';
import { sceneSection } from './scene';
import { choose, choosePart, chosenSample, isDark, onChoice, onPart, onTheme, setTheme } from './state';
import { errorsSection, groupsSection, influenceSection, licencesSection, noiseSection, originSection, stepsSection, validationSection, weakSection } from './tables';

function buttons(): HTMLElement[] {
  const theme = h('button', { type: 'button', id: 'theme', click: () => setTheme(isDark() ? 'light' : 'dark') });
  const say = () => { theme.textContent = isDark() ? 'Light' : 'Dark'; theme.setAttribute('aria-label', `${theme.textContent} colours`); };
  say();
  onTheme(say);
  return [theme, h('button', { type: 'button', click: () => print() }, 'Print')];
}

function contents(sections: Section[], top: boolean): HTMLElement {
  const links = [...(top ? [{ id: 'top', title: 'In short' }] : []), ...sections].map((s) => h('li', {}, h('a', { href: `#${s.id}` }, s.id === 'verdict' ? 'In short' : s.title)));
  return h('nav', { class: 'contents', 'aria-label': 'Contents' }, h('ol', {}, ...links));
}
/** Marks the section in the table of contents that is being read. */
function follow(nav: HTMLElement, elements: HTMLElement[]): void {
  const seen = new Set<string>();
  const observer = new IntersectionObserver((entries) => {
    for (const e of entries) e.isIntersecting ? seen.add(e.target.id) : seen.delete(e.target.id);
    const first = elements.find((element) => seen.has(element.id));
    for (const a of nav.querySelectorAll('a')) a.classList.toggle('here', a.hash === `#${first?.id}`);
  }, { rootMargin: '-10% 0px -60% 0px' });
  for (const element of elements) observer.observe(element);
}

function showSensor(name: string): void {
  document.getElementById('residuals')?.scrollIntoView();
  // The section is made when it comes near; its parts are there a moment later.
  setTimeout(() => [...document.querySelectorAll<HTMLElement>('#residuals .sensor')]
    .find((part) => part.dataset.part === `sensor/${name}`)?.scrollIntoView({ block: 'start' }), 300);
}

/** The strip that shows the chosen sample and chooses another. */
function sampleStrip(of: Context): HTMLElement {
  const ids = of.samples.id, word = of.result.kind === 'plan' ? 'posture' : 'sample';
  const select = h('select', { 'aria-label': `Chosen ${word}`, change: () => choose(select.selectedIndex - 1, false) },
    h('option', {}, `no ${word} chosen`), ...ids.map((id) => h('option', {}, id)));
  const text = h('span', { class: 'numbers', 'aria-live': 'polite' });
  const step = (by: number) => choose((Math.max(chosenSample(), by > 0 ? -1 : ids.length) + by + ids.length) % ids.length, false);
  const marks = h('style'), partMarks = h('style');
  document.head.append(marks, partMarks);
  onChoice((sample) => {
    select.selectedIndex = sample + 1;
    text.textContent = sample >= 0 ? sampleText(of, sample) : '';
    // A rule, not a class: rows that are drawn later (sorted, "show all") are marked as well.
    marks.textContent = sample >= 0 ? `tr[data-row="${sample}"] > * { background: var(--mark) !important }` : '';
    document.body.classList.toggle('has-sample', sample >= 0);
  });
  const about = h('span', { class: 'about' });
  onPart((part, point) => {
    // Rows of what belongs to it, in every table; and where its residuals are drawn.
    partMarks.textContent = part ? `[data-part="${CSS.escape(part)}"] > *, [data-part="${CSS.escape(part)}"] > h3 { background: var(--mark) }` : '';
    const [kind, name] = [part.split('/')[0], part.slice(part.indexOf('/') + 1)];
    about.replaceChildren(...(part ? [h('b', {}, `${kind} ${name}`), point >= 0 ? ` point ${point} ` : ' ',
      kind === 'sensor' ? h('a', { href: '#residuals', click: (event) => { event.preventDefault(); showSensor(name); } }, 'its residuals')
        : h('a', { href: '#changes' }, 'its changes'), ' ',
      h('button', { type: 'button', 'aria-label': 'Clear the choice', click: () => choosePart('') }, '×')] : []));
    document.body.classList.toggle('has-part', part !== '');
  });
  addEventListener('keydown', (event) => {
    const at = event.target as HTMLElement;
    if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT|TEXTAREA|CANVAS)$/.test(at.tagName) || at.classList?.contains('scroll')) return;
    if (event.key === 'ArrowRight') step(1);
    else if (event.key === 'ArrowLeft') step(-1);
    else if (event.key === 'Escape') { choose(-1, false); choosePart(''); }
  });
  return h('div', { class: 'strip', role: 'region', 'aria-label': `Chosen ${word}` },
    h('button', { type: 'button', 'aria-label': `Previous ${word}`, click: () => step(-1) }, '←'), select,
    h('button', { type: 'button', 'aria-label': `Next ${word}`, click: () => step(1) }, '→'), text, about);
}

/** On paper everything is drawn, in light colours, laid out and drawn again at the width of the paper. Nothing of it may
 *  wait for a frame of the screen: none comes before the page is printed. */
function printing(): void {
  const root = document.documentElement;
  let before: string | null = null;
  let closed: HTMLDetailsElement[] = [];
  addEventListener('beforeprint', () => {
    if (root.classList.contains('paper')) return;
    before = root.dataset.theme ?? null;
    root.classList.add('paper');
    closed = [...document.querySelectorAll<HTMLDetailsElement>('.held details:not([open])')];
    for (const details of closed) details.open = true;
    drawAll();
    setTheme('light');
  });
  addEventListener('afterprint', () => {
    root.classList.remove('paper');
    for (const details of closed) details.open = false;
    setTheme(before);
  });
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => setTheme(document.documentElement.dataset.theme ?? null));
}

function lay(head: HTMLElement, sections: Section[], strip: HTMLElement | null): void {
  const nav = contents(sections, !head.classList.contains('masthead'));
  const top = h('div', { id: 'top' }, head);
  const main = h('main', { id: 'main' }, top, ...sections.map((s) => s.element));
  document.getElementById('page')!.append(nav, main);
  if (strip) document.body.append(strip);
  follow(nav, [top, ...sections.map((s) => s.element)]);
  printing();
  performance.mark('kincal-first-screen');
}

function reportSections(of: Context): Section[] {
  return [errorsSection(of), validationSection(of), sceneSection(of), loopsSection(of), weakSection(of), sigmasSection(of), changesSection(of),
    groupsSection(of), samplesSection(of), sensorsSection(of), jointsSection(of), curvesSection(of), byJointSection(of), coverageSection(of), influenceSection(of), noiseSection(of),
    correlationSection(of), stepsSection(of), originSection(of), licencesSection()].filter((s): s is Section => s !== null);
}

function start(): void {
  let data: PageData;
  try {
    data = JSON.parse(document.getElementById('data')!.textContent!) as PageData;
  } catch (error) {
    document.getElementById('page')!.append(h('main', {}, h('h1', {}, 'This report cannot be read'), missing(String(error))));
    return;
  }
  if (isEmpty(data)) {
    document.getElementById('page')!.append(h('main', {}, h('h1', {}, 'Calibration report'), missing('This is the empty template: kincal writes the data of a calibration into it.')));
    return;
  }
  if (isOverview(data)) {
    document.title = data.title ? `Calibrations: ${data.title}` : 'Calibrations';
    const head = h('header', { class: 'masthead' }, h('h1', {}, document.title), h('div', { class: 'buttons' }, ...buttons()));
    lay(head, [...overviewSections(data), licencesSection()], null);
    return;
  }
  const of = context(data);
  document.title = titleOf(of);
  const head = h('div', {}, masthead(of, buttons()), of.result.kind ? inputScreen(of) : firstScreen(of));
  lay(head, of.result.kind ? inputSections(of) : reportSections(of), of.samples.id.length ? sampleStrip(of) : null);
}
start();
