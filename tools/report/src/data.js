/*
 * The data of a report, as the C++ side writes it.
 *
 * Arrays are named by references ("ref") into the binary block, see blocks.js.
 *
 *   { "format": 1, "version": "0.1.0", "title": str, "created": "2026-11-21T12:00:00Z", "file": str,
 *     "yaml": str,                                                    the resolved experiment file
 *     "robot": { "name": str, "joints": [ { "name": str, "kind": "revolute"|"continuous"|"prismatic" } ] },
 *     "scene": null | { "tool": int (the link whose way is drawn; not given: the last fixed one without shapes),
 *       "note": str (meshes that are missing; not given or empty: none),
 *       "links": [ {
 *         "name": str, "parent": int (-1: base),
 *         "joint": int (-1: fixed, else the index of the joint that moves the link),
 *         "origin": { "xyz": [3], "quat": [w, x, y, z] }, "axis": [3], "color": [r, g, b, a] | null,
 *         "shapes": [ { "type": "capsule", "from": [3], "to": [3], "radius": m }
 *                   | { "type": "box", "size": [3], "pose": { xyz, quat } }
 *                   | { "type": "cylinder", "radius", "length" (along z), "pose" }
 *                   | { "type": "sphere", "radius", "pose" }
 *                   | { "type": "mesh", "positions": ref, "indices": ref | null, "pose" } ] } ] },
 *         link frame = parent frame * origin * motion(axis, q); z is up
 *         where no link has shapes, rods from joint to joint are drawn
 *     "environments": [ {                                 what stands around the arm; not given: nothing
 *         "safety_distance_m": num, "note": str (what could not be read), "obstacles": [ { "name": str }
 *             & ( { "type": "box"|"cylinder"|"sphere", ... } as the shapes of links
 *               | { "type": "half_space", "pose" } (solid below z = 0 of the pose)
 *               | { "type": "moving_sphere", "radius", "waypoints": [[s, x, y, z]], "repeats": bool }
 *               | { "type": "person", "capsules": [ { "from", "to": [3], "radius" } ] (from its place), "waypoints", "repeats",
 *                   "unseen": [[from_s, to_s]], "speed_mps", "latency_s", "error_m" } (how far it can have come)
 *               | { "type": "map", "pose", "edge_m": num, "centres": ref f32 3*cubes } (of what could not be read: no centres)
 *             ) ] } ],
 *     "limits": [str], the names of the bits of "active",
 *     "summary": { "columns": [str], "rows": [[str]], "note": str },
 *     "cases": [ {
 *         "name", "filter", "robust_loop", "plant", "guarantees": bool, "verdict", "sentence" (may be empty): str,
 *         "grade": "good" | "doubtful" | "broken" | "failed", as on the terminal,
 *         "stop": null | { "time_s", "message" }, "details": str (monospace text),
 *         "rows": int, "tick_s": num, "t0": 0, "step_s": num, "buckets": int,
 *         "joints": [ { "series": {
 *             "error" (real_q - nominal_q): ref | null, "nominal_q", "nominal_qd", "nominal_qdd", "nominal_jerk": ref, "real_q", "real_qd", "real_qdd",
 *             "real_jerk" (both differentiated from real_qd tick by tick): ref | null,
 *             "tau_desired", "tau_filter": ref, "tau_robust", "tau_motor": ref | null, "margin": ref,
 *             "tau_external": ref (what pushes the real arm; not given: nothing known),
 *             "error_true", "error_velocity" (of the true arm, not as measured): ref | null,
 *             "real_position_lower", ..., "real_velocity_upper": num (limits of the real joint; not given: as the nominal's),
 *             "bound_position", "bound_velocity": num (how far the true arm may be from nominal; not given: not known),
 *             "bound_measured": num (the same of the readings: beyond it a run trips; not given: not known),
 *             "position_lower", "position_upper", "velocity_...", "acceleration_...", "jerk_...": ref | num | null },
 *           "active": ref u16, one per bucket: a bit for each limit that acted in it } ],
 *         "status": ref u16, one per bucket, the worst in it: an index into STATUS,
 *         "tick_time": { "edges_us": [...], "counts": [...], "late": int (that took a tick or longer) },
 *         "jitter": the same, of how far the time between two ticks of a live run is from the tick's; not given: not live,
 *         "takes": [ { "number": int, "from_s", "to_s": num } ], what the operator of a live run recorded,
 *         "clearance" (not given: nothing stood around the arm): { "environment": int | null, "links", "obstacles": [str],
 *           "distance": ref, like a series: from what is nearest on the way through the tick and the stop [m] | null
 *           (no filter looked) },
 *         "tool" (not given: no tool is commanded): { "nominal": ref, "real": ref | null }, like a series: its distance from the
 *           commanded one [m],
 *         "contact" (not given: the plant does not tell what the real arm touches): { "obstacles": [str],
 *           "pressing": ref, like a series: the sum of the normal forces [N], "peak_N", "peak_s", "last_N": num, of all ticks,
 *           "peak_obstacle": int (-1: none) },
 *         "verification_note": str (why what `viable verify` left is not shown; not given: nothing is in the way),
 *         "verification" (what `viable verify` found out about the arm; not given: nothing): {
 *           "signal": "real"|"nominal" (whose readings), "verdict": VERDICT, "confidence", "excess" (share of a limit that was looked
 *           for), "excess_duration_s", "begin_s", "end_s", "samples": num, "joints": [ {
 *             "unit": str, "trouble": str (why nothing can be said) | null, "noise", "quantum", "window_s", "left_out": num | null,
 *             "limits": { "position", "velocity", "acceleration", "jerk": { "verdict": VERDICT, "unit": str, "lower", "upper",
 *               "lowest", "highest", "deviation", "judged" (share of the time), "visible_excess" (null: none): num | null,
 *               "broken": null | { "side": "lower"|"upper", "first_s", "worst_s", "excess", "certain_excess", "duration_s" } } },
 *             "curves": null | { "t0", "step_s": num, "n": int, "position", ...: { "raw" (differences of the readings), "mean"
 *               (the estimate), "band" (its edges): ref f32 2*n, least and largest in turns } } } ] },
 *           VERDICT: "held"|"broken"|"cannot_tell"|"no_limit"
 *         "replay": { "step_s": num, "n": int, "nominal": ref f32 n*joints, "real": ref | null,
 *           with a clearance "rest": ref f32 n*joints (where the backup stop ends; NaN: nowhere)
 *           and "nearest": ref f32 n*11: distance [m] (NaN: unknown), link, obstacle (-1: the arm itself), other link, the
 *           point on the arm xyz, the one on the obstacle xyz, duration of the backup stop [s],
 *           with a contact "contact": ref f32 n*8, of the hardest tick of each frame: pressing [N], force on the arm xyz [N],
 *           the point of the deepest contact xyz [m], its obstacle } } ] }
 *
 * A series has 2 * buckets values, least and largest per bucket, drawn at t0 + (i + 0.25) * step and
 * t0 + (i + 0.75) * step. Where step_s == tick_s it has one value per bucket, drawn at t0 + i * step (jerk as steps).
 * A number that is not finite is NaN in an array.
 */

