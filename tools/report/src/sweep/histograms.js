import { button, el, swatch, table } from '../dom.js';
import { caseColour, colours } from '../theme.js';
import { ticks } from '../format.js';
import { count } from './head.js';
import { OUTSIDE } from './data.js';
import { Panel } from './panel.js';
import { binAt, binsOf, quantile } from './statistics.js';
import { axisOf, rowsByCase, viewOf } from './view.js';

const MARGIN = { left: 56, right: 18, top: 16, bottom: 24 };

/** How often the result had which value, the cases over each other, and its quantiles in a table. */
export class ResultHistogram extends Panel {
  #isLogarithmic = false;

  constructor(state) {
    const name = el('h2');
    const note = el('span.note');
    const scale = button({ class: 'chip', title: 'How the height tells the number of runs' });
    super('histogram', 240, name, note, el('span.push'), scale);
    this.state = state;
    this.name = name;
    this.note = note;
    scale.addEventListener('click', () => {
      this.#isLogarithmic = !this.#isLogarithmic;
      scale.textContent = `height: ${this.#isLogarithmic ? 'logarithmic' : 'linear'}`;
      this.invalidate();
    });
    scale.textContent = 'height: linear';
    this.table = el('div.scroll', { tabindex: 0, role: 'region', 'aria-label': 'Quantiles' });
    this.root.append(this.table);
    this.update();
  }

  /** The result or the shown rows are others. */
  update() {
    const { state } = this;
    const column = state.result;
    this.groups = rowsByCase(state, column);
    this.view = column ? viewOf(column, this.groups, 60) : null;
    this.name.textContent = column ? column.title : 'No result';
    const values = this.groups.flatMap(({ rows }) => rows).length;
    this.canvas.setAttribute('aria-label', `Histogram of ${column?.title ?? 'nothing'}, ${values} runs`);
    this.note.textContent = '';
    if (this.view?.isCut) {
      const { min, max } = this.view;
      const beyond = this.groups.flatMap(({ rows }) => rows).map((row) => column.numbers[row]);
      const far = beyond.filter((value) => value < min || value > max);
      const most = far.reduce((a, b) => (Math.abs(b) > Math.abs(a) ? b : a));
      this.note.textContent = `${count(far.length)} beyond the plot, as far as ${column.format(most, true)}`;
    }
    this.#fillTable(column);
    this.invalidate();
  }

  #fillTable(column) {
    if (!column) return this.table.replaceChildren();
    const isEndless = (row) => Math.abs(column.numbers[row]) === Infinity;
    const shown = this.state.rows;
    const heads = ['case', 'runs', 'min', 'median', 'p95', 'p99', 'max', ...(column.isShare ? ['beyond the limit'] : [])];
    const body = this.groups.map(({ c, rows }) => {
      const sorted = rows.map((row) => column.numbers[row]);
      const own = shown.filter((row) => this.state.sweep.caseOf[row] === c.index);
      const endless = own.filter(isEndless).length;
      const without = own.length - rows.length - endless;
      const beyond = sorted.filter((value) => value > OUTSIDE).length + (column.isShare ? endless : 0);
      const note = [without ? `${count(without)} without a value` : '', endless ? `${count(endless)} infinite` : ''];
      const remark = note.filter(Boolean).join(', ');
      return el(
        'tr',
        el('th', { scope: 'row' }, swatch(c.index), c.name),
        el('td.number', { text: `${count(rows.length)}${remark ? ` (${remark})` : ''}` }),
        ...[0, 0.5, 0.95, 0.99, 1].map((share) =>
          el('td', {
            class: `number${column.isShare && quantile(sorted, share) > OUTSIDE ? ' bad' : ''}`,
            text: column.format(quantile(sorted, share), true),
          }),
        ),
        column.isShare ? el('td', { class: `number${beyond ? ' bad' : ''}`, text: count(beyond) }) : null,
      );
    });
    const cells = heads.map((text, i) => el('th', { scope: 'col', class: i ? 'number' : null, text }));
    this.table.replaceChildren(table({ class: 'summary quantiles' }, cells, body));
  }

  draw(painter, { width, height }) {
    const column = this.state.result;
    const { view } = this;
    const plot = { left: MARGIN.left, top: MARGIN.top, right: width - MARGIN.right, bottom: height - MARGIN.bottom };
    if (!view) return this.drawNothing(painter, width, height);
    const toX = (value) => plot.left + ((value - view.min) / (view.max - view.min)) * (plot.right - plot.left);
    const counts = this.groups.map(({ c, rows }) => ({ c, counts: countIn(view.bins, column.numbers, rows) }));
    const most = Math.max(1, ...counts.map((one) => Math.max(...one.counts)));
    const size = (n) => (this.#isLogarithmic ? Math.log10(2 * n) / Math.log10(2 * most) : n / most);
    const toY = (n) => plot.bottom - (n > 0 ? size(n) : 0) * (plot.bottom - plot.top);
    const levels = this.#isLogarithmic
      ? Array.from({ length: Math.floor(Math.log10(most)) + 1 }, (_, i) => 10 ** i)
      : ticks(0, most, 4).values.filter(Number.isInteger);
    for (const n of levels) {
      if (n > 0) painter.rect(plot.left, toY(n), plot.right - plot.left, 1, colours.grid);
      painter.text(count(n), plot.left - 6, toY(n), { colour: colours.muted, align: 'right' });
    }
    drawAxis(painter, column, view, plot, toX, Math.max(2, width / 90));
    const isAlone = counts.length === 1;
    for (const { c, counts: own } of counts) {
      const colour = caseColour(c.index);
      own.forEach((n, i) => {
        const x = toX(view.bins.start + i * view.bins.step);
        const end = toX(view.bins.start + (i + 1) * view.bins.step);
        if (n > 0) painter.rect(x, toY(n), Math.max(1, end - x - 1), plot.bottom - toY(n), colour, isAlone ? 0.85 : 0.28);
      });
    }
    if (!isAlone)
      for (const { c, counts: own } of counts)
        painter.line(
          (sink) => {
            sink.moveTo(toX(view.min), plot.bottom);
            own.forEach((n, i) => {
              sink.lineTo(toX(view.bins.start + i * view.bins.step), toY(n));
              sink.lineTo(toX(view.bins.start + (i + 1) * view.bins.step), toY(n));
            });
            sink.lineTo(toX(view.max), plot.bottom);
          },
          { colour: caseColour(c.index), width: 1.6 },
        );
    if (column.isShare) drawLimit(painter, plot, toX(1), view.max < 1);
  }
}

