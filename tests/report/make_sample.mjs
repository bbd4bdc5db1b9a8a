// Writes a synthetic report, so that the page can be developed and tested without a run:
//   node make_sample.mjs TEMPLATE REPORT [--cases 3] [--joints 6] [--rows 600000] [--data FOLDER]
// The arms follow made-up references under roughly kept limits; the numbers only look like a run's.
// --data also writes data.json and data.bin.gz, what the C++ side puts into the template.
import { mkdir, readFile, writeFile } from 'node:fs/promises';
import { join } from 'node:path';
import { parseArgs } from 'node:util';
import { gzipSync } from 'node:zlib';

const { positionals: [template, target], values: options } = parseArgs({
  allowPositionals: true,
  options: {
    cases: { type: 'string', default: '3' },
    joints: { type: 'string', default: '6' },
    rows: { type: 'string', default: '600000' },
    data: { type: 'string' },
  },
});
if (!target) {
  console.error('usage: node make_sample.mjs TEMPLATE REPORT [--cases N] [--joints N] [--rows N] [--data FOLDER]');
  process.exit(2);
}
const CASES = Number(options.cases);
const JOINTS = Number(options.joints);
const ROWS = Number(options.rows);
const TICK = 0.001;
const LIMITS = ['position', 'velocity', 'acceleration', 'jerk'].flatMap((kind) => [`${kind}_lower`, `${kind}_upper`]);
const MOST_BUCKETS = 5000;
const MOST_FRAMES = 3000;

/** Collects arrays, each from a multiple of 4 bytes on, and hands out references. */
class Binary {
  #parts = [];
  #size = 0;

