// Opens a report in a browser and checks that it shows what it should, alone, safely and for everyone:
//   node browser_test.mjs REPORT [--quick] [--only PATTERN] [--title TEXT] [--screenshots FOLDER]
// --quick leaves out what depends on the page only, not on the data; --only runs the tests of whose names the pattern
// is a part. --title: what the title must be.
// The browser: see browser.mjs.
import assert from 'node:assert/strict';
import { mkdir, readFile } from 'node:fs/promises';
import { join } from 'node:path';
import { parseArgs } from 'node:util';
import { gunzipSync, gzipSync } from 'node:zlib';
import {
  browser, chromium, colouredPixels, contentOf, eventually, EXECUTABLE, finish, open as openPage, replaced, runTests, variant,
} from './browser.mjs';

const { positionals: [reportPath], values: options } = parseArgs({
  allowPositionals: true,
  options: {
    quick: { type: 'boolean', default: false },
    only: { type: 'string', default: '' },
    title: { type: 'string' },
    screenshots: { type: 'string' },
  },
});
if (!reportPath) {
  console.error('usage: node browser_test.mjs REPORT [--quick] [--only PATTERN] [--title TEXT] [--screenshots FOLDER]');
  process.exit(2);
}
const HOSTILE = '<script>window.hacked=1</script><img src=x onerror="window.hacked=1">"\'`&amp;$&$1</title></style>';

const html = await readFile(reportPath, 'utf8');
const open = (path = reportPath, settings) => openPage(path, settings);
const tests = [];
/** A test of the page with the data of the run, and one of the page alone. */
const test = (name, body, settings) => {
  if (new RegExp(options.only).test(name)) tests.push({ name, body, ...settings });
};
const testOfPage = (name, body, settings) => {
  if (!options.quick) test(name, body, settings);
};

const content = (id) => contentOf(html, id);
const description = JSON.parse(content('viable-data'));
const jointCount = description.robot.joints.length;
const hasScene = Boolean(description.scene) && description.cases.some((c) => c.replay);
const bytes = gunzipSync(Buffer.from(content('viable-binary'), 'base64'));
const endOf = (c) => c.t0 + Math.min(c.buckets * c.step_s, c.rows * c.tick_s);
const end = Math.max(...description.cases.map(endOf));
const hasReal = description.cases.some((c) => c.joints.some(({ series }) => series.real_q));
const hasBound = description.cases.some((c) => c.joints.some(({ series }) => series.bound_velocity !== undefined));
const hasClearance = description.cases.some((c) => c.clearance?.distance);
const touching = description.cases.find((c) => c.contact);
const QUANTITIES = [
  ...(description.cases.some((c) => c.tool) ? ['tool'] : []),
  ...['position', 'velocity', 'acceleration', 'jerk', 'torque'],
  ...(hasReal ? ['error'] : []),
  ...(hasBound ? ['velocity_error'] : []),
  'margin',
  ...(hasClearance ? ['clearance'] : []),
  ...(touching ? ['contact'] : []),
];
const OF_ARM = ['tool', 'clearance', 'contact']; // not of a joint
const LIMITED = ['position', 'velocity', 'acceleration', 'jerk'];
const SERIES = {
  tool: 'tool',
  position: 'nominal_q',
  velocity: 'nominal_qd',
  acceleration: 'nominal_qdd',
  jerk: 'nominal_jerk',
  torque: 'tau_filter',
  error: 'real_q',
  velocity_error: 'error_velocity',
  margin: 'margin',
  clearance: 'clearance',
  contact: 'contact',
};

/** Pixels of a plot in a colour (0xrrggbb), nearly. */
const pixelsOf = (panel, colour) =>
  panel.evaluate((root, wanted) => {
    const canvas = root.querySelector('canvas');
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    let count = 0;
    for (let i = 0; i < data.length; i += 4) {
      const distance =
        Math.abs(data[i] - (wanted >> 16)) +
        Math.abs(data[i + 1] - ((wanted >> 8) & 255)) +
        Math.abs(data[i + 2] - (wanted & 255));
      if (data[i + 3] > 200 && distance < 30) ++count;
    }
    return count;
  }, colour);

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
  const key = SERIES[quantity];
  return !key || description.cases.some((c) => extremes(c, key));
}

/** Least and largest value of a series of the first joint in a case, or null. */
function extremes(c, key) {
  const ofArm = { clearance: c.clearance?.distance, contact: c.contact?.pressing, tool: c.tool?.nominal };
  const reference = key in ofArm ? ofArm[key] : c.joints[0].series[key];
  if (typeof reference === 'number') return [reference, reference];
  const range = [Infinity, -Infinity];
  for (let i = 0; i < (reference?.n ?? 0); ++i) {
    const value = bytes.readFloatLE(reference.at + 4 * i);
    if (value < range[0]) range[0] = value;
    if (value > range[1]) range[1] = value;
  }
  return range[0] <= range[1] ? range : null;
}

/** The report with another description of the run, and its page. */
const withData = (data) => replaced(html, 'viable-data', JSON.stringify(data).replaceAll('<', '\\u003c'));
const described = (change) => {
  const copy = structuredClone(description);
  change(copy);
  return withData(copy);
};
const openDescribed = async (name, change) => open(await variant(name, described(change)));

const panels = (page) => page.locator('.panel').all();
const panelOf = (page, quantity) => page.locator(`.panel[data-quantity=${quantity}]`);
const over = (page, quantity) => panelOf(page, quantity).locator('.u-over').first();
const numbersOf = (panel, key) => panel.evaluate((root, k) => (root.dataset[k] ?? '').split(' ').map(Number), key);
const viewOf = (page, quantity) => numbersOf(panelOf(page, quantity).first(), 'view');
const rangeOf = (page, quantity) => numbersOf(panelOf(page, quantity), 'range');
const overflow = (page) => page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
/** What a button saves. */
async function saved(page, button) {
  const [download] = await Promise.all([page.waitForEvent('download'), button.click()]);
  return { name: download.suggestedFilename(), bytes: await readFile(await download.path()) };
}
/** Waits until so many pixels of what is shown differ from a picture. */
const changed = (picture, shown, least, what) =>
  eventually(async () => (await differentPixels(picture, await shown.screenshot())) > least, what);
async function drawn(panel, what = 'lines') {
  await panel.scrollIntoViewIfNeeded();
  await eventually(async () => (await colouredPixels(panel)) > 20, what);
}
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
  await panelOf(page, quantity).first().scrollIntoViewIfNeeded();
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

