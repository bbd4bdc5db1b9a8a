/*
 * The data of a report, as the C++ side writes it.
 *
 * The script `viable-data` is JSON, every `<` written as \u003c. The script `viable-binary` is base64 of a gzip stream
 * of little-endian arrays. An array reference is {"at": byteOffset, "n": elements, "type": "f32"|"u8"}, offsets
 * multiples of 4 (u32 is understood, too).
 *
 *   { "format": 1, "version": "0.1.0", "title": str, "created": "2026-11-21T12:00:00Z", "file": str,
 *     "yaml": str,                                                    the resolved experiment file
 *     "robot": { "name": str, "joints": [ { "name": str, "kind": "revolute"|"continuous"|"prismatic" } ] },
 *     "scene": null | { "tool": int (the link whose way is drawn; not given: the last fixed one without shapes),
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
 *     "summary": { "columns": [str], "rows": [[str]], "note": str },
 *     "cases": [ {
 *         "name", "filter", "robust_loop", "plant", "promises": bool, "verdict": str, "ok": bool,
 *         "stop": null | { "time_s", "message" }, "details": str (monospace text),
 *         "rows": int, "tick_s": num, "t0": 0, "step_s": num, "buckets": int,
 *         "joints": [ { "series": {
 *             "error" (real_q - nominal_q): ref | null, "nominal_q", "nominal_qd", "nominal_qdd", "nominal_jerk": ref, "real_q", "real_qd", "real_qdd",
 *             "real_jerk" (both differentiated from real_qd tick by tick): ref | null,
 *             "tau_desired", "tau_filter": ref, "tau_robust", "tau_motor": ref | null, "margin": ref,
 *             "position_lower", "position_upper", "velocity_...", "acceleration_...", "jerk_...": ref | num | null },
 *           "active": ref u8, one per bucket: a bit for each limit that acted in it, LIMITS[i] the bit i - 1 } ],
 *         "status": ref u8, one per bucket, the worst in it: an index into STATUS,
 *         "tick_time": { "edges_us": [...], "counts": [...] },
 *         "replay": { "step_s": num, "n": int, "nominal": ref f32 n*joints, "real": ref | null } } ] }
 *
 * A series has 2 * buckets values, least and largest per bucket, drawn at t0 + (i + 0.25) * step and
 * t0 + (i + 0.75) * step. Where step_s == tick_s it has one value per bucket, drawn at t0 + i * step (jerk as steps).
 * A number that is not finite is NaN in an array.
 */

const LIMITS = [
  'none',
  'position_lower',
  'position_upper',
  'velocity_lower',
  'velocity_upper',
  'acceleration_lower',
  'acceleration_upper',
  'jerk_lower',
  'jerk_upper',
];
export const STATUS = [
  'passed',
  'modified',
  'stopped by plan',
  'returning',
  'no admissible choice',
  'invalid or faulted',
];

/** The names of the limits that acted, of a bucket's bits. */
export const limitsIn = (bits) => LIMITS.filter((_, i) => i > 0 && bits & (1 << (i - 1)));

const ELEMENT = { f32: Float32Array, u8: Uint8Array, u32: Uint32Array };

/** An error whose message is meant for the reader of the report. */
export class DataError extends Error {}

/**
 * Values at equal distances: y[i] belongs to x0 + i * dx. `pairs` tells that y holds least and largest per bucket.
 * @typedef {{x0: number, dx: number, y: Float32Array, pairs: boolean}} Samples
 */

/** Reads the two data scripts of the page. */
export async function loadRun() {
  const json = readJson(takeText('viable-data'));
  const buffer = await unpack(takeText('viable-binary'));
  return new Run(json, buffer);
}

/** The text of a script, which is emptied: it is not needed twice. */
function takeText(id) {
  const script = document.getElementById(id);
  const text = script ? script.textContent.trim() : '';
  if (text === '' || text.startsWith('@@'))
    throw new DataError(
      `This page holds no run: its ${id} is empty. ` + 'It is a template; the program writes the report.',
    );
  script.textContent = '';
  return text;
}

function readJson(text) {
  let json;
  try {
    json = JSON.parse(text);
  } catch (error) {
    throw new DataError(`The description of the run (viable-data) is damaged: ${error.message}.`);
  }
  if (json?.format !== 1) throw new DataError(`The data has format ${json?.format}; this page reads format 1.`);
  return json;
}

/** base64 of a gzip stream to its bytes. */
async function unpack(text) {
  if (typeof DecompressionStream === 'undefined')
    throw new DataError(
      'This browser cannot unpack the data of the run ' +
        '(it has no DecompressionStream). Any browser of 2023 or later can.',
    );
  try {
    const clean = text.replace(/\s+/g, '');
    const parts = [];
    for (let at = 0; at < clean.length; at += 1 << 20) {
      // a multiple of 4 characters
      const characters = atob(clean.slice(at, at + (1 << 20)));
      const bytes = new Uint8Array(characters.length);
      for (let i = 0; i < bytes.length; ++i) bytes[i] = characters.charCodeAt(i);
      parts.push(bytes);
    }
    const stream = new Blob(parts).stream().pipeThrough(new DecompressionStream('gzip'));
    return await new Response(stream).arrayBuffer();
  } catch (error) {
    throw new DataError(
      'The numbers of the run (viable-binary) are damaged or cut off. ' +
        `Was the file copied whole? (${error.message || error.name})`,
    );
  }
}

