// A chart knows what to draw of a joint; where it is drawn (page, PNG, SVG) it does not know.
import { number, span } from './format.js';
import { caseColour, colours } from './theme.js';
import { isDense, same, trace, widen } from './traces.js';

/** Lines over time of one quantity of a joint, with its limits. */
export class LineChart {
  #limits = null;
  #extent = 1;

  constructor(state, quantity, joint) {
    this.state = state;
    this.quantity = quantity;
    this.id = quantity.id;
    this.joint = joint;
    /** Per case that leaves the plot: how far. */
    this.beyond = [];
  }

  get title() {
    return this.quantity.title;
  }
  get unit() {
    return this.quantity.units[this.state.run.joints[this.joint].linear ? 1 : 0];
  }
  get jointName() {
    return this.state.run.joints[this.joint].name;
  }

  /** To be called when the joint or the shown cases are others. */
  invalidate() {
    this.#limits = null;
  }

  get #kinds() {
    return this.quantity.kinds.filter(({ key }) => !this.state.hiddenKinds.has(key));
  }

  /** The series to draw: those of the first kind last, hence on top. */
  #lines() {
    const lines = [];
    for (const kind of [...this.#kinds].reverse())
      for (const c of this.state.cases) {
        const samples = kind.samples(c, this.joint);
        if (samples) lines.push({ c, kind, samples });
      }
    return lines;
  }

  /** The limits in force, equal ones of several cases once. */
  #limitLines() {
    if (this.#limits) return this.#limits;
    const limits = [];
    for (const side of this.quantity.limit ? ['lower', 'upper'] : [])
      for (const c of this.state.cases) {
        const value = c.samples(this.joint, `${this.quantity.limit}_${side}`);
        if (value === null) continue;
        const known = limits.find((limit) => limit.side === side && same(limit.value, value));
        if (known) known.cases.push(c);
        else limits.push({ side, value, cases: [c] });
      }
    this.#limits = limits;
    return limits;
  }

  /** The values to show for the times in view. */
  range({ min, max }) {
    const perCase = new Map();
    for (const { c, samples } of this.#lines()) {
      const range = perCase.get(c) ?? [Infinity, -Infinity];
      widen(range, samples, min, max);
      perCase.set(c, range);
    }
    const data = this.quantity.zero ? [0, 0] : [Infinity, -Infinity];
    for (const [low, high] of perCase.values()) {
      data[0] = Math.min(data[0], low);
      data[1] = Math.max(data[1], high);
    }
    const limits = [Infinity, -Infinity];
    for (const { value } of this.#limitLines()) {
      if (typeof value !== 'number') widen(limits, value, min, max);
      else if (Number.isFinite(value)) {
        limits[0] = Math.min(limits[0], value);
        limits[1] = Math.max(limits[1], value);
      }
    }
    const range = this.#fit(data, limits);
    this.#extent = range[1] - range[0];
    this.beyond = [...perCase].filter(([, [low, high]]) => low < range[0] || high > range[1]);
    return range;
  }

  #fit(data, limits) {
    const fit = this.state.fit.get(this.id) ?? 'auto';
    if (limits[0] > limits[1] || fit === 'data') return pad(data, 0.06);
    if (fit === 'limits') return pad(limits, 0.15);
    const within = Math.max(limits[1] - limits[0], 1e-9);
    const far = data[1] - limits[1] > within || limits[0] - data[0] > within; // it would flatten all the rest
    if (far) return pad(limits, 0.3);
    return pad([Math.min(data[0], limits[0]), Math.max(data[1], limits[1])], 0.06);
  }

  draw(painter, frame, palette = colours, sparse = false) {
    painter.clip(frame.left, frame.top, frame.width, frame.height, () => {
      const limits = this.#limitLines();
      for (const limit of limits) this.#drawLimit(painter, frame, limit, palette);
      for (const { c, kind, samples } of this.#lines()) {
        const dash = isDense(samples, frame) ? [] : kind.style.dash;
        const stepped = this.quantity.steps && !samples.pairs;
        painter.line((sink) => trace(sink, samples, frame, stepped), {
          ...kind.style,
          dash,
          colour: caseColour(c.index, palette),
        });
      }
      if (!sparse) for (const limit of limits) this.#drawLimitLabel(painter, frame, limit, palette);
    });
  }

  #limitColour({ cases }, palette) {
    return cases.length === this.state.cases.length ? palette.limit : caseColour(cases[0].index, palette);
  }

  #drawLimit(painter, frame, limit, palette) {
    const style = { colour: this.#limitColour(limit, palette), width: 1, dash: [5, 4] };
    painter.line((sink) => {
      if (typeof limit.value !== 'number') trace(sink, limit.value, frame);
      else {
        sink.moveTo(frame.left, frame.toY(limit.value));
        sink.lineTo(frame.left + frame.width, frame.toY(limit.value));
      }
    }, style);
  }

  #drawLimitLabel(painter, frame, limit, palette) {
    const { value, side, cases } = limit;
    const first = typeof value === 'number' ? value : value.y[0];
    const y = frame.toY(first);
    if (!(y >= frame.top && y <= frame.top + frame.height)) return;
    const below = side === 'upper' ? y + 12 < frame.top + frame.height : y - 12 < frame.top; // on the allowed side
    const text =
      typeof value === 'number'
        ? `${side} limit ${String(Number(value.toPrecision(4))).replace('-', '−')}`
        : `${side} limit`;
    const index = this.#limitLines()
      .filter((other) => other.side === side)
      .indexOf(limit);
    painter.text(text, frame.left + 6 + index * 110, below ? y + 8 : y - 8, {
      colour: cases.length === this.state.cases.length ? palette.muted : caseColour(cases[0].index, palette),
      size: 10,
      halo: palette.surface,
    });
  }

  /** Per shown case the values at a time, kind by kind. */
  values(time) {
    return this.state.cases.map((c) => ({
      c,
      values: this.#kinds.map((kind) => {
        const range = c.at(kind.samples(c, this.joint), time);
        return range ? span(range, this.#extent) : '–';
      }),
    }));
  }

  get kindCount() {
    return this.#kinds.length;
  }

  get valueTitle() {
    return this.#kinds.map(({ label }) => label).join(' | ');
  }

  get description() {
    return `${this.title} of ${this.jointName} over time`;
  }
}

