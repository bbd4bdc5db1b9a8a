import { Emitter } from '../emitter.js';

/**
 * What the reader has chosen. `rows`: cases or statuses shown are others; `result`: another result; `select`: another run;
 * `theme`.
 */
export class State extends Emitter {
  constructor(sweep) {
    super();
    this.sweep = sweep;
    this.shownCases = sweep.cases.map(() => true);
    this.hiddenStatuses = new Set();
    this.result = firstResult(sweep);
    this.selected = null; // a row
  }

  /** The cases that are shown. */
  get cases() {
    return this.sweep.cases.filter(({ index }) => this.shownCases[index]);
  }

  isShown(row) {
    return this.shownCases[this.sweep.caseOf[row]] && !this.hiddenStatuses.has(this.sweep.statuses[row]);
  }

  /** The rows that are shown. */
  get rows() {
    const rows = [];
    for (let row = 0; row < this.sweep.rows; ++row) if (this.isShown(row)) rows.push(row);
    return rows;
  }

  toggleCase(index) {
    this.shownCases[index] = !this.shownCases[index];
    this.emit('rows');
  }

  select(row) {
    this.set('select', { selected: row === this.selected ? null : row });
  }
}

/** What the reader wants to know first: the share of the bound, else the worst use of a limit of the real joint, else any. */
function firstResult({ results, rows }) {
  const filled = results.filter((column) => {
    for (let row = 0; row < rows; ++row) if (column.has(row)) return true;
    return false;
  });
  const find = (pattern) => filled.find(({ name }) => pattern.test(name));
  return find(/^bound\.share$/) ?? find(/^real\.worst_use\./) ?? find(/worst_use\./) ?? filled[0] ?? results[0] ?? null;
}