/** What the SVG button of a plot saves. */
async function savedSvg(page, quantity) {
  const { name, bytes } = await saved(page, panelOf(page, quantity).getByRole('button', { name: 'SVG' }));
  return { name, text: bytes.toString() };
}

test('opens from a file without an error and without any other request', async () => {
  const page = await open();
  assert.equal(await page.locator('h1').textContent(), description.title || 'Run');
  if (options.title !== undefined) assert.equal(await page.locator('h1').textContent(), options.title);
  assert.equal(await page.locator('.verdict').count(), description.cases.length);
  assert.equal(await page.locator('#summary tbody tr').count(), description.summary.rows.length);
  for (const panel of await panels(page)) await panel.scrollIntoViewIfNeeded();
  await page.waitForTimeout(200);
  assert.equal(await page.locator('#message').isVisible(), false);
  const shown = await page.locator('#page').textContent();
  for (const c of description.cases) {
    assert.ok(shown.includes(c.name), `no case ${c.name}`);
    assert.ok(shown.includes(c.details), `no details of ${c.name}`);
  }
  assert.ok(shown.includes(description.yaml), 'no experiment file');
  assert.equal(await page.evaluate(() => document.querySelectorAll('#page script, #page img').length), 0);
});

test('a case is one sentence, and the rest unfolds', async () => {
  const page = await open();
  for (const [i, c] of description.cases.entries()) {
    const card = page.locator('.verdict').nth(i);
    assert.ok((await card.locator('.verdict-text').textContent()).includes((c.sentence || c.verdict).slice(0, 30)), c.name);
    if (!c.sentence) continue;
    assert.equal(await card.locator('.verdict-full').isVisible(), false);
    await card.locator('summary').click();
    assert.ok(await card.locator('.verdict-full').isVisible());
  }
});

test('every plot is drawn', async () => {
  const page = await open();
  const all = await page.locator('#plots .panel').all();
  assert.deepEqual(await page.locator('#plots .panel').evaluateAll((list) => list.map((panel) => panel.dataset.quantity)), [
    'interventions',
    ...QUANTITIES,
    'tick_time',
  ]);
  const missing = [];
  for (const panel of all) {
    const name = await panel.getAttribute('data-quantity');
    await panel.scrollIntoViewIfNeeded();
    if (hasNumbers(name)) await drawn(panel, `pixels of ${name}`).catch(() => missing.push(name));
  }
  assert.deepEqual(missing, []);
});

test('all joints side by side are drawn', async () => {
  if (jointCount < 2) return;
  const page = await open();
  await page.keyboard.press('a');
  const count = (1 + QUANTITIES.filter((quantity) => !OF_ARM.includes(quantity)).length) * jointCount;
  await eventually(async () => (await page.locator('.panel.compact').count()) === count, 'small plots');
  for (const quantity of QUANTITIES.filter((one) => OF_ARM.includes(one)))
    assert.equal(await panelOf(page, quantity).count(), 1, quantity);
  for (let j = 0; j < jointCount; ++j) await drawn(panelOf(page, 'position').nth(j), `position of joint ${j}`);
  await page.keyboard.press('a');
  await eventually(async () => (await page.locator('.panel.compact').count()) === 0, 'plots of one joint');
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
  const deviation = page.getByLabel('Deviation of the real arm');
  assert.equal(await deviation.count(), description.cases.some((c) => c.replay?.real) ? 1 : 0);
  if ((await deviation.count()) > 0) {
    const before = await stage(page).screenshot();
    await deviation.selectOption('50');
    await changed(before, stage(page), 100, 'the real arm 50 times as far from the nominal one');
  }
});

testOfPage('the links of the replay may tell how fast they are', async () => {
  const page = await open();
  if (!hasScene) return;
  await page.locator('.nearest-text').evaluate((text) => {
    text.style.opacity = '0'; // the picture is what counts
  });
  const before = await showReplay(page, Number((0.5 * end).toFixed(3)));
  await page.getByLabel('Colour of the links').selectOption('speed');
  const toNumber = (text) => Number(text.replace('−', '-'));
  const speeds = [];
  for (const share of [0.1, 0.3, 0.5, 0.7, 0.9]) {
    await showReplay(page, Number((share * end).toFixed(3)));
    speeds.push(toNumber((await words(page)).match(/fastest: .+, (\S+) m\/s$/)[1]));
  }
  const most = toNumber((await page.locator('.speed-scale').textContent()).match(/^to (\S+) m\/s$/)[1]);
  assert.ok(most > 0, 'nothing ever moves');
  assert.ok(speeds.every((speed) => speed <= 1.01 * most) && Math.max(...speeds) > 0, `${speeds} of ${most} m/s`);
  await eventually(
    async () => (await differentPixels(before, await showReplay(page, Number((0.5 * end).toFixed(3))))) > 50,
    'links in the colour of their speed',
  );
});

/** The case whose arm the replay shows at first, where it keeps a clearance. */
const near = description.cases.find((c) => c.guarantees && c.grade === 'good' && c.clearance?.distance);
const part = (page, name) => page.locator('#replay .chip', { hasText: name });
const words = (page) => page.locator('.nearest-text').textContent();

testOfPage('the replay shows obstacles, the backup stop and what is nearest; each can be hidden', async () => {
  const page = await open(reportPath, { height: 2000 }); // nothing lies over the picture
  const at = Number((0.32 * end).toFixed(3));
  const whole = await showReplay(page, at);
  const frame = Math.floor((at - near.t0) / near.replay.step_s + 1e-9);
  const numbers = Array.from({ length: 11 }, (_, i) =>
    bytes.readFloatLE(near.replay.nearest.at + 4 * (11 * frame + i)),
  );
  const distance = `${Number((1000 * numbers[0]).toPrecision(3))} mm`;
  const { links, obstacles } = near.clearance;
  assert.equal(
    await words(page),
    `${links[numbers[1]]} – ${obstacles[numbers[2]]}: ${distance}, stop in ${numbers[10].toFixed(2)} s`,
  );
  const label = page.locator('.nearest-label:visible');
  assert.equal(await label.textContent(), distance);
  const place = async () => {
    const [box, around] = [await label.boundingBox(), await stage(page).boundingBox()];
    return box.x > around.x && box.y > around.y && box.x < around.x + around.width && box.y < around.y + around.height;
  };
  assert.ok(await place(), 'the label is within the picture');
  const { bytes: png } = await saved(page, page.locator('#replay').getByRole('button', { name: 'PNG' }));
  assert.ok((await differentPixels(png)) > 5000, 'an empty picture');
  for (const [name, least] of [
    ['obstacles', 5000],
    ['backup stop', 300],
    ['nearest points', 50],
  ]) {
    const button = part(page, name);
    assert.equal(await button.getAttribute('aria-pressed'), 'true');
    await button.click();
    assert.equal(await button.getAttribute('aria-pressed'), 'false');
    await changed(whole, stage(page), least, `the picture without ${name}`);
    if (name === 'nearest points') {
      assert.equal(await label.count(), 0);
      assert.equal(await page.locator('.nearest-text').isVisible(), false);
    }
    await button.click();
    await eventually(
      async () => (await differentPixels(whole, await stage(page).screenshot())) === 0,
      `the picture with ${name} again`,
    );
  }
  await page.locator('.replay-head select').selectOption({ label: 'all shown cases' });
  const lines = page.locator('.nearest-text p');
  await eventually(async () => (await lines.count()) === 2, 'a line per case with a clearance');
  assert.equal(await label.count(), 0, 'labels of several cases would lie on each other');
  await page.locator('.replay-head select').selectOption({ label: description.cases[0].name });
  await eventually(async () => !(await lines.first().isVisible()), 'nothing of a case without obstacles');
});

