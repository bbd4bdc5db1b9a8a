// What an operator wears or holds moves a live arm: node hands_test.mjs BUILD SOURCE [--screenshots FOLDER]
// A headset with two controllers, which iwer emulates, and a phone that is turned.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import {
  awaitRest, build, distance, holdArm, invite, limits, number, numbers, open, openArm, press, shoot, sleep, timesAfter, tool, wasHeldUp,
} from './live_arm.mjs';

const { eventually, finish, runTests } = await import('./browser.mjs'); // where its modules are is known now
const IWER = join(build, 'report/node_modules/iwer/build/iwer.min.js');
const NEAR_M = 0.005;
const NEAR_RAD = 0.01;
const STILL_M = 1e-4;
const LONGEST_GAP_MS = 80; // between messages, so that the loop does not hold the arm in between, at 100 ms
const HANDS = ['released', 'engaged', 'held', 'refused'];
const [HELD, REFUSED] = [2, 3];
const REFUSALS = ['', 'not finite', 'not tracked', 'jump', 'silent', 'paused'];

const { arm, address } = await holdArm('tool');
if (!arm.isRealTime) {
  console.log(`SKIPPED: hands are judged in milliseconds, and this machine gives no real time:\n${arm.text}`);
  process.exit(77);
}

/** A headset, before the page's own script runs. iwer calls every position estimated; here the test says what is. */
function wearHeadset() {
  // One eye: without a graphics card two take so long that the loop holds the arm between pictures, as it should.
  const quest = structuredClone(window.IWER.metaQuest3);
  quest.controllerConfig.layout.right.gripOffsetMatrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]; // where it is put, it is held
  const headset = new window.IWER.XRDevice(quest, { stereoEnabled: false });
  headset.installRuntime({ forceInstall: true });
  headset.position.set(0, 1.6, 0);
  const { position, quaternion } = headset.controllers.right;
  position.set(0.2, 1.2, -0.3);
  const test = { headset, position, isEstimated: false, isLost: false, pulses: 0, hands: new Set(), gap: 0, timer: 0, done: () => {} };
  window.test = test;
  Object.defineProperty(window.XRPose.prototype, 'emulatedPosition', { get: () => test.isEstimated });
  const { getPose } = window.XRFrame.prototype;
  window.XRFrame.prototype.getPose = function (space, ...more) {
    const isController = space === headset.controllers.right.inputSource.gripSpace;
    return test.isLost && isController ? null : getPose.call(this, space, ...more);
  };
  test.count = () => {
    for (const one of headset.controllers.right.inputSource.gamepad.hapticActuators) one.pulse = () => (test.pulses += 1);
  };
  /** Carries the controller by so much, evenly, and turns it about the vertical. */
  test.carry = (way, turn, duration) =>
    new Promise((resolve) => {
      const from = [position.x, position.y, position.z];
      const half = Math.atan2(quaternion.y, quaternion.w);
      const begin = performance.now();
      test.stop();
      test.done = resolve;
      test.timer = setInterval(() => {
        const share = Math.min(1, (performance.now() - begin) / duration);
        position.set(...from.map((value, i) => value + share * way[i]));
        quaternion.set(0, Math.sin(half + (share * turn) / 2), 0, Math.cos(half + (share * turn) / 2));
        if (share < 1) return;
        test.stop();
      }, 5);
    });
  test.stop = () => {
    clearInterval(test.timer);
    test.done();
  };
}

const page = await open(address, { width: 320, height: 240, scripts: [{ path: IWER }, wearHeadset] });
const grip = (isHeld) =>
  page.evaluate((v) => window.test.headset.controllers.right.updateButtonValue('squeeze', v), Number(isHeld));
const carry = (way, { turn = 0, ms = 600 } = {}) => page.evaluate((all) => window.test.carry(...all), [way, turn, ms]);
const set = (values) =>
  page.evaluate((all) => {
    Object.assign(window.test, all);
    return performance.now();
  }, values);
