// Statistics over columns of numbers; NaN: no value. Nothing here knows of the page.
import { roundStep } from '../format.js';

/** The indices of the finite values, in the order of their values. @returns {Uint32Array} */
export function orderOf(values) {
  const indices = [];
  for (let i = 0; i < values.length; ++i) if (Number.isFinite(values[i])) indices.push(i);
  return Uint32Array.from(indices).sort((a, b) => values[a] - values[b] || a - b);
}

/**
 * Ranks 1, 2, ... of the rows that `isIn` admits; equal values share the mean of their ranks. Ranks of other rows are NaN.
 * @param {Uint32Array} order of `values`, from orderOf
 */
export function ranksOf(values, order, isIn) {
  const ranks = new Float64Array(values.length).fill(NaN);
  const rows = order.filter((row) => isIn(row));
  for (let first = 0; first < rows.length;) {
    let end = first + 1;
    while (end < rows.length && values[rows[end]] === values[rows[first]]) ++end;
    for (let i = first; i < end; ++i) ranks[rows[i]] = (first + 1 + end) / 2;
    first = end;
  }
  return ranks;
}

/**
 * Spearman's rank correlation: the correlation of the ranks, in [-1, 1].
 * @returns {{rho: number, count: number}} rho is NaN where one of the two never changes
 */
export function rankCorrelation(a, orderOfA, b, orderOfB, isIn) {
  const both = (row) => Number.isFinite(a[row]) && Number.isFinite(b[row]) && isIn(row);
  const x = ranksOf(a, orderOfA, both);
  const y = ranksOf(b, orderOfB, both);
  let count = 0;
  for (const rank of x) if (rank === rank) ++count;
  const mean = (count + 1) / 2;
  let xx = 0;
  let yy = 0;
  let xy = 0;
  for (let i = 0; i < x.length; ++i) {
    if (x[i] !== x[i]) continue;
    const dx = x[i] - mean;
    const dy = y[i] - mean;
    xx += dx * dx;
    yy += dy * dy;
    xy += dx * dy;
  }
  return { rho: xx > 0 && yy > 0 ? xy / Math.sqrt(xx * yy) : NaN, count };
}

/**
 * How much of the ranks of `b` the groups (words) explain, as a number in [0, 1] that can stand beside |rho|: the root of
 * Kruskal and Wallis' H, less what chance gives so many groups (epsilon squared, Kelley 1935).
 * @param {Uint32Array} codes the group of each row
 */
export function groupEffect(codes, b, orderOfB, isIn) {
  const ranks = ranksOf(b, orderOfB, (row) => Number.isFinite(b[row]) && isIn(row));
  const groups = new Map();
  let count = 0;
  for (let i = 0; i < ranks.length; ++i) {
    if (ranks[i] !== ranks[i]) continue;
    const group = groups.get(codes[i]) ?? { n: 0, sum: 0 };
    ++group.n;
    group.sum += ranks[i];
    groups.set(codes[i], group);
    ++count;
  }
  if (groups.size < 2) return { rho: NaN, count };
  const mean = (count + 1) / 2;
  let between = 0;
  let total = 0;
  for (const { n, sum } of groups.values()) between += n * (sum / n - mean) ** 2;
  for (const rank of ranks) if (rank === rank) total += (rank - mean) ** 2;
  if (!(total > 0) || count <= groups.size) return { rho: NaN, count };
  const explained = 1 - ((1 - between / total) * (count - 1)) / (count - groups.size);
  return { rho: Math.sqrt(Math.max(0, explained)), count };
}

/** The value that a share of sorted values does not exceed, between two neighbours on the line between them. */
export function quantile(sorted, share) {
  if (sorted.length === 0) return NaN;
  const at = share * (sorted.length - 1);
  const low = Math.floor(at);
  const high = Math.min(low + 1, sorted.length - 1);
  return sorted[low] + (at - low) * (sorted[high] - sorted[low]);
}

/** Bins of equal width on round numbers that hold all from min to max: {start, step, count}. */
export function binsOf(min, max, count) {
  if (!(max > min)) {
    const step = Math.abs(min) * 0.02 || 1;
    return { start: min - step / 2, step, count: 1 };
  }
  const step = roundStep(min, max, count, [1, 2, 2.5, 5, 10]);
  const start = Math.floor(min / step + 1e-9) * step;
  return { start, step, count: Math.max(1, Math.floor((max - start) / step + 1e-9) + 1) };
}

export const binAt = ({ start, step, count }, value) =>
  Math.min(count - 1, Math.max(0, Math.floor((value - start) / step + 1e-9)));
