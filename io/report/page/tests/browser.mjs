// node tests/browser.mjs REPORT.html [--shots DIR] [--within MS] [--missing]
// Opens a report in a headless browser and proves: no error on the console and no request but the file itself; the first
// screen stands in time; every section is there and has the numbers of the embedded result; a sample that is chosen
// is marked everywhere; the 3-D view draws and turns; names are text, never elements; everything is drawn for print.
// With --missing it opens the page again and again, each time without one key of the data: no error, and everything draws.
// Does not prove that it looks well: --shots takes the pictures for that.
import { mkdirSync, readFileSync } from 'node:fs';
import { resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { chromium } from 'playwright-core';

const args = process.argv.slice(2);
const option = (name) => (args.includes(name) ? args.splice(args.indexOf(name), 2)[1] : undefined);
const shots = option('--shots');
const missing = args.includes('--missing') && args.splice(args.indexOf('--missing'), 1).length > 0;
const within = Number(option('--within') ?? 1000);
const file = resolve(args[0]);
const data = JSON.parse(/<script type="application\/json" id="data">([\s\S]*?)<\/script>/.exec(readFileSync(file, 'utf8'))[1]);
const overview = Array.isArray(data.overview);

const failures = [];
const check = (ok, what) => { console.log(`${ok ? 'ok  ' : 'FAIL'} ${what}`); if (!ok) failures.push(what); };

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', headless: true,
  args: ['--headless', '--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update',
    '--disable-sync', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});
const context = await browser.newContext({ viewport: { width: 1400, height: 900 }, colorScheme: 'light' });
const page = await context.newPage();
await page.setContent('<p>warm</p>');                       // the browser's own start is not the page's
await page.screenshot();
const errors = [], requests = [];
page.on('console', (message) => { if (message.type() === 'error') errors.push(message.text()); });
page.on('pageerror', (error) => errors.push(String(error.stack ?? error)));
page.on('request', (request) => { if (!/^(file|blob|data):/.test(request.url())) requests.push(request.url()); });

await page.goto(pathToFileURL(file).href, { waitUntil: 'commit' });
await page.waitForSelector('#verdict');
const first = await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => setTimeout(() => done(
  Math.max(performance.getEntriesByName('kincal-first-screen')[0]?.startTime ?? Infinity, performance.getEntriesByType('paint').at(-1)?.startTime ?? 0))))));
check(first < within, `first screen after ${Math.round(first)} ms (at most ${within})`);
const text = (selector) => page.locator(selector).first().innerText();
// What the page writes for a number: three digits, a proper minus.
const digits = (x) => page.evaluate((v) => {
  const s = Math.abs(v);
  if (v === 0) return '0';
  if (s >= 1e6 || s < 1e-4) return v.toExponential(2).replace('e+', 'e').replace(/^-/, '−');
  return (s >= 100 ? Math.round(v).toString() : Number(v.toPrecision(3)).toFixed(Math.max(0, 2 - Math.floor(Math.log10(Number(s.toPrecision(3))) + 1e-12)))).replace('-', '−');
}, x);

/** Waits until something holds (a loaded machine draws late); says at last whether it does. */
async function until(holds, most = 10000) {
  for (const end = Date.now() + most; Date.now() < end; await page.waitForTimeout(60)) if (await holds()) return true;
  return holds();
}

async function reach(id) {
  await page.locator(`#${id}`).scrollIntoViewIfNeeded();
  await page.evaluate((i) => document.getElementById(i).scrollIntoView(), id);
  await until(() => page.locator(`#${id} .body > *`).count());
}

