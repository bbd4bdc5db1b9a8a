// What a bad line between an operator and a live arm does: delay, jitter, lost, doubled and reordered messages, stalls, half-open
// connections, slow readers, many viewers: node line_test.mjs BUILD SOURCE [--out FOLDER] [--seed N] [--judge-times]
// --out: line.csv and line.svg, the tool's error against the delay. --judge-times: it fails, too, if the loop notices.
// The operator is no browser, but speaks as the page does, through a line that this program makes bad; a viewer on a good line sees
// what the arm does. About four minutes. Exit code 77: this machine gives no real time, so that no hand can be judged, or
// has no chromium, which the other tests of the page need.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { createReadStream, mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join, resolve } from 'node:path';
import { createInterface } from 'node:readline';
import { openLive, quantile } from '../support/live_client.mjs';
import { Arm, build, distance, more, program, sleep } from './live_arm.mjs';

const { eventually, finish } = await import('./browser.mjs');
await finish(); // nobody looks at a page here
const WebSocket = createRequire(join(resolve(build, 'log_readers'), 'package.json'))('ws');
const option = (name) => (more.includes(name) ? more[more.indexOf(name) + 1] : null);
const seed = Number(option('--seed') ?? 1);
console.log(`seed ${seed}`);

const WINDOW_MS = 8000;
const HAND_MS = 16;
const STALL_EVERY_MS = 2000;
const PRESS_AGAIN_MS = 300; // an operator who sees that the hand is refused
const REACH_M = 0.1; // how far the hand goes, at up to 0.08 m/s
const SWING_S = 4.0;
const MOST_MPS = 0.5; // of the tool, which may have to catch up
const MOST_SLOWER = 1.1; // p99 of the loop's compute time, to that on a good line
const [ENGAGED, HELD, REFUSED] = [1, 2, 3];

/** Numbers in [0, 1): mulberry32. */
function makeRandom(begin) {
  let state = begin | 0;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
}
let lineCount = 0;

/**
 * A way for messages: each comes `delay` later, in order. Those of a hand (binary) may be lost, doubled, and come out of order:
 * what is only the newest is sent like that, and words are not. [ms, shares]
 */
class Line {
  #queue = [];
  #timer = 0;

  constructor(deliver, { delay = 0, jitter = 0, loss = 0, doubles = 0, reorders = false, stall = 0 } = {}) {
    Object.assign(this, { deliver, delay, jitter, loss, doubles, reorders, stall });
    this.begin = performance.now();
    this.random = makeRandom(seed + 1000 * ++lineCount);
    this.isCut = false;
  }