/** A run: what was experimented, on what robot, and the cases. */
export class Run {
  #buffer;

  constructor(json, buffer) {
    this.#buffer = buffer;
    for (const key of ['title', 'version', 'created', 'file', 'yaml']) this[key] = String(json[key] ?? '');
    this.robot = need(json.robot, 'robot').name;
    this.joints = needArray(json.robot.joints, 'robot.joints').map(({ name, kind }) => ({
      name: String(name),
      kind,
      linear: kind === 'prismatic',
    }));
    this.summary = json.summary ?? { columns: [], rows: [], note: '' };
    this.scene = json.scene ?? null;
    this.cases = needArray(json.cases, 'cases').map((description, index) => new Case(this, description, index));
    if (this.cases.length === 0) throw new DataError('The run has no cases.');
    if (this.joints.length === 0) throw new DataError('The robot has no joints.');
    this.tMin = Math.min(...this.cases.map((c) => c.t0));
    this.tMax = Math.max(...this.cases.map((c) => c.end));
    if (!(this.tMax > this.tMin)) this.tMax = this.tMin + 1;
    this.frameStep = Math.min(...this.cases.map((c) => c.replay?.step ?? c.step));
  }

  /** The array that a reference names; `where` is for the message. */
  array(reference, where, length = null) {
    const { at, n, type } = need(reference, where);
    const Type = ELEMENT[type];
    if (!Type) throw new DataError(`${where}: unknown element type ${type}.`);
    const size = Type.BYTES_PER_ELEMENT;
    if (!(
      Number.isInteger(at) &&
      Number.isInteger(n) &&
      at >= 0 &&
      n >= 0 &&
      at % size === 0 &&
      at + n * size <= this.#buffer.byteLength
    ))
      throw new DataError(
        `${where}: ${n} values at byte ${at} are not within the ${this.#buffer.byteLength} bytes of the data.`,
      );
    if (length !== null && n !== length) throw new DataError(`${where}: ${n} values, expected ${length}.`);
    return new Type(this.#buffer, at, n);
  }
}

/** A case of a run: one filter, robust loop and plant, from start to end. */
export class Case {
  #run;
  #joints;
  #cache = new Map();

  constructor(run, json, index) {
    const where = `cases[${index}]`;
    this.#run = run;
    this.index = index;
    for (const key of ['name', 'filter', 'robust_loop', 'plant', 'verdict', 'details'])
      this[key] = String(json[key] ?? '');
    this.promises = Boolean(json.promises);
    this.ok = Boolean(json.ok);
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
    this.tickTime = json.tick_time ?? { edges_us: [], counts: [] };
    this.#joints = needArray(json.joints, `${where}.joints`);
    if (this.#joints.length !== run.joints.length)
      throw new DataError(`${where}: ${this.#joints.length} joints, the robot has ${run.joints.length}.`);
    this.active = this.#joints.map((joint, j) => run.array(joint.active, `${where}.joints[${j}].active`, this.buckets));
    this.#joints.forEach((joint, j) => {
      // damaged data is found now, not when a plot is drawn
      for (const key of Object.keys(need(joint.series, `${where}.joints[${j}].series`))) this.samples(j, key);
    });
    this.replay = json.replay ? this.#readReplay(json.replay, `${where}.replay`) : null;
  }

  /**
   * A series of a joint: samples, a number (a constant), or null where the case has none.
   * @returns {Samples|number|null}
   */
  samples(joint, key) {
    const id = `${joint} ${key}`;
    if (this.#cache.has(id)) return this.#cache.get(id);
    const reference = this.#joints[joint].series[key];
    let samples = null;
    if (typeof reference === 'number') samples = reference;
    else if (reference) {
      const where = `cases[${this.index}].joints[${joint}].series.${key}`;
      const y = this.#run.array(reference, where);
      if (y.length !== this.buckets && y.length !== 2 * this.buckets)
        throw new DataError(`${where}: ${y.length} values for ${this.buckets} buckets.`);
      const pairs = y.length !== this.buckets;
      samples = pairs
        ? { x0: this.t0 + 0.25 * this.step, dx: 0.5 * this.step, y, pairs }
        : { x0: this.t0, dx: this.step, y, pairs };
    }
    this.#cache.set(id, samples);
    return samples;
  }

  /** Real minus nominal position in thousandths, or null. @returns {Samples|null} */
  trackingError(joint) {
    const id = `${joint} error in thousandths`;
    if (!this.#cache.has(id)) {
      const error = this.samples(joint, 'error');
      this.#cache.set(id, error && typeof error !== 'number' ? { ...error, y: error.y.map((value) => 1000 * value) } : null);
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

  #readReplay({ step_s: step, n, nominal, real }, where) {
    const length = n * this.#run.joints.length;
    if (!(step > 0)) throw new DataError(`${where}: step_s must be positive.`);
    return {
      step,
      n,
      nominal: this.#run.array(nominal, `${where}.nominal`, length),
      real: real ? this.#run.array(real, `${where}.real`, length) : null,
    };
  }
}

function need(value, where) {
  if (value === null || typeof value !== 'object') throw new DataError(`The data has no ${where}.`);
  return value;
}

function needArray(value, where) {
  if (!Array.isArray(value)) throw new DataError(`The data has no list ${where}.`);
  return value;
}
