import { button, el, swatch } from '../dom.js';
import { fixed } from '../format.js';
import { caseColour, colours } from '../theme.js';
import { count } from './head.js';
import { isOk, prettyStatus } from './data.js';
import { Panel } from './panel.js';
import { groupEffect, rankCorrelation } from './statistics.js';
import { axisOf, rowsByCase, viewOf } from './view.js';

const MARGIN = { left: 52, right: 10, top: 6, bottom: 22 };
const FIRST = 12; // scatters shown at first
const NEAR = 14; // pixels from the mouse to a point

/** How strongly the result of each shown case depends on a draw: {c, rho, count}. */
function dependence(state, draw, cases) {
  const result = state.result;
  return cases.map((c) => {
    const isIn = (row) => state.sweep.caseOf[row] === c.index && state.isShown(row);
    const { rho, count } = draw.isWords
      ? groupEffect(draw.codes, result.numbers, result.order, (row) => draw.has(row) && isIn(row))
      : rankCorrelation(draw.numbers, draw.order, result.numbers, result.order, isIn);
    return { c, rho, count };
  });
}

/** The result against one draw, a point per run. */
class Scatter extends Panel {
  #points = null; // { rows, x, y }: pixels of the rows drawn
  #at = -1; // of the points in the order of x, by keys

