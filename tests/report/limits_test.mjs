// Which limit the live page names, from frames made by hand.
import assert from 'node:assert/strict';
import { limitsOf } from '../../tools/report/src/live/limits.js';

const limits = ['position', 'velocity', 'acceleration', 'jerk', 'torque', 'clearance'];
const run = { moves: 'tool', joints: [{}, {}], environment: { safety_distance_m: 0.02 }, limits };
const still = {
  hand: [1], limit: [0, 0], clearance: [0.5], q: [0, 0], qd: [0, 0], target_q: [0, 0],
  velocity_lower: [-1, -1], velocity_upper: [1, 1], position_lower: [-2, -Infinity], position_upper: [2, Infinity],
  tool: [0, 0, 0, 1, 0, 0, 0], target: [0.1, 0, 0, 1, 0, 0, 0],
};
const named = (changes, of = run) => limitsOf((name) => ({ ...still, ...changes })[name], of);

assert.deepEqual(named({}), [null, null], 'late, and nothing known');
assert.deepEqual(named({ limit: [3, 12] }), ['velocity_lower', 'clearance_upper'], 'what the filter tells');
assert.deepEqual(named({ qd: [0.995, -1] }), ['velocity_upper', 'velocity_lower']);
assert.deepEqual(named({ q: [1.999, 0] }), ['position_upper', null], 'a joint at its end; one without ends');
assert.deepEqual(named({ q: [1.999, 0], qd: [0, 0.5] }), ['position_upper', null], 'a joint at its end while another moves');
assert.deepEqual(named({ q: [1.999, 0], qd: [-0.1, 0] }), [null, null], 'a joint that leaves its end');
assert.deepEqual(named({ clearance: [0.027] }), ['clearance_lower', 'clearance_lower'], 'barred, at rest');
assert.deepEqual(named({ clearance: [0.027], qd: [0.1, 0] }), [null, null], 'near something, on the way');
assert.deepEqual(named({ clearance: [0.027], target: still.tool }), [null, null], 'near something, where it should be');
assert.deepEqual(named({ clearance: [0.027], target: [0, 0, 0, Math.cos(0.1), 0, 0, Math.sin(0.1)] }), ['clearance_lower', 'clearance_lower'], 'a turn that is barred');
assert.deepEqual(named({ clearance: [0.027], hand: [0] }), [null, null], 'nobody moves it');
assert.deepEqual(named({ clearance: [NaN], hand: [NaN], target: [] }, { ...run, moves: '', environment: null }), [null, null]);
assert.deepEqual(named({ clearance: [0.001] }, { ...run, environment: null }), [null, null], 'no surroundings');
assert.deepEqual(named({ q: [2, 0], target_q: [2.5, 0] }, { ...run, moves: 'joints' }), ['position_upper', null]);
assert.deepEqual(named({ q: [2, 0], target_q: [2, 0] }, { ...run, moves: 'joints' }), [null, null]);
assert.deepEqual(named({ q: [2, 0], target_q: [2, 1] }, { ...run, moves: 'joints' }), [null, null], 'another joint is late');
assert.deepEqual(named({ q: [-1.999, 0], target_q: [-2.5, 0] }, { ...run, moves: 'joints' }), ['position_lower', null]);
console.log('limits: all as expected');
