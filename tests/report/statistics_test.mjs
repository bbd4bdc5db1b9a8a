// The statistics of the sweep's page against the plain definitions, with random data (seed below).
import assert from 'node:assert/strict';
import { binAt, binsOf, groupEffect, orderOf, quantile, rankCorrelation } from '../../tools/report/src/sweep/statistics.js';

let seed = 7;
const random = () => {
  seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
  return seed / 2 ** 32;
};

/** Rank by counting: how many are smaller, and half of the equal ones. */
const rank = (values, x) =>
  values.filter((y) => y < x).length + (values.filter((y) => y === x).length + 1) / 2;
function correlation(x, y) {
  const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;
  const [mx, my] = [mean(x), mean(y)];
  const sum = (f) => x.reduce((total, _, i) => total + f(x[i] - mx, y[i] - my), 0);
  return sum((a, b) => a * b) / Math.sqrt(sum((a) => a * a) * sum((_, b) => b * b));
}
const close = (a, b, what) => assert.ok(Math.abs(a - b) < 1e-12, `${what}: ${a}, expected ${b}`);

for (let trial = 0; trial < 20; ++trial) {
  const a = Float64Array.from({ length: 80 }, () => (random() < 0.1 ? NaN : Math.floor(12 * random()))); // many ties
  const b = Float64Array.from(a, (x) => (random() < 0.1 ? NaN : random() < 0.05 ? Infinity : 0.3 * x + 4 * random()));
  const isIn = (row) => row % 7 !== 3;
  const rows = [...a.keys()].filter((i) => isIn(i) && Number.isFinite(a[i]) && Number.isFinite(b[i]));
  const x = rows.map((i) => a[i]);
  const y = rows.map((i) => b[i]);
  const expected = correlation(x.map((value) => rank(x, value)), y.map((value) => rank(y, value)));
  const { rho, count } = rankCorrelation(a, orderOf(a), b, orderOf(b), isIn);
  close(rho, expected, `rank correlation of trial ${trial}`);
  assert.equal(count, rows.length);
}

// Two groups: the share explained is the square of the rank correlation with 0 and 1, less what chance gives.
const n = 400;
const group = Uint32Array.from({ length: n }, () => (random() < 0.3 ? 1 : 0));
const b = Float64Array.from(group, (g) => g + 2 * random());
const plain = rankCorrelation(Float64Array.from(group), orderOf(Float64Array.from(group)), b, orderOf(b), () => true).rho;
close(
  groupEffect(group, b, orderOf(b), () => true).rho,
  Math.sqrt(1 - ((1 - plain ** 2) * (n - 1)) / (n - 2)),
  'effect of two groups',
);
const noise = Uint32Array.from({ length: n }, () => Math.floor(20 * random()));
assert.ok(groupEffect(noise, b, orderOf(b), () => true).rho < 0.2, 'many groups of chance explain little');
const constant = new Float64Array(n);
assert.ok(Number.isNaN(rankCorrelation(constant, orderOf(constant), b, orderOf(b), () => true).rho));

close(quantile([1, 2, 3, 4], 0.5), 2.5, 'median');
close(quantile([1, 2, 3, 4], 1), 4, 'largest');
assert.ok(Number.isNaN(quantile([], 0.5)));
for (let trial = 0; trial < 200; ++trial) {
  const low = (random() - 0.5) * 10 ** (8 * random() - 4);
  const high = low + random() * 10 ** (8 * random() - 4);
  const bins = binsOf(low, high, 40);
  assert.ok(bins.start <= low + 1e-6 * bins.step && bins.start + bins.step * bins.count >= high - 1e-6 * bins.step, 'bins hold all');
  assert.ok(bins.count >= 1 && bins.count <= 90, `${bins.count} bins`);
  assert.ok(binAt(bins, low) === 0 && binAt(bins, high) === bins.count - 1, 'from the first to the last');
}
console.log('statistics: passed (seed 7)');