/** The limit of a share, or where it is if it is out of view. */
function drawLimit(painter, plot, x, isBeyond) {
  const at = isBeyond ? plot.right : x;
  if (!isBeyond) painter.segment(x, plot.top - 8, x, plot.bottom, { colour: colours.bad, width: 1.6, dash: [5, 4] });
  const isRight = isBeyond || x > (plot.left + plot.right) / 2;
  painter.text(isBeyond ? 'limit: 100 %, far to the right' : 'limit', at + (isRight ? -5 : 5), plot.top - 5, {
    colour: colours.bad,
    align: isRight ? 'right' : 'left',
    size: 10,
    halo: colours.surface,
  });
}

function drawAxis(painter, column, view, plot, toX, howMany) {
  painter.rect(plot.left, plot.bottom, plot.right - plot.left, 1, colours.line);
  for (const { value, text } of axisOf(column, view.min, view.max, howMany))
    painter.text(text, toX(value), plot.bottom + 13, { colour: colours.muted, align: 'center' });
}

function countIn(bins, values, rows) {
  const counts = new Array(bins.count).fill(0);
  const end = bins.start + bins.step * bins.count;
  for (const row of rows) if (values[row] >= bins.start - bins.step * 1e-6 && values[row] <= end) ++counts[binAt(bins, values[row])];
  return counts;
}

/** What was drawn of one parameter, over all runs, each once. */
export class DrawHistogram extends Panel {
  constructor(sweep, column, rows) {
    const text = column.distribution;
    super(column.name, 96, el('h3', { text: column.title, title: column.name }));
    this.root.classList.add('compact');
    if (text) this.stage.before(el('p.hint.distribution', { text, title: text }));
    this.column = column;
    this.rows = rows.filter((row) => column.has(row));
    this.canvas.setAttribute('aria-label', `How often which value of ${column.title} was drawn; ${text}`);
  }

  draw(painter, { width, height }) {
    const { column, rows } = this;
    const plot = { left: 6, top: 4, right: width - 6, bottom: height - 20 };
    if (rows.length === 0) return this.drawNothing(painter, width, height);
    if (column.isWords) return drawWords(painter, column, rows, plot);
    const numbers = rows.map((row) => column.placeOf(row)).filter(Number.isFinite);
    if (numbers.length === 0) return;
    const [min, max] = numbers.reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [Infinity, -Infinity]);
    const bins = binsOf(min, max, 30);
    const counts = countIn(bins, numbers, numbers.keys());
    const view = { min: bins.start, max: bins.start + bins.step * bins.count };
    const toX = (value) => plot.left + ((value - view.min) / (view.max - view.min)) * (plot.right - plot.left);
    const most = Math.max(...counts);
    counts.forEach((n, i) => {
      const x = toX(bins.start + i * bins.step);
      const size = (n / most) * (plot.bottom - plot.top);
      if (n > 0) painter.rect(x, plot.bottom - size, Math.max(1, toX(bins.start + (i + 1) * bins.step) - x - 1), size, colours.accent, 0.75);
    });
    painter.clip(0, 0, width, height, () => drawAxis(painter, column, view, plot, toX, Math.max(2, width / 80)));
  }
}

function drawWords(painter, column, rows, plot) {
  const counts = new Map();
  for (const row of rows) counts.set(column.text(row), (counts.get(column.text(row)) ?? 0) + 1);
  const words = [...counts].sort((a, b) => b[1] - a[1]);
  const size = (plot.right - plot.left) / words.length;
  const most = words[0][1];
  words.forEach(([word, n], i) => {
    const x = plot.left + i * size;
    const high = (n / most) * (plot.bottom - plot.top);
    painter.rect(x + 1, plot.bottom - high, Math.max(1, size - 2), high, colours.accent, 0.75);
    if (size > 24)
      painter.clip(x, plot.top, size, 1e3, () =>
        painter.text(word, x + size / 2, plot.bottom + 11, { colour: colours.muted, align: 'center' }),
      );
  });
}