  send(message) {
    if (this.isCut) return;
    const isHand = typeof message !== 'string';
    if (isHand && this.random() < this.loss) return;
    const now = performance.now();
    let due = now + this.delay + this.jitter * this.random();
    // What TCP makes of a lost packet: nothing for a while, then all at once.
    if (this.stall > 0) {
      const phase = (now - this.begin) % STALL_EVERY_MS;
      if (phase < this.stall) due += this.stall - phase;
    }
    if (this.reorders && isHand) {
      setTimeout(() => this.deliver(message), due - now);
      return;
    }
    const copies = isHand && this.random() < this.doubles ? 2 : 1;
    due = Math.max(due, this.#queue.at(-1)?.due ?? 0);
    for (let k = 0; k < copies; ++k) this.#queue.push({ due, message });
    this.#pump();
  }

  /** What is due, one after the other. */
  #pump() {
    clearTimeout(this.#timer);
    while (this.#queue.length > 0 && this.#queue[0].due <= performance.now() + 0.5) {
      const { message } = this.#queue.shift();
      if (!this.isCut) this.deliver(message);
    }
    if (this.#queue.length > 0) this.#timer = setTimeout(() => this.#pump(), this.#queue[0].due - performance.now());
  }
}

/** A page without a browser: speaks through a line each way. */
class Client {
  you = 0;
  operator = null;
  refusals = 0;
  #fields = new Map();
  #wait = null;

  constructor(address, fault = {}) {
    this.socket = openLive(WebSocket, address);
    this.out = new Line((message) => this.socket.readyState === WebSocket.OPEN && this.socket.send(message), fault);
    this.in = new Line((data) => this.#hear(data), { ...fault, loss: 0, doubles: 0, reorders: false });
    this.socket.on('message', (data, isBinary) => this.in.send(isBinary ? data : String(data)));
    this.socket.on('error', () => {});
    this.isOpen = new Promise((open, fail) => this.socket.once('open', open).once('error', fail));
    this.alive = setInterval(() => this.out.send('alive'), 2000);
  }

  #hear(data) {
    if (typeof data !== 'string') {
      this.frame = Float64Array.from({ length: data.length / 8 }, (_, i) => data.readDoubleLE(8 * i));
      this.onFrame?.(this);
      return;
    }
    const message = JSON.parse(data);
    if (message.hello) this.you = message.you;
    if ('people' in message) this.operator = message.operator;
    if (message.invitation) this.#wait?.(message.invitation);
    let at = 0;
    for (const [name, count] of message.fields ?? []) {
      this.#fields.set(name, [at, count]);
      at += count;
    }
  }

  get(name) {
    const [at, count] = this.#fields.get(name);
    return this.frame.subarray(at, at + count);
  }

  get isReady() {
    return Boolean(this.frame) && this.#fields.size > 0 && this.you !== 0;
  }

  invite() {
    const answer = new Promise((take) => (this.#wait = take));
    this.out.send('invite');
    return answer;
  }

  sendHand(press, isPressed, position) {
    const bytes = Buffer.alloc(8 + 8 * 10);
    bytes.writeUInt8(1, 0);
    bytes.writeUInt8((isPressed ? 1 : 0) | 2, 1);
    bytes.writeUInt32LE(press, 4);
    [performance.now() / 1000, this.frame[0], 1, ...position, 1, 0, 0, 0].forEach((x, i) => bytes.writeDoubleLE(x, 8 + 8 * i));
    this.out.send(bytes);
  }

  close() {
    clearInterval(this.alive);
    this.socket.terminate();
  }
}

/** Where the hand is, from a place of rest: to and fro on a slanted way. */
function handAt(now) {
  const swing = (REACH_M / 2) * (1 - Math.cos((2 * Math.PI * now) / SWING_S));
  return [0.6 * swing, 0.5 * swing, Math.sqrt(1 - 0.36 - 0.25) * swing];
}
const minus = (a, b) => [0, 1, 2].map((i) => a[i] - b[i]);
const rms = (values) => Math.sqrt(values.reduce((sum, x) => sum + x * x, 0) / Math.max(1, values.length));

const arm = new Arm('tool');
const address = await arm.address();
await eventually(() => /armed \(program\)/.test(arm.text), 'the arm is held');
if (!arm.isRealTime) {
  console.log(`SKIPPED: this machine gives no real time:\n${arm.text}`);
  process.exit(77);
}
const monitor = new Client(address);
await monitor.isOpen;
await eventually(() => monitor.isReady, 'the monitor sees the arm');
const time = () => monitor.get('time_s')[0];
const isAtRest = () => Math.max(...[...monitor.get('qd')].map(Math.abs)) < 1e-4;

/**
 * An operator moves the hand for a while, by a line with a fault.
 * @param act  called in the middle of the window
 * @returns what came of it: errors of the tool [m], shares of the time in which it was engaged, held, refused, times by the loop
 */
async function operate(fault, { act = () => {}, viewers = 0 } = {}) {
  const crowd = [];
  for (let i = 0; i < viewers; ++i) {
    crowd.push(new Client(await monitor.invite()));
    await crowd.at(-1).isOpen;
  }
  const client = new Client(await monitor.invite(), fault);
  await client.isOpen;
  await eventually(() => client.isReady, 'the operator sees the arm');
  client.out.send('take over');
  await eventually(() => monitor.operator === client.you, 'it operates');
  client.out.send('start');
  await eventually(() => monitor.get('state')[0] === 1, 'the arm runs');
  await eventually(isAtRest, 'the arm rests');
  let press = 1;
  let releasedAt = -1;
  const begin = performance.now();
  const errors = [];
  const speeds = [];
  const hands = [0, 0, 0, 0];
  const from = time();
  const toolBegin = [...monitor.get('tool')];
  let last = { at: from, tool: toolBegin };
  monitor.onFrame = () => {
    const now = (performance.now() - begin) / 1000;
    const next = { at: time(), tool: [...monitor.get('tool')] };
    if (next.at > last.at) speeds.push(distance(next.tool, last.tool) / (next.at - last.at));
    last = next;
    errors.push(distance(minus(monitor.get('tool'), toolBegin), handAt(now)));
    hands[monitor.get('hand')[0]] += 1;
  };
  const timer = setInterval(() => {
    const now = performance.now() - begin;
    if (client.get('hand')[0] === REFUSED && releasedAt < 0) {
      releasedAt = now;
      ++client.refusals;
    }
    const isPressed = releasedAt < 0;
    client.sendHand(press, isPressed, handAt(now / 1000));
    if (!isPressed && now - releasedAt > PRESS_AGAIN_MS && client.get('hand')[0] !== REFUSED) {
      releasedAt = -1;
      ++press;
    }
  }, HAND_MS);
  await sleep(WINDOW_MS / 2);
  const acted = await act(client);
  await sleep(WINDOW_MS / 2);
  monitor.onFrame = null;
  clearInterval(timer);
  const found = { from, to: time(), errors, fastest: Math.max(...speeds), hands: hands.map((count) => count / errors.length), refusals: client.refusals, acted };
  client.close();
  for (const one of crowd) one.close();
  await eventually(() => isAtRest() && monitor.get('hand')[0] !== ENGAGED, 'the arm rests without an operator');
  return found;
}

/** When the loop holds the arm and when it ends the engagement, once nothing comes any more. [s] */
async function watchSilence() {
  const begin = performance.now();
  const when = {};
  const before = monitor.onFrame;
  monitor.onFrame = () => {
    before?.();
    const hand = monitor.get('hand')[0];
    if (hand === HELD) when.held ??= (performance.now() - begin) / 1000;
    if (hand === REFUSED) when.refused ??= (performance.now() - begin) / 1000;
    if (monitor.operator === null) when.gone ??= (performance.now() - begin) / 1000;
  };
  await eventually(() => when.held && when.refused && when.gone, 'a silent operator is held, refused, and gone');
  monitor.onFrame = before;
  return when;
}

const rows = [];
async function row(name, fault, options = {}) {
  const found = await operate(fault, options);
  const { from, to, errors, fastest, hands, refusals, acted } = found;
  rows.push({ name, fault, from, to, error: rms(errors), worst: Math.max(...errors), fastest, hands, refusals });
  console.log(
    `${name.padEnd(26)} tool off ${(1000 * rms(errors)).toFixed(1)} mm RMS, ${(1000 * Math.max(...errors)).toFixed(1)} at most, up to ${fastest.toFixed(2)} m/s; engaged ` +
      `${(100 * hands[ENGAGED]).toFixed(0)} %, held ${(100 * hands[HELD]).toFixed(0)} %, refused ${(100 * hands[REFUSED]).toFixed(0)} %, ` +
      `pressed anew ${refusals} times`,
  );
  return acted;
}

const DELAYS = [10, 20, 50, 100, 150, 250, 500, 1000, 2000]; // there and back
await row('good line', {});
for (const delay of DELAYS) await row(`delay ${delay} ms`, { delay: delay / 2 });
await row('jitter 0 to 60 ms', { jitter: 30 });
await row('10 % lost', { loss: 0.1 });
await row('60 % lost', { loss: 0.6 });
await row('30 % doubled', { doubles: 0.3 });
await row('out of order', { jitter: 60, reorders: true });
await row('stalls of 150 ms', { stall: 150 });
await row('stalls of 700 ms', { stall: 700 });
const half = await row('half-open', {}, {
  act: async (client) => {
    client.out.isCut = true; // nothing goes any more, and nobody says so
    client.socket._socket.pause();
    return watchSilence();
  },
});
console.log(`  held after ${(1000 * half.held).toFixed(0)} ms, refused after ${(1000 * half.refused).toFixed(0)} ms, let go after ${half.gone.toFixed(1)} s`);
await row('reads nothing for 3 s', {}, {
  act: async (client) => {
    client.socket._socket.pause();
    setTimeout(() => client.socket._socket.resume(), 3000);
  },
});
await row('14 viewers more', {}, { viewers: 14 });
await row('good line again', {});
monitor.out.send('stop');
assert.equal(await arm.ended, 0, arm.text);
monitor.close();

// What the loop made of it.
const log = join(arm.out, 'tool.mcap');
const again = spawnSync(program, ['run', log, '--again'], { encoding: 'utf8' });
assert.equal(again.status, 0, again.stdout + again.stderr);
const [summary] = JSON.parse(readFileSync(join(arm.out, 'summary.json'), 'utf8')).cases;
for (const [quantity, joints] of Object.entries(summary.limits))
  for (const [joint, { ticks_outside: outside }] of Object.entries(joints))
    assert.equal(outside, 0, `${joint} passes its limit of ${quantity}`);
const csv = join(arm.out, 'log.csv');
assert.equal(spawnSync(program, ['export', log, '--to', 'csv', csv]).status, 0);
const ticks = []; // time, computing time, missed: the whole is larger than what a string may be
let places = null;
for await (const line of createInterface({ input: createReadStream(csv) })) {
  const all = line.split(',');
  if (places) ticks.push(places.map((at) => Number(all[at])));
  else places = ['time_s', 'tick.compute_us', 'tick.missed'].map((name) => all.indexOf(name));
}
for (const one of rows) {
  const within = ticks.filter(([at]) => at >= one.from && at <= one.to);
  one.p50 = quantile(within.map(([, us]) => us), 0.5);
  one.p99 = quantile(within.map(([, us]) => us), 0.99);
  one.missed = within.reduce((sum, [, , missed]) => sum + missed, 0);
  one.ticks = within.length;
  console.log(`${one.name.padEnd(26)} compute p50 ${one.p50.toFixed(1)}, p99 ${one.p99.toFixed(1)} us, missed ${one.missed} of ${one.ticks}`);
}
console.log('all joint limits kept, the log replays to the bit');

const folder = option('--out');
if (folder) {
  mkdirSync(folder, { recursive: true });
  const table = rows.map((r) => [r.name, 1000 * r.error, 1000 * r.worst, ...r.hands.slice(1), r.refusals, r.p50, r.p99, r.missed, r.ticks].join(','));
  writeFileSync(
    join(folder, 'line.csv'),
    ['line,rms_mm,worst_mm,engaged,held,refused,pressed_anew,compute_p50_us,compute_p99_us,missed,ticks', ...table, ''].join('\n'),
  );
  writeFileSync(join(folder, 'line.svg'), drawDelays(rows.filter(({ name }) => name.startsWith('delay '))));
}

// Whoever sees the arm 200 ms late is not followed, and 500 ms late no longer in control; what comes in time moves the arm
// whatever else the line does; and nothing that a line does makes the tool jump.
const of = (name) => rows.find((one) => one.name === name);
for (const name of ['good line', 'delay 10 ms', 'delay 20 ms', 'delay 50 ms', 'jitter 0 to 60 ms', '10 % lost', '30 % doubled', 'out of order', '14 viewers more', 'good line again']) {
  assert.ok(of(name).hands[ENGAGED] > 0.9, `${name}: it is not engaged`);
  assert.ok(of(name).error < 0.02, `${name}: the tool does not follow`);
}
for (const name of ['delay 100 ms', '60 % lost', 'stalls of 150 ms']) assert.ok(of(name).hands[ENGAGED] > 0.5, `${name}: it is hardly engaged`);
for (const delay of [500, 1000, 2000]) assert.ok(of(`delay ${delay} ms`).hands[ENGAGED] < 0.05, `${delay} ms late is too late`);
for (const name of ['stalls of 700 ms', 'reads nothing for 3 s', 'half-open', 'delay 1000 ms']) assert.ok(of(name).hands[HELD] + of(name).hands[REFUSED] > 0, `${name}: is not noticed`);
for (const one of rows) assert.ok(one.fastest < MOST_MPS, `${one.name}: the tool jumps`);
assert.ok(half.held >= 0.08 && half.held <= 0.2 && half.refused >= 0.45 && half.refused <= 0.65 && half.gone < 15, JSON.stringify(half));
if (!more.includes('--judge-times')) process.exit(0); // a machine of several cores, with nothing else on it
const good = rows.filter(({ name }) => name.startsWith('good line'));
const most = Math.max(...good.map(({ p99 }) => p99));
const usual = good.reduce((sum, one) => sum + one.missed, 0) / good.reduce((sum, one) => sum + one.ticks, 0);
for (const one of rows) {
  assert.ok(one.p99 <= MOST_SLOWER * most, `${one.name}: the loop notices, ${one.p99} us against ${most}`);
  // Ticks are missed by chance where others use the machine: three standard deviations of the difference of two such counts.
  const expected = usual * one.ticks;
  assert.ok(one.missed <= expected + 3 * Math.sqrt(expected + one.missed), `${one.name}: ticks are missed, ${one.missed} against ${expected}`);
}
process.exit(0);

/** The tool's error against the delay, with logarithmic time. */
function drawDelays(points) {
  const [width, height, left, bottom] = [560, 320, 60, 44];
  const highest = Math.max(...points.map(({ worst }) => 1000 * worst)) * 1.1;
  const [low, high] = [Math.log10(8), Math.log10(2500)];
  const x = (ms) => left + ((Math.log10(ms) - low) / (high - low)) * (width - left - 16);
  const y = (mm) => height - bottom - (mm / highest) * (height - bottom - 16);
  const at = points.map((one) => [2 * one.fault.delay, 1000 * one.error, 1000 * one.worst]);
  const line = (k, colour) =>
    `<polyline fill="none" stroke="${colour}" stroke-width="2" points="${at.map((p) => `${x(p[0])},${y(p[k])}`).join(' ')}"/>` +
    at.map((p) => `<circle cx="${x(p[0])}" cy="${y(p[k])}" r="3.5" fill="${colour}"/>`).join('');
  const text = (px, py, what, anchor = 'middle') => `<text x="${px}" y="${py}" text-anchor="${anchor}">${what}</text>`;
  const marks = [10, 20, 50, 100, 200, 500, 1000, 2000].map((ms) => text(x(ms), height - bottom + 18, ms)).join('');
  const heights = [0, 0.25, 0.5, 0.75, 1].map((share) => Math.round(share * highest));
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" font-family="sans-serif" font-size="12" fill="#333">` +
    `<rect width="${width}" height="${height}" fill="#fff"/>` +
    heights.map((mm) => `<path d="M${left} ${y(mm)}H${width - 16}" stroke="#ddd"/>${text(left - 8, y(mm) + 4, mm, 'end')}`).join('') +
    `<path d="M${x(200)} 16V${height - bottom}" stroke="#b00" stroke-dasharray="4 3"/>${text(x(200) + 6, 28, 'not followed beyond', 'start')}` +
    line(1, '#1f6fb4') + line(2, '#c46a1b') + marks +
    text((width + left) / 2, height - 8, 'delay, there and back [ms]') +
    `<g transform="rotate(-90 16 ${height / 2})">${text(16, height / 2, 'tool off the hand [mm]: RMS (blue), largest')}</g></svg>\n`
  );
}