import { DataError, need, needArray, readBlocks } from './blocks.js';

let limitNames = []; // of the run's bits
export const STATUS = ['passed', 'modified', 'stopped by plan', 'recovering', 'no admissible choice', 'invalid or faulted'];

/** What a verification judges, in the order of derivatives. */
export const JUDGED = ['position', 'velocity', 'acceleration', 'jerk'];

const NEAREST = 11; // numbers per frame of the replay
const CONTACT = 8;

/** The names of the limits that acted, of a bucket's bits. */
export const limitsIn = (bits) => limitNames.filter((_, i) => bits & (1 << i));

/**
 * Values at equal distances: y[i] belongs to x0 + i * dx. `pairs` tells that y holds least and largest per bucket.
 * @typedef {{x0: number, dx: number, y: Float32Array, pairs: boolean}} Samples
 */

/** @returns {Samples} of buckets with least and largest value */
const pairsOf = (t0, step, y) => ({ x0: t0 + 0.25 * step, dx: 0.5 * step, y, pairs: true });

/** Reads the two data scripts of the page. */
export async function loadRun() {
  return new Run(await readBlocks());
}

/** A run: what was experimented, on what robot, and the cases. */
export class Run {
  /** @param {import('./blocks.js').Blocks} blocks */
  constructor({ json, array }) {
    this.array = array;
    limitNames = needArray(json.limits, 'limits').map(String);
    for (const key of ['title', 'version', 'created', 'file', 'yaml']) this[key] = String(json[key] ?? '');
    this.robot = need(json.robot, 'robot').name;
    const readJoint = ({ name, kind }) => ({ name: String(name), linear: kind === 'prismatic' });
    this.joints = needArray(json.robot.joints, 'robot.joints').map(readJoint);
    this.summary = json.summary ?? { columns: [], rows: [], note: '' };
    this.scene = json.scene ?? null;
    this.environments = json.environments ? needArray(json.environments, 'environments') : [];
    this.cases = needArray(json.cases, 'cases').map((description, index) => new Case(this, description, index));
    if (this.cases.length === 0) throw new DataError('The run has no cases.');
    if (this.joints.length === 0) throw new DataError('The robot has no joints.');
    this.tMin = Math.min(...this.cases.map((c) => c.t0));
    this.tMax = Math.max(...this.cases.map((c) => c.end));
    if (!(this.tMax > this.tMin)) this.tMax = this.tMin + 1;
    this.frameStep = Math.min(...this.cases.map((c) => c.replay?.step ?? c.step));
  }
}