/** How often a tick took how long, for all shown cases. */
export class HistogramChart {
  id = 'tick_time';
  title = 'Tick time';
  unit = 'ticks';
  beyond = [];

  constructor(state) {
    this.state = state;
  }

  invalidate() {}

  /** The times: from the first to the last that was counted in any case, on a logarithmic axis. */
  get domain() {
    let min = Infinity;
    let max = -Infinity;
    for (const {
      tickTime: { edges_us: edges, counts },
    } of this.state.run.cases)
      counts.forEach((count, i) => {
        if (count === 0) return;
        min = Math.min(min, edges[i]);
        max = Math.max(max, edges[i + 1]);
      });
    if (!(max > min)) return { min: 1, max: 1000 };
    return { min: Math.max(min, max * 1e-6), max: max * 1.05 };
  }

  get isEmpty() {
    return this.state.run.cases.every(({ tickTime }) => !tickTime.counts.some((count) => count > 0));
  }

  range() {
    let most = 10;
    for (const c of this.state.cases) for (const count of c.tickTime.counts) most = Math.max(most, count);
    return [0.7, most * 1.6];
  }

  draw(painter, frame, palette = colours) {
    const floor = frame.top + frame.height;
    const fill = this.state.cases.length <= 3 ? 0.1 : 0;
    painter.clip(frame.left, frame.top, frame.width, frame.height, () => {
      for (const c of this.state.cases) {
        const { edges_us: edges, counts } = c.tickTime;
        const x = (i) => frame.toX(Math.max(edges[i], frame.xMin * 1e-3));
        const y = (i) => (counts[i] > 0 ? frame.toY(counts[i]) : floor + 2);
        const colour = caseColour(c.index, palette);
        counts.forEach((count, i) => {
          if (count > 0 && fill) painter.rect(x(i), y(i), x(i + 1) - x(i), floor - y(i), colour, fill);
        });
        painter.line(
          (sink) => {
            sink.moveTo(x(0), floor + 2);
            counts.forEach((_, i) => {
              sink.lineTo(x(i), y(i));
              sink.lineTo(x(i + 1), y(i));
            });
            sink.lineTo(x(counts.length), floor + 2);
          },
          { colour, width: 1.3 },
        );
      }
    });
  }

  /** Per shown case the number of ticks in the class of a tick time. */
  values(time) {
    return this.state.cases.map((c) => {
      const { edges_us: edges, counts } = c.tickTime;
      const i = edges.findIndex((edge, k) => edge <= time && time < edges[k + 1]);
      return { c, values: [i < 0 ? '0' : number(counts[i], 6)] };
    });
  }

  valueTitle = 'ticks';
  description = 'How many ticks took how long';
  jointName = '';
}

function pad([low, high], share) {
  if (!(low <= high)) return [-1, 1];
  const margin = (high - low) * share || Math.abs(high) * 0.1 || 1;
  return [low - margin, high + margin];
}
