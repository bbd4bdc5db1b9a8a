import { button, el, save, swatch, table } from '../dom.js';
import { isOk, OUTSIDE, prettyStatus, severity } from './data.js';
import { count } from './head.js';

const FIRST = 15; // rows shown at first
const MORE = 100;

/**
 * A table of runs: sorted by a click on a head, filtered by words, saved as CSV. `admits(row)` chooses the runs;
 * `columns()` are those beside run and case.
 */
export class RunTable {
  #shown = FIRST;
  #sort; // { key, isDown }

  constructor(host, state, { name, title, hint, admits, columns, sort }) {
    this.state = state;
    this.name = name;
    this.admits = admits;
    this.columns = columns;
    this.#sort = sort;
    this.makeTitle = title;
    this.title = el('h2');
    this.filter = el('input', {
      type: 'search',
      placeholder: 'filter: run, case, status, word',
      'aria-label': 'Filter the table',
      oninput: () => this.#reset(),
    });
    const csv = button({ text: 'CSV', title: 'Save the table, all its rows, as CSV', onclick: () => this.#saveCsv() });
    this.table = el('table.summary.runs');
    this.more = button({
      class: 'more',
      onclick: () => {
        this.#shown += MORE;
        this.update();
      },
    });
    host.append(
      el('div.section-head', this.title, el('span.hint', { text: hint }), el('span.push'), this.filter, csv),
      el('div.scroll.card', { tabindex: 0, role: 'region', 'aria-label': name }, this.table),
      this.more,
    );
    this.host = host;
    state.on('rows result', () => this.#reset());
    state.on('select', () => this.#markSelected());
    this.update();
  }

  #reset() {
    this.#shown = FIRST;
    this.update();
  }

  /** What stands in a column: {key, title, text(row), full(row), compare(a, b), has(row)}. */
  #all() {
    const { sweep } = this.state;
    const caseOf = (row) => sweep.caseOf[row];
    const caseName = (row) => sweep.cases[caseOf(row)].name;
    const own = [
      { key: 'run', title: 'run', isNumber: true, text: (row) => String(sweep.run[row]), compare: (a, b) => sweep.run[a] - sweep.run[b] },
      { key: 'case_name', title: 'case', text: caseName, compare: (a, b) => caseOf(a) - caseOf(b), mark: (row) => swatch(caseOf(row)) },
    ];
    const ofStatus = {
      text: (row) => prettyStatus(sweep.statuses[row]),
      isBad: (row) => !isOk(sweep.statuses[row]),
      compare: (a, b) => severity(sweep.statuses[b]) - severity(sweep.statuses[a]),
    };
    const seen = new Set();
    const stored = this.columns().filter((column) => column && !seen.has(column.name) && seen.add(column.name));
    return [
      ...own.map((column) => ({ ...column, full: column.text, has: () => true })),
      ...stored.map((column) => ({
        key: column.name,
        title: column.title,
        isNumber: !column.isWords,
        isCommand: column.name === 'replay',
        text: (row) => column.show(row),
        full: (row) => column.text(row),
        isBad: (row) => column.isShare && column.numbers[row] > OUTSIDE,
        compare: (a, b) => column.compare(a, b),
        has: (row) => column.has(row),
        ...(column.name === 'status' ? ofStatus : {}),
      })),
    ];
  }

  /** The rows of the table, in its order. Runs without a value are last, whatever the order. */
  #rows(columns) {
    const { state } = this;
    const words = this.filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    const textual = columns.filter(({ isNumber, key }) => !isNumber || key === 'run');
    const matches = (row) => {
      const texts = textual.map(({ text }) => text(row).toLowerCase());
      return words.every((word) => texts.some((text) => text.includes(word)));
    };
    const rows = state.rows.filter((row) => this.admits(row) && (words.length === 0 || matches(row)));
    const key = this.#sort.key();
    const by = columns.find((column) => column.key === key) ?? columns[0];
    const sign = this.#sort.isDown ? -1 : 1;
    return rows.sort((a, b) => Number(by.has(b)) - Number(by.has(a)) || sign * by.compare(a, b) || a - b);
  }

  update() {
    const columns = this.#all();
    const rows = this.#rows(columns);
    const sortKey = this.#sort.key();
    this.title.textContent = this.makeTitle(rows.length);
    const heads = columns.map(({ key, title, isNumber }) => {
      const isSorted = key === sortKey;
      const [order, mark] = !isSorted ? [null, ''] : this.#sort.isDown ? ['descending', ' ▾'] : ['ascending', ' ▴'];
      const onclick = () => this.#sortBy(key, isNumber);
      return el(
        'th',
        { scope: 'col', class: isNumber ? 'number' : null, 'aria-sort': order },
        button({ class: 'sort', text: title + mark, title: `${key}: sort`, onclick }),
      );
    });
    const body = rows.slice(0, this.#shown).map((row) => this.#row(row, columns));
    this.table.replaceChildren(...table({}, heads, body).children);
    this.table.dataset.rows = String(rows.length);
    const left = rows.length - body.length;
    this.more.hidden = left <= 0;
    this.more.textContent = left <= MORE ? `Show the other ${count(left)}` : `Show ${MORE} more of ${count(left)}`;
    this.#markSelected();
  }

  #row(row, columns) {
    return el(
      'tr',
      { 'data-row': row, onclick: () => this.state.select(row) },
      ...columns.map(({ key, text, isNumber, isBad, isCommand, mark, full }) => {
        if (key === 'run')
          return el('th', { scope: 'row', class: 'number' }, button({ class: 'joint-name', text: text(row), title: 'Show this run' }));
        if (isCommand) return el('td', copyButton(full(row)));
        const classes = [isNumber ? 'number' : '', isBad?.(row) ? 'bad' : ''].filter(Boolean).join(' ');
        return el('td', { class: classes || null, title: isNumber ? null : full(row) }, mark ? mark(row) : null, text(row));
      }),
    );
  }

  #sortBy(key, isNumber) {
    const isSame = this.#sort.key() === key;
    this.#sort = { key: () => key, isDown: isSame ? !this.#sort.isDown : isNumber && key !== 'run' };
    this.#reset();
  }

  #markSelected() {
    for (const row of this.table.querySelectorAll('tbody tr'))
      row.classList.toggle('selected', Number(row.dataset.row) === this.state.selected);
  }

  #saveCsv() {
    const columns = this.#all();
    const quote = (text) => (/[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const lines = [columns.map(({ key }) => key), ...this.#rows(columns).map((row) => columns.map(({ full }) => full(row)))];
    const text = lines.map((cells) => cells.map(quote).join(',')).join('\r\n');
    save(new Blob([`${text}\r\n`], { type: 'text/csv' }), `${this.state.sweep.title} ${this.name}.csv`);
  }
}

/** Copies a text; without a clipboard the button selects nothing and says so. */
export function copyButton(text) {
  const copy = button({
    class: 'quiet copy',
    text: 'copy replay',
    title: text || 'no command',
    disabled: text === '',
    onclick: async (event) => {
      event.stopPropagation();
      try {
        await navigator.clipboard.writeText(text);
        copy.textContent = 'copied';
      } catch {
        copy.textContent = 'no clipboard';
      }
      setTimeout(() => (copy.textContent = 'copy replay'), 1500);
    },
  });
  return copy;
}