if (overview) {
  check((await page.locator('#verdict tbody tr').count()) === data.overview.length, 'a row for each result');
  const links = await page.locator('#verdict a').evaluateAll((all) => all.map((a) => a.getAttribute('href')));
  check(links.every((link) => !/^[a-z]+:/i.test(link)), 'links lead to files beside this one');
} else {
  const result = data.result;
  const words = { good: 'Good', doubts: 'Usable, with doubts', no: 'Do not use' };
  if (result.verdict) check((await text('.verdict')).includes(words[result.verdict.use]), `verdict: ${words[result.verdict.use]}`);
  if (result.verdict) check((await text('.verdict')).includes(`What to do: ${result.verdict.next?.[0] ?? 'nothing'}`), 'what to do is the second line');
  const ratio = (result.chi2_data ?? result.chi2) / (result.dof_data ?? result.dof);
  if (Number.isFinite(ratio)) check((await text('#verdict')).includes(await digits(ratio)), `chi2/dof ${await digits(ratio)}`);
  const sections = await page.locator('main > section').evaluateAll((all) => all.map((s) => s.id));
  const wanted = result.kind === 'plan' ? ['forecast', 'robot', 'postures', 'coverage', 'origin', 'licences'] : result.kind === 'check' ? ['findings', 'tested', 'coverage', 'origin', 'licences']
    : result.kind ? ['errors', 'samples', 'residuals', 'byjoint', 'coverage', 'origin', 'licences'] : ['errors', 'robot', 'loops', 'weak', 'sigmas', 'changes', 'samples', 'residuals', 'joints', 'coverage', 'influence', 'correlation', 'steps', 'origin', 'licences'];
  check(wanted.every((id) => sections.includes(id)), `sections: ${sections.join(' ')}`);
  for (const id of sections) {
    await reach(id);
    check((await page.locator(`#${id} .body > *`).count()) > 0 && (await text(`#${id} h2`)).length > 3, `section ${id} has content`);
  }
  const errorsText = sections.includes('errors') ? await text('#errors') : '';
  for (const finding of result.findings ?? []) check((await text('#verdict')).includes(finding.text.slice(1, 40)), `finding ${finding.id} on the first screen`);
  for (const [name, sensor] of Object.entries(result.sensors ?? {})) {
    const v = sensor.train?.rms_as_read;
    if (v) check(errorsText.includes(name) && errorsText.includes(await digits(v * (sensor.unit === 'px' ? 1 : 1000))), `error of ${name}: ${await digits(v * (sensor.unit === 'px' ? 1 : 1000))}`);
  }
  for (const row of result.validation?.stages?.rows ?? [])
    check((await text('#curves')).includes(await digits(row.rms * (row.unit === 'px' ? 1 : 1000))), `held-out error ${row.added.length ? `with ${row.added}` : 'of the rigid robot'}`);
  if (result.curves) check((await page.locator('#curves canvas.over').count()) === Object.keys(result.curves).length, 'a plot for each curve');
  if (result.plan) check((await text('#verdict')).includes(await digits(result.plan.forecast.at(-1).planned * (result.plan.unit === 'm' ? 1000 : 1))), 'the forecast on the first screen');
  if (result.steps?.length) check((await text('#steps')).includes(await digits(result.steps.at(-1).chi2)), 'chi2 of the last step');
  if (result.input?.rig) check((await text('#origin')).includes(result.input.rig), 'hash of the rig');
  for (const weak of (result.weak_directions ?? []).slice(0, 2)) check((await text('#weak')).includes(weak.why.slice(1, 60)), 'why a direction is weak');

  if (sections.includes('samples') && data.samples?.id.length && data.residuals?.sample?.length) {
    // Ink of the chosen sample on the layer above a plot.
    const ink = (selector) => page.locator(selector).first().evaluate((c) => {
      const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
      let n = 0;
      for (let i = 3; i < d.length; i += 4) if (d[i]) n++;
      return n;
    });
    await reach('samples');
    check((await ink('#samples canvas.over')) === 0, 'nothing is marked before a sample is chosen');
    const button = page.locator('#samples button.link').first();
    const chosen = Number(await button.getAttribute('data-sample'));
    await button.click();
    check((await page.locator('.strip select').evaluate((s) => s.selectedIndex)) === chosen + 1, 'a click on a row chooses its sample');
    check(await until(async () => (await ink('#samples canvas.over')) > 0), 'it is marked in the plot');
    const before = await page.locator('#samples tbody tr').first().locator('td').first().evaluate((td) => getComputedStyle(td).backgroundColor);
    check(before !== 'rgba(0, 0, 0, 0)', 'and in the table');
    const sensor = data.residuals.sensor[data.residuals.sample.indexOf(chosen)];
    const holder = page.locator('#residuals .sensor', { has: page.locator('h3').getByText(data.names.sensors[sensor], { exact: true }) });
    await holder.scrollIntoViewIfNeeded();
    const marked = () => holder.locator('canvas.over').evaluateAll((all) => all.filter((c) => {
      const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
      return d.some((v, i) => i % 4 === 3 && v);
    }).length);
    // (What is drawn above on the way moves it out of the window again.)
    check(await until(async () => { await holder.scrollIntoViewIfNeeded(); return (await marked()) >= 2; }), `and in ${await marked()} plots of its sensor`);
    await button.press('ArrowRight');
    check((await page.locator('.strip select').evaluate((s) => s.selectedIndex)) === ((chosen + 1) % data.samples.id.length) + 1, 'the arrow key goes to the next sample');
    await reach('samples');
    const canvas = page.locator('#samples .canvas').first();
    await page.keyboard.press('Escape');
    const box = await canvas.boundingBox();
    for (let x = 60; x < box.width - 20 && (await page.locator('.strip select').evaluate((s) => s.selectedIndex)) === 0; x += 12)
      for (let y = 20; y < box.height - 40 && (await page.locator('.strip select').evaluate((s) => s.selectedIndex)) === 0; y += 24)
        await canvas.click({ position: { x, y } });
    check((await page.locator('.strip select').evaluate((s) => s.selectedIndex)) > 0, 'a click in a plot chooses a sample');
  }
  if (sections.includes('robot') && result.scene?.links?.length) {
    await reach('robot');
    await page.waitForTimeout(1000);
    const view = page.locator('.view3d canvas');
    const one = await view.screenshot();
    const box = await view.boundingBox();
    await page.mouse.move(box.x + 300, box.y + 200);
    await page.mouse.down();
    await page.mouse.move(box.x + 420, box.y + 230, { steps: 4 });
    await page.mouse.up();
    let two = one;
    await until(async () => !(two = await view.screenshot()).equals(one), 5000);
    const many = await view.evaluate((c) => {
      const copy = document.createElement('canvas');
      copy.width = c.width; copy.height = c.height;
      const d = copy.getContext('2d'); d.drawImage(c, 0, 0);
      const p = d.getImageData(0, 0, c.width, c.height).data;
      const seen = new Set();
      for (let i = 0; i < p.length; i += 4) seen.add((p[i] << 16) | (p[i + 1] << 8) | p[i + 2]);
      return seen.size;
    });
    check(many > 20, `the 3-D view draws (${many} colours)`);
    check(!one.equals(two), 'and turns');
  }
}
const markup = await page.evaluate(() => ({
  images: document.querySelectorAll('#page img').length, bold: [...document.querySelectorAll('#page script, #page iframe')].length,
}));
check(markup.images === 0 && markup.bold === 0, 'names are text, never elements');
const download = await Promise.all([page.waitForEvent('download'), page.locator('button.csv').first().click()]).then(([d]) => d.path());
check(readFileSync(download, 'utf8').split('\r\n').length > 2, 'a CSV file comes from its button');
await page.emulateMedia({ media: 'print' });
await page.evaluate(() => dispatchEvent(new Event('beforeprint')));
await page.waitForTimeout(500);
check((await page.evaluate(() => [...document.querySelectorAll('.body')].filter((b) => !b.childElementCount).length)) === 0, 'everything is drawn for print');
// What the event changed at once is what is printed: no frame of the screen comes in between.
const stretched = await page.evaluate(async () => {
  dispatchEvent(new Event('afterprint'));
  dispatchEvent(new Event('beforeprint'));
  await null;
  const wide = [...document.querySelectorAll('.canvas canvas:not(.over), .uplot-host canvas')].filter((c) => Math.abs(c.width / devicePixelRatio - c.clientWidth) > 2);
  const lost = [...document.querySelectorAll('.name3d:not([hidden])')].filter((name) => !name.style.transform);
  return { wide: wide.length, lost: lost.length, page: document.getElementById('page').clientWidth, marks: [...document.querySelectorAll('.over')].filter((c) => c.checkVisibility()).length };
});
check(stretched.wide === 0 && stretched.page < 700, 'at the width of the paper');
check(stretched.lost === 0 && stretched.marks === 0, 'names in their places, nothing over the plots');
check((await page.locator('.table').evaluateAll((all) => all.filter((t) => !t.querySelector('.more').hidden && Number(/\d+/.exec(t.querySelector('.more').textContent)[0]) <= 200).length)) === 0, 'with whole tables');
if (shots) {
  mkdirSync(shots, { recursive: true });
  await page.pdf({ path: `${shots}/print.pdf`, format: 'A4' });
  await page.evaluate(() => dispatchEvent(new Event('afterprint')));
  await page.emulateMedia({ media: 'screen' });
  for (const width of [1400, 800]) for (const theme of ['light', 'dark']) {
    await page.setViewportSize({ width, height: width === 1400 ? 900 : 1000 });
    await page.evaluate(() => delete document.documentElement.dataset.theme);
    await page.emulateMedia({ colorScheme: theme });
    await page.evaluate(() => scrollTo(0, 0));
    await page.waitForTimeout(400);
    await page.screenshot({ path: `${shots}/first-${width}-${theme}.png` });
    await page.screenshot({ path: `${shots}/all-${width}-${theme}.png`, fullPage: true });
    if (theme === 'light' || width === 1400)
      for (const id of await page.locator('main > section').evaluateAll((all) => all.map((s) => s.id))) {
        await page.evaluate((i) => document.getElementById(i).scrollIntoView(), id);
        await page.waitForTimeout(150);
        await page.screenshot({ path: `${shots}/${id}-${width}-${theme}.png` });
      }
  }
} else await page.evaluate(() => dispatchEvent(new Event('afterprint')));
if (missing) {
  const [head, , tail] = readFileSync(file, 'utf8').split(/(<script type="application\/json" id="data">[\s\S]*?<\/script>)/);
  // Paths of keys to take out: of the data, of the result, and of the first entry of every list and object in it.
  const paths = [[]];
  for (const key of Object.keys(data)) {
    paths.push([key]);
    const value = data[key];
    if (value && typeof value === 'object' && !Array.isArray(value)) for (const inner of Object.keys(value)) {
      paths.push([key, inner]);
      const deep = value[inner];
      const first = Array.isArray(deep) ? 0 : deep && typeof deep === 'object' ? Object.keys(deep)[0] : undefined;
      if (key === 'result' && first !== undefined && deep[first] && typeof deep[first] === 'object')
        for (const last of Object.keys(deep[first])) paths.push([key, inner, first, last]);
    }
  }
  const { writeFileSync, rmSync } = await import('node:fs');
  const copy = `${file}.missing.html`;
  for (const path of paths) {
    const less = structuredClone(data);
    if (!path.length) for (const key of Object.keys(less)) { if (key !== 'version' && key !== 'overview') delete less[key]; }
    else delete path.slice(0, -1).reduce((o, key) => o[key], less)[path.at(-1)];
    if (!path.includes('scene') && less.result) delete less.result.scene;              // the 3-D view takes its time
    writeFileSync(copy, `${head}<script type="application/json" id="data">${JSON.stringify(less).replace(/</g, '\\u003c')}</script>${tail}`);
    const before = errors.length;
    await page.goto(pathToFileURL(copy).href);
    await page.evaluate(() => dispatchEvent(new Event('beforeprint')));
    await page.waitForTimeout(50);
    const empty = await page.evaluate(() => [...document.querySelectorAll('.body')].filter((b) => !b.childElementCount).length);
    const shown = await page.evaluate(() => /undefined|\bNaN\b|\[object/.exec(document.body.innerText)?.[0] ?? '');
    if (errors.length > before || empty || shown || !(await page.locator('h1').count())) check(false, `without ${path.join('.') || 'anything'}: ${errors.slice(before).join(' ').slice(0, 300)} ${empty ? `${empty} sections empty` : ''} ${shown}`);
  }
  rmSync(copy);
  check(true, `opened without each of ${paths.length} keys`);
}
check(errors.length === 0, `no error on the console${errors.length ? `: ${errors.join(' | ').slice(0, 800)}` : ''}`);
check(requests.length === 0, `no request to anywhere${requests.length ? `: ${requests.join(' ')}` : ''}`);
await browser.close();
console.log(failures.length ? `${failures.length} failed` : 'all right');
process.exit(failures.length ? 1 : 0);
