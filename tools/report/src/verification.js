// Did the real arm keep its limits? What `viable verify` found out: a verdict per joint and quantity, and why.
import { drawBeyond, drawLabel, LIMIT_STYLES, limitText, pad, traceLimit, withLabels } from './charts.js';
import { JUDGED } from './data.js';
import { button, caseStyle, el, lineSample, setPressed, swatch, table } from './dom.js';
import { amount, duration, number, seconds, span } from './format.js';
import { followPage, Panel } from './plots.js';
import { pretty } from './table.js';
import { caseColour, colours } from './theme.js';
import { envelope, trace, widen } from './traces.js';

/** A verdict is told by its word and its mark, and coloured besides. */
const VERDICTS = {
  held: { word: 'held', mark: '✓', tone: 'ok' },
  broken: { word: 'broken', mark: '✗', tone: 'bad' },
  cannot_tell: { word: 'cannot tell', mark: '?', tone: 'warn' },
  no_limit: { word: 'no limit', mark: '–', tone: 'none' },
};
const WORST_FIRST = ['broken', 'cannot_tell', 'held', 'no_limit'];
const verdictOf = ({ verdict }) => VERDICTS[verdict] ?? VERDICTS.cannot_tell;
function judgement(judged) {
  const { word, mark, tone } = verdictOf(judged);
  return el('span', { class: `judgement ${tone}` }, el('span.mark', { 'aria-hidden': 'true', text: mark }), word);
}

const TABLE = 'Verdict per joint and limit';
const RAW = { width: 1, alpha: 0.25 }; // pale: it may fill the whole plot
const MEAN = { width: 1.5 };
const BAND_ALPHA = 0.26;
const WIDE_OPEN = 3; // times the usual width of a band: so it is at the ends of the record and around gaps

const percent = (share) => `${Number((100 * share).toPrecision(2))} %`;
const isNumber = (value) => typeof value === 'number' && Number.isFinite(value);

/**
 * What part of a limit a value is: of half the range between a position's limits, else of the larger limit, and where there
 * is a limit on one side only of 1 at least; as `viable verify` prints it.
 */
function shareOf(value, { lower, upper }, quantity) {
  const limits = [lower, upper].filter(isNumber);
  if (limits.length === 0) return NaN;
  const isOpen = limits.length < 2;
  const size =
    quantity === 'position' && !isOpen ? (upper - lower) / 2 : Math.max(isOpen ? 1 : 0, ...limits.map(Math.abs));
  return size > 0 ? value / size : NaN;
}

/** An excess in percent of the limit, where that means something, else with its unit. */
function excessText(value, limit, quantity) {
  const share = shareOf(value, limit, quantity);
  return Number.isFinite(share) ? percent(share) : amount(value, pretty(limit.unit));
}

/** What stands below a verdict. */
function remark(limit, quantity) {
  const { verdict, broken, visible_excess: visible } = limit;
  if (verdict === 'no_limit') return '';
  if (broken) return `${seconds(broken.first_s)} s, by ≥ ${amount(broken.certain_excess, pretty(limit.unit))}`;
  if (!isNumber(visible)) return 'no excess would be seen';
  return `seen ${verdict === 'held' ? '' : 'only '}from ${excessText(visible, limit, quantity)} on`;
}

/** The same in whole sentences. */
function explain(limit, quantity) {
  const { verdict, broken, judged, visible_excess: visible } = limit;
  const unit = pretty(limit.unit);
  const both = (value) => `${amount(value, unit)} (${excessText(value, limit, quantity)} of the limit)`;
  const sentences = [];
  if (broken)
    sentences.push(
      `beyond the ${broken.side} limit from ${seconds(broken.first_s)} s on, for ${duration(1e6 * broken.duration_s)} in all`,
      `worst at ${seconds(broken.worst_s)} s: by ${both(broken.excess)}, at least by ${both(broken.certain_excess)}`,
    );
  else if (verdict !== 'no_limit')
    sentences.push(
      isNumber(visible)
        ? `${verdict === 'held' ? '' : 'only '}an excess from ${both(visible)} on would have been seen`
        : 'no excess of the length looked for would have been seen for certain',
    );
  if (judged < 0.995) sentences.push(`${percent(judged)} of the time could be judged`);
  return sentences.join('; ');
}

