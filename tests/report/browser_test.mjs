// Opens a report in a browser and checks that it shows what it should, alone, safely and for everyone:
//   node browser_test.mjs REPORT [--screenshots FOLDER]
// The browser is /usr/bin/chromium or that of the variable CHROMIUM; playwright-core comes from tools/report.
import assert from 'node:assert/strict';
import { mkdir, mkdtemp, readFile, rm, writeFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { parseArgs } from 'node:util';
import { gunzipSync } from 'node:zlib';

const modules = process.env.VIABLE_REPORT_FOLDER
  ? pathToFileURL(join(resolve(process.env.VIABLE_REPORT_FOLDER), 'package.json'))
  : new URL('../../tools/report/package.json', import.meta.url);
const { chromium } = createRequire(modules)('playwright-core');

const {
  positionals: [reportPath],
  values: options,
} = parseArgs({ allowPositionals: true, options: { screenshots: { type: 'string' } } });
if (!reportPath) {
  console.error('usage: node browser_test.mjs REPORT [--screenshots FOLDER]');
  process.exit(2);
}
const EXECUTABLE = process.env.CHROMIUM ?? '/usr/bin/chromium';
const ARGUMENTS = [
  '--no-sandbox',
  '--enable-unsafe-swiftshader',
  '--use-gl=angle',
  '--use-angle=swiftshader',
  '--disable-gpu-compositing',
]; // only the replay needs the slow software graphics
const PATIENCE = 30_000; // this may be a slow machine that draws without a graphics card
const HOSTILE = '<script>window.hacked=1</script><img src=x onerror="window.hacked=1">"\'`&amp;$&$1</title></style>';

const html = await readFile(reportPath, 'utf8');
const folder = await mkdtemp(join(tmpdir(), 'viable-report-'));
const browser = await chromium.launch({ executablePath: EXECUTABLE, args: ARGUMENTS });
const tests = [];
const test = (name, body) => tests.push({ name, body });

/** The content of a data script of the report, and the report with another one. */
const scriptPattern = (id) => new RegExp(`(<script type="[a-z/]+" id="${id}">)([^<]*)(</script>)`);
const content = (id) => html.match(scriptPattern(id))[2];
const replaced = (page, id, text) => page.replace(scriptPattern(id), (_, start, __, end) => start + text + end);
const description = JSON.parse(content('viable-data'));
const jointCount = description.robot.joints.length;
const hasScene = Boolean(description.scene) && description.cases.some((c) => c.replay);
const bytes = gunzipSync(Buffer.from(content('viable-binary'), 'base64'));
const end = Math.max(...description.cases.map((c) => c.t0 + c.buckets * c.step_s));

/** Opens a page and watches over it: errors and requests are kept. */
async function open(
  path = reportPath,
  { width = 1280, height = 900, colorScheme = 'light', ready = '#page:not([hidden])', from = browser } = {},
) {
  const page = await from.newPage({ viewport: { width, height }, colorScheme, acceptDownloads: true });
  const own = pathToFileURL(resolve(path)).href;
  page.problems = [];
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

async function variant(name, text) {
  const path = join(folder, `${name}.html`);
  await writeFile(path, text);
  return path;
}

async function eventually(check, what) {
  const deadline = Date.now() + PATIENCE;
  for (;;) {
    const value = await check();
    if (value) return value;
    assert.ok(Date.now() < deadline, `waited in vain: ${what}`);
    await new Promise((wait) => setTimeout(wait, 100));
  }
}

/** Pixels of a plot that are neither grey (axes, grid, text) nor empty. */
const colouredPixels = (panel) =>
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

/** How many pixels of a picture differ from its first one, or from those of another picture. */
async function differentPixels(picture, other = null) {
  const page = await browser.newPage();
  const count = await page.evaluate(
    async ([first, second]) => {
      const read = async (base64) => {
        const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
        const bitmap = await createImageBitmap(new Blob([bytes]));
        const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d');
        context.drawImage(bitmap, 0, 0);
        return context.getImageData(0, 0, bitmap.width, bitmap.height).data;
      };
      const a = await read(first);
      const b = second ? await read(second) : null;
      if (b && b.length !== a.length) return a.length / 4;
      let different = 0;
      for (let i = 0; i < a.length; i += 4) {
        const k = b ? i : 0;
        const base = b ?? a;
        if (Math.abs(a[i] - base[k]) + Math.abs(a[i + 1] - base[k + 1]) + Math.abs(a[i + 2] - base[k + 2]) > 24)
          ++different;
      }
      return different;
    },
    [picture.toString('base64'), other?.toString('base64') ?? null],
  );
  await page.close();
  return count;
}

/** Whether there is anything to draw for a quantity of the first joint. */
function hasNumbers(quantity) {
  const key = {
    position: 'nominal_q',
    velocity: 'nominal_qd',
    acceleration: 'nominal_qdd',
    jerk: 'nominal_jerk',
    torque: 'tau_filter',
    error: 'real_q',
    margin: 'margin',
  }[quantity];
  return (
    !key ||
    description.cases.some(({ joints: [{ series }] }) => {
      const { at, n } = series[key] ?? { at: 0, n: 0 };
      for (let i = 0; i < n; ++i) if (Number.isFinite(bytes.readFloatLE(at + 4 * i))) return true;
      return false;
    })
  );
}

const panels = (page) => page.locator('.panel').all();
const over = (page, quantity) => page.locator(`.panel[data-quantity=${quantity}] .u-over`).first();
const viewOf = (page, quantity) =>
  page
    .locator(`.panel[data-quantity=${quantity}]`)
    .first()
    .evaluate((root) => (root.dataset.view ?? '').split(' ').map(Number));
const setScrubber = (page, time) =>
  page.locator('#scrubber').evaluate((input, value) => {
    input.value = value;
    input.dispatchEvent(new Event('input'));
  }, String(time));
const time = (page) => page.locator('#scrubber').evaluate((input) => Number(input.value));
const stage = (page) => page.locator('.stage canvas');

async function showReplay(page, at) {
  await setScrubber(page, at);
  await stage(page).scrollIntoViewIfNeeded();
  await eventually(
    () => page.locator('.stage').evaluate((element, t) => Math.abs(Number(element.dataset.time) - t) < 1e-3, at),
    `the replay at ${at} s`,
  );
  return stage(page).screenshot();
}

/** Scrolls to a plot and waits until it is drawn. */
async function reach(page, quantity) {
  await page.locator(`.panel[data-quantity=${quantity}]`).first().scrollIntoViewIfNeeded();
  await over(page, quantity).waitFor();
}

/** Draws the mouse over a plot, from one share of its width to another. */
async function drag(page, quantity, from, to) {
  await reach(page, quantity);
  const target = over(page, quantity);
  const box = await target.boundingBox();
  const y = box.y + box.height / 2;
  await page.mouse.move(box.x + from * box.width, y);
  await page.mouse.down();
  await page.mouse.move(box.x + ((from + to) / 2) * box.width, y, { steps: 4 });
  await page.mouse.move(box.x + to * box.width, y, { steps: 4 });
  await page.mouse.up();
}

const assertQuiet = (page) => assert.deepEqual(page.problems, []);

test('opens from a file without an error and without any other request', async () => {
  const page = await open();
  assert.equal(await page.locator('h1').textContent(), description.title || 'Run');
  assert.equal(await page.locator('.verdict').count(), description.cases.length);
  assert.equal(await page.locator('.summary tbody tr').count(), description.summary.rows.length);
  for (const panel of await panels(page)) await panel.scrollIntoViewIfNeeded();
  await page.waitForTimeout(500);
  assert.equal(await page.locator('#message').isVisible(), false);
  assertQuiet(page);
});

test('every plot is drawn', async () => {
  const page = await open();
  const all = await panels(page);
  assert.ok(all.length >= 8, `${all.length} plots`);
  const missing = [];
  for (const panel of all) {
    const name = await panel.getAttribute('data-quantity');
    await panel.scrollIntoViewIfNeeded();
    if (hasNumbers(name))
      await eventually(async () => (await colouredPixels(panel)) > 20, `pixels of ${name}`).catch(() =>
        missing.push(name),
      );
  }
  assert.deepEqual(missing, []);
  assertQuiet(page);
});

test('all joints side by side are drawn', async () => {
  if (jointCount < 2) return;
  const page = await open();
  await page.keyboard.press('a');
  await eventually(async () => (await page.locator('.panel.compact').count()) === 8 * jointCount, 'small plots');
  const positions = page.locator('.panel[data-quantity=position]');
  for (let j = 0; j < jointCount; ++j) {
    await positions.nth(j).scrollIntoViewIfNeeded();
    await eventually(async () => (await colouredPixels(positions.nth(j))) > 20, `position of joint ${j}`);
  }
  await page.keyboard.press('a');
  await eventually(async () => (await page.locator('.panel.compact').count()) === 0, 'plots of one joint');
  assertQuiet(page);
});

test('the replay shows the arm and follows the scrubber', async () => {
  const page = await open();
  if (!hasScene) {
    assert.match(await page.locator('.no-replay').textContent(), /no shapes|no motion/);
    return;
  }
  const pictures = [];
  for (const share of [0, 0.23, 0.47, 0.71]) pictures.push(await showReplay(page, Number((share * end).toFixed(3))));
  assert.ok((await differentPixels(pictures[0])) > 1000, 'the picture is blank');
  const moved = await Promise.all(pictures.slice(1).map((picture) => differentPixels(pictures[0], picture)));
  assert.ok(Math.max(...moved) > 200, `pixels that moved: ${moved}`);
  assertQuiet(page);
});

test('a click in a plot moves the scrubber and its line in all plots', async () => {
  const page = await open();
  await reach(page, 'position');
  const box = await over(page, 'position').boundingBox();
  await page.mouse.click(box.x + 0.4 * box.width, box.y + 20);
  await eventually(async () => Math.abs((await time(page)) - 0.4 * end) < 0.01 * end, 'the scrubber at 40 %');
  const lines = await page
    .locator('.scrub-line:visible')
    .evaluateAll((all) => all.map((line) => line.getBoundingClientRect().left));
  assert.ok(lines.length >= 2, `${lines.length} lines`);
  assert.ok(Math.max(...lines) - Math.min(...lines) < 1.5, `lines at ${lines}`);
  assertQuiet(page);
});

test('the read-out follows the mouse', async () => {
  const page = await open();
  await reach(page, 'position');
  const target = over(page, 'position');
  const box = await target.boundingBox();
  const text = () => page.locator('.panel[data-quantity=position] .readout').textContent();
  const seen = new Set();
  for (const share of [0.2, 0.35, 0.5, 0.8]) {
    await page.mouse.move(box.x + share * box.width, box.y + 30);
    await page.waitForTimeout(300);
    seen.add(await text());
  }
  assert.ok(seen.size > 1, 'always the same numbers');
  assert.equal(
    await page
      .locator('.panel[data-quantity=velocity] .u-cursor-x')
      .evaluate((line) => getComputedStyle(line).display !== 'none'),
    true,
  );
  assertQuiet(page);
});

test('a zoom in one plot zooms all, a double click resets all', async () => {
  const page = await open();
  await drag(page, 'position', 0.2, 0.5);
  const [from, to] = await eventually(async () => {
    const view = await viewOf(page, 'position');
    return view[1] < 0.6 * end ? view : null;
  }, 'a zoomed plot');
  assert.ok(
    Math.abs(from - 0.2 * end) < 0.02 * end && Math.abs(to - 0.5 * end) < 0.02 * end,
    `zoomed to ${from} - ${to}`,
  );
  for (const quantity of ['interventions', 'velocity', 'jerk', 'torque', 'margin']) {
    await reach(page, quantity);
    await eventually(
      async () => (await viewOf(page, quantity)).join() === [from, to].join(),
      `${quantity} zoomed, too`,
    );
  }
  await reach(page, 'torque');
  await over(page, 'torque').dblclick();
  for (const quantity of ['torque', 'position', 'interventions']) {
    await reach(page, quantity);
    await eventually(
      async () => Math.abs((await viewOf(page, quantity))[1] - end) < 1e-6 * end,
      `${quantity} is whole again`,
    );
  }
  assertQuiet(page);
});

test('the keyboard does it all', async () => {
  const page = await open();
  const press = (key) => page.keyboard.press(key);
  await press(' ');
  await eventually(async () => (await time(page)) > 0, 'the replay plays');
  await press(' ');
  await page.waitForTimeout(300);
  const paused = await time(page);
  await page.waitForTimeout(300);
  assert.equal(await time(page), paused, 'it goes on after a pause');
  await press('Home');
  assert.equal(await time(page), 0);
  await press('ArrowRight');
  const step = await time(page);
  assert.ok(step > 0, 'no step');
  await press('Shift+ArrowRight');
  assert.ok(Math.abs((await time(page)) - 11 * step) < 1e-6, 'not ten steps');
  await press('ArrowLeft');
  assert.ok(Math.abs((await time(page)) - 10 * step) < 1e-6, 'no step back');

  const toggle = page.locator('.case-toggle').first();
  await press('1');
  assert.equal(await toggle.getAttribute('aria-pressed'), 'false');
  await press('1');
  assert.equal(await toggle.getAttribute('aria-pressed'), 'true');

  const joint = () => page.locator('.joint-choice select').inputValue();
  await press('j');
  assert.equal(await joint(), String(1 % jointCount));
  await press('k');
  assert.equal(await joint(), '0');

  await press('+');
  await eventually(async () => (await viewOf(page, 'position'))[1] < 0.9 * end, 'zoomed by the keyboard');
  await press('0');
  await eventually(
    async () => Math.abs((await viewOf(page, 'position'))[1] - end) < 1e-6 * end,
    'whole again by the keyboard',
  );

  await press('?');
  assert.equal(await page.locator('dialog').isVisible(), true);
  await press('Escape');
  assert.equal(await page.locator('dialog').isVisible(), false);

  await press('Tab');
  const focused = await page.evaluate(() => {
    const { outlineStyle, outlineWidth } = getComputedStyle(document.activeElement);
    return { tag: document.activeElement.tagName, outline: outlineStyle !== 'none' && parseFloat(outlineWidth) > 0 };
  });
  assert.ok(focused.outline, `no visible focus on ${focused.tag}`);
  assertQuiet(page);
});

test('all controls have names', async () => {
  const page = await open();
  const nameless = await page.evaluate(() =>
    [...document.querySelectorAll('button, select, input, [role=img]')]
      .filter((e) => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length))
      .map((e) => e.outerHTML.slice(0, 80)),
  );
  assert.deepEqual(nameless, []);
});

test('a hidden case is gone from the plots', async () => {
  const page = await open();
  const panel = page.locator('.panel[data-quantity=position]');
  await panel.scrollIntoViewIfNeeded();
  await eventually(async () => (await colouredPixels(panel)) > 20, 'lines');
  for (const toggle of await page.locator('.case-toggle').all()) await toggle.click();
  await eventually(async () => (await colouredPixels(panel)) === 0, 'no lines');
  assertQuiet(page);
});

test('PNG and SVG are saved', async () => {
  const page = await open();
  for (const quantity of ['position', 'interventions', 'tick_time']) {
    const panel = page.locator(`.panel[data-quantity=${quantity}]`);
    if ((await panel.count()) === 0) continue;
    const save = async (name) => {
      const [download] = await Promise.all([
        page.waitForEvent('download'),
        panel.getByRole('button', { name, exact: true }).click(),
      ]);
      return { name: download.suggestedFilename(), bytes: await readFile(await download.path()) };
    };
    const png = await save('PNG');
    assert.match(png.name, /\.png$/);
    assert.equal(png.bytes.subarray(1, 4).toString(), 'PNG');
    assert.ok((await differentPixels(png.bytes)) > 1000, 'an empty PNG');
    const svg = await save('SVG');
    assert.match(svg.name, /\.svg$/);
    const found = await page.evaluate((text) => {
      const drawing = new DOMParser().parseFromString(text, 'image/svg+xml');
      return {
        error: drawing.querySelector('parsererror')?.textContent ?? '',
        marks: drawing.querySelectorAll('path, rect').length,
        texts: drawing.querySelectorAll('text').length,
      };
    }, svg.bytes.toString());
    assert.equal(found.error, '');
    assert.ok(found.marks > 10 && found.texts > 5, JSON.stringify(found));
  }
  assertQuiet(page);
});

test('fits a phone of 375 pixels', async () => {
  const page = await open(reportPath, { width: 375, height: 812 });
  const overflow = () => page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  for (const details of await page.locator('#details summary').all()) await details.click();
  for (const panel of await panels(page)) await panel.scrollIntoViewIfNeeded();
  assert.ok((await overflow()) <= 0, `${await overflow()} pixels too wide`);
  await page.locator('body').press('a');
  await page.waitForTimeout(500);
  assert.ok((await overflow()) <= 0, `${await overflow()} pixels too wide with all joints`);
  await page.keyboard.press('?');
  assert.ok((await page.locator('dialog').boundingBox()).width <= 375, 'the list of keys is too wide');
  assertQuiet(page);
});

test('light and dark differ, by system and by switch', async () => {
  const look = (page) => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  const light = await open(reportPath, { colorScheme: 'light' });
  const dark = await open(reportPath, { colorScheme: 'dark' });
  assert.notEqual(await look(light), await look(dark));
  const pictures = [];
  for (const page of [light, dark]) {
    await reach(page, 'position');
    const panel = page.locator('.panel[data-quantity=position]');
    await eventually(async () => (await colouredPixels(panel)) > 20, 'lines');
    pictures.push(await panel.screenshot());
  }
  assert.ok((await differentPixels(...pictures)) > 10_000);
  const before = await look(light);
  await light.getByRole('button', { name: 'Dark colours' }).click();
  assert.notEqual(await look(light), before);
  assert.equal(await look(light), await look(dark));
  assertQuiet(light);
  assertQuiet(dark);
});

test('hostile names stay text', async () => {
  const hostile = structuredClone(description);
  const spoil = (object, ...keys) => {
    for (const key of keys) object[key] = `${HOSTILE}${object[key]}`;
  };
  spoil(hostile, 'title', 'file', 'yaml', 'version', 'created');
  spoil(hostile.robot, 'name');
  hostile.robot.joints.forEach((joint) => spoil(joint, 'name'));
  spoil(hostile.summary, 'note');
  hostile.summary.columns = hostile.summary.columns.map((text) => HOSTILE + text);
  hostile.summary.rows = hostile.summary.rows.map((row) => row.map((text) => HOSTILE + text));
  hostile.cases.forEach((c) => {
    spoil(c, 'name', 'filter', 'robust_loop', 'plant', 'verdict', 'details');
    c.stop = { time_s: 1, message: HOSTILE };
  });
  const path = await variant(
    'hostile',
    replaced(html, 'viable-data', JSON.stringify(hostile).replaceAll('<', '\\u003c')),
  );
  const page = await open(path);
  for (const summary of await page.locator('#details summary').all()) await summary.click();
  await page.keyboard.press('j');
  await page.keyboard.press('a');
  for (const panel of (await panels(page)).slice(0, 20)) await panel.scrollIntoViewIfNeeded();
  await page.keyboard.press('a');
  const [download] = await Promise.all([
    page.waitForEvent('download'),
    page.locator('.panel[data-quantity=interventions]').getByRole('button', { name: 'SVG' }).click(),
  ]);
  const svg = (await readFile(await download.path())).toString();
  assert.ok(!/<script|<img|onerror="/.test(svg), 'markup in the SVG');
  assert.match(download.suggestedFilename(), /^[\p{L}\p{N}._-]+\.svg$/u);
  assert.equal(await page.evaluate(() => window.hacked), undefined);
  assert.equal(await page.evaluate(() => document.querySelectorAll('img').length), 0);
  assert.equal(await page.locator('h1').textContent(), hostile.title);
  assert.ok((await page.title()).includes('<script>'));
  for (const name of [
    hostile.robot.joints[0].name,
    hostile.cases[0].name,
    hostile.cases[0].verdict,
    hostile.summary.columns[0],
    hostile.yaml,
  ])
    assert.ok(
      (await page.locator('#page').textContent()).includes(name.slice(0, 200)),
      `not shown: ${name.slice(0, 60)}`,
    );
  assert.ok(
    (await page.evaluate(() => document.documentElement.scrollWidth - innerWidth)) <= 0,
    'long names make the page too wide',
  );
  assertQuiet(page);
});

test('markup that slips in cannot run', async () => {
  const path = await variant(
    'injected',
    html.replace('</body>', () => '<script>window.hacked=1</script><img src="x.png" onerror="window.hacked=1"></body>'),
  );
  const page = await open(path);
  await page.waitForTimeout(300);
  assert.equal(await page.evaluate(() => window.hacked), undefined);
});

test('without WebGL the replay says so and the rest works', async () => {
  const poor = await chromium.launch({ executablePath: EXECUTABLE, args: ['--no-sandbox', '--disable-3d-apis'] });
  try {
    const page = await open(reportPath, { from: poor });
    assert.match(await page.locator('.no-replay').textContent(), hasScene ? /WebGL/ : /no/);
    const panel = page.locator('.panel[data-quantity=position]');
    await panel.scrollIntoViewIfNeeded();
    await eventually(async () => (await colouredPixels(panel)) > 20, 'lines');
    await setScrubber(page, end / 2);
    assertQuiet(page);
  } finally {
    await poor.close();
  }
});

test('damaged data is told in words', async () => {
  const binary = content('viable-binary').trim();
  const changed = (change) => {
    const copy = structuredClone(description);
    change(copy);
    return replaced(html, 'viable-data', JSON.stringify(copy).replaceAll('<', '\\u003c'));
  };
  const cases = {
    cut: [replaced(html, 'viable-binary', binary.slice(0, Math.floor(binary.length / 8) * 4)), /damaged or cut off/],
    garbage: [replaced(html, 'viable-binary', 'no base64 at all!'), /damaged or cut off/],
    json: [replaced(html, 'viable-data', content('viable-data').slice(0, -20)), /damaged/],
    template: [replaced(replaced(html, 'viable-data', '@@VIABLE_' + 'DATA@@'), 'viable-binary', ''), /holds no run/],
    future: [
      changed((data) => {
        data.format = 2;
      }),
      /format 2/,
    ],
    reference: [
      changed((data) => {
        data.cases[0].joints[0].series.nominal_q.at = 4e9;
      }),
      /nominal_q.*not within/,
    ],
    length: [
      changed((data) => {
        data.cases[0].joints[0].series.margin.n -= 1;
      }),
      /margin.*values for/,
    ],
    joints: [
      changed((data) => {
        data.cases[0].joints.pop();
      }),
      /joints/,
    ],
  };
  for (const [name, [text, expected]] of Object.entries(cases)) {
    const page = await open(await variant(name, text), { ready: '#message:not([hidden])' });
    assert.match(await page.locator('#message').textContent(), expected, name);
    assert.equal(await page.locator('#loading').isVisible(), false);
    assertQuiet(page);
    await page.close();
  }
});

test('gaps, missing series and cases without rows are no error', async () => {
  const data = structuredClone(description);
  const [c] = data.cases;
  for (const joint of c.joints)
    Object.assign(joint.series, {
      real_q: null,
      real_qd: null,
      real_qdd: null,
      tau_robust: null,
      tau_motor: null,
      position_lower: null,
      position_upper: null,
    });
  c.replay.real = null;
  const empty = structuredClone(c);
  const none = (type) => ({ at: 0, n: 0, type });
  Object.assign(empty, {
    name: 'empty',
    rows: 0,
    buckets: 0,
    status: none('u8'),
    replay: { step_s: 0.01, n: 0, nominal: none('f32'), real: null },
    tick_time: { edges_us: [], counts: [] },
  });
  for (const joint of empty.joints) {
    joint.active = none('u8');
    for (const [key, value] of Object.entries(joint.series)) if (value?.type) joint.series[key] = none('f32');
  }
  data.cases.push(empty);
  const page = await open(
    await variant('gaps', replaced(html, 'viable-data', JSON.stringify(data).replaceAll('<', '\\u003c'))),
  );
  for (const panel of await panels(page)) await panel.scrollIntoViewIfNeeded();
  for (const choice of hasScene
    ? await page.locator('.replay-head option').evaluateAll((all) => all.map(({ value }) => value))
    : []) {
    await page.locator('.replay-head select').selectOption(choice);
    await setScrubber(page, end / 3);
    await page.waitForTimeout(200);
  }
  assert.equal(await page.locator('#message').isVisible(), false);
  assertQuiet(page);
});

async function takeScreenshots() {
  await mkdir(options.screenshots, { recursive: true });
  const shot = (name) => join(options.screenshots, `${name}.png`);
  const prepare = async (settings) => {
    const page = await open(reportPath, settings);
    await page.keyboard.press('j');
    await page.keyboard.press('j');
    await setScrubber(page, end * 0.36);
    return page;
  };
  for (const [name, colorScheme] of [
    ['plots', 'light'],
    ['dark', 'dark'],
  ]) {
    const page = await prepare({ height: 960, colorScheme });
    const share = Math.min(0.5, 8 / end);
    await drag(page, 'position', 0.36 - share / 3, 0.36 + (share * 2) / 3);
    await page.locator('#toolbar').evaluate((bar) => scrollTo(0, bar.offsetTop));
    const box = await over(page, 'position').boundingBox();
    await page.mouse.move(box.x + box.width * 0.6, box.y + 30);
    await page.waitForTimeout(2500);
    await page.screenshot({ path: shot(name) });
  }
  const page = await prepare({ height: 1000 });
  if (hasScene) await showReplay(page, end * 0.36);
  await page.locator('#toolbar').evaluate((bar) => scrollTo(0, bar.offsetTop));
  await page.waitForTimeout(1500);
  await page.locator('#side').screenshot({ path: shot('replay') });
  const phone = await prepare({ width: 375, height: 812 });
  await phone.locator('.panel[data-quantity=position]').scrollIntoViewIfNeeded();
  await phone.locator('.panel[data-quantity=interventions]').evaluate((panel) => scrollTo(0, panel.offsetTop - 120));
  await phone.waitForTimeout(2000);
  await phone.screenshot({ path: shot('phone') });
}

let failed = 0;
for (const [index, { name, body }] of tests.entries()) {
  const start = Date.now();
  const label = () =>
    `${String(index + 1).padStart(2)}/${tests.length} ${name} (${((Date.now() - start) / 1000).toFixed(1)} s)`;
  try {
    await body();
    console.log(`PASS ${label()}`);
  } catch (error) {
    ++failed;
    console.log(`FAIL ${label()}\n     ${String(error.message).replaceAll('\n', '\n     ')}`);
  }
  for (const context of browser.contexts()) await context.close();
}
if (options.screenshots) await takeScreenshots();
await browser.close();
await rm(folder, { recursive: true });
console.log(failed === 0 ? `100% of ${tests.length} tests passed` : `${failed} of ${tests.length} tests failed`);
process.exitCode = failed === 0 ? 0 : 1;
