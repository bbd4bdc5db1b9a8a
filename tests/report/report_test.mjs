// Reports as a user gets them, in a browser:
//   node report_test.mjs sample|run|sweep BUILD SOURCE
// sample: made-up data, all tests with 4 s, those of speed with 600 s. run: the program's own reports, of an experiment
// that means harm and of the paper's Fig. 5. sweep: made-up sweeps, a large one, and small odd ones.
import { spawnSync } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';

const [kind, build, source] = process.argv.slice(2);
if (!['sample', 'run', 'sweep'].includes(kind) || !source) {
  console.error('usage: node report_test.mjs sample|run|sweep BUILD SOURCE');
  process.exit(2);
}
const folder = mkdtempSync(join(tmpdir(), 'viable-report-test-'));
process.on('exit', () => rmSync(folder, { recursive: true, force: true }));
process.env.VIABLE_REPORT_FOLDER = join(build, 'report');

/** Runs a program to its end; ends with its exit code if that is not 0. */
function run(program, ...words) {
  const { status, error } = spawnSync(program, words, { stdio: ['ignore', 'inherit', 'inherit'] });
  if (error) console.error(`${program}: ${error.message}`);
  if (status !== 0) process.exit(status ?? 1);
}
const here = (name) => fileURLToPath(new URL(name, import.meta.url));
const runScript = (name, ...words) => run(process.execPath, here(name), ...words);
const program = join(build, 'bin/viable');

const TITLE =
  '<script>window.hacked=1</script><img src=x onerror="window.hacked=1">\'`&amp;$&$1${1}</title></style>-->' +
  ' @@VIABLE_DATA@@ @@VIABLE_BINARY@@ \\u003c/script> \u2028 ünï 机器人';
const CASES = [
  ['__proto__', '{plugin: certified_braking, k_alpha: 5, gamma: 20}'],
  ['constructor', '{plugin: acceleration_viability, k_alpha: 5}'],
  ['-', '{plugin: exponential_cbf, k_alpha: 5, gamma: 20, on_infeasible: stop}'],
  [`+${'long_name'.repeat(7)}`, '{plugin: tosbp, k_alpha: 5, gamma: 20}'],
];

/** Two seconds of the Indy7 and its real arm under names that a careless page would run. */
function writeHostile(path) {
  const cases = CASES.map(([name, filter]) => `  "${name}": {filter: ${filter}}`);
  writeFileSync(
    path,
    `# </script><script>window.hacked=1</script> <!-- <script>
schema: 1
title: ${JSON.stringify(TITLE)}  # -->
robot: indy7
duration_s: 2
tick_s: 0.001
limits:
  position_rad:
    center: [0, -pi/12, -pi/2, 0, -5*pi/12, 0]
    half_range: [pi/6, pi/12, pi/6, pi/12, pi/6, pi/3]
  velocity_radps: [2*pi/3, .inf, 2*pi/3, 2*pi/3, 2*pi/3, 2*pi/3]
  acceleration_radps2: 4*pi
  jerk_radps3: 12*pi
command: {plugin: random_steps, seed: 1, shortest_s: 0.4, longest_s: 0.8}
controller: {plugin: joint_pd, stiffness: 100, damping: 20}
robust_loop: {plugin: nric, k_r: 600, k_p: 20, k_i: 8}
real_plant: {plugin: simbody, friction: robot, payload_kg: 1.0, seed: 7}
cases:
${cases.join('\n')}
`,
  );
}

if (kind === 'sample') {
  const template = join(build, 'share/viable/report_template.html');
  const [short, long] = ['short.html', 'long.html'].map((name) => join(folder, name));
  runScript('make_sample.mjs', template, short, '--rows', '4000');
  runScript('browser_test.mjs', short);
  runScript('make_sample.mjs', template, long, '--rows', '600000');
  runScript('browser_test.mjs', long, '--only', 'it is quick|a zoom in one');
} else if (kind === 'sweep') {
  runScript('statistics_test.mjs');
  runScript('limits_test.mjs');
  runScript('sweep_browser_test.mjs', join(build, 'share/viable/sweep_template.html'));
} else {
  const file = join(folder, 'hostile.yaml');
  writeHostile(file);
  run(program, 'run', file, '--out', join(folder, 'hostile'));
  runScript('browser_test.mjs', '--quick', '--title', TITLE, join(folder, 'hostile/report.html'));
  run(program, 'run', join(source, 'experiments/paper_fig5.yaml'), '--out', join(folder, 'fig5'));
  runScript('browser_test.mjs', '--quick', join(folder, 'fig5/report.html'));
}