testOfPage('what the real arm touches has a plot, an arrow as long as its force, and words', async () => {
  const page = await open(reportPath, { height: 2000 });
  const { peak_N: peak, last_N: last, peak_s, obstacles } = touching.contact;
  assert.deepEqual(await page.locator('.verdict-contact').allTextContents(), [
    `pressed ${obstacles[0]} with up to ${peak.toPrecision(3)} N (at ${peak_s.toFixed(3)} s), ${last} N at the end`,
  ]);
  await reach(page, 'contact');
  assert.ok((await savedSvg(page, 'contact')).text.includes('>Contact force [N]<'));
  const [, high] = await rangeOf(page, 'contact');
  assert.ok(high > peak && high < 1.2 * peak, `${peak} N in a plot up to ${high} N`);

  const chip = part(page, 'contact force');
  const perDecimetre = Number((await chip.textContent()).match(/: 0\.1 m is (\S+) N$/)[1]);
  assert.match(String(perDecimetre), /^[125]0*$/);
  const arrow = () =>
    page.evaluate(() => {
      const { scene } = window.viableReport.replay;
      const found = scene.getObjectByName('force');
      found.updateMatrixWorld(true);
      const [rod, head] = found.children;
      const at = (part, height) => part.position.clone().set(0, height, 0).applyMatrix4(part.matrixWorld).toArray();
      return { isShown: found.visible, from: at(rod, 0), neck: at(rod, 1), base: at(head, -1), tip: at(head, 0) };
    });
  const close = (a, b, what) => assert.ok(Math.hypot(...a.map((value, i) => value - b[i])) < 1e-6, `${what}: ${a}, not ${b}`);
  for (const at of [1.502, 1.6, 1.798]) {
    await showReplay(page, at);
    const frame = Math.floor((at - touching.t0) / touching.replay.step_s + 1e-9);
    const [pressing, ...rest] = Array.from({ length: 7 }, (_, i) =>
      bytes.readFloatLE(touching.replay.contact.at + 4 * (8 * frame + i)),
    );
    const [force, point] = [rest.slice(0, 3), rest.slice(3)];
    assert.ok(pressing > 80, `${pressing} N`);
    const { isShown, from, neck, base, tip } = await arrow();
    assert.ok(isShown);
    close(from, point, 'it begins where the arm touches');
    close(tip, point.map((value, i) => value + (0.1 * force[i]) / perDecimetre), 'it ends at the tip of the force');
    close(neck, base, 'rod and head are one');
    const text = `${pressing.toPrecision(3)} N`;
    assert.equal(await page.locator('.nearest-label:visible', { hasText: /N$/ }).textContent(), text);
    assert.ok((await words(page)).startsWith(`presses ${obstacles[0]} with ${text}`), await words(page));
  }
  await chip.click();
  await eventually(async () => !(await arrow()).isShown, 'no arrow');
  assert.doesNotMatch(await words(page), /presses/);
  await chip.click();
  await eventually(async () => (await arrow()).isShown, 'the arrow again');
  await showReplay(page, 1.4); // nothing is touched
  assert.equal((await arrow()).isShown, false);
  assert.equal(await page.locator('.nearest-label:visible', { hasText: /N$/ }).count(), 0);
  await page.locator('.replay-head select').selectOption({ label: description.cases[0].name });
  await eventually(async () => (await chip.textContent()) === 'contact force', 'no scale without a force');
});

testOfPage('a moving sphere is where it is at the time of the scrubber', async () => {
  const own = await open();
  const slow = await openDescribed('slow_ball', ({ environments: [{ obstacles }] }) => {
    const ball = obstacles.find(({ type }) => type === 'moving_sphere');
    ball.waypoints = ball.waypoints.map(([time, ...place]) => [2 * time, ...place]);
  });
  const differ = async (at) => differentPixels(await showReplay(own, at), await showReplay(slow, at));
  assert.equal(await differ(0), 0, 'both begin at the first waypoint');
  assert.ok((await differ(0.2 * end)) > 300, 'the slower one is elsewhere');
});

testOfPage('joints whose names differ at the end only can be told apart', async () => {
  const name = (j) => `left_arm_of_the_iiwa_joint_${j + 1}`;
  const page = await openDescribed('names', (data) => data.robot.joints.forEach((joint, j) => (joint.name = name(j))));
  await showReplay(page, 0.1 * end);
  const shown = await page.locator('.joint-name').evaluateAll((buttons) =>
    buttons.map((button) => ({
      text: button.textContent,
      isWhole: button.clientWidth > 0 && button.scrollWidth <= button.clientWidth && button.scrollHeight <= button.clientHeight,
    })),
  );
  assert.deepEqual(
    shown,
    description.robot.joints.map((_, j) => ({ text: name(j), isWhole: true })),
  );
});

testOfPage('what has no end or is far away does not move the camera', async () => {
  const camera = (page) => page.evaluate(() => window.viableReport.replay.camera.position.toArray());
  const nearby = await openDescribed('near', ({ environments: [environment] }) => {
    environment.obstacles = environment.obstacles.filter(({ type }) => type !== 'half_space');
    environment.obstacles.find(({ type }) => type === 'map').centres.n -= 3; // the last cell is far away
  });
  const [own, bare] = [await camera(await open()), await camera(nearby)];
  assert.ok(Math.hypot(...own.map((value, i) => value - bare[i])) < 1e-6, `${own} and ${bare}`);
  const alone = await camera(await openDescribed('no_surroundings', (data) => (data.environments = [])));
  assert.ok(Math.hypot(...own) < 1.5 * Math.hypot(...alone), `${own} is farther away than ${alone}`);
});

