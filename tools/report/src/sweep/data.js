/*
 * The data of a sweep's report, as the C++ side writes it. Arrays are named by references ("ref"), see ../blocks.js.
 *
 *   { "format": 1, "version": str, "created": str, "writer": str (the version that swept), "title": str, "file": str,
 *     "experiment": str (the file's text), "file_hash": str, "seed": str, "runs": str (planned), "cases": [str],
 *     "joints": [str], "rows": int (one per run and case that is done), "run": ref u32, "case": ref u32 (index),
 *     "columns": [ { "name", "kind": "draw"|"result"|"status", "unit", "label", "distribution",
 *       "numbers": ref f64, NaN where there is none
 *       | "words": ref u8 (UTF-8, each ended by a zero byte), "codes": ref u32 (index of a word, 2^32 - 1: none) } ] }
 */
import { DataError, need, needArray, readBlocks } from '../blocks.js';
import { fixed, number } from '../format.js';
import { orderOf } from './statistics.js';

const NONE = 0xffffffff;

/** Statuses, the worst first. Another one counts as a failure. */
const SEVERITY = ['crashed', 'guarantee_broken', 'promise_broken', 'tripped', 'failed', 'timed_out', 'stopped', 'ok'];
export const severity = (status) => Math.max(0, SEVERITY.indexOf(status));
export const isOk = (status) => status === 'ok';
export const prettyStatus = (status) => status.replaceAll('_', ' ');

/** Reads the two data scripts of the page. */
export async function loadSweep() {
  return new Sweep(await readBlocks());
}

export class Sweep {
  constructor({ json, array }) {
    for (const key of ['title', 'version', 'created', 'writer', 'file', 'experiment', 'file_hash', 'seed'])
      this[key] = String(json[key] ?? '');
    this.planned = Number(json.runs) || 0;
    this.cases = needArray(json.cases, 'cases').map((name, index) => ({ name: String(name), index }));
    this.rows = json.rows;
    if (!Number.isInteger(this.rows) || this.rows < 0) throw new DataError('The data does not tell its number of rows.');
    if (this.cases.length === 0) throw new DataError('The sweep has no cases.');
    this.run = array(json.run, 'run', this.rows);
    this.caseOf = array(json.case, 'case', this.rows);
    this.columns = needArray(json.columns, 'columns').map((column, i) => new Column(column, array, `columns[${i}]`, this.rows));
    this.draws = this.columns.filter(({ kind }) => kind === 'draw');
    this.results = this.columns.filter(({ kind, isWords }) => kind === 'result' && !isWords);
    const status = this.columns.find(({ name }) => name === 'status');
    if (!status) throw new DataError('The data has no column "status".');
    this.statuses = Array.from({ length: this.rows }, (_, row) => status.text(row) || 'failed');
    this.done = new Set(this.run).size;
    this.isPartial = this.rows < this.planned * this.cases.length;
  }

  column(name) {
    return this.columns.find((column) => column.name === name) ?? null;
  }

  /** What the columns of a set hold in a row: the value as the store has it. */
  value(name, row) {
    return this.column(name)?.text(row) ?? '';
  }
}

/** One column of the store: numbers or words. */
export class Column {
  #order = null;

  constructor(json, array, where, rows) {
    need(json, where);
    this.name = String(json.name);
    this.kind = json.kind;
    this.unit = String(json.unit ?? '');
    this.distribution = String(json.distribution ?? '');
    const path = this.name.replace(/^draw\./, '');
    const label = String(json.label ?? '');
    this.label = label !== '' && label !== path ? label : wordsOf(path, this.unit);
    this.isWords = Boolean(json.codes);
    if (this.isWords) {
      this.codes = array(json.codes, `${where}.codes`, rows);
      const text = new TextDecoder().decode(array(json.words, `${where}.words`));
      this.words = text.split('\0').slice(0, -1);
    } else this.numbers = array(json.numbers, `${where}.numbers`, rows);
  }

  /** A share of a limit, which is broken beyond 1. */
  get isShare() {
    return /(^|\.)worst_use(\.|$)|(^|\.)share$/.test(this.name);
  }

  /** Drawn evenly over the orders of magnitude, and shown so. */
  get isLogarithmic() {
    return this.distribution.startsWith('log_uniform');
  }

  /** Where a row is on an axis of this column. */
  placeOf(row) {
    return this.isLogarithmic ? Math.log10(this.numbers[row]) : this.numbers[row];
  }

  get title() {
    const { unit } = this;
    return unit && !this.isShare ? `${this.label} [${unit}]` : this.label;
  }

  /** The rows with a finite value, in the order of their values. */
  get order() {
    return (this.#order ??= orderOf(this.numbers));
  }

  has(row) {
    return this.isWords ? this.codes[row] !== NONE : this.numbers[row] === this.numbers[row];
  }

  /** The value in full, as for a file; empty where there is none. */
  text(row) {
    if (!this.has(row)) return '';
    return this.isWords ? (this.words[this.codes[row]] ?? '') : String(this.numbers[row]);
  }

  /** The value for people, with its unit if it has one. */
  show(row, withUnit = false) {
    if (!this.has(row)) return '–';
    return this.isWords ? this.text(row) : this.format(this.numbers[row], withUnit);
  }

  /** A number of this column for people. */
  format(value, withUnit = false) {
    if (value === Infinity || value === -Infinity) return value > 0 ? '∞' : '−∞';
    if (Number.isNaN(value)) return '–';
    if (this.isShare) return percent(value);
    const text = Number.isInteger(value) && Math.abs(value) < 1e15 ? String(value).replace('-', '−') : number(value);
    return withUnit && this.unit ? `${text} ${this.unit}` : text;
  }

  /** Negative, zero, positive: the order of two rows; rows without a value are last. */
  compare(a, b) {
    if (this.isWords) return this.text(a).localeCompare(this.text(b));
    return this.numbers[a] - this.numbers[b];
  }
}

/** The end of a key path as words: "real_plant.payload_kg" of unit kg is "real plant · payload". */
function wordsOf(path, unit) {
  const parts = path.split('.').slice(-2).join(' · ');
  return (unit ? parts.replace(/_[A-Za-z]+\d?(?=(\[\d+\])?$)/, '') : parts).replaceAll('_', ' ');
}

/** Beyond a limit by a hair does not read as 100 %. */
function percent(share) {
  const isFine = Math.abs(share) < 0.1 || Math.abs(share - 1) < 0.01;
  const text = fixed(100 * share, isFine ? 2 : 1);
  return `${share > OUTSIDE && Number(text) <= 100 ? '> 100' : text} %`;
}

/** A share of a limit beyond this is a limit broken: rounding is not (kOutsideShare of the framework). */
export const OUTSIDE = 1 + 1e-9;