  add(array) {
    const bytes = Buffer.from(array.buffer, array.byteOffset, array.byteLength);
    const reference = { at: this.#size, n: array.length, type: array instanceof Uint8Array ? 'u8' : 'f32' };
    const rest = (4 - (bytes.length % 4)) % 4;
    this.#parts.push(bytes, Buffer.alloc(rest));
    this.#size += bytes.length + rest;
    return reference;
  }

  get bytes() {
    return Buffer.concat(this.#parts);
  }
}

const binary = new Binary();

/** Least and largest of the ticks of each bucket, or the ticks themselves where a bucket is one tick. */
class Series {
  constructor(buckets, perBucket) {
    this.perBucket = perBucket;
    this.values = new Float32Array(perBucket === 1 ? buckets : 2 * buckets).fill(NaN);
  }

  put(row, value) {
    const { values, perBucket } = this;
    if (perBucket === 1) {
      values[row] = value;
      return;
    }
    const at = 2 * Math.floor(row / perBucket);
    if (!(values[at] <= value)) values[at] = value;
    if (!(values[at + 1] >= value)) values[at + 1] = value;
  }
}

const CENTRE = [0, -0.262, -1.571, 0, -1.309, 0];
const HALF_RANGE = [0.524, 0.262, 0.524, 0.262, 0.524, 1.047];
const VELOCITY = (2 * Math.PI) / 3;
const ACCELERATION = 4 * Math.PI;
const JERK = 12 * Math.PI;
const BOUND = { position: 0.02, velocity: 0.1 }; // how far the real arm may be from the nominal one
const INERTIA = [3.2, 2.8, 1.4, 0.3, 0.12, 0.03];

/** One joint through all ticks of a case. */
function simulateJoint(j, rows, perBucket, buckets, frames, stride, style) {
  const centre = CENTRE[j % 6];
  const half = HALF_RANGE[j % 6];
  const inertia = INERTIA[j % 6];
  const series = {};
  const active = new Uint8Array(buckets);
  const modified = new Uint8Array(buckets);
  const poses = { nominal: new Float32Array(frames), real: new Float32Array(frames), rest: new Float32Array(frames) };
  const allowed = { velocity: VELOCITY, acceleration: ACCELERATION, jerk: JERK };
  let q = centre;
  let v = 0;
  let a = 0;
  let lag = 0;
  for (let row = 0; row < rows; ++row) {
    const t = row * TICK;
    const reference =
      centre +
      half *
        1.7 *
        (0.62 * Math.sin(1.9 * t + 1.7 * j) +
          0.38 * Math.sin(4.3 * t + j + 0.1 * style.phase) * Math.sin(0.071 * t + j)) *
        Math.min(1, t / 3);
    const wished = 90 * (reference - q) - 17 * v;
    const stop = 0.12 + Math.abs(v) * 0.16;
    let upper = Math.min(allowed.acceleration, (allowed.velocity - v) / 0.12);
    let lower = Math.max(-allowed.acceleration, (-allowed.velocity - v) / 0.12);
    let upperName = upper === allowed.acceleration ? 6 : 4;
    let lowerName = lower === -allowed.acceleration ? 5 : 3;
    const highStop = 22 * (centre + half * 0.998 - q - v * stop * 1.5) - 9 * v;
    const lowStop = 22 * (centre - half * 0.998 - q - v * stop * 1.5) - 9 * v;
    if (highStop < upper) [upper, upperName] = [Math.max(highStop, -allowed.acceleration), 2];
    if (lowStop > lower) [lower, lowerName] = [Math.min(lowStop, allowed.acceleration), 1];
    let next = Math.min(Math.max(wished, Math.min(lower, upper)), upper);
    let acting = next === wished ? 0 : next < wished ? upperName : lowerName;
    if (style.boundedJerk && Math.abs(next - a) > allowed.jerk * TICK) {
      if (!acting) acting = next > a ? 8 : 7;
      next = a + Math.sign(next - a) * allowed.jerk * TICK;
    }
    const jerk = style.boundedJerk
      ? (next - a) / TICK
      : (next - a) / TICK + (acting ? 900 * Math.sin(row) * (row % 37 === 0) * 12 : 0);
    a = next;
    v += a * TICK;
    q += v * TICK;
    const bound = Math.abs(q - centre) > half;
    if (bound) {
      q = centre + Math.sign(q - centre) * half;
      v = 0;
    }
    const friction = 0.25 * Math.tanh(40 * v) * (1 + 0.2 * Math.sin(31 * t));
    lag +=
      (style.robust
        ? (0.0006 * friction) / inertia ** 0.3 - lag * 30 * TICK * 4
        : 0.00004 * friction - lag * 0.05 * TICK) * (style.robust ? 4 : 1);
    const realQ = q + Math.max(-1.5, Math.min(1.5, lag));
    const filterTorque = inertia * a + 12 * Math.sin(q + j) * inertia;
    const robustTorque = style.robust ? 4 * friction * inertia + 0.4 * Math.sin(57 * t) : 0;
    const values = {
      nominal_q: q,
      nominal_qd: v,
      nominal_qdd: a,
      nominal_jerk: jerk,
      real_q: realQ,
      real_qd: v + 0.02 * Math.sin(211 * t),
      real_qdd: a + 0.4 * Math.sin(333 * t),
      real_jerk: 133.2 * Math.cos(333 * t),
      error: realQ - q,
      error_true: realQ - q + 1e-5 * Math.sin(97 * t),
      error_velocity: 0.02 * Math.sin(211 * t),
      tau_external: style.bound && t % 2 < 0.2 ? 3 : 0,
      tau_desired: inertia * wished + 12 * Math.sin(q + j) * inertia,
      tau_filter: filterTorque,
      tau_robust: robustTorque,
      tau_motor: filterTorque + robustTorque,
      margin: Math.max(0, half - Math.abs(q - centre) - Math.abs(v) * stop * 0.3),
    };
    for (const name in values) (series[name] ??= new Series(buckets, perBucket)).put(row, values[name]);
    const bucket = Math.floor(row / perBucket);
    if (acting) active[bucket] |= 1 << (acting - 1);
    if (acting) modified[bucket] = 1;
    if (row % stride === 0 && row / stride < frames) {
      const pose = { nominal: q, real: realQ, rest: q + 0.5 * v * stop };
      for (const name in pose) poses[name][row / stride] = pose[name];
    }
  }
  return { series, active, modified, poses };
}

/** What a case is unless it says otherwise. */
const USUAL_STYLE = {
  filter: 'certified_braking',
  robust: true,
  boundedJerk: true,
  guarantees: true,
  grade: 'good',
  verdict: 'all limits kept',
};
const STYLES = [
  {
    name: 'C1',
    verified: 'unclear',
    filter: 'acceleration_viability',
    boundedJerk: false,
    guarantees: false,
    grade: 'broken',
    verdict: 'jerk limit missed in 24259 joint-ticks',
  },
  {
    name: 'C2',
    filter: 'tosbp',
    environment: true,
    guarantees: false,
    grade: 'broken',
    verdict: '53 joint-ticks outside, 25 ticks empty',
  },
  { name: 'C3', verified: 'broken', environment: true, bound: true, touches: true },
  { name: 'C3_without_nric', robust: false },
  { name: 'broken', filter: 'broken_plugin', grade: 'failed', verdict: 'broke its guarantee at 0.6 of the run', stopAt: 0.6 },
  { name: 'soft', filter: 'tosbp', guarantees: false },
  { name: 'slow', robust: false },
  {
    name: 'passive',
    filter: 'none',
    boundedJerk: false,
    guarantees: false,
    grade: 'broken',
    verdict: 'position limit missed',
  },
].map((style) => ({ ...USUAL_STYLE, ...style }));

/** xyz, rpy of the joints of an Indy7. */
const FRAMES = [
  [0, 0, 0.078, 0, 0, 0],
  [0, -0.109, 0.222, Math.PI / 2, Math.PI / 2, 0],
  [-0.45, 0, -0.0305, 0, 0, 0],
  [-0.267, 0, -0.075, -Math.PI / 2, 0, Math.PI / 2],
  [0, -0.114, 0.083, Math.PI / 2, Math.PI / 2, 0],
  [-0.168, 0, 0.069, -Math.PI / 2, 0, Math.PI / 2],
].map((numbers) => [numbers.slice(0, 3), numbers.slice(3)]);
const LINKS = Array.from({ length: JOINTS }, (_, j) => `link${j + 1}`);

const SOLIDS = [
  { name: 'table', type: 'box', size: [0.4, 0.9, 0.04], pose: pose([0.62, 0.05, 0.17]) },
  { name: 'post', type: 'cylinder', radius: 0.05, length: 0.9, pose: pose([0.1, 0.55, 0.45]) },
  { name: 'lamp', type: 'sphere', radius: 0.09, pose: pose([0.3, 0.35, 1.0]) },
  { name: 'floor', type: 'half_space', pose: pose([0, 0, -0.004]) },
];
const BALL = {
  name: 'ball',
  type: 'moving_sphere',
  radius: 0.07,
  waypoints: [[0, 0.72, -0.5, 0.35], [1.5, 0.72, 0.5, 0.45], [3, 0.72, -0.5, 0.35]],
  repeats: true,
};
const OBSTACLES = [...SOLIDS.map(({ name }) => name), BALL.name, 'cell'];
const SAFETY_DISTANCE = 0.02;
const NEAREST = 11;
const CONTACT = 8;

function pose(xyz) {
  return { xyz, quat: [1, 0, 0, 0] };
}

/** Every kind of obstacle; the map is a corner of walls, and far away, where no camera should go, a single cube. */
function makeEnvironment() {
  const edge = 0.05;
  const centres = [];
  for (let i = 0; i < 22; ++i)
    for (let k = 0; k < 12; ++k)
      if (i < 12 || k < 3 + (i % 4)) centres.push(-0.45, -0.55 + i * edge, k * edge + edge / 2);
  centres.push(30, 30, 10);
  const map = {
    name: 'cell',
    type: 'map',
    pose: { xyz: [0, 0, 0], quat: [Math.cos(0.1), 0, 0, Math.sin(0.1)] },
    edge_m: edge,
    centres: binary.add(Float32Array.from(centres)),
  };
  return { safety_distance_m: SAFETY_DISTANCE, obstacles: [...SOLIDS, BALL, map], note: '' };
}

/** What the joints of an arm at rest are nearest to of table and ball, per frame. */
function findNearest(rest, frames, step) {
  const nearest = new Float32Array(NEAREST * frames);
  for (let i = 0; i < frames; ++i) {
    const time = i * step;
    const [, ...from] = BALL.waypoints[0];
    const [, ...to] = BALL.waypoints[1];
    const share = 1 - Math.abs(((time % 3) / 1.5) - 1);
    const ball = from.map((value, k) => value + share * (to[k] - value));
    let best = [Infinity];
    findJoints(rest.subarray(i * JOINTS, (i + 1) * JOINTS)).forEach((point, link) => {
      const radius = 0.045;
      const [{ size, pose: table }] = SOLIDS;
      const onTable = point.map((value, k) =>
        Math.min(Math.max(value, table.xyz[k] - size[k] / 2), table.xyz[k] + size[k] / 2),
      );
      for (const [obstacle, target, own] of [[0, onTable, 0], [SOLIDS.length, ball, BALL.radius]]) {
        const way = target.map((value, k) => value - point[k]);
        const length = Math.hypot(...way);
        const at = (reach) => point.map((value, k) => value + (way[k] * reach) / length);
        const distance = length - radius - own;
        if (distance < best[0]) best = [distance, Math.min(link, JOINTS - 1), obstacle, -1, ...at(radius), ...at(length - own), 0.21];
      }
    });
    nearest.set(best, NEAREST * i);
  }
  return nearest;
}

/** Where the joints' frames are, and a point of the tool. */
function findJoints(q) {
  let place = [0, 0, 0];
  let turn = [1, 0, 0, 0];
  const joints = Array.from(q, (angle, j) => {
    const [xyz, rpy] = FRAMES[j % 6];
    place = rotated(turn, xyz).map((value, k) => place[k] + value);
    turn = product(product(turn, fromRpy(...rpy)), [Math.cos(angle / 2), 0, 0, Math.sin(angle / 2)]);
    return place;
  });
  return [...joints, rotated(turn, [0, 0, 0.1]).map((value, k) => place[k] + value)];
}

function product([a, b, c, d], [e, f, g, h]) {
  return [
    a * e - b * f - c * g - d * h,
    a * f + b * e + c * h - d * g,
    a * g - b * h + c * e + d * f,
    a * h + b * g - c * f + d * e,
  ];
}

function rotated(turn, vector) {
  const [w, ...axis] = turn;
  return product(product(turn, [0, ...vector]), [w, ...axis.map((value) => -value)]).slice(1);
}

function makeCase(index) {
  const style = { ...STYLES[index % STYLES.length], phase: index };
  const { filter, guarantees, verdict, grade } = style;
  const rows = Math.round(ROWS * (style.stopAt ?? 1));
  const perBucket = Math.max(1, Math.ceil(ROWS / MOST_BUCKETS));
  const buckets = Math.ceil(rows / perBucket);
  const stride = Math.max(1, Math.ceil(ROWS / MOST_FRAMES));
  const frames = Math.ceil(rows / stride);
  const status = new Uint8Array(buckets);
  const [nominal, real, rest] = [0, 1, 2].map(() => new Float32Array(frames * JOINTS));
  const joints = [];
  const judged = { motions: [], limits: [], buckets, step: perBucket * TICK, rows, breaks: style.verified === 'broken' };
  for (let j = 0; j < JOINTS; ++j) {
    const motion = simulateJoint(j, rows, perBucket, buckets, frames, stride, style);
    motion.modified.forEach((value, i) => {
      status[i] = Math.max(status[i], value);
    });
    for (const [name, all] of Object.entries({ nominal, real, rest }))
      motion.poses[name].forEach((value, i) => (all[i * JOINTS + j] = value));
    const series = Object.fromEntries(Object.entries(motion.series).map(([name, { values }]) => [name, binary.add(values)]));
    if (!style.robust) series.tau_robust = null;
    if (!style.bound) for (const name of ['tau_external', 'error_true', 'error_velocity']) delete series[name];
    const centre = CENTRE[j % 6];
    const half = HALF_RANGE[j % 6];
    const limits = {
      position: [centre - half, centre + half],
      velocity: [-VELOCITY, VELOCITY],
      acceleration: [-ACCELERATION, ACCELERATION],
      jerk: [-JERK, JERK],
    };
    judged.motions.push(motion);
    judged.limits.push(limits);
    for (const [name, [lower, upper]] of Object.entries(limits))
      Object.assign(series, { [`${name}_lower`]: lower, [`${name}_upper`]: upper });
    if (style.bound)
      Object.assign(series, {
        bound_position: BOUND.position,
        bound_velocity: BOUND.velocity,
        bound_measured: 1.05 * BOUND.position,
        real_position_lower: centre - half - BOUND.position,
        real_position_upper: centre + half + BOUND.position,
        real_velocity_lower: -VELOCITY - BOUND.velocity,
        real_velocity_upper: VELOCITY + BOUND.velocity,
      });
    if (j === 1)
      // a limit that changes in the run
      series.velocity_upper = binary.add(
        Float32Array.from(
          { length: buckets },
          (_, i) => (i > buckets * 0.4 && i < buckets * 0.55 ? 0.5 : 1) * VELOCITY,
        ),
      );
    joints.push({ series, active: binary.add(motion.active) });
  }
  if (style.name === 'C2') for (let i = 0; i < buckets; i += Math.ceil(buckets / 25)) status[i] = 4;
  if (style.stopAt) status.fill(2, Math.floor(buckets * 0.97));
  const edges = Array.from({ length: 61 }, (_, i) => 10 ** (i / 15)); // 1 us to 10 ms
  const counts = edges
    .slice(1)
    .map((edge) =>
      Math.floor(
        rows * 0.16 * Math.exp(-(((Math.log10(edge) - 1.6 - 0.07 * index) / 0.14) ** 2)) +
          rows * 2e-4 * Math.exp(-(((Math.log10(edge) - 2.7) / 0.3) ** 2)),
      ),
    );
  const nearest = style.environment ? findNearest(rest, frames, stride * TICK) : null;
  const distance = new Series(buckets, perBucket);
  if (nearest)
    for (let row = 0; row < rows; ++row) distance.put(row, nearest[NEAREST * Math.floor(row / stride)]);
  const tool = new Series(buckets, perBucket);
  for (let row = 0; row < rows; ++row) tool.put(row, 0.03 + 0.02 * Math.sin(row / 400 + index));
  const pressing = new Series(buckets, perBucket);
  const contact = new Float32Array(CONTACT * frames);
  const force = (row) => (row % 1000 > 500 && row % 1000 < 800 ? 250 - (row % 1000) / 5 : 0); // at most 149.8 N
  if (style.touches)
    for (let row = 0; row < rows; ++row) {
      pressing.put(row, force(row));
      const frame = CONTACT * Math.floor(row / stride);
      if (force(row) > contact[frame])
        contact.set([force(row), 0.6 * force(row), 0, 0.8 * force(row), 0.5, 0.1, 0.19, 0], frame);
    }
  const touched = { obstacles: OBSTACLES, peak_N: 149.8, peak_s: 0.501, peak_obstacle: 0, last_N: 0 };
  return {
    tool: { nominal: binary.add(tool.values), real: null },
    ...(style.touches && { contact: { ...touched, pressing: binary.add(pressing.values) } }),
    ...(nearest && { clearance: { environment: 0, links: LINKS, obstacles: OBSTACLES, distance: binary.add(distance.values) } }),
    ...(style.verified && { verification: makeVerification(judged) }),
    name: style.name + (index >= STYLES.length ? `_${index}` : ''),
    ...{ filter, guarantees, verdict, grade },
    robust_loop: style.robust ? 'nric' : 'none',
    plant: 'simbody',
    sentence: index % 2 ? '' : `${style.name} in one sentence; ${style.verdict}.`,
    stop: style.stopAt
      ? { time_s: rows * TICK, message: 'jerk 61.2 rad/s^3 of joint2 is over its limit 37.7 rad/s^3' }
      : null,
    details:
      `${style.name}: filter ${filter}, robust loop ${style.robust ? 'nric' : 'none'}, real plant simbody; ${(rows * TICK).toFixed(3)} s simulated\n` +
      `  verdict       ${verdict}\n  position      worst use    100.00 % (joint3 at 19.832 s), outside in 0 joint-ticks, worst excess 0 rad\n` +
      '  velocity      worst use     91.33 % (joint5 at 24.347 s), outside in 0 joint-ticks, worst excess 0 rad/s\n' +
      '  tick          median 50.5 us, p99 202.7 us, max 3890.1 us\n',
    rows,
    tick_s: TICK,
    t0: 0,
    step_s: perBucket * TICK,
    buckets,
    joints,
    status: binary.add(status),
    tick_time: { edges_us: edges, counts, late: counts.reduce((sum, n, i) => sum + (edges[i] >= 1e6 * TICK * (1 - 1e-6) ? n : 0), 0) },
    replay: {
      step_s: stride * TICK,
      n: frames,
      nominal: binary.add(nominal),
      real: binary.add(real),
      ...(nearest && { rest: binary.add(rest), nearest: binary.add(nearest) }),
      ...(style.touches && { contact: binary.add(contact) }),
    },
  };
}

const ORDERS = [
  { name: 'position', key: 'nominal_q', unit: 'rad', raw: 3e-6, band: 6e-6 },
  { name: 'velocity', key: 'nominal_qd', unit: 'rad/s', raw: 4e-3, band: 1e-3 },
  { name: 'acceleration', key: 'nominal_qdd', unit: 'rad/s^2', raw: 7, band: 0.25 },
  { name: 'jerk', key: 'nominal_jerk', unit: 'rad/s^3', raw: 13e3, band: 4 },
];
const MOST_LOOKS = 1500;

/**
 * What `viable verify` could have found: the second joint's readings are too noisy for its jerk, the third is too quick
 * for a while, of the fourth nothing can be said, the sixth has no position limit.
 */
function makeVerification({ motions, limits, buckets, step, rows, breaks }) {
  const factor = Math.ceil(buckets / MOST_LOOKS);
  const n = Math.ceil(buckets / factor);
  const end = rows * TICK;
  let seed = 1;
  const chance = () => (seed = (seed * 16807) % 2147483647) / 2147483647 - 0.5;
  const joints = motions.map((motion, j) => {
    const trouble = j === 3 ? 'its readings are all the same' : null;
    const noise = j === 1 ? 40 : 1;
    const found = {};
    const curves = { t0: 0, step_s: factor * step, n };
    ORDERS.forEach(({ name, key, unit, raw, band }, order) => {
      const { values } = motion.series[key];
      const perBucket = values.length / buckets;
      const [lower, upper] = order === 0 && j === 5 ? [null, null] : limits[j][name];
      const isBroken = breaks && j === 2 && name === 'velocity';
      const pairs = { raw: new Float32Array(2 * n), mean: new Float32Array(2 * n), band: new Float32Array(2 * n) };
      const highest = [Infinity, -Infinity];
      for (let i = 0; i < n; ++i) {
        const own = values.subarray(i * factor * perBucket, (i + 1) * factor * perBucket);
        const bound = 1.2 * JERK;
        let least = Math.max(Math.min(...own), order === 3 ? -bound : -Infinity);
        let most = Math.min(Math.max(...own), order === 3 ? bound : Infinity);
        const isPulse = isBroken && Math.abs(i / n - 0.42) < 0.012;
        if (isPulse) [least, most] = [1.1 * upper, 1.12 * upper];
        const half = noise * band * (1 + 0.3 * Math.sin(i / 40) + 20 * Math.exp(-Math.min(i, n - 1 - i)));
        pairs.mean.set([least, most], 2 * i);
        pairs.band.set(i === 0 ? [NaN, NaN] : [least - half, most + half], 2 * i);
        pairs.raw.set([least - noise * raw * (0.7 + 0.6 * chance()), most + noise * raw * (0.7 + 0.6 * chance())], 2 * i);
        if (least < highest[0]) highest[0] = least;
        if (most > highest[1]) highest[1] = most;
      }
      const visible = 0.7 * noise * band;
      const size = order === 0 && upper !== null ? (upper - lower) / 2 : upper;
      const verdict = trouble
        ? 'cannot_tell'
        : upper === null
          ? 'no_limit'
          : isBroken
            ? 'broken'
            : visible < 0.1 * size
              ? 'held'
              : 'cannot_tell';
      found[name] = {
        ...{ verdict, unit, lower, upper, lowest: highest[0], highest: highest[1], deviation: (noise * band) / 5.5 },
        ...{ judged: trouble ? 0 : 0.998, visible_excess: trouble ? null : visible, broken: null },
      };
      if (isBroken)
        found[name].broken = {
          ...{ side: 'upper', first_s: 0.41 * end, worst_s: 0.42 * end, excess: 0.12 * upper },
          ...{ certain_excess: 0.12 * upper - band, duration_s: 0.024 * end },
        };
      curves[name] = Object.fromEntries(Object.entries(pairs).map(([kind, array]) => [kind, binary.add(array)]));
    });
    return {
      ...{ unit: 'rad', trouble, noise: trouble ? null : noise * 2.1e-7, quantum: trouble || j === 1 ? null : 7.9e-7 },
      ...{ window_s: trouble ? null : 0.012 * Math.sqrt(noise), left_out: trouble ? null : j === 0 ? 3 : 0 },
      ...{ limits: found, curves: trouble ? null : curves },
    };
  });
  const verdicts = joints.flatMap((joint) => Object.values(joint.limits).map(({ verdict }) => verdict));
  return {
    ...{ signal: 'real', verdict: verdicts.includes('broken') ? 'broken' : 'cannot_tell', confidence: 0.99, excess: 0.1 },
    ...{ excess_duration_s: 0.05, begin_s: 0, end_s: end, samples: rows, joints },
  };
}

/** Frames of an Indy7, with a shape of every kind. */
function makeScene() {
  const none = pose([0, 0, 0]);
  const links = [
    {
      name: 'base',
      parent: -1,
      joint: -1,
      origin: none,
      axis: [0, 0, 1],
      color: [0.35, 0.38, 0.42, 1],
      shapes: [
        { type: 'cylinder', radius: 0.09, length: 0.08, pose: pose([0, 0, 0.04]) },
        { type: 'box', size: [0.26, 0.26, 0.02], pose: pose([0, 0, 0.01]) },
      ],
    },
  ];
  for (let j = 0; j < JOINTS; ++j) {
    const [xyz, rpy] = FRAMES[j % 6];
    const next = FRAMES[(j + 1) % 6][0];
    const radius = [0.075, 0.065, 0.055, 0.05, 0.045, 0.04][j % 6];
    const shapes =
      j % 6 === 5
        ? [
            { type: 'sphere', radius: 0.045, pose: none },
            { type: 'mesh', ...cone(0.05, 0.12), pose: pose([0, 0, 0.03]) },
          ]
        : [
            { type: 'capsule', from: [0, 0, 0], to: [0, 0, next[2]], radius },
            { type: 'capsule', from: [0, 0, next[2]], to: next, radius: radius * 0.9 },
          ];
    links.push({
      name: `link${j + 1}`,
      parent: j,
      joint: j,
      origin: { xyz, quat: fromRpy(...rpy) },
      axis: [0, 0, 1],
      shapes,
      color: j % 6 === 5 ? [0.25, 0.45, 0.6, 1] : null,
    });
  }
  return { links };
}

function cone(radius, height) {
  const points = [];
  const at = (i) => [radius * Math.cos((i * Math.PI) / 8), radius * Math.sin((i * Math.PI) / 8), 0];
  for (let i = 0; i < 16; ++i) points.push(...at(i), ...at(i + 1), 0, 0, height, ...at(i + 1), ...at(i), 0, 0, 0);
  return { positions: binary.add(Float32Array.from(points)), indices: null };
}

function fromRpy(roll, pitch, yaw) {
  const [cr, cp, cy] = [roll, pitch, yaw].map((angle) => Math.cos(angle / 2));
  const [sr, sp, sy] = [roll, pitch, yaw].map((angle) => Math.sin(angle / 2));
  return [
    cr * cp * cy + sr * sp * sy,
    sr * cp * cy - cr * sp * sy,
    cr * sp * cy + sr * cp * sy,
    cr * cp * sy - sr * sp * cy,
  ];
}

const cases = Array.from({ length: CASES }, (_, i) => makeCase(i));
const data = {
  format: 1,
  limits: LIMITS,
  version: '0.1.0',
  title: 'Unilateral teleoperation, synthetic sample',
  created: '2026-11-21T12:00:00Z',
  file: 'experiments/sample.yaml',
  yaml: 'schema: 1\ntitle: Unilateral teleoperation, synthetic sample\nrobot: indy7\nduration_s: 600\ntick_s: 0.001\ncommand: {plugin: generated_hand_motion, seed: 1}\n',
  robot: {
    name: 'indy7',
    joints: Array.from({ length: JOINTS }, (_, j) => ({
      name: `joint${j}`,
      kind: j === 5 ? 'continuous' : 'revolute',
    })),
  },
  scene: makeScene(),
  environments: [makeEnvironment()],
  summary: {
    columns: [
      'case',
      'position [%]',
      'velocity [%]',
      'accel. [%]',
      'jerk [%]',
      'joint-ticks outside',
      'ticks empty',
      'ticks changed',
      'RMS error [mrad]',
      'max [mrad]',
      'tick median [µs]',
      'p99 [µs]',
    ],
    rows: cases.map((c, i) => [
      c.name,
      '100.00',
      (91.33 + i).toFixed(2),
      (67.2 + i * 3).toFixed(2),
      i === 0 ? '66667' : '100.00',
      String(i === 0 ? 24259 : 0),
      String(i === 1 ? 25 : 0),
      '91.3 %',
      (2.854 + i).toFixed(3),
      (11.6 + i).toFixed(2),
      '50.5',
      '202.7',
    ]),
    note: 'Columns in percent: the largest share of a limit that the nominal arm used.',
  },
  cases,
};

const json = JSON.stringify(data).replaceAll('<', '\\u003c');
const packed = gzipSync(binary.bytes, { level: 6 });
const page = (await readFile(template, 'utf8'))
  .replace('@@VIABLE_DATA@@', () => json)
  .replace('@@VIABLE_BINARY@@', () => packed.toString('base64'));
await writeFile(target, page);
if (options.data) {
  await mkdir(options.data, { recursive: true });
  await writeFile(join(options.data, 'data.json'), json);
  await writeFile(join(options.data, 'data.bin.gz'), packed);
}
console.log(`${target}: ${(page.length / 1e6).toFixed(1)} MB, ${CASES} cases, ${JOINTS} joints, ${ROWS} rows`);