testOfPage('a run without surroundings has nothing of them', async () => {
  const page = await openDescribed('empty_space', (data) => {
    delete data.environments;
    for (const c of data.cases) {
      for (const key of ['clearance', 'contact']) delete c[key];
      for (const key of ['rest', 'nearest', 'contact']) delete c.replay[key];
    }
  });
  await showReplay(page, 0.1 * end);
  assert.equal(await page.locator('#replay .chip').count(), 0);
  assert.equal(await page.locator('.nearest-text').isVisible(), false);
  assert.equal(await page.locator('.nearest-label').count(), 0);
  assert.equal(await page.locator(':is([data-quantity=clearance], [data-quantity=contact], .verdict-contact)').count(), 0);
});

testOfPage('maps and meshes that are lost are told; a clearance that nobody kept is not made up', async () => {
  const damaged = Buffer.from(bytes);
  for (const c of description.cases)
    for (let i = 0; i < (c.clearance ? c.replay.n : 0); ++i) damaged.writeFloatLE(NaN, c.replay.nearest.at + 44 * i);
  const note = 'The map is not drawn: there is no such file';
  const meshes = 'Meshes are missing: link `a`: <b>a.stl</b> was not found';
  const text = described((data) => {
    const [environment] = data.environments;
    environment.note = note;
    data.scene.note = meshes;
    delete environment.obstacles.find(({ type }) => type === 'map').centres;
    for (const c of data.cases) if (c.clearance) c.clearance.distance = null;
  });
  const page = await open(
    await variant('lost', replaced(text, 'viable-binary', gzipSync(damaged).toString('base64'))),
  );
  await showReplay(page, 0.1 * end);
  assert.deepEqual(await page.locator('#replay [role=note]').allTextContents(), [meshes, note]);
  assert.match(await words(page), /^stop in 0\.\d+ s$/);
  assert.equal(await page.locator('.nearest-label:visible').count(), 0);
  assert.equal(await part(page, 'nearest points').count(), 0);
  assert.equal(await part(page, 'obstacles').count(), 1);
  assert.equal(await panelOf(page, 'clearance').count(), 0);
});

const verified = description.cases.find((c) => c.verification?.verdict === 'broken');
const section = (page) => page.locator('#verification');
const verdictCell = (page, joint, column) =>
  section(page).locator('tbody tr').nth(joint).locator('.verdict-cell').nth(column);
const verdictRange = (page) => numbersOf(section(page).locator('.panel'), 'range');

async function openVerified(settings) {
  const page = await open(reportPath, settings);
  await section(page).locator('.group-head .chip', { hasText: verified.name }).click();
  return page;
}

testOfPage('what was verified is told joint by joint, in words and marks', async () => {
  const page = await openVerified();
  assert.equal(await section(page).locator('h2').textContent(), 'Did the real arm keep its limits?');
  assert.match(await section(page).locator('p.hint').first().textContent(), /99 % confidence.* by 10 % .* 50 ms/);
  const choices = await section(page).locator('.group-head .chip').allTextContents();
  assert.deepEqual(choices, ['C1 ?cannot tell', 'C3 ✗broken']);
  const words = { held: '✓held', broken: '✗broken', cannot_tell: '?cannot tell', no_limit: '–no limit' };
  const tones = new Set();
  for (const [j, { limits, trouble, curves }] of verified.verification.joints.entries()) {
    const row = section(page).locator('tbody tr').nth(j);
    assert.equal(await row.locator('th').textContent(), description.robot.joints[j].name);
    if (trouble) assert.equal(await row.locator('.trouble').textContent(), `? cannot tell: ${trouble}`);
    assert.equal(await row.locator('.verdict-cell').count(), curves ? 4 : 0);
    if (!curves) continue;
    for (const [i, limit] of Object.values(limits).entries()) {
      const text = await verdictCell(page, j, i).textContent();
      assert.ok(text.startsWith(words[limit.verdict]), `${text} is not ${limit.verdict}`);
      tones.add(
        await verdictCell(page, j, i).locator('.judgement').evaluate((element) => getComputedStyle(element).color),
      );
      const label = await verdictCell(page, j, i).getAttribute('aria-label');
      if (limit.broken) assert.match(label, /beyond the upper limit from [\d.]+ s on.* at least by .*rad\/s/);
      if (limit.broken) assert.match(text, /[\d.]+ s, by ≥ [\d.]+ rad\/s/);
      if (limit.verdict === 'held') assert.match(text, /seen from [\d.]+ % on/);
      if (limit.verdict === 'cannot_tell') assert.match(text, /seen only from \d+ % on/);
    }
  }
  assert.equal(tones.size, 4, [...tones].join());
  assert.match(await section(page).locator('tbody tr').first().textContent(), /0.21 µrad0.79 µrad12 ms3/);
});

testOfPage('a verdict that is chosen, by mouse or keys, has its plot: band and limits, whatever the readings', async () => {
  const page = await openVerified();
  const panel = section(page).locator('.panel');
  const heading = () => panel.locator('h3').textContent();
  const pressed = section(page).locator('.verdict-cell[aria-pressed=true]');
  await drawn(panel);
  assert.equal(await heading(), 'joint2: velocity [rad/s]', 'at first the worst');
  assert.match(await panel.locator('.facts').textContent(), /^Broken: beyond the upper limit/);
  const { text: broken } = await savedSvg(page, 'verification');
  assert.match(broken, /beyond, at least/);

  await verdictCell(page, 0, 3).click();
  assert.equal(await heading(), 'joint0: jerk [rad/s³]');
  assert.equal(await pressed.count(), 1);
  const { upper, lower } = verified.verification.joints[0].limits.jerk;
  await eventually(async () => (await verdictRange(page))[1] > upper, 'the range of the jerk');
  const [low, high] = await verdictRange(page);
  assert.ok(low < lower && high < 2 * upper, `the readings flatten band and limits: ${low} to ${high}`);
  assert.match(await panel.locator('.facts').textContent(), /differences of the readings from −1\d{4} /);
  const { name, text } = await savedSvg(page, 'verification');
  assert.match(name, /C3_joint0_jerk_verification\.svg$/);
  for (const label of ['upper limit', 'lower limit', '99 % band', 'differences of readings'])
    assert.ok(text.includes(label), label);

  const before = await panel.locator('.plot').screenshot();
  await panel.locator('.chip', { hasText: 'differences' }).click();
  await changed(before, panel.locator('.plot'), 5000, 'the picture without the readings');

  await verdictCell(page, 0, 3).focus();
  const at = await time(page);
  await page.keyboard.press('ArrowLeft');
  assert.equal(await heading(), 'joint0: acceleration [rad/s²]');
  for (const [joint, key] of [1, 2, 4].map((j) => [j, 'ArrowDown'])) {
    await page.keyboard.press(key);
    assert.equal(await heading(), `joint${joint}: acceleration [rad/s²]`, 'joint3 has no plot');
  }
  assert.equal(await pressed.evaluate((element) => element === document.activeElement), true);
  assert.equal(await section(page).locator('.verdict-cell[tabindex="0"]').count(), 1, 'one stop of the Tab key');
  assert.equal(await time(page), at, 'the scrubber stays');
});