async function handIs(state, on = page) {
  for (let i = 0; i < 50 && (await handOf(on)) !== state; ++i) await sleep(100);
  assert.equal(await handOf(on), state);
}
const choose = (values) => page.evaluate((all) => Object.assign(window.viableLive.hand, all), values);
const isPresenting = () => page.evaluate(() => window.viableLive.view.renderer.xr.isPresenting);
/** The state of the hand in a word or two. */
async function handOf(on = page) {
  const state = await number(on, 'hand');
  return state === REFUSED ? `refused: ${REFUSALS[await number(on, 'refusal')]}` : HANDS[state];
}
const mm = (value) => `${(1000 * value).toFixed(2)} mm`;

/** Turn of the tool about the base's vertical between two poses [rad], and about all else. */
function turnBetween(a, b) {
  const w = b[3] * a[3] + b[4] * a[4] + b[5] * a[5] + b[6] * a[6];
  const z = -b[3] * a[6] - b[4] * a[5] + b[5] * a[4] + b[6] * a[3];
  const all = 2 * Math.acos(Math.min(1, Math.abs(w)));
  const vertical = 2 * Math.asin(Math.max(-1, Math.min(1, z * Math.sign(w))));
  return { vertical, all };
}

async function enter(mode, stand = 0) {
  await page.getByLabel('Where you stand in the headset').selectOption(String(stand));
  await press(page, mode);
  await eventually(isPresenting, 'the headset shows it');
  await sleep(500);
  await page.evaluate(() => window.test.count());
}

async function leave() {
  await page.evaluate(() => window.viableLive.view.renderer.xr.getSession().end());
  await eventually(async () => !(await isPresenting()), 'the page shows it again');
}

async function hold() {
  for (let tries = 1; ; ++tries) {
    await grip(false); // a test before may have failed
    await handIs('released');
    await awaitRest(page);
    await wasHeldUp(); // before this try
    await grip(true);
    try {
      return await handIs('engaged');
    } catch (error) {
      const [held_ms, state] = [await wasHeldUp(), await handOf()];
      if (state === 'engaged') return;
      const isOfIt = ['held', 'refused: silent', 'refused: not tracked'].includes(state);
      if (held_ms === 0 || !isOfIt || tries === 6) throw error;
      console.log(`     the browser was held up for ${held_ms.toFixed(0)} ms: ${state}`);
    }
  }
}

async function letGo() {
  await grip(false);
  await handIs('released');
  await awaitRest(page);
}

/**
 * Squeezes, carries the controller and waits: how far the tool then is from where the hand's motion puts it. Where this
 * machine holds up the browser for longer than a hand may be silent the loop ends it, as it should: then once more.
 */
async function follow(way, wanted, options) {
  for (let tries = 1; ; ++tries) {
    await hold();
    const before = await tool(page);
    await page.evaluate(() => {
      window.test.hands = new Set();
      window.test.gap = 0;
    });
    await carry(way, options);
    await sleep(3000);
    const [after, hand] = [await tool(page), await handOf()];
    const { hands, gap } = await page.evaluate(() => ({ hands: [...window.test.hands], gap: window.test.gap }));
    const [acting, clearance] = [await limits(page), await number(page, 'clearance')];
    await letGo();
    const wasStalled = hands.includes(HELD) || gap > LONGEST_GAP_MS;
    if (!wasStalled || tries === 6) assert.equal(hand, 'engaged');
    if (!wasStalled) {
      const off = distance(after, before.map((value, i) => value + (wanted[i] ?? 0)));
      if (off > NEAR_M) console.log(`     held back by ${acting.join(' ')}, ${mm(clearance)} from an obstacle, tool ${before} to ${after}`);
      return { before, after, off };
    }
    console.log(`     the browser was held up for ${gap.toFixed(0)} ms: ${hand}`);
    await carry(way.map((value) => -value), { turn: -(options?.turn ?? 0) });
  }
}

/** Leads the tool there; the operator stands behind the arm. */
async function bring(there) {
  const here = await tool(page);
  const [x, y, z] = [0, 1, 2].map((i) => there[i] - here[i]);
  const way = [-y, z, -x];
  const found = await follow(way, [x, y, z], { ms: 1500 });
  await carry(way.map((one) => -one));
  return found;
}

