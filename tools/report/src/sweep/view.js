// What the plots of a result have in common: its values case by case, and the part of its axis that is shown.
import { binsOf, quantile } from './statistics.js';
import { powers, tick, ticks } from '../format.js';

const WIDE = 4; // times the distance from the 1st to the 99th percentile

/** Per shown case the rows with a finite value of a column, in the order of the values. */
export function rowsByCase(state, column) {
  const { sweep } = state;
  const groups = state.cases.map((c) => ({ c, rows: [] }));
  const of = new Map(groups.map((group) => [group.c.index, group]));
  if (column) for (const row of column.order) if (state.isShown(row)) of.get(sweep.caseOf[row]).rows.push(row);
  return groups;
}

/**
 * The part of a column's axis to show: all values, but where a few far ones would flatten all the rest, as far as the
 * rest goes. `bins` covers it; `isCut` tells that values are beyond. Null where there is no value.
 */
export function viewOf(column, groups, count) {
  const all = groups.flatMap(({ rows }) => rows.map((row) => column.numbers[row])).sort((a, b) => a - b);
  if (all.length === 0) return null;
  let [min, max] = [all[0], all.at(-1)];
  const [low, high] = [quantile(all, 0.01), quantile(all, 0.99)];
  const reach = WIDE * (high - low);
  const isCut = reach > 0 && all.length >= 100 && (max - high > reach || low - min > reach);
  if (isCut) [min, max] = [Math.max(min, low - reach / 2), Math.min(max, high + reach / 2)];
  if (column.isShare) {
    if (min > 0) min = Math.min(min, max > 0.3 ? 0 : min);
    if (max > 0.3 && max < 1) max = 1; // the limit is in view
  }
  const bins = binsOf(min, max, count);
  return { bins, isCut, min: bins.start, max: bins.start + bins.step * bins.count };
}

/** The ticks of an axis of a column, as text; `value` is a place (see Column.placeOf). */
export function axisOf(column, min, max, count) {
  if (column.isLogarithmic) {
    const all = powers(10 ** min, 10 ** max);
    const some = all.length > 2 * count ? powers(10 ** min, 10 ** max, true) : all;
    const values = some.length > 1 ? some : ticks(10 ** min, 10 ** max, count).values;
    return values.map((value) => ({ value: Math.log10(value), text: tick(value, value) }));
  }
  const { values, increment } = ticks(min, max, count);
  const text = (value) => (column.isShare ? `${tick(100 * value, 100 * increment)} %` : tick(value, increment));
  return values.map((value) => ({ value, text: text(value) }));
}