testOfPage('the plot of a verdict shares the time in view and the scrubber', async () => {
  const page = await openVerified();
  await drag(page, 'verification', 0.3, 0.6);
  const [from, to] = await eventually(async () => {
    const view = await viewOf(page, 'verification');
    return view[1] < 0.7 * end ? view : null;
  }, 'a zoomed plot');
  await reach(page, 'position');
  await eventually(async () => (await viewOf(page, 'position')).join() === [from, to].join(), 'position zoomed, too');
  await page.keyboard.press('0');
  await reach(page, 'verification');
  const box = await over(page, 'verification').boundingBox();
  await page.mouse.click(box.x + 0.7 * box.width, box.y + 40);
  await eventually(async () => Math.abs((await time(page)) - 0.7 * end) < 0.02 * end, 'the scrubber at 70 %');
  await eventually(
    async () => /band .*readings /.test(await section(page).locator('.readout').textContent()),
    'the values there',
  );
});

testOfPage('cases that were not verified have nothing of it; what cannot be shown is noted', async () => {
  const note = 'C2.verify.json is not shown: it is about C1.mcap.';
  const bare = (data) => {
    for (const c of data.cases) delete c.verification;
  };
  const page = await openDescribed('not_verified', bare);
  assert.equal(await section(page).isVisible(), false);
  assert.equal(await page.locator('.verdict-cell').count(), 0);
  const noted = await openDescribed('noted', (data) => {
    bare(data);
    data.cases[1].verification_note = note;
  });
  assert.equal(await section(noted).textContent(), note);
  assert.equal(await section(noted).locator('[role=note]').isVisible(), true);
  const one = await openDescribed('one_verified', (data) => {
    delete data.cases[0].verification;
    for (const joint of data.cases[2].verification.joints) joint.curves = null;
  });
  assert.equal(await section(one).locator('button').count(), 0, 'nothing to choose');
  assert.equal(await section(one).locator('.panel').count(), 0);
  assert.match(await section(one).locator('.group-head').textContent(), /limits\?C3 ✗broken$/);
});

testOfPage('the plot of the clearance shows the safety distance and what is near it', async () => {
  const page = await open();
  await reach(page, 'clearance');
  const { text } = await savedSvg(page, 'clearance');
  assert.ok(text.includes('safety distance 20 mm'), 'no safety distance');
  const [low, high] = await rangeOf(page, 'clearance');
  assert.ok(low < 20 && high > 100 && high < 300, `${low} to ${high} mm`);
});

test('limits are drawn, labelled and in view, whatever the data', async () => {
  const page = await open();
  const stopped = description.cases.find((c) => c.stop && endOf(c) >= c.stop.time_s);
  for (const quantity of LIMITED) {
    const limits = description.cases.map(({ joints: [{ series }] }) => [
      series[`${quantity}_lower`],
      series[`${quantity}_upper`],
    ]);
    if (!limits.every((pair) => pair.every(Number.isFinite))) continue;
    const least = Math.min(...limits.map(([lower]) => lower));
    const largest = Math.max(...limits.map(([, upper]) => upper));
    await reach(page, quantity);
    const panel = panelOf(page, quantity);
    const [low, high] = await rangeOf(page, quantity);
    assert.ok(low < least && high > largest, `${quantity}: limits ${least}, ${largest} in ${low}, ${high}`);
    assert.ok(high - low < 4.5 * (largest - least), `${quantity}: the limits are flattened: ${low}, ${high}`);
    const { text } = await savedSvg(page, quantity);
    for (const [side, value] of [
      ['lower', limits[0][0]],
      ['upper', limits[0][1]],
    ])
      assert.ok(
        text.includes(`${side} limit ${String(Number(value.toPrecision(4))).replace('-', '−')} `),
        `${side} ${quantity}`,
      );
    if (stopped) assert.ok(text.includes('stops'), `no mark of the stop of ${stopped.name} in ${quantity}`);

    await panel.getByRole('button', { name: 'y: limits' }).click();
    const data = description.cases.map((c) => extremes(c, SERIES[quantity])).filter(Boolean);
    await eventually(async () => {
      const [all, most] = await rangeOf(page, quantity);
      return data.every(([a, b]) => all <= a && most >= b);
    }, `all ${quantity} in view`);
    await panel.getByRole('button', { name: 'y: all data' }).click();
  }
});

test('what the operator of a live run recorded is a click away', async () => {
  const page = await openDescribed('takes', (data) => {
    data.cases[0].takes = [{ number: 1, from_s: 0.2, to_s: 0.4 }, { number: 2, from_s: 1, to_s: 1.5 }];
  });
  await page.getByRole('group', { name: 'Takes' }).getByRole('button', { name: 'Take 2' }).click();
  assert.match(await page.textContent('.view-text'), /^1(\.0+)? – 1\.50* s$/);
  assert.match(await page.textContent('output.time'), /^1(\.0+)? s$/);

  // Many are a list; of several cases each tells whose it is.
  const list = await openDescribed('many_takes', (data) => {
    const takes = Array.from({ length: 5 }, (_, i) => ({ number: i + 1, from_s: 0.2 * i + 0.1, to_s: 0.2 * i + 0.2 }));
    data.cases = [data.cases[0], { ...structuredClone(data.cases[0]), name: 'other' }];
    for (const one of data.cases) one.takes = takes;
  });
  const select = list.getByRole('combobox', { name: 'Take' });
  const inView = () => list.textContent('.view-text');
  await select.selectOption('6'); // the second one of the other case
  assert.match(await inView(), /^0\.30* – 0\.40* s$/);
  await list.locator('h1').click();
  await list.keyboard.press('0'); // the whole run
  assert.doesNotMatch(await inView(), /^0\.30* – 0\.40* s$/);
  await select.dispatchEvent('pointerdown'); // who opens it again may choose the same one
  assert.equal(await select.inputValue(), '');
  await select.selectOption('6');
  assert.match(await inView(), /^0\.30* – 0\.40* s$/);
  // By keys one take comes after the other, from the first one on after the focus was elsewhere.
  for (let again = 0; again < 2; ++again) {
    await select.focus();
    await list.locator('h1').click(); // the focus goes elsewhere
    assert.equal(await select.inputValue(), '');
    await select.focus();
    await list.keyboard.press('ArrowDown');
    assert.match(await inView(), /^0\.10* – 0\.20* s$/);
    await list.keyboard.press('ArrowDown');
    assert.match(await inView(), /^0\.30* – 0\.40* s$/);
  }
  assert.match(await select.textContent(), /Take 2 of other, 0\.30* to 0\.40* s/);
});