/** What the loop does once `act` is over while the hand moves; once more where the browser was held up before it. */
async function timesOf(act, watcher = page) {
  for (let tries = 1; ; ++tries) {
    await hold();
    const carried = carry([0, 0.15, 0], { ms: 1500 });
    await sleep(500);
    const isEngaged = (await handOf(watcher)) === 'engaged';
    if (isEngaged || tries === 6) {
      const times = await timesAfter(watcher, act);
      await carried;
      console.log(`     decided after ${(1000 * times.decided).toFixed(0)} ms, at rest after ${(1000 * times.rested).toFixed(0)} ms`);
      assert.ok(times.decided < 0.2 && times.rested < 1.0);
      return;
    }
    console.log(`     the browser was held up: ${await handOf(watcher)}`);
    await carried;
    await carry([0, -0.15, 0]);
  }
}

/** The hand moves; then `act`. The loop must refuse it for `reason`, and go on refusing after `undo`, until the next press. */
async function refuses(act, reason, undo = async () => {}) {
  let hand;
  try {
    await timesOf(act);
    hand = await handOf();
  } finally {
    await undo();
  }
  assert.equal(hand, `refused: ${reason}`);
  const before = await tool(page);
  await carry([0, -0.15, 0]);
  await sleep(300);
  assert.equal(await handOf(), `refused: ${reason}`, 'the same press moves it again');
  assert.ok(distance(before, await tool(page)) < STILL_M);
  await letGo();
  await hold();
  await sleep(300);
  assert.ok(distance(before, await tool(page)) < STILL_M, 'engaging moves it');
  await letGo();
}

const cases = [];
const test = (name, traits, body) => cases.push({ name, ...traits, body });

test('headset: squeezing moves nothing, then the tool goes as the hand does, within 5 mm after 3 s', {}, async () => {
  await page.waitForSelector('.stage[data-pictures]');
  await page.evaluate(() => {
    const { link } = window.viableLive;
    link.on('frame', () => window.test.hands.add(link.frame('hand')[0]));
    const { sendHand } = link;
    let last = 0;
    link.sendHand = (message) => {
      window.test.gap = Math.max(window.test.gap, performance.now() - last);
      last = performance.now();
      sendHand.call(link, message);
    };
  });
  await press(page, 'Take control');
  await press(page, 'Start');
  await eventually(async () => (await page.textContent('.pill')) === 'Running', 'the arm runs');
  await enter('VR');
  const rest = await tool(page);
  await shoot(page, 'headset'); // a picture takes longer than a hand may be silent
  await carry([0.1, 0.1, 0.1]);
  assert.ok(distance(rest, await tool(page)) < STILL_M, 'it moves without the switch');
  await hold();
  await sleep(500);
  assert.ok(distance(rest, await tool(page)) < STILL_M, 'engaging moves it');
  await letGo();
  // Right, up and towards the operator: to minus y, plus z and minus x of the base.
  const { off } = await follow([0.04, 0.05, 0.06], [-0.06, -0.04, 0.05]);
  console.log(`     ${mm(off)} off`);
  assert.ok(off < NEAR_M);
});

test('headset: scale, position only, turn only', {}, async () => {
  await choose({ scale: 0.5 });
  const half = await follow([0, -0.06, 0], [0, 0, -0.03]);
  assert.ok(half.off < NEAR_M, mm(half.off));
  await choose({ scale: 1, part: 1 });
  const place = await follow([0, 0, -0.04], [0.04, 0, 0], { turn: 0.3 });
  assert.ok(place.off < NEAR_M, mm(place.off));
  assert.ok(turnBetween(place.before, place.after).all < NEAR_RAD);
  await choose({ part: 2 });
  const turned = await follow([0, 0, 0.04], [0, 0, 0], { turn: 0.3 });
  const { vertical, all } = turnBetween(turned.before, turned.after);
  console.log(`     turned by ${vertical.toFixed(4)} rad of 0.3, ${mm(turned.off)} off`);
  assert.ok(turned.off < NEAR_M, mm(turned.off));
  assert.ok(Math.abs(vertical - 0.3) < NEAR_RAD && Math.abs(all - 0.3) < NEAR_RAD);
  await choose({ part: 0 });
});