/** A case of a run: one filter, robust loop and plant, from start to end. */
export class Case {
  #run;
  #joints;
  #names;
  #ofArm = {}; // series that are not a joint's, but the arm's
  #cache = new Map();

  constructor(run, json, index) {
    const where = `cases[${index}]`;
    this.#run = run;
    this.index = index;
    for (const key of ['name', 'filter', 'robust_loop', 'plant', 'verdict', 'sentence', 'grade', 'details'])
      this[key] = String(json[key] ?? '');
    this.guarantees = Boolean(json.guarantees);
    this.stop = json.stop ?? null;
    this.rows = json.rows;
    this.tick = json.tick_s;
    this.t0 = json.t0 ?? 0;
    this.step = json.step_s;
    this.buckets = json.buckets;
    if (!(this.step > 0) || !(this.tick > 0) || !Number.isInteger(this.buckets) || this.buckets < 0)
      throw new DataError(`${where}: tick_s, step_s and buckets must be positive.`);
    this.end = this.t0 + Math.min(this.buckets * this.step, (this.rows ?? Infinity) * this.tick); // the last may be part
    this.status = run.array(json.status, `${where}.status`, this.buckets);
    this.tickTime = json.tick_time ?? { edges_us: [], counts: [], late: 0 };
    this.takes = json.takes ?? [];
    this.jitter = json.jitter ?? { edges_us: [], counts: [], late: 0 };
    this.#joints = needArray(json.joints, `${where}.joints`);
    if (this.#joints.length !== run.joints.length)
      throw new DataError(`${where}: ${this.#joints.length} joints, the robot has ${run.joints.length}.`);
    this.active = this.#joints.map((joint, j) => run.array(joint.active, `${where}.joints[${j}].active`, this.buckets));
    this.#joints.forEach((joint, j) => {
      // damaged data is found now, not when a plot is drawn
      for (const key of Object.keys(need(joint.series, `${where}.joints[${j}].series`))) this.samples(j, key);
    });
    this.replay = json.replay ? this.#readReplay(json.replay, `${where}.replay`) : null;
    /** What `viable verify` found out, or null; why it is not shown, or an empty text. */
    this.verification = json.verification ? readVerification(run, json.verification, `${where}.verification`) : null;
    this.verificationNote = String(json.verification_note ?? '');
    /** What stood around the arm, or null. */
    this.environment = run.environments[json.clearance?.environment] ?? null;
    this.#names = { links: json.clearance?.links ?? [], obstacles: (json.clearance ?? json.contact)?.obstacles ?? [] };
    if (json.clearance) this.#ofArm = { clearance: json.clearance.distance, clearance_lower: this.environment?.safety_distance_m };
    if (json.contact) this.#ofArm.pressing = json.contact.pressing;
    if (json.tool) Object.assign(this.#ofArm, { tool_nominal: json.tool.nominal, tool_real: json.tool.real });
    for (const key of Object.keys(this.#ofArm)) this.samples(0, key);
    /** The hardest touch of the run and the force at its end [N], or null where nobody knows. */
    this.contact = json.contact && {
      peak: json.contact.peak_N,
      time: json.contact.peak_s,
      obstacle: this.#obstacle(json.contact.peak_obstacle),
      last: json.contact.last_N,
    };
  }

  /**
   * A series of a joint, or of the whole arm: samples, a number (a constant), or null where the case has none.
   * @returns {Samples|number|null}
   */
  samples(joint, key) {
    const id = `${joint} ${key}`;
    if (this.#cache.has(id)) return this.#cache.get(id);
    const reference = this.#joints[joint].series[key] ?? this.#ofArm[key];
    let samples = null;
    if (typeof reference === 'number') samples = reference;
    else if (reference) {
      const where = `cases[${this.index}].joints[${joint}].series.${key}`;
      const y = this.#run.array(reference, where);
      const pairs = y.length !== this.buckets;
      if (pairs && y.length !== 2 * this.buckets)
        throw new DataError(`${where}: ${y.length} values for ${this.buckets} buckets.`);
      samples = pairs ? pairsOf(this.t0, this.step, y) : { x0: this.t0, dx: this.step, y, pairs };
    }
    this.#cache.set(id, samples);
    return samples;
  }

  /** A series of a joint in thousandths. @returns {Samples|number|null} */
  thousandths(joint, key) {
    const id = `${joint} ${key} in thousandths`;
    if (!this.#cache.has(id)) {
      const samples = this.samples(joint, key);
      const scaled = typeof samples === 'number' ? 1000 * samples : samples;
      this.#cache.set(id, scaled?.y ? { ...scaled, y: scaled.y.map((value) => 1000 * value) } : scaled);
    }
    return this.#cache.get(id);
  }

  /** The bucket of a time, or -1 outside of the case. */
  bucketAt(time) {
    const bucket = Math.floor((time - this.t0) / this.step + 1e-9);
    return bucket >= 0 && bucket < this.buckets ? bucket : -1;
  }

  /** Least and largest value of a series at a time, or null. */
  at(samples, time) {
    if (samples === null) return null;
    if (typeof samples === 'number') return [samples, samples];
    const bucket = this.bucketAt(time);
    if (bucket < 0) return null;
    const { y, pairs } = samples;
    return pairs
      ? [Math.min(y[2 * bucket], y[2 * bucket + 1]), Math.max(y[2 * bucket], y[2 * bucket + 1])]
      : [y[bucket], y[bucket]];
  }

  /**
   * What the arm was nearest to at a time, by the frame of the replay before it, and how long the backup stop takes [s];
   * null where nothing stood around it.
   * @returns {null|{distance: number, link: string, other: string, onArm: number[], onObstacle: number[], stop: number}}
   *   distance [m]; NaN: nobody looked, infinite: nothing is near, and there are no names or points
   */
  nearestAt(time) {
    const numbers = this.#frameAt(this.replay?.nearest, NEAREST, time);
    if (!numbers) return null;
    const [distance, link, obstacle, otherLink, ...others] = numbers;
    const { links } = this.#names;
    const nameOf = (i) => String(links[i] ?? `link ${i}`);
    return {
      distance: link < 0 && distance > 0 ? Infinity : distance,
      link: nameOf(link),
      other: obstacle < 0 ? nameOf(otherLink) : this.#obstacle(obstacle),
      onArm: others.slice(0, 3),
      onObstacle: others.slice(3, 6),
      stop: others[6],
    };
  }

  /**
   * What the real arm touches at a time, by the frame of the replay before it; null: nothing, or nobody knows.
   * @returns {null|{pressing: number, force: number[], point: number[], obstacle: string}}
   */
  contactAt(time) {
    const [pressing, ...others] = this.#frameAt(this.replay?.contact, CONTACT, time) ?? [];
    if (!(pressing > 0)) return null;
    return { pressing, force: others.slice(0, 3), point: others.slice(3, 6), obstacle: this.#obstacle(others[6]) };
  }

  #obstacle(index) {
    return String(this.#names.obstacles[index] ?? `obstacle ${index}`);
  }

  /** The numbers of the frame of the replay before a time, or null. */
  #frameAt(numbers, width, time) {
    const { step, n } = this.replay ?? {};
    if (!numbers || n === 0) return null;
    const frame = Math.min(Math.max(Math.floor((time - this.t0) / step + 1e-9), 0), n - 1);
    return numbers.subarray(width * frame, width * (frame + 1));
  }

  #readReplay({ step_s: step, n, nominal, real, rest, nearest, contact }, where) {
    const length = n * this.#run.joints.length;
    if (!(step > 0)) throw new DataError(`${where}: step_s must be positive.`);
    const read = (reference, name, count) => (reference ? this.#run.array(reference, `${where}.${name}`, count) : null);
    return {
      step,
      n,
      nominal: this.#run.array(nominal, `${where}.nominal`, length),
      real: read(real, 'real', length),
      rest: read(rest, 'rest', length),
      nearest: read(nearest, 'nearest', NEAREST * n),
      contact: read(contact, 'contact', CONTACT * n),
    };
  }
}

/** Its curves are samples: least and largest value per bucket, of a band its edges. */
function readVerification(run, json, where) {
  const joints = needArray(json.joints, `${where}.joints`).map((joint, j) => {
    const limits = need(joint.limits, `${where}.joints[${j}].limits`);
    for (const quantity of JUDGED) need(limits[quantity], `${where}.joints[${j}].limits.${quantity}`);
    return { ...joint, curves: joint.curves ? readCurves(run, joint.curves, `${where}.joints[${j}].curves`) : null };
  });
  if (joints.length !== run.joints.length)
    throw new DataError(`${where}: ${joints.length} joints, the robot has ${run.joints.length}.`);
  return { ...json, joints };
}

function readCurves(run, { t0, step_s: step, n, ...quantities }, where) {
  if (!(step > 0)) throw new DataError(`${where}: step_s must be positive.`);
  const samples = (reference, name) => pairsOf(t0, step, run.array(reference, `${where}.${name}`, 2 * n));
  const curves = JUDGED.map((quantity) => {
    const read = need(quantities[quantity], `${where}.${quantity}`);
    const kinds = ['raw', 'mean', 'band'].map((kind) => [kind, samples(read[kind], `${quantity}.${kind}`)]);
    return [quantity, Object.fromEntries(kinds)];
  });
  return Object.fromEntries(curves);
}
