// A browser for the tests of reports: /usr/bin/chromium or that of the variable CHROMIUM, driven by the playwright-core of
// tools/report or of the folder of the variable VIABLE_REPORT_FOLDER. Without a browser the exit code is 77.
import assert from 'node:assert/strict';
import { existsSync } from 'node:fs';
import { mkdtemp, rm, writeFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';

const modules = process.env.VIABLE_REPORT_FOLDER
  ? pathToFileURL(join(resolve(process.env.VIABLE_REPORT_FOLDER), 'package.json'))
  : new URL('../../tools/report/package.json', import.meta.url);
export const { chromium } = createRequire(modules)('playwright-core');

export const EXECUTABLE = process.env.CHROMIUM ?? '/usr/bin/chromium';
if (!existsSync(EXECUTABLE)) {
  console.error(
    `SKIPPED: there is no browser ${EXECUTABLE}. Install it (Debian: apt-get install chromium) or name one in CHROMIUM.`,
  );
  process.exit(77);
}
const ARGUMENTS = [
  '--no-sandbox',
  '--enable-unsafe-swiftshader',
  '--use-gl=angle',
  '--use-angle=swiftshader',
  '--disable-gpu-compositing',
]; // only the replay needs the slow software graphics
const PATIENCE = 30_000; // this may be a slow machine that draws without a graphics card
export const folder = await mkdtemp(join(tmpdir(), 'viable-report-'));
export const browser = await chromium.launch({ executablePath: EXECUTABLE, args: ARGUMENTS });

/** The content of a data script of a report, and the report with another one. */
const scriptPattern = (id) => new RegExp(`(<script type="[a-z/]+" id="${id}">)([^<]*)(</script>)`);
export const contentOf = (html, id) => html.match(scriptPattern(id))[2];
export const replaced = (page, id, text) => page.replace(scriptPattern(id), (_, start, __, end) => start + text + end);

let opened = []; // in this test

/** Opens a page and watches over it: errors and requests are kept. */
export async function open(
  path,
  {
    width = 1280,
    height = 900,
    colorScheme = 'light',
    ready = '#page:not([hidden])',
    from = browser,
    hasTouch = false,
  } = {},
) {
  const page = await from.newPage({ viewport: { width, height }, colorScheme, hasTouch, acceptDownloads: true });
  const own = pathToFileURL(resolve(path)).href;
  page.problems = [];
  opened.push(page);
  page.on('console', (message) => {
    if (message.type() === 'error') page.problems.push(`console: ${message.text()}`);
  });
  page.on('pageerror', (error) => page.problems.push(`error: ${error.message}`));
  page.on('request', (request) => {
    if (request.url() !== own && !request.url().startsWith('blob:'))
      page.problems.push(`request: ${request.url().slice(0, 120)}`);
  });
  page.setDefaultTimeout(PATIENCE);
  await page.goto(own);
  await page.waitForSelector(ready);
  return page;
}

/** The path of a page with this text. */
export async function variant(name, text) {
  const path = join(folder, `${name}.html`);
  await writeFile(path, text);
  return path;
}

export async function eventually(check, what) {
  const deadline = Date.now() + PATIENCE;
  for (;;) {
    const value = await check();
    if (value) return value;
    assert.ok(Date.now() < deadline, `waited in vain: ${what}`);
    await new Promise((wait) => setTimeout(wait, 100));
  }
}

/** Pixels of a plot that are neither grey (axes, grid, text) nor empty. */
export const colouredPixels = (panel) =>
  panel.evaluate((root) => {
    const canvas = root.querySelector('canvas');
    if (!canvas || canvas.width === 0) return 0;
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    let count = 0;
    for (let i = 0; i < data.length; i += 4) {
      const [r, g, b, a] = data.subarray(i, i + 4);
      if (a > 60 && Math.max(r, g, b) - Math.min(r, g, b) > 40) ++count;
    }
    return count;
  });

let failed = 0;

const MOST_HELD_UP = 7; // tries that are given back

/**
 * Runs tests one after the other; each has a name and a body. No page of a test may have problems, unless pages are kept or
 * `isQuiet` says that it may. One that waits for a browser in milliseconds may say how many
 * `tries` it has, as others use the machine, too: it fails if none of them passes, and `restore` makes room before the next. A
 * try in which the browser was held up, as `wasHeldUp` has measured ([ms]; 0: it was not), does not count.
 */
export async function runTests(
  tests,
  { keepsPages = false, restore = async () => {}, wasHeldUp = async () => 0 } = {},
) {
  for (const [index, { name, body, tries = 1, isQuiet = !keepsPages }] of tests.entries()) {
    let left = tries;
    let heldUp = 0;
    for (let isFirst = true; left > 0; isFirst = false) {
      const start = Date.now();
      const label = () =>
        `${String(index + 1).padStart(2)}/${tests.length} ${name} (${((Date.now() - start) / 1000).toFixed(1)} s)`;
      try {
        if (!isFirst) await restore();
        await wasHeldUp(); // before this try
        opened = [];
        await body();
        if (isQuiet) for (const page of opened) assert.deepEqual(page.problems, []);
        console.log(`PASS ${label()}`);
        left = 0;
      } catch (error) {
        const held_ms = tries > 1 && heldUp < MOST_HELD_UP ? await wasHeldUp() : 0;
        if (held_ms > 0) ++heldUp;
        else --left;
        if (left === 0) ++failed;
        const reason = held_ms > 0 ? `     the browser was held up for ${held_ms.toFixed(0)} ms\n` : '';
        console.log(`${left === 0 ? 'FAIL' : 'ONCE MORE'} ${label()}\n${reason}     ${String(error.message).replaceAll('\n', '\n     ')}`);
      }
      if (!keepsPages) for (const context of browser.contexts()) await context.close();
    }
  }
  console.log(failed === 0 ? `100% of ${tests.length} tests passed` : `${failed} of ${tests.length} tests failed`);
}

/** Closes the browser; the exit code tells whether all tests passed. */
export async function finish() {
  await browser.close();
  await rm(folder, { recursive: true });
  process.exitCode = failed === 0 ? 0 : 1;
}
