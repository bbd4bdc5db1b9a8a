// Writes the report of a synthetic sweep, so that the page can be developed and tested without one:
//   node make_sweep_sample.mjs TEMPLATE REPORT [--runs 10000] [--done 10000] [--cases 2] [--draws 12] [--title TEXT]
// The results follow made-up laws of the draws: |e| grows with draw 1 and falls with draw 2; the words matter a little.
import { readFile, writeFile } from 'node:fs/promises';
import { parseArgs } from 'node:util';
import { gzipSync } from 'node:zlib';

const text = { type: 'string' };
const { positionals: [template, target], values: options } = parseArgs({
  allowPositionals: true,
  options: {
    runs: { ...text, default: '10000' },
    done: text,
    cases: { ...text, default: '2' },
    draws: { ...text, default: '12' },
    title: { ...text, default: 'Sweep of payload and friction, synthetic sample' },
  },
});
if (!target) {
  console.error('usage: node make_sweep_sample.mjs TEMPLATE REPORT [--runs N] [--done N] [--cases N] [--draws N] [--title TEXT]');
  process.exit(2);
}
const RUNS = Number(options.runs);
const DONE = Number(options.done ?? options.runs);
const CASES = Number(options.cases);
const DRAWS = Number(options.draws);
const NONE = 0xffffffff;

let seed = 20261121;
const random = () => {
  seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
  return seed / 2 ** 32;
};

const parts = [];
let size = 0;
function add(array, type) {
  const bytes = Buffer.from(array.buffer, array.byteOffset, array.byteLength);
  const reference = { at: size, n: array.length, type };
  const rest = (8 - (bytes.length % 8)) % 8;
  parts.push(bytes, Buffer.alloc(rest));
  size += bytes.length + rest;
  return reference;
}
const numbers = (values) => ({ numbers: add(Float64Array.from(values, (value) => value ?? NaN), 'f64') });
function words(values) {
  const known = [...new Set(values.filter((value) => value !== null))];
  const places = new Map(known.map((word, i) => [word, i]));
  return {
    words: add(Uint8Array.from(Buffer.from(known.map((word) => `${word}\0`).join(''))), 'u8'),
    codes: add(Uint32Array.from(values, (value) => places.get(value) ?? NONE), 'u32'),
  };
}

const NAMES = ['payload_kg', 'friction.scale', 'shape'];
const draws = Array.from({ length: DRAWS }, (_, k) => ({
  name: `draw.real_plant.${NAMES[k] ?? `effect_${k}`}`,
  unit: ['kg', '', ''][k] ?? 'Nm',
  label: '',
  distribution: k === 2 ? 'one of sine, step, noise' : `uniform from 0 to ${k + 1}`,
  values: [],
}));
const results = ['bound.share', 'worst_use.position', 'worst_use.jerk', 'real.worst_use.velocity', 'tracking.max_rad', 'tripped_at_s'].map(
  (name) => ({ name, unit: name.endsWith('_rad') ? 'rad' : name.endsWith('_s') ? 's' : '', label: '', values: [] }),
);
const status = { status: [], exit_code: [], message: [], replay: [], wall_s: [] };
const run = [];
const caseOf = [];
for (let i = 0; i < DONE; ++i) {
  const drawn = draws.map((_, k) => (k === 2 ? ['sine', 'step', 'noise'][Math.floor(3 * random())] : (k + 1) * random()));
  for (let c = 0; c < CASES; ++c) {
    run.push(i);
    caseOf.push(c);
    draws.forEach(({ values }, k) => values.push(drawn[k]));
    const share = Math.max(
      0.01,
      0.3 * (drawn[0] ?? 0) - 0.08 * (drawn[1] ?? 0) + 0.1 * (drawn[2] === 'step') + 0.25 + 0.2 * c + 0.06 * (random() - 0.5),
    );
    const crashed = (i * CASES + c) % 997 === 996;
    const tripped = !crashed && share > 0.95;
    const values = [share, 1 - 1e-4 * random(), c === 1 ? 1.4 : 1, 0.8 + 0.2 * share, 0.01 * share, tripped ? 3 * random() : null];
    results.forEach((result, k) => result.values.push(crashed ? null : values[k]));
    status.status.push(crashed ? 'crashed' : tripped ? 'tripped' : 'ok');
    status.exit_code.push(crashed ? 139 : tripped ? 6 : 0);
    status.message.push(crashed ? 'signal 11' : tripped ? '<img src=x onerror="window.hacked=1"> |e| is over the bound' : null);
    status.replay.push(`viable sweep sample.yaml --replay ${i} --case C${c}`);
    status.wall_s.push(0.1 + 0.01 * random());
  }
}
const column = (kind) => ({ values, ...rest }) => ({
  ...rest,
  kind,
  ...(values.some((value) => typeof value === 'string') ? words(values) : numbers(values)),
});
const data = {
  format: 1,
  version: '0.1.0',
  writer: '0.1.0',
  created: '2026-11-21T12:00:00Z',
  title: options.title,
  file: 'experiments/sample.yaml',
  experiment: 'schema: 1\ntitle: sample\n',
  file_hash: '0123456789abcdef',
  seed: '42',
  runs: String(RUNS),
  cases: Array.from({ length: CASES }, (_, c) => `C${c}`),
  joints: ['joint0'],
  rows: run.length,
  run: add(Uint32Array.from(run), 'u32'),
  case: add(Uint32Array.from(caseOf), 'u32'),
  columns: [
    ...draws.map(column('draw')),
    ...results.map(column('result')),
    ...Object.entries(status).map(([name, values]) => column('status')({ name, unit: name === 'wall_s' ? 's' : '', label: '', values })),
  ],
};
const json = JSON.stringify(data).replaceAll('<', '\\u003c');
const page = (await readFile(template, 'utf8'))
  .replace('@@VIABLE_DATA@@', () => json)
  .replace('@@VIABLE_BINARY@@', () => gzipSync(Buffer.concat(parts)).toString('base64'));
await writeFile(target, page);
console.log(`${target}: ${(page.length / 1e6).toFixed(1)} MB, ${run.length} rows, ${data.columns.length} columns`);