test('headset: squeezing again at another place moves nothing', {}, async () => {
  const before = await tool(page);
  await carry([0.4, -0.2, 0.5], { turn: 1 });
  await hold();
  await sleep(700);
  assert.ok(distance(before, await tool(page)) < STILL_M);
  assert.ok(turnBetween(before, await tool(page)).all < 1e-3);
  await letGo();
  await carry([-0.4, 0.2, -0.5], { turn: -1 });
});

test('headset: letting go brings it to rest', {}, async () => {
  await timesOf(() => grip(false));
  assert.equal(await handOf(), 'released');
});

test('headset: an estimated position is refused', {}, () =>
  refuses(() => set({ isEstimated: true }), 'not tracked', () => set({ isEstimated: false })));

test('headset: a lost pose is refused', {}, () =>
  refuses(() => set({ isLost: true }), 'not tracked', () => set({ isLost: false })));

test('headset: a session behind a menu is refused', {}, () => {
  const state = (value) =>
    page.evaluate((v) => {
      window.test.headset.updateVisibilityState(v);
      return performance.now();
    }, value);
  return refuses(() => state('visible-blurred'), 'not tracked', () => state('visible'));
});

test('headset: a controller that is 0.7 m elsewhere is refused, though it counts as tracked', {}, () =>
  refuses(
    () =>
      page.evaluate(() => {
        window.test.stop();
        window.test.position.x += 0.7;
        window.test.carry([0, 0.05, 0], 0, 500);
        return performance.now();
      }),
    'jump',
    () => carry([-0.7, 0, 0]),
  ));

test('headset: a pose that is no number is refused', {}, async () => {
  let y = 0;
  await refuses(
    async () => {
      y = await page.evaluate(() => {
        window.test.stop();
        const was = window.test.position.y;
        window.test.position.y = NaN;
        return was;
      });
    },
    'not finite',
    () => page.evaluate((value) => (window.test.position.y = value), y),
  );
});

test('headset: room set anew (the origin goes elsewhere): refused', {}, () =>
  refuses(() => page.evaluate(() => window.test.headset.recenter()), 'not tracked'));

test('headset: against what limits, it rumbles, and no limit is passed', {}, async () => {
  await choose({ scale: 1 });
  let before;
  for (let tries = 1; ; ++tries) {
    await set({ pulses: 0 });
    await hold();
    before = await tool(page);
    await page.evaluate(() => window.test.hands.clear());
    const acted = new Set();
    const carried = carry([0, -0.6, 0.3], { ms: 700 });
    for (let i = 0; i < 30; ++i) {
      await sleep(60);
      for (const name of await limits(page)) acted.add(name);
    }
    await carried;
    await awaitRest(page); // as near as it comes, though the hand is farther
    await sleep(300);
    for (const name of await limits(page)) acted.add(name);
    const wasHeld = await page.evaluate((held) => window.test.hands.has(held), HELD);
    const hand = wasHeld ? 'held in between' : await handOf();
    await letGo();
    const pulses = await page.evaluate(() => window.test.pulses);
    console.log(`     limits that acted: ${[...acted].join(' ')}; ${pulses} pulses; at rest, ${hand}`);
    if (hand === 'engaged') {
      assert.ok([...acted].some((name) => name.startsWith('velocity')) && acted.has('clearance_lower') && pulses > 1);
      break;
    }
    assert.ok((wasHeld || (await wasHeldUp()) > 0) && tries < 6, hand);
    await carry([0, 0.6, -0.3]);
    await bring(before);
  }
  await carry([0, 0.6, -0.3]);
  const { off } = await bring([before[0] - 0.05, before[1], before[2] - 0.1]); // the tests before have stretched it
  assert.ok(off < NEAR_M, mm(off));
});

test('headset: leaving it lets go, and from the other side the hand goes the other way', {}, async () => {
  await hold();
  await leave();
  await handIs('released');
  await grip(false);
  await sleep(300);
  await enter('AR', 2);
  assert.equal(await page.evaluate(() => window.viableLive.view.scene.background), null, 'the room is hidden');
  await shoot(page, 'headset_ar');
  const { off } = await follow([0.04, -0.04, 0], [0, 0.04, -0.04]);
  console.log(`     ${mm(off)} off`);
  assert.ok(off < NEAR_M);
});