/** The estimate of a quantity of a joint with its band, before what plain differences of the readings give. */
class VerificationChart {
  id = 'verification';
  beyond = [];
  jointName = ''; // it stands in the title
  valueTitle = 'estimate | band | readings';
  kindCount = 6; // room for wide values
  #extent = 0;
  #usable = Infinity;

  constructor(state) {
    this.state = state;
  }

  /** What is to be drawn from now on. */
  select(c, joint, quantity) {
    this.c = c;
    this.joint = joint;
    this.quantity = quantity;
    const found = c.verification.joints[joint];
    this.limit = found.limits[quantity];
    this.curves = found.curves[quantity];
    const { y } = this.curves.band;
    const widths = [];
    for (let i = 0; i < y.length; i += 2) if (y[i + 1] >= y[i]) widths.push(y[i + 1] - y[i]);
    widths.sort((a, b) => a - b);
    this.#usable = WIDE_OPEN * (widths[widths.length >> 1] ?? Infinity);
  }

  get cases() {
    return [this.c];
  }
  get name() {
    return this.state.run.joints[this.joint].name;
  }
  get title() {
    return `${this.name}: ${this.quantity}`;
  }
  get unit() {
    return pretty(this.limit.unit);
  }
  get fileName() {
    return `${this.c.name} ${this.name} ${this.quantity} verification`;
  }
  get description() {
    return `Estimated ${this.quantity} of ${this.name} with its band over time: ${verdictOf(this.limit).word}`;
  }

  invalidate() {
    this.#extent = 0;
  }

  isShown(kind) {
    return !this.state.hiddenKinds.has(`verification_${kind}`);
  }