  constructor(state, draw) {
    const notes = el('span.note');
    super(draw.name, 190, el('h3', { text: draw.title, title: draw.name }), el('span.push'), notes);
    this.root.classList.add('compact');
    this.state = state;
    this.draw_ = draw;
    this.notes = notes;
    this.mark = el('div.point-mark', { hidden: true, 'aria-hidden': 'true' });
    this.chosen = el('div.point-mark.chosen', { hidden: true, 'aria-hidden': 'true' });
    this.stage.append(this.mark, this.chosen);
    this.canvas.tabIndex = 0;
    this.canvas.addEventListener('pointermove', (event) => this.#point(this.#nearest(event)));
    this.canvas.addEventListener('pointerleave', () => this.#point(-1));
    this.canvas.addEventListener('blur', () => this.#point(-1));
    this.canvas.addEventListener('click', (event) => {
      const point = this.#nearest(event);
      if (point >= 0) state.select(this.#points.rows[point]);
    });
    this.canvas.addEventListener('keydown', (event) => this.#key(event));
  }

  /** The result or the rows are others. */
  update(view, effects) {
    this.view = view;
    this.effects = effects;
    this.strength = Math.max(0, ...effects.map(({ rho }) => Math.abs(rho)).filter((rho) => rho === rho));
    this.notes.replaceChildren(
      ...effects.slice(0, 4).map(({ c, rho, count: n }) => {
        const isChance = !(Math.abs(rho) > 2 / Math.sqrt(n));
        const sign = this.draw_.isWords ? 'η' : 'ρ';
        return el(
          'span',
          { class: isChance ? 'chance' : null, title: isChance ? 'not to be told from chance' : `rank correlation of ${c.name}` },
          this.state.cases.length > 1 ? swatch(c.index) : null,
          rho === rho ? `${sign} ${fixed(rho, 2)}` : `${sign} –`,
        );
      }),
    );
    const text = effects.map(({ c, rho }) => `${c.name} ${fixed(rho, 2)}`).join(', ');
    this.canvas.setAttribute(
      'aria-label',
      `${this.state.result.title} against ${this.draw_.title}; rank correlation ${text}. Arrow keys go from run to run, Enter selects.`,
    );
    this.#points = null;
    this.#at = -1;
    this.invalidate();
  }

  /** Where a row is on the x axis: its number, or the place of its word, the points of a word beside each other. */
  #abscissae() {
    const { draw_: draw, state } = this;
    if (!draw.isWords) {
      let [min, max] = [Infinity, -Infinity];
      for (const row of draw.order)
        if (state.isShown(row)) {
          min = Math.min(min, draw.placeOf(row));
          max = Math.max(max, draw.placeOf(row));
        }
      if (!(min <= max)) [min, max] = [0, 1];
      const margin = (max - min) * 0.03 || Math.abs(max) * 0.05 || 1;
      return { min: min - margin, max: max + margin, of: (row) => draw.placeOf(row), words: null };
    }
    const words = [...draw.words].sort((a, b) => a.localeCompare(b));
    const places = draw.words.map((word) => words.indexOf(word));
    const spread = (row) => (((row * 2654435761) >>> 0) / 2 ** 32 - 0.5) * 0.7;
    const of = (row) => (draw.has(row) ? places[draw.codes[row]] + spread(row) : NaN);
    return { min: -0.5, max: words.length - 0.5, of, words };
  }

  draw(painter, { width, height }) {
    const { state, view } = this;
    if (!view) return this.drawNothing(painter, width, height);
    const plot = { left: MARGIN.left, top: MARGIN.top, right: width - MARGIN.right, bottom: height - MARGIN.bottom };
    const x = this.#abscissae();
    const toX = (value) => plot.left + ((value - x.min) / (x.max - x.min)) * (plot.right - plot.left);
    const toY = (value) => plot.bottom - ((value - view.min) / (view.max - view.min)) * (plot.bottom - plot.top);
    this.#drawAxes(painter, x, plot, toX, toY);
    const { result, sweep } = state;
    const rows = [];
    for (let row = 0; row < sweep.rows; ++row) {
      const isPlaced = Number.isFinite(result.numbers[row]) || !isOk(sweep.statuses[row]);
      if (isPlaced && state.isShown(row) && Number.isFinite(x.of(row))) rows.push(row);
    }
    const points = { rows, x: new Float32Array(rows.length), y: new Float32Array(rows.length) };
    const { context } = painter;
    const size = rows.length > 3000 ? 2 : 3;
    context.globalAlpha = Math.min(0.9, Math.max(0.18, 30 / Math.sqrt(rows.length + 1)));
    for (const { c } of this.effects) {
      context.fillStyle = caseColour(c.index);
      rows.forEach((row, i) => {
        if (sweep.caseOf[row] !== c.index) return;
        points.x[i] = toX(x.of(row));
        const value = result.numbers[row];
        points.y[i] = Number.isNaN(value) ? plot.top : Math.min(plot.bottom, Math.max(plot.top, toY(value)));
        context.fillRect(points.x[i] - size / 2, points.y[i] - size / 2, size, size);
      });
    }
    context.globalAlpha = 1;
    context.fillStyle = colours.bad;
    rows.forEach((row, i) => {
      if (!isOk(sweep.statuses[row])) context.fillRect(points.x[i] - 2, points.y[i] - 2, 4, 4);
    });
    this.#points = points;
    this.root.dataset.points = String(rows.length);
    this.markChosen();
  }

  #drawAxes(painter, x, plot, toX, toY) {
    const { view, draw_: draw } = this;
    const { result } = this.state;
    for (const { value, text } of axisOf(result, view.min, view.max, 4)) {
      painter.rect(plot.left, toY(value), plot.right - plot.left, 1, colours.grid);
      painter.text(text, plot.left - 5, toY(value), { colour: colours.muted, align: 'right', size: 10 });
    }
    painter.rect(plot.left, plot.bottom, plot.right - plot.left, 1, colours.line);
    if (result.isShare && view.max >= 1)
      painter.segment(plot.left, toY(1), plot.right, toY(1), { colour: colours.bad, width: 1.2, dash: [5, 4] });
    const space = (plot.right - plot.left) / (x.words?.length ?? 1);
    if (!x.words) {
      for (const { value, text } of axisOf(draw, x.min, x.max, Math.max(2, (plot.right - plot.left) / 80)))
        painter.text(text, toX(value), plot.bottom + 12, { colour: colours.muted, align: 'center', size: 10 });
    } else if (space < 20)
      painter.text(`${count(x.words.length)} words`, (plot.left + plot.right) / 2, plot.bottom + 12, {
        colour: colours.muted,
        align: 'center',
        size: 10,
      });
    else
      x.words.forEach((word, i) =>
        painter.clip(toX(i) - space / 2 + 1, plot.bottom, space - 2, 30, () =>
          painter.text(word, toX(i), plot.bottom + 12, { colour: colours.muted, align: 'center', size: 10 }),
        ),
      );
  }

  #nearest({ offsetX, offsetY }) {
    if (!this.#points) return -1;
    const { x, y } = this.#points;
    let best = -1;
    let least = NEAR * NEAR;
    for (let i = 0; i < x.length; ++i) {
      const distance = (x[i] - offsetX) ** 2 + (y[i] - offsetY) ** 2;
      if (distance < least) {
        least = distance;
        best = i;
      }
    }
    return best;
  }

  /** Marks a point and tells its run; -1: none. */
  #point(point) {
    const tip = document.getElementById('tip');
    tip.hidden = point < 0;
    this.mark.hidden = point < 0;
    if (point < 0) return;
    const { rows, x, y } = this.#points;
    place(this.mark, x[point], y[point]);
    const { sweep, result } = this.state;
    const row = rows[point];
    const c = sweep.cases[sweep.caseOf[row]];
    tip.replaceChildren(
      el('div', swatch(c.index), ` run ${sweep.run[row]} · ${c.name} · ${prettyStatus(sweep.statuses[row])}`),
      el('div', { text: `${this.draw_.label} ${this.draw_.show(row, true)}` }),
      el('div', { text: `${result.label} ${result.show(row, true)}` }),
    );
    const box = this.stage.getBoundingClientRect();
    const left = box.left + x[point] + 12;
    const isWide = left + tip.offsetWidth > innerWidth - 8;
    tip.style.setProperty('left', `${isWide ? Math.max(4, left - 24 - tip.offsetWidth) : left}px`);
    tip.style.setProperty('top', `${Math.max(4, box.top + y[point] - 12 - tip.offsetHeight)}px`);
  }

  #key(event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key] ?? 0;
    if (!this.#points || this.#points.rows.length === 0) return;
    const order = (this.#points.byX ??= [...this.#points.x.keys()].sort((a, b) => this.#points.x[a] - this.#points.x[b]));
    if (step) {
      this.#at = Math.min(order.length - 1, Math.max(0, this.#at + step));
      this.#point(order[this.#at]);
    } else if (event.key === 'Enter' && this.#at >= 0) this.state.select(this.#points.rows[order[this.#at]]);
    else return;
    event.preventDefault();
  }

  /** Rings the selected run. */
  markChosen() {
    const point = this.#points && this.state.selected !== null ? this.#points.rows.indexOf(this.state.selected) : -1;
    this.chosen.hidden = point < 0;
    if (point >= 0) place(this.chosen, this.#points.x[point], this.#points.y[point]);
  }
}

function place(mark, x, y) {
  mark.style.setProperty('left', `${x}px`);
  mark.style.setProperty('top', `${y}px`);
}

/** All scatters, the strongest dependence first. */
export class Influence {
  constructor(host, state) {
    this.state = state;
    this.scatters = state.sweep.draws.map((draw) => new Scatter(state, draw));
    this.grid = el('div.multiples.scatters', ...this.scatters.map(({ root }) => root));
    this.title = el('h2');
    this.more = button({
      class: 'more',
      text: `Show all ${this.scatters.length}`,
      onclick: () => {
        this.isWhole = true;
        this.update();
      },
    });
    host.append(el('div.section-head', this.title, el('span.hint', { text: EXPLANATION })), this.grid, this.more);
    host.hidden = this.scatters.length === 0;
    state.on('select', () => this.scatters.forEach((scatter) => scatter.markChosen()));
    state.on('rows result', () => this.update());
    state.on('theme', () => this.scatters.forEach((scatter) => scatter.invalidate()));
    this.update();
  }

  update() {
    const { state } = this;
    if (!state.result) return;
    this.title.textContent = `What ${state.result.label} depends on`;
    const groups = rowsByCase(state, state.result);
    const view = viewOf(state.result, groups, 12);
    for (const scatter of this.scatters) scatter.update(view, dependence(state, scatter.draw_, state.cases));
    const sorted = [...this.scatters].sort((a, b) => b.strength - a.strength);
    const shown = this.isWhole ? sorted : sorted.slice(0, FIRST);
    this.grid.replaceChildren(...shown.map(({ root }) => root));
    this.more.hidden = shown.length === sorted.length;
  }
}

const EXPLANATION =
  'a point per run, failing ones red (at the top edge without a value) · ρ: Spearman’s rank correlation (η: the same for words), strongest first; ' +
  'grey: not to be told from chance (below 2/√n) · click a point to see its run';