test('headset: a closed connection is a hand that lets go, and when it is back the old press counts for nothing', {}, async () => {
  await leave();
  const watcher = await openArm(await invite(page), { width: 400, height: 300 });
  await watcher.evaluate(() => (window.viableLive.view.renderer.render = () => {})); // only its numbers are looked at
  await enter('VR');
  await page.evaluate(() => {
    const { link, headset } = window.viableLive;
    link.on('close', () => (window.test.told ??= headset.text));
  });
  await timesOf(() => page.evaluate(() => window.socket.close()), watcher);
  assert.match(await page.evaluate(() => window.test.told), /^No connection: use the arm.s own stop\.$/);
  await eventually(() => page.evaluate(() => window.viableLive.link.isOpen), 'it is back');
  await page.evaluate(() => window.viableLive.link.say('take'));
  await eventually(() => page.evaluate(() => window.viableLive.link.isOperator), 'it operates');
  const before = await tool(watcher);
  await carry([0, -0.15, 0]);
  await sleep(500);
  assert.ok(distance(before, await tool(watcher)) < STILL_M);
  await letGo();
  await leave();
  await watcher.context().close();
  assert.deepEqual(page.problems, []);
});

test('phone: the tool turns as it does while a finger holds the pad', {}, async () => {
  if (await isPresenting()) await leave(); // a test before may have failed
  const phone = await openArm(await invite(page), { width: 390, height: 844, hasTouch: true, isMobile: true });
  await press(phone, 'Take over');
  await eventually(() => phone.evaluate(() => window.viableLive.link.isOperator), 'it operates');
  await press(phone, 'Turn it with this phone');
  const fingers = await phone.context().newCDPSession(phone);
  const turn = (alpha, beta, gamma) => fingers.send('DeviceOrientation.setDeviceOrientationOverride', { alpha, beta, gamma });
  await turn(20, 40, 5);
  const pad = phone.getByText('Hold, and turn the phone');
  await pad.scrollIntoViewIfNeeded();
  const box = await pad.boundingBox();
  const at = { x: box.x + box.width / 2, y: box.y + box.height / 2 };
  const touch = (type, ...points) => fingers.send('Input.dispatchTouchEvent', { type, touchPoints: points });
  const rest = await tool(phone);
  await turn(50, 40, 5);
  await sleep(300);
  assert.ok(turnBetween(rest, await tool(phone)).all < 1e-3, 'it turns without the finger');
  await touch('touchStart', at);
  await handIs('engaged', phone);
  await sleep(500);
  assert.ok(turnBetween(rest, await tool(phone)).all < 1e-3, 'engaging turns it');
  for (let i = 1; i <= 20; ++i) {
    await turn(50 + i / 2, 40, 5);
    await sleep(30);
  }
  await shoot(phone, 'phone_held');
  await sleep(3000);
  const after = await tool(phone);
  const { vertical, all } = turnBetween(rest, after);
  console.log(`     turned by ${vertical.toFixed(4)} rad of ${(Math.PI / 18).toFixed(4)}, ${mm(distance(rest, after))} off`);
  assert.equal(await handOf(phone), 'engaged');
  assert.ok(distance(rest, after) < NEAR_M);
  assert.ok(Math.abs(vertical - Math.PI / 18) < NEAR_RAD && Math.abs(all - Math.PI / 18) < NEAR_RAD);
  await turn(200, 40, 5); // a compass that finds north: no hand
  await handIs('refused: jump', phone);
  await touch('touchEnd');
  await handIs('released', phone);
  assert.deepEqual(phone.problems, []);
  await phone.context().close();
});

test('Stop ends it within all limits', {}, async () => {
  await press(page, 'Stop');
  assert.equal(await arm.ended, 0, arm.text);
  const summary = JSON.parse(readFileSync(join(arm.out, 'summary.json'), 'utf8'));
  assert.match(summary.cases[0].account, /verdict +all limits kept \(nominal arm/);
});

await runTests(cases, { keepsPages: true });
if (process.exitCode) console.log(arm.text, page.problems);
await finish();
