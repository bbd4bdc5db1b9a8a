// What the tests of the page of a live arm share: node TEST BUILD SOURCE [--screenshots FOLDER]. An arm is a simulated Indy7
// that the program drives; without a browser the exit code is 77.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { mkdirSync, mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

export const [build, source, ...more] = process.argv.slice(2);
process.env.VIABLE_REPORT_FOLDER = join(build, 'report');
const { browser, eventually } = await import('./browser.mjs');
export const shots = more.includes('--screenshots') ? more[more.indexOf('--screenshots') + 1] : null;
if (shots) mkdirSync(shots, { recursive: true });
const folder = mkdtempSync(join(tmpdir(), 'viable-live-test-'));
process.on('exit', () => rmSync(folder, { recursive: true, force: true }));
export const program = join(build, 'bin/viable');
export const TITLE = '<img src=x onerror="window.hacked=1"></title><script>window.hacked=1</script>';
export const sleep = (ms) => new Promise((wait) => setTimeout(wait, ms));

/** A live arm in a process of its own. */
export class Arm {
  text = '';
  #process;

  constructor(name, ...words) {
    const experiment = words[0]?.endsWith('.yaml') ? words.shift() : 'indy7_live.yaml';
    this.out = join(folder, name);
    this.#process = spawn(
      program,
      [
        'live', join(source, 'experiments', experiment), '--case', name, '--out', this.out, '--no-report',
        '--set', `title=${JSON.stringify(TITLE)}`, ...words, ...(words.includes('--page') ? [] : ['--page', '127.0.0.1:0']),
      ],
      { env: { ...process.env, XDG_STATE_HOME: join(folder, 'state') }, stdio: ['ignore', 'pipe', 'pipe'] },
    );
    for (const stream of [this.#process.stdout, this.#process.stderr])
      stream.on('data', (data) => (this.text += data));
    this.id = this.#process.pid;
    this.ended = new Promise((resolve) => this.#process.on('exit', resolve));
    process.on('exit', () => this.#process.kill('SIGKILL'));
  }

  /** Once it is held. */
  get isRealTime() {
    return !/not real time/.test(this.text);
  }

  async address() {
    await eventually(() => /page: (\S+)/.test(this.text) || this.#process.exitCode !== null, 'the address of the page');
    const found = this.text.match(/page: (\S+)/);
    assert.ok(found, this.text);
    return found[1];
  }
}

const HELD_UP_MS = 90; // the loop holds the arm after 100 ms without a message

/** Keeps the connection, and the longest time in which a pressed hand said nothing. */
function watchSilence() {
  window.WebSocket = class extends WebSocket {
    constructor(...all) {
      super(...all);
      window.socket = this;
    }
  };
  const { send } = WebSocket.prototype;
  window.silence = { last: 0, longest: 0, isPressed: false };
  WebSocket.prototype.send = function (data) {
    if (typeof data !== 'string') {
      const now = performance.now();
      const { silence } = window;
      if (silence.isPressed) silence.longest = Math.max(silence.longest, now - silence.last);
      silence.last = now;
      silence.isPressed = (new Uint8Array(data)[1] & 1) === 1;
    }
    return send.call(this, data);
  };
}

/** For how long a page was held up since the last call, so that the arm was held as it should [ms]; 0: none was. */
export async function wasHeldUp() {
  let longest = 0;
  for (const page of browser.contexts().flatMap((context) => context.pages()))
    longest = Math.max(
      longest,
      await page
        .evaluate(() => {
          const { longest: found } = window.silence;
          window.silence.longest = 0;
          return found;
        })
        .catch(() => 0),
    );
  return longest > HELD_UP_MS ? longest : 0;
}

/** A browser of its own at an address; `scripts` run before those of the page. */
export async function open(address, { width = 1280, height = 900, colorScheme = 'light', hasTouch = false, isMobile = false, scripts = [] } = {}) {
  const context = await browser.newContext({
    viewport: { width, height },
    colorScheme,
    hasTouch,
    isMobile,
    ignoreHTTPSErrors: true,
  });
  for (const script of [watchSilence, ...scripts]) await context.addInitScript(script);
  const page = await context.newPage();
  page.problems = [];
  page.on('console', (message) => {
    if (message.type() === 'error') page.problems.push(message.text());
  });
  page.on('pageerror', (error) => page.problems.push(error.message));
  page.on('request', (request) => {
    if (new URL(request.url()).origin !== new URL(address).origin && !request.url().startsWith('blob:'))
      page.problems.push(`request: ${request.url()}`);
  });
  page.setDefaultTimeout(60_000);
  await page.goto(address);
  return page;
}

/** The same, once it shows the arm. */
export async function openArm(address, settings) {
  const page = await open(address, settings);
  await page.waitForSelector('.stage[data-pictures]');
  return page;
}

export const press = (page, name) => page.getByRole('button', { name, exact: true }).click();
export const numbers = (page, name) => page.evaluate((key) => [...window.viableLive.link.frame(key)], name);
export const number = async (page, name) => (await numbers(page, name))[0];
/** The limits that act, by their names. */
export const limits = (page) => page.evaluate(() => window.viableLive.limits().filter(Boolean));
export const distance = (a, b) => Math.hypot(...[0, 1, 2].map((i) => a[i] - b[i]));
export const tool = (page) => numbers(page, 'tool');
const isAtRest = async (page) => Math.max(...(await numbers(page, 'qd')).map(Math.abs)) < 1e-4;
export const awaitRest = (page) => eventually(() => isAtRest(page), 'the arm at rest');
export const projected = (page, point) => page.evaluate((p) => window.viableLive.view.project(p), point.slice(0, 3));
export const shoot = (page, name) => shots && page.screenshot({ path: join(shots, `${name}.png`) });

/** Holds the frame at the tool and pulls it by so many pixels. */
export async function drag(page, dx, dy) {
  const { x, y } = await projected(page, await tool(page));
  await page.mouse.move(x, y);
  await sleep(200); // the frame sees what is pointed at
  await page.mouse.down();
  for (let i = 1; i <= 10; ++i) {
    await page.mouse.move(x + (dx * i) / 10, y + (dy * i) / 10);
    await sleep(30);
  }
}

/**
 * What the loop does once `act` is over, by the frames that a page gets: the time until the hand is no longer engaged, and
 * until the arm rests. [s] `act` may tell when it was done, by the page's clock; else it is when it was asked for.
 */
export async function timesAfter(page, act) {
  await page.evaluate(() => {
    const { link } = window.viableLive;
    window.seen = [];
    link.on('frame', () => {
      const one = (name) => link.frame(name)[0];
      window.seen?.push([one('time_s'), one('hand'), Math.max(...[...link.frame('qd')].map(Math.abs)), performance.now()]);
    });
  });
  await sleep(100);
  const asked = await page.evaluate(() => performance.now());
  const done = await act();
  const at = typeof done === 'number' ? done : asked;
  await sleep(2500);
  const seen = await page.evaluate(() => {
    const all = window.seen;
    window.seen = null; // what is kept for ever would count as the page's memory
    return all;
  });
  const [begin, hand] = seen.filter((one) => one[3] <= at).at(-1);
  assert.equal(hand, 1, 'the hand is engaged before');
  const after = seen.filter((one) => one[0] >= begin);
  const decided = after.find((one) => one[1] !== 1);
  const rested = after.find((one, i) => one[1] !== 1 && after.slice(i).every((later) => later[2] < 1e-3));
  assert.ok(decided && rested, 'the arm does not come to rest');
  return { decided: decided[0] - begin, rested: rested[0] - begin, seen };
}

/**
 * From now on a page takes of all frames none ('none'), again and again the first ('same'), or those until the arm brakes
 * ('moving'), until window.hear(). The connection stays open.
 */
export const filterFrames = (page, kind) =>
  page.evaluate((which) => {
    const { socket } = window;
    const { onmessage } = socket;
    let first = null;
    window.hear = () => {
      socket.onmessage = onmessage;
    };
    socket.onmessage = (message) => {
      if (typeof message.data === 'string') return onmessage(message);
      if (which === 'none' || (which === 'moving' && window.viableLive.link.frame('state')[0] > 1)) return undefined;
      first ??= message;
      return onmessage(which === 'same' ? first : message);
    };
  }, kind);

/** The address for one more browser, from the page that is in. */
export async function invite(page) {
  await press(page, 'Invite');
  const field = page.getByRole('textbox', { name: 'Address', exact: true });
  const text = await field.inputValue();
  await press(page, 'Close');
  return text;
}

/** An arm that is held, and its address. */
export async function holdArm(name, ...words) {
  const arm = new Arm(name, ...words);
  const address = await arm.address();
  await eventually(() => /armed \(program\)/.test(arm.text), 'the arm is held');
  return { arm, address };
}