test('what coincides is seen in turns; twelve cases are told apart', async () => {
  const page = await openDescribed('twelve', (data) => {
    const calm = data.cases.find((c) => c.guarantees) ?? data.cases[0];
    data.cases = Array.from({ length: 12 }, (_, i) => ({
      ...structuredClone(i < 8 ? calm : data.cases[i % data.cases.length]),
      name: `case ${i}`,
      stop: null,
    }));
  });
  assert.equal(await page.locator('.case-toggle').count(), 12);
  const marks = await page.locator('.case-toggle .swatch').evaluateAll((all) =>
    all.map((swatch) => {
      const { backgroundColor, backgroundImage, boxShadow } = getComputedStyle(swatch);
      return `${backgroundColor} ${backgroundImage} ${boxShadow}`;
    }),
  );
  assert.equal(new Set(marks).size, 12, marks.join('\n'));
  await reach(page, 'position');
  const panel = panelOf(page, 'position');
  await drawn(panel);
  const colours = await page.evaluate(() =>
    [0, 1, 2, 3, 4, 5, 6, 7].map((i) => getComputedStyle(document.documentElement).getPropertyValue(`--case-${i}`)),
  );
  const unseen = [];
  for (const colour of colours)
    if ((await pixelsOf(panel, parseInt(colour.trim().slice(1), 16))) < 5) unseen.push(colour);
  assert.deepEqual(unseen, [], 'colours that are hidden by others');
  assert.match((await savedSvg(page, 'position')).text, /stroke-dasharray="9 4"/); // of the ninth case on

  const second = parseInt(colours[1].trim().slice(1), 16);
  const inTurn = await pixelsOf(panel, second);
  await panel.locator('.value').nth(1).hover();
  await eventually(async () => (await pixelsOf(panel, second)) > 2 * inTurn, 'the line of the case that is pointed at');

  const toggle = page.locator('.case-toggle').nth(9);
  await toggle.dblclick();
  const pressed = () =>
    page.locator('.case-toggle').evaluateAll((all) => all.map((b) => b.getAttribute('aria-pressed')).join());
  assert.equal(await pressed(), Array.from({ length: 12 }, (_, i) => String(i === 9)).join());
  await toggle.dblclick();
  assert.equal(await pressed(), Array(12).fill('true').join());
  assert.ok((await overflow(page)) <= 0, 'too wide');
});

testOfPage('the limits and the bound of the real joint are drawn, named and can be hidden', async () => {
  // One case, so that its limits are common: the real joint's in red, beyond the nominal's; the band wide enough to see.
  const page = await openDescribed('real', (copy) => {
    copy.cases = [copy.cases.find(({ joints }) => joints[0].series.bound_position !== undefined)];
    for (const { series } of copy.cases[0].joints) series.bound_position = 0.3;
  });
  await reach(page, 'position');
  const panel = panelOf(page, 'position');
  const red = () => pixelsOf(panel, 0xb3261e);
  assert.ok((await red()) > 500, 'the limits of the real joint are drawn');
  assert.match(await panel.locator('.legend').textContent(), /limit of nominal.*limit of real joint/);
  const before = await panel.locator('.plot').screenshot();
  const band = panel.locator('.chip', { hasText: 'bound' });
  await band.click();
  assert.equal(await band.getAttribute('aria-pressed'), 'false');
  await changed(before, panel.locator('.plot'), 5000, 'the picture without the band');
  await reach(page, 'error');
  const [low, high] = await rangeOf(page, 'error');
  assert.ok(low < -300 && high > 300, `the bound of 300 mrad is in view: ${low} to ${high}`);
});

testOfPage('it is quick', async () => {
  const page = await open(reportPath, { ready: '.panel[data-view]' });
  const [first, plots] = await page.evaluate(() => [
    performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? 0,
    performance.now(),
  ]);
  await reach(page, 'velocity');
  await page.waitForTimeout(500);
  const session = await page.context().newCDPSession(page);
  await session.send('Performance.enable');
  const busy = async () =>
    (await session.send('Performance.getMetrics')).metrics.find(({ name }) => name === 'TaskDuration').value;
  const frame = () =>
    page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  /** How long the page works for a step [ms], in the middle. */
  async function measure(step, steps) {
    const times = [];
    for (let i = 0; i < steps; ++i) {
      const before = await busy();
      await step(i);
      await frame();
      times.push(1000 * ((await busy()) - before));
    }
    return times.sort((a, b) => a - b)[steps >> 1];
  }
  const box = await over(page, 'velocity').boundingBox();
  const hover = await measure((i) => page.mouse.move(box.x + 50 + 7 * i, box.y + 30), 15);
  const zoom = await measure((i) => page.keyboard.press(i % 2 ? '-' : '+'), 12);
  console.log(
    `     first paint ${first.toFixed(0)} ms, first plots ${plots.toFixed(0)} ms; ` +
      `work per zoom step ${zoom.toFixed(0)} ms, per move of the cursor ${hover.toFixed(0)} ms`,
  );
  assert.ok(plots < 10_000, `the first plots after ${plots} ms`); // generous: the machine may be slow and busy
  assert.ok(zoom < 1000, `${zoom} ms per zoom step`);
  assert.ok(hover < 0.5 * zoom + 50, `a move of the cursor takes ${hover} ms, a zoom step ${zoom} ms`);
}, { tries: 3 });

test('a click in a plot moves the scrubber and its line in all plots', async () => {
  const page = await open();
  await reach(page, 'position');
  const box = await over(page, 'position').boundingBox();
  await page.mouse.click(box.x + 0.4 * box.width, box.y + 20);
  await eventually(async () => Math.abs((await time(page)) - 0.4 * end) < 0.01 * end, 'the scrubber at 40 %');
  const lines = await page
    .locator('#plots .scrub-line:visible')
    .evaluateAll((all) => all.map((line) => line.getBoundingClientRect().left));
  assert.ok(lines.length >= 2, `${lines.length} lines`);
  assert.ok(Math.max(...lines) - Math.min(...lines) < 1.5, `lines at ${lines}`);
  if (hasScene)
    await eventually(
      async () => Math.abs(Number(await page.locator('.stage').getAttribute('data-time')) - (await time(page))) < 1e-3,
      'the replay is there, too',
    );
});