  get #limits() {
    return ['lower', 'upper']
      .map((side) => ({ side, value: this.limit[side] }))
      .filter(({ value }) => isNumber(value));
  }

  /** Of the band where it is not wide open, and of the limits; readings may leave the plot. */
  range({ min, max }) {
    const { x0, dx, y } = this.curves.band;
    const reach = [Infinity, -Infinity];
    const first = Math.max(0, Math.floor((min - x0) / dx / 2));
    const last = Math.min(y.length / 2 - 1, Math.ceil((max - x0) / dx / 2));
    for (let i = first; i <= last; ++i) {
      if (!(y[2 * i + 1] - y[2 * i] <= this.#usable)) continue;
      reach[0] = Math.min(reach[0], y[2 * i]);
      reach[1] = Math.max(reach[1], y[2 * i + 1]);
    }
    const limits = this.#limits.map(({ value }) => value);
    if (reach[0] > reach[1] && limits.length === 0) widen(reach, this.curves.mean, min, max);
    const all = [Math.min(reach[0], ...limits), Math.max(reach[1], ...limits)];
    const range = limits.length > 0 ? withLabels(all, [Math.min(...limits), Math.max(...limits)]) : pad(all, 0.06);
    this.#extent = range[1] - range[0];
    return range;
  }

  draw(painter, frame, palette = colours) {
    const colour = caseColour(this.c.index, palette);
    const { raw, mean, band } = this.curves;
    painter.clip(frame.left, frame.top, frame.width, frame.height, () => {
      if (this.isShown('raw')) painter.line((sink) => trace(sink, raw, frame), { colour: palette.muted, ...RAW });
      for (const limit of this.#limits) drawBeyond(painter, frame, limit, palette);
      if (this.isShown('band')) painter.area((sink) => envelope(sink, band, frame), { colour, alpha: BAND_ALPHA });
      for (const { value } of this.#limits)
        painter.line((sink) => traceLimit(sink, value, frame), { colour: palette.limit, ...LIMIT_STYLES.limit });
      if (this.isShown('mean')) painter.line((sink) => trace(sink, mean, frame), { colour, ...MEAN });
      for (const { side, value } of this.#limits)
        drawLabel(painter, frame, side, frame.toY(value), `${side} limit ${limitText(value, this.unit)}`, {
          colour: palette.muted,
          halo: palette.surface,
        });
      if (this.limit.broken) this.#drawBroken(painter, frame, palette);
    });
  }

  /** Where it lies farthest beyond its limit. */
  #drawBroken(painter, frame, palette) {
    const { side, worst_s: worst, excess, certain_excess: certain } = this.limit.broken;
    const sign = side === 'upper' ? 1 : -1;
    const x = frame.toX(worst);
    const y = frame.toY(this.limit[side] + sign * excess);
    const colour = palette.bad;
    painter.rect(x - 0.5, frame.top, 1, frame.height, colour, 0.5);
    const arrow = (sink) => {
      sink.moveTo(x - 4.5, y + sign * -9);
      sink.lineTo(x, y + sign * -2);
      sink.lineTo(x + 4.5, y + sign * -9);
    };
    painter.line(arrow, { colour: palette.surface, width: 5 });
    painter.line(arrow, { colour, width: 2.2 });
    const text = `${seconds(worst)} s: ${amount(certain, this.unit)} beyond, at least`;
    const width = painter.textWidth(text, 10, 600) + 8;
    const isRight = x + width < frame.left + frame.width;
    const start = isRight ? x + 6 : Math.max(frame.left + 2, x - width);
    painter.text(text, start, frame.toY(this.limit[side]) + sign * 9, {
      colour,
      size: 10,
      weight: 600,
      halo: palette.surface,
    });
  }

  values(time) {
    if (this.#extent === 0) this.range(this.state.view); // it has not been drawn yet
    const { x0, dx, y } = this.curves.mean;
    const bucket = Math.floor((time - x0) / dx / 2 + 0.25);
    const text = (kind, before) => {
      const { y: values } = this.curves[kind];
      const ends = [values[2 * bucket], values[2 * bucket + 1]];
      return `${before}${ends.every(isNumber) ? span(ends, this.#extent) : '–'}`;
    };
    const isInside = bucket >= 0 && bucket < y.length / 2;
    const kinds = [['mean', ''], ['band', 'band '], ['raw', 'readings ']].filter(([kind]) => this.isShown(kind));
    return [{ c: this.c, values: isInside ? kinds.map(([kind, before]) => text(kind, before)) : ['–'] }];
  }

  /** For figures that are saved. */
  legend(palette) {
    const colour = caseColour(this.c.index, palette);
    return [
      { kind: 'mean', name: `${this.c.name}, estimated`, colour, isLine: true },
      { kind: 'band', name: bandName(this.c.verification), colour, alpha: BAND_ALPHA, isLine: false },
      { kind: 'raw', name: rawName(this.quantity), colour: palette.muted, alpha: RAW.alpha, isLine: true },
    ].filter(({ kind }) => this.isShown(kind));
  }
}

const bandName = ({ confidence }) => `${percentExact(confidence)} band`;
const rawName = (quantity) => (quantity === 'position' ? 'readings' : 'differences of readings');
const percentExact = (share) => `${Number((100 * share).toPrecision(6))} %`;

/** The section of the page: cases, table of verdicts, and the plot of the one that is chosen. */
export class Verification {
  #panel = null;
  #chart;
  #cells = [];

  constructor(host, state) {
    this.host = host;
    this.state = state;
    this.cases = state.run.cases.filter((c) => c.verification);
    const notes = state.run.cases
      .filter((c) => c.verificationNote)
      .map((c) => el('p.hint', { role: 'note', text: c.verificationNote }));
    host.hidden = this.cases.length + notes.length === 0;
    if (this.cases.length === 0) {
      host.replaceChildren(...notes);
      return;
    }
    this.#chart = new VerificationChart(state);
    this.title = el('h2');
    this.intro = el('p.hint');
    this.table = el('div.scroll.card', { tabindex: 0, role: 'region', 'aria-label': TABLE });
    this.plot = el('div');
    this.facts = el('p.hint.facts');
    const head = el('div.group-head', this.title, this.#choice());
    host.replaceChildren(head, this.intro, ...notes, this.table, this.plot);
    this.#listen();
    this.#setCase(this.cases[0]);
  }

  #listen() {
    const { state } = this;
    this.observer = followPage(() => (this.#panel ? [this.#panel] : []), this.plot, state, 'view theme');
    state.on('kinds', () => {
      this.#updateHead();
      this.#panel?.invalidate();
    });
  }

  /** Each verified case with its verdict; a button, where there are several. */
  #choice() {
    this.choices = this.cases.map((c) => {
      const content = [swatch(c.index), `${c.name} `, judgement(c.verification)];
      if (this.cases.length === 1) return el('span.legend-item', { style: caseStyle(c.index) }, ...content);
      return button({ class: 'chip', onclick: () => this.#setCase(c) }, ...content);
    });
    return el('span.chips', { role: 'group', 'aria-label': 'Verified case' }, ...this.choices);
  }

  #setCase(c) {
    this.c = c;
    const { verification } = c;
    if (this.cases.length > 1)
      this.choices.forEach((chip, i) => setPressed(chip, this.cases[i] === c));
    const arm = verification.signal === 'nominal' ? 'nominal' : 'real';
    this.title.textContent = `Did the ${arm} arm keep its limits?`;
    this.intro.textContent =
      `Judged by its readings alone, at ${percentExact(verification.confidence)} confidence for the whole record of ` +
      `${number(verification.end_s - verification.begin_s, 3)} s: all joints, limits and times together. Looked for: an ` +
      `excess by ${percentExact(verification.excess)} of a limit, for ` +
      `${duration(1e6 * verification.excess_duration_s)}. Below a verdict: the smallest excess that would have been seen ` +
      '(of a position: in percent of half its range); of a broken limit when, and by how much for certain.';
    this.#fillTable(verification);
    const chosen = this.#worst(verification);
    this.#panel?.destroy();
    this.#panel = null;
    this.plot.replaceChildren();
    if (chosen) this.#select(...chosen);
  }

  /** The first of the worst verdicts that have something to draw: joint and quantity, or null. */
  #worst({ joints }) {
    for (const verdict of WORST_FIRST)
      for (const [j, { curves, limits }] of joints.entries())
        for (const quantity of JUDGED) if (curves && limits[quantity].verdict === verdict) return [j, quantity];
    return null;
  }

  #fillTable({ joints }) {
    this.#cells = [];
    const head = (text, title = null, number = false) =>
      el('th', { scope: 'col', class: number ? 'number' : null, text, title });
    const hasLeftOut = joints.some(({ left_out: count }) => count > 0);
    const rows = joints.map((joint, j) => {
      const name = this.state.run.joints[j].name;
      const unit = pretty(joint.unit);
      const value = (text) => el('td.number', { text });
      const resolved = isNumber(joint.window_s) ? duration(1e6 * joint.window_s) : '–';
      return el(
        'tr',
        el('th', { scope: 'row', title: name, text: name }),
        ...(joint.trouble
          ? [el('td.judgement.warn.trouble', { colspan: JUDGED.length, text: `? cannot tell: ${joint.trouble}` })]
          : JUDGED.map((quantity, i) => this.#cell(j, i, name, quantity, joint))),
        value(amount(joint.noise ?? NaN, unit)),
        value(amount(joint.quantum ?? NaN, unit)),
        value(resolved),
        hasLeftOut ? value(joint.left_out === null ? '–' : String(joint.left_out)) : null,
      );
    });
    const names = ['joint', ...JUDGED, 'noise', 'resolution', 'resolves', 'left out'];
    for (const row of rows)
      [...row.children].reduce((column, one) => {
        if (column > 0 && one.colSpan === 1) one.dataset.label = names[column];
        return column + one.colSpan;
      }, 0);
    const heads = [
      head('joint'),
      ...JUDGED.map((quantity) => head(quantity)),
      head('noise', 'Standard deviation of a reading', true),
      head('resolution', 'The steps in which readings come; –: none were found', true),
      head('resolves', 'Motion that is quicker is not resolved', true),
      hasLeftOut ? head('left out', 'Readings that were left out as outliers', true) : null,
    ];
    const onkeydown = (event) => this.#move(event);
    this.table.replaceChildren(table({ class: 'summary verification', role: 'grid', 'aria-label': TABLE, onkeydown }, heads, rows));
  }

  #cell(j, column, name, quantity, { limits, curves }) {
    const limit = limits[quantity];
    const below = remark(limit, quantity);
    const content = [judgement(limit), below ? el('span.remark', { text: below }) : null];
    const title = explain(limit, quantity);
    if (!curves) return el('td', { title: title || null }, ...content);
    const label = `${name}, ${quantity}: ${verdictOf(limit).word}${title ? `; ${title}` : ''}`;
    const onclick = () => this.#select(j, quantity);
    const cell = button({ class: 'verdict-cell', tabindex: -1, title: title || null, 'aria-label': label, onclick }, ...content);
    this.#cells.push({ button: cell, j, quantity, column });
    return el('td', cell);
  }

  /** Arrows go from cell to cell, and what they come to is shown. */
  #move(event) {
    const step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    const from = this.#cells.find((cell) => cell.button === event.target);
    if (!step || !from || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    const [down, right] = step;
    const inWay = this.#cells.filter(({ j, column }) =>
      down === 0 ? j === from.j && (column - from.column) * right > 0 : column === from.column && (j - from.j) * down > 0,
    );
    const to = down + right > 0 ? inWay[0] : inWay.at(-1); // joints in between may have no plot
    if (!to) return;
    this.#select(to.j, to.quantity);
    to.button.focus();
  }

  #select(joint, quantity) {
    for (const cell of this.#cells) {
      const isIt = cell.j === joint && cell.quantity === quantity;
      setPressed(cell.button, isIt);
      cell.button.tabIndex = isIt ? 0 : -1;
    }
    this.#chart.select(this.c, joint, quantity);
    if (this.#panel) this.#panel.invalidate();
    else {
      this.#panel = new Panel(this.state, this.#chart, { head: this.#head() });
      this.plot.replaceChildren(this.#panel.root);
      this.#panel.root.append(this.facts);
      this.observer.disconnect();
      this.observer.observe(this.#panel.root);
    }
    this.#updateHead();
    this.facts.textContent = this.#describe();
  }

  /** Which lines there are; each can be hidden. */
  #head() {
    const chip = (kind, sample) => {
      const label = el('span');
      const onclick = () => this.state.toggleKind(`verification_${kind}`);
      return { kind, chip: button({ class: 'chip', onclick }, sample, label), label };
    };
    this.chips = [
      chip('mean', lineSample(MEAN)),
      chip('band', el('span.band-sample', { 'aria-hidden': 'true' })),
      chip('raw', lineSample(RAW)),
    ];
    return el('span.chips', ...this.chips.map(({ chip }) => chip));
  }

  #updateHead() {
    if (!this.chips) return;
    const names = { mean: 'estimate', band: bandName(this.c.verification), raw: rawName(this.#chart.quantity) };
    for (const { kind, chip, label } of this.chips) {
      label.textContent = names[kind];
      setPressed(chip, this.#chart.isShown(kind));
    }
  }

  /** The verdict of the plot in words, and how far readings leave it. */
  #describe() {
    const { limit, quantity, curves } = this.#chart;
    const unit = pretty(limit.unit);
    const readings = [Infinity, -Infinity];
    widen(readings, curves.raw, -Infinity, Infinity);
    const { word } = verdictOf(limit);
    const found = explain(limit, quantity);
    const goes = (low, high, digits) => `from ${amount(low, unit, digits)} to ${amount(high, unit, digits)}`;
    return (
      `${word[0].toUpperCase()}${word.slice(1)}${found ? `: ${found}` : ''}. ` +
      `The estimate goes ${goes(limit.lowest, limit.highest, 4)}` +
      (quantity === 'position' || readings[0] > readings[1]
        ? '.'
        : `, plain differences of the readings ${goes(...readings, 3)}.`)
    );
  }
}