test('the read-out follows the mouse', async () => {
  const page = await open();
  await reach(page, 'position');
  const target = over(page, 'position');
  const box = await target.boundingBox();
  const text = () => panelOf(page, 'position').locator('.readout').textContent();
  const seen = new Set();
  for (const share of [0.2, 0.35, 0.5, 0.8]) {
    await page.mouse.move(box.x + share * box.width, box.y + 30);
    await page.waitForTimeout(300);
    seen.add(await text());
  }
  assert.ok(seen.size > 1, 'always the same numbers');
  assert.equal(
    await panelOf(page, 'velocity').locator('.u-cursor-x').evaluate((line) => getComputedStyle(line).display !== 'none'),
    true,
  );
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
});

testOfPage('two fingers zoom, one moves; Ctrl and wheel zoom', async () => {
  const page = await open(reportPath, { hasTouch: true });
  await reach(page, 'position');
  await over(page, 'position').evaluate((element) => element.scrollIntoView({ block: 'center' }));
  const box = await over(page, 'position').boundingBox();
  const session = await page.context().newCDPSession(page);
  const y = box.y + box.height / 2;
  const touch = (type, ...shares) =>
    session.send('Input.dispatchTouchEvent', {
      type,
      touchPoints: shares.map((share, id) => ({ x: box.x + share * box.width, y: y + id, id })),
    });
  const view = () => viewOf(page, 'position');
  const isNear = (value, wished) => Math.abs(value - wished) < 0.03 * end;
  await touch('touchStart', 0.4);
  await touch('touchStart', 0.4, 0.6);
  for (const spread of [0.13, 0.18, 0.25, 0.3]) await touch('touchMove', 0.5 - spread, 0.5 + spread);
  await touch('touchEnd');
  const [from, to] = await eventually(async () => {
    const zoomed = await view();
    return isNear(zoomed[1] - zoomed[0], end / 3) ? zoomed : null;
  }, 'a view of a third');
  assert.ok(isNear((from + to) / 2, end / 2), `zoomed to ${from}, ${to}: not about the fingers`);
  assert.equal(await time(page), 0, 'a pinch is no tap');

  await touch('touchStart', 0.3);
  for (const share of [0.35, 0.45, 0.6]) await touch('touchMove', share);
  await touch('touchEnd');
  await eventually(async () => isNear((await view())[0], from - 0.3 * (to - from)), 'a view moved to the left');
  assert.equal(await time(page), 0, 'a move is no tap');

  await page.touchscreen.tap(box.x + box.width / 2, y);
  await eventually(async () => {
    const [min, max] = await view();
    return isNear(await time(page), (min + max) / 2);
  }, 'a tap moves the scrubber');

  await page.keyboard.press('0');
  await eventually(async () => isNear((await view())[1], end), 'whole again');
  await page.mouse.move(box.x + 0.25 * box.width, y);
  await page.keyboard.down('Control');
  await page.mouse.wheel(0, -80);
  await page.keyboard.up('Control');
  await eventually(async () => {
    const [min, max] = await view();
    return max - min < 0.7 * end && min < 0.25 * end && max > 0.25 * end;
  }, 'the wheel zooms about the mouse');
});

testOfPage('the keyboard does it all', async () => {
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

  await reach(page, 'position');
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
});

testOfPage('all controls have names', async () => {
  const page = await open();
  const nameless = await page.evaluate(() =>
    [...document.querySelectorAll('button, select, input, [role=img]')]
      .filter((e) => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length))
      .map((e) => e.outerHTML.slice(0, 80)),
  );
  assert.deepEqual(nameless, []);
});

testOfPage('a hidden case is gone from the plots', async () => {
  const page = await open();
  const panel = panelOf(page, 'position');
  await drawn(panel);
  for (const toggle of await page.locator('.case-toggle').all()) await toggle.click();
  await eventually(async () => (await colouredPixels(panel)) === 0, 'no lines');
});

testOfPage('PNG and SVG are saved', async () => {
  const page = await open();
  for (const quantity of ['position', 'interventions', 'tick_time']) {
    const panel = panelOf(page, quantity);
    if ((await panel.count()) === 0) continue;
    const save = (name) => saved(page, panel.getByRole('button', { name, exact: true }));
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
  for (const format of ['PNG', 'SVG']) {
    const { name: file, bytes: figure } = await saved(page, page.getByRole('button', { name: `Figure as ${format}` }));
    assert.match(file, new RegExp(`limits\\.${format.toLowerCase()}$`));
    if (format === 'PNG') assert.ok((await differentPixels(figure)) > 5000, 'an empty figure');
    else
      for (const name of ['Position', 'Velocity', 'Acceleration', 'Jerk'])
        assert.ok(figure.includes(`>${name} [`), name);
  }
});

test('the summary table fits a screen of 1280 pixels', async () => {
  const page = await open(reportPath, { width: 1280, height: 900 });
  const { scrollWidth, clientWidth } = await page.locator('#summary .scroll').evaluate((root) => ({
    scrollWidth: root.scrollWidth,
    clientWidth: root.clientWidth,
  }));
  assert.ok(scrollWidth <= clientWidth, `${scrollWidth} pixels of ${clientWidth}`);
});

test('fits a phone of 375 pixels', async () => {
  const page = await open(reportPath, { width: 375, height: 812 });
  for (const details of await page.locator('#details summary').all()) await details.click();
  for (const panel of await panels(page)) await panel.scrollIntoViewIfNeeded();
  assert.ok((await overflow(page)) <= 0, `${await overflow(page)} pixels too wide`);
  for (const host of await page.locator('.scroll, #joints').all())
    assert.ok(await host.evaluate((root) => root.scrollWidth <= root.clientWidth), 'a table must be moved sideways');
  await page.locator('body').press('a');
  await page.waitForTimeout(500);
  assert.ok((await overflow(page)) <= 0, `${await overflow(page)} pixels too wide with all joints`);
  await page.keyboard.press('?');
  assert.ok((await page.locator('dialog').boundingBox()).width <= 375, 'the list of keys is too wide');
});

testOfPage('light and dark differ, by system and by switch', async () => {
  const look = (page) => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  const light = await open(reportPath, { colorScheme: 'light' });
  const dark = await open(reportPath, { colorScheme: 'dark' });
  assert.notEqual(await look(light), await look(dark));
  const pictures = [];
  for (const page of [light, dark]) {
    await reach(page, 'position');
    const panel = panelOf(page, 'position');
    await drawn(panel);
    pictures.push(await panel.screenshot());
  }
  assert.ok((await differentPixels(...pictures)) > 10_000);
  const before = await look(light);
  await light.getByRole('button', { name: 'Dark colours' }).click();
  assert.notEqual(await look(light), before);
  assert.equal(await look(light), await look(dark));
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
    if (c.verification) {
      spoil(c.verification, 'signal');
      c.verification_note = HOSTILE;
      for (const joint of c.verification.joints) {
        spoil(joint, 'unit', 'trouble');
        for (const limit of Object.values(joint.limits)) spoil(limit, 'unit', 'verdict');
      }
    }
    for (const key of c.clearance ? ['links', 'obstacles'] : [])
      c.clearance[key] = c.clearance[key].map((name) => HOSTILE + name);
    if (c.contact) c.contact.obstacles = c.contact.obstacles.map((name) => HOSTILE + name);
  });
  for (const environment of hostile.environments ?? []) {
    spoil(environment, 'note');
    environment.obstacles.forEach((obstacle) => spoil(obstacle, 'name'));
  }
  const page = await open(await variant('hostile', withData(hostile)));
  for (const summary of await page.locator('#details summary').all()) await summary.click();
  await page.keyboard.press('j');
  await page.keyboard.press('a');
  for (const panel of (await panels(page)).slice(0, 8)) await panel.scrollIntoViewIfNeeded();
  await page.keyboard.press('a');
  const svg = await savedSvg(page, 'interventions');
  assert.ok(!/<script|<img|onerror="/.test(svg.text), 'markup in the SVG');
  assert.match(svg.name, /^[\p{L}\p{N}._-]+\.svg$/u);
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
      (await page.locator('#page').textContent()).includes(name.slice(0, 110)),
      `not shown: ${name.slice(0, 60)}`,
    );
  assert.ok((await overflow(page)) <= 0, 'long names make the page too wide');
});

testOfPage('markup that slips in cannot run', async () => {
  const path = await variant(
    'injected',
    html.replace('</body>', () => '<script>window.hacked=1</script><img src="x.png" onerror="window.hacked=1"></body>'),
  );
  const page = await open(path);
  await page.waitForTimeout(300);
  assert.equal(await page.evaluate(() => window.hacked), undefined);
}, { isQuiet: false });

testOfPage('without WebGL the replay says so and the rest works', async () => {
  const poor = await chromium.launch({ executablePath: EXECUTABLE, args: ['--no-sandbox', '--disable-3d-apis'] });
  try {
    const page = await open(reportPath, { from: poor });
    assert.match(await page.locator('.no-replay').textContent(), hasScene ? /WebGL/ : /no/);
    const panel = panelOf(page, 'position');
    await drawn(panel);
    await setScrubber(page, end / 2);
  } finally {
    await poor.close();
  }
});

testOfPage('damaged data is told in words', async () => {
  const binary = content('viable-binary').trim();
  const cases = {
    cut: [replaced(html, 'viable-binary', binary.slice(0, Math.floor(binary.length / 8) * 4)), /damaged or cut off/],
    garbage: [replaced(html, 'viable-binary', 'no base64 at all!'), /damaged or cut off/],
    json: [replaced(html, 'viable-data', content('viable-data').slice(0, -20)), /damaged/],
    template: [replaced(replaced(html, 'viable-data', '@@VIABLE_' + 'DATA@@'), 'viable-binary', ''), /holds no data/],
    future: [described((data) => (data.format = 2)), /format 2/],
    reference: [described((data) => (data.cases[0].joints[0].series.nominal_q.at = 4e9)), /nominal_q.*not within/],
    length: [described((data) => (data.cases[0].joints[0].series.margin.n -= 1)), /margin.*values for/],
    joints: [described((data) => data.cases[0].joints.pop()), /joints/],
    verification: [
      described((data) => (data.cases[0].verification.joints[0].curves.jerk.band.n -= 2)),
      /verification.*curves.jerk.band.*values/,
    ],
    contact: [
      described((data) => (data.cases.find((c) => c.contact).replay.contact.n -= 8)),
      /replay.contact.*values/,
    ],
  };
  for (const [name, [text, expected]] of Object.entries(cases)) {
    const page = await open(await variant(name, text), { ready: '#message:not([hidden])' });
    assert.match(await page.locator('#message').textContent(), expected, name);
    assert.equal(await page.locator('#loading').isVisible(), false);
    await page.close();
  }
});

testOfPage('gaps, missing series and cases without rows are no error', async () => {
  const data = structuredClone(description);
  const [c] = data.cases;
  const missing = 'real_q real_qd real_qdd real_jerk error tau_robust tau_motor position_lower position_upper'.split(' ');
  for (const joint of c.joints) for (const name of missing) joint.series[name] = null;
  c.replay.real = null;
  const empty = structuredClone(c);
  const none = (type) => ({ at: 0, n: 0, type });
  Object.assign(empty, {
    name: 'empty',
    rows: 0,
    buckets: 0,
    status: none('u8'),
    replay: { step_s: 0.01, n: 0, nominal: none('f32'), real: null },
    tick_time: { edges_us: [], counts: [], late: 0 },
    tool: undefined,
  });
  for (const joint of empty.joints) {
    joint.active = none('u8');
    for (const [key, value] of Object.entries(joint.series)) if (value?.type) joint.series[key] = none('f32');
  }
  data.cases.push(empty);
  const page = await open(await variant('gaps', withData(data)));
  for (const panel of await panels(page)) await panel.scrollIntoViewIfNeeded();
  for (const choice of hasScene
    ? await page.locator('.replay-head option').evaluateAll((all) => all.map(({ value }) => value))
    : []) {
    await page.locator('.replay-head select').selectOption(choice);
    await setScrubber(page, end / 3);
    await page.waitForTimeout(200);
  }
  assert.equal(await page.locator('#message').isVisible(), false);
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
  await panelOf(phone, 'position').scrollIntoViewIfNeeded();
  await panelOf(phone, 'interventions').evaluate((panel) => scrollTo(0, panel.offsetTop - 120));
  await phone.waitForTimeout(2000);
  await phone.screenshot({ path: shot('phone') });
}

await runTests(tests);
if (options.screenshots) await takeScreenshots();
await finish();
