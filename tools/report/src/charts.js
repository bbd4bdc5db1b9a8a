// A chart knows what to draw of a joint; where it is drawn (page, PNG, SVG) it does not know.
import { duration, span } from './format.js';
import { bandOf } from './quantities.js';
import { caseColour, caseDash, colours } from './theme.js';
import { Lanes } from './timeline.js';
import { band, isDense, same, takeTurns, trace, widen } from './traces.js';

const LABEL_HEIGHT = 14; // of the text at a limit

/** How limits are drawn: in force for the nominal arm, those of the real joint, and how large an error may be. */
export const LIMIT_STYLES = {
  limit: { width: 1.2, dash: [5, 4] },
  real: { width: 1.8 },
  bound: { width: 1.2, dash: [5, 4] },
  trip: { width: 1, dash: [1, 3] },
};
const BEYOND = { limit: 'real', bound: 'trip' }; // which kind of limit lies farther out
const LIMIT_NAMES = {
  limit: (side, { limitName }) => limitName ?? `${side} limit`,
  real: (side) => `${side} limit of the real joint`,
  bound: () => 'bound',
  trip: () => 'trips at',
};

/** Lines over time of one quantity of a joint, with its limits. */
export class LineChart {
  #limits = null;
  #extent = 0;
  #ways = new Map(); // case to how far its line goes up and down

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
    return this.quantity.ofArm ? '' : this.state.run.joints[this.joint].name;
  }

  /** To be called when the joint or the shown cases are others. */
  invalidate() {
    this.#limits = null;
    this.#extent = 0;
  }

  get #kinds() {
    return this.quantity.kinds.filter(({ key }) => !this.state.hiddenKinds.has(key));
  }

  /**
   * The series to draw, the last on top: those of the first kind, of these what the reader points at, else the calmest,
   * of equally calm ones what guarantees to keep the limits.
   */
  #lines() {
    const calmness = (c) => -Math.round(Math.log2((this.#ways.get(c) ?? 0) + 1e-9));
    const rank = (c) => [c.index === this.state.focus, calmness(c), c.guarantees];
    const cases = this.state.cases
      .map((c) => ({ c, rank: rank(c) }))
      .sort((a, b) => a.rank.map((value, i) => value - b.rank[i]).find((difference) => difference !== 0) ?? 0);
    const lines = [];
    for (const kind of [...this.#kinds].reverse())
      for (const { c } of cases) {
        const samples = kind.samples(c, this.joint);
        if (samples) lines.push({ c, kind, samples });
      }
    return lines;
  }

  /** What bounds the values of a case: the limits in force, those of the real joint, how large an error may be. */
  *#limitsOf(c) {
    const { limit, realLimit, bound, trip, isError, inThousandths } = this.quantity;
    const read = (key) => (inThousandths ? c.thousandths(this.joint, key) : c.samples(this.joint, key));
    for (const [side, sign] of [['lower', -1], ['upper', 1]]) {
      if (limit) yield { side, value: read(`${limit}_${side}`), kind: 'limit' };
      if (realLimit) yield { side, value: c.samples(this.joint, `${realLimit}_${side}`), kind: 'real' };
      const reach = isError ? c.thousandths(this.joint, bound) : null;
      if (reach !== null) yield { side, value: sign * reach, kind: 'bound' };
      const measured = trip ? c.thousandths(this.joint, trip) : null;
      if (measured !== null) yield { side, value: sign * measured, kind: 'trip' };
    }
  }

  /** The limits, equal ones of several cases once. */
  #limitLines() {
    if (this.#limits) return this.#limits;
    const limits = [];
    for (const c of this.state.cases)
      for (const { side, value, kind } of this.#limitsOf(c)) {
        if (value === null) continue;
        const known = limits.find((one) => one.side === side && one.kind === kind && same(one.value, value));
        if (known) known.cases.push(c);
        else limits.push({ side, value, kind, cases: [c] });
      }
    this.#limits = limits;
    return limits;
  }

  /** The values to show for the times in view. */
  range({ min, max }) {
    const perCase = new Map();
    this.#ways.clear();
    for (const kind of this.#kinds)
      for (const c of this.state.cases) {
        const samples = kind.samples(c, this.joint);
        if (!samples) continue;
        const range = perCase.get(c) ?? [Infinity, -Infinity];
        const way = widen(range, samples, min, max);
        perCase.set(c, range);
        if (!this.#ways.has(c)) this.#ways.set(c, way);
      }
    const ranges = [...perCase.values()];
    const data = [Math.min(...ranges.map(([low]) => low)), Math.max(...ranges.map(([, high]) => high))];
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

  /** Limits and data; where data far beyond would flatten all the rest, the limits and what is near them. */
  #fit(values, limits) {
    const data = this.quantity.zero ? [Math.min(0, values[0]), Math.max(0, values[1])] : values;
    if (limits[0] > limits[1] || this.state.fitted.has(this.id)) return pad(data, 0.06);
    if (limits[0] === limits[1]) return this.#fitToOne(values, data, limits[0]);
    const within = Math.max(limits[1] - limits[0], 1e-9);
    const far = data[1] - limits[1] > within || limits[0] - data[0] > within;
    if (far) return pad(limits, 0.3);
    return withLabels([Math.min(data[0], limits[0]), Math.max(data[1], limits[1])], limits);
  }

  /** A limit on one side, and the data that is several times as far from it as zero at most, if there is any. */
  #fitToOne(values, data, limit) {
    const within = 8 * Math.abs(limit) || Infinity;
    const low = values[1] < limit - within ? data[0] : Math.max(data[0], limit - within);
    const high = values[0] > limit + within ? data[1] : Math.min(data[1], limit + within);
    return withLabels([Math.min(low, limit), Math.max(high, limit)], [limit, limit]);
  }

  draw(painter, frame, palette = colours, sparse = false) {
    painter.clip(frame.left, frame.top, frame.width, frame.height, () => {
      const limits = this.#limitLines();
      for (const limit of limits) this.#drawForbidden(painter, frame, limit, palette);
      for (const limit of limits) this.#drawLimit(painter, frame, limit, palette);
      this.#drawBands(painter, frame, palette);
      this.#drawLines(painter, frame, palette);
      if (sparse) return;
      for (const limit of limits) this.#drawLimitLabel(painter, frame, limit, palette);
      this.state.cases.filter((c) => c.stop).forEach((c, i) => this.#drawStop(painter, frame, c, i, palette));
    });
  }

  /** Where the real joint may be, around the nominal lines; only beside the real lines. */
  #drawBands(painter, frame, palette) {
    const { bound, isError, kinds } = this.quantity;
    const [nominal, real] = kinds;
    const hidden = (key) => this.state.hiddenKinds.has(key);
    if (!bound || isError || !real || hidden(real.key) || hidden(bandOf(this.quantity))) return;
    for (const c of this.state.cases) {
      const reach = c.samples(this.joint, bound);
      const samples = nominal.samples(c, this.joint);
      if (reach === null || !samples) continue;
      const colour = caseColour(c.index, palette);
      painter.area((sink) => band(sink, samples, reach, frame), { colour, alpha: 0.16 });
    }
  }

  #drawLines(painter, frame, palette) {
    const isCalm = ({ c }) => ((this.#ways.get(c) ?? 0) / this.#extent) * frame.height < 8 * frame.width;
    const lines = this.#lines();
    const inTurns = lines.filter(({ c, kind }) => kind === this.#kinds[0] && c.index !== this.state.focus);
    const parts = takeTurns(inTurns.map(({ samples }) => samples), frame);
    for (const line of lines) {
      const turn = inTurns.indexOf(line);
      const draw = (part) => this.#drawLine(painter, part, line, isCalm(line), palette);
      if (turn < 0 || parts[turn].length === 1) draw(frame);
      else
        for (const [from, to] of parts[turn]) {
          const x = frame.toX(from);
          const part = { ...frame, xMin: Math.max(from, frame.xMin), xMax: Math.min(to, frame.xMax) };
          painter.clip(x, frame.top, frame.toX(to) - x, frame.height, () => draw(part));
        }
    }
  }

  #drawLine(painter, frame, { c, kind, samples }, isCalm, palette) {
    const dash = isCalm || !isDense(samples, frame) ? (kind.style.dash ?? caseDash(c.index)) : [];
    const stepped = this.quantity.steps && !samples.pairs;
    const { focus } = this.state;
    const alpha = (kind.style.alpha ?? 1) * (focus === null || focus === c.index ? 1 : 0.2);
    const draw = (part, style = {}) =>
      painter.line((sink) => trace(sink, samples, part, stepped), {
        ...kind.style,
        dash,
        alpha,
        colour: caseColour(c.index, palette),
        ...style,
      });
    const stop = c.stop?.time_s ?? Infinity;
    if (stop > frame.xMin) draw({ ...frame, xMax: Math.min(frame.xMax, stop) });
    if (stop < frame.xMax) draw({ ...frame, xMin: Math.max(frame.xMin, stop) }, { alpha: alpha * 0.5, dash: [2, 3] });
  }

  /** A cross and a line where a case was stopped; what comes after is not the filter's. */
  #drawStop(painter, frame, c, row, palette) {
    const kind = this.#kinds[0];
    const value = kind ? c.at(kind.samples(c, this.joint), Math.min(c.stop.time_s, c.end - c.step / 2)) : null;
    if (!value) return;
    const x = frame.toX(c.stop.time_s);
    const bottom = frame.top + frame.height;
    const y = Math.min(Math.max(frame.toY(value[0]), frame.top + 6), bottom - 6);
    painter.rect(x - 0.5, frame.top, 1, frame.height, caseColour(c.index, palette), 0.5);
    const cross = (sink) => {
      for (const sign of [-1, 1]) {
        sink.moveTo(x - 4.5, y - sign * 4.5);
        sink.lineTo(x + 4.5, y + sign * 4.5);
      }
    };
    painter.line(cross, { colour: palette.surface, width: 5 });
    painter.line(cross, { colour: caseColour(c.index, palette), width: 2.2 });
    const isLeft = x < frame.left + 0.7 * frame.width;
    painter.text(`${c.name} stops`, isLeft ? x + 5 : x - 5, bottom - 9 - 13 * row, {
      colour: caseColour(c.index, palette),
      size: 10,
      weight: 600,
      align: isLeft ? 'left' : 'right',
      halo: palette.surface,
    });
  }

  #isCommon({ cases }) {
    return cases.length === this.state.cases.length;
  }

  #limitColour(limit, palette) {
    if (!this.#isCommon(limit)) return caseColour(limit.cases[0].index, palette);
    return limit.kind === 'real' ? palette.bad : palette.limit;
  }

  /** Where no case may be is tinted. */
  #drawForbidden(painter, frame, limit, palette) {
    if (!this.#isCommon(limit)) return;
    if (typeof limit.value !== 'number' && limit.value.y.some(Number.isNaN)) return; // not everywhere a limit
    drawBeyond(painter, frame, limit, palette);
  }

  #drawLimit(painter, frame, limit, palette) {
    const style = { colour: this.#limitColour(limit, palette), ...LIMIT_STYLES[limit.kind] };
    painter.line((sink) => traceLimit(sink, limit.value, frame), style);
  }

  /** At the right end, beyond the limit where there is room: there is the least to cover. */
  #drawLimitLabel(painter, frame, limit, palette) {
    const { value, side, kind } = limit;
    const isNumber = typeof value === 'number';
    const y = frame.toY(isNumber ? value : value.y.at(-1));
    const bottom = frame.top + frame.height;
    if (!(y >= frame.top && y <= bottom)) return;
    const own = this.#limitLines().filter((other) => other.side === side);
    const isInner = own.some((other) => other.kind === BEYOND[kind]); // beyond it there is another line
    const index = own.filter((other) => other.kind === kind).indexOf(limit);
    const name = LIMIT_NAMES[kind](side, this.quantity);
    drawLabel(painter, frame, side, y, isNumber ? `${name} ${limitText(value, this.unit)}` : name, {
      colour: this.#isCommon(limit) && kind !== 'real' ? palette.muted : this.#limitColour(limit, palette),
      halo: palette.surface,
      isInner,
      shift: index * 140,
    });
  }

  /** Per shown case the values at a time, kind by kind. */
  values(time) {
    if (this.#extent === 0) this.range(this.state.view); // it has not been drawn yet
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
    return `${this.title}${this.jointName ? ` of ${this.jointName}` : ''} over time`;
  }
}

/** What is counted of a tick's times. */
export const TIMES = [
  { id: 'tick_time', title: 'Tick time', description: 'How many ticks took how long', of: ({ tickTime }) => tickTime },
  {
    id: 'jitter',
    title: 'Jitter of the ticks',
    description: 'How many ticks began how much sooner or later than one period after the last tick',
    of: ({ jitter }) => jitter,
  },
];

/** How often one of a tick's TIMES was how long: a row of bars per case, on a logarithmic scale as high as wide. */
export class HistogramChart extends Lanes {
  hint = 'height: ticks, logarithmic';
  #of;

  constructor(state, { id, title, description, of }) {
    super(state);
    this.description = description;
    this.id = id;
    this.title = title;
    this.#of = of;
  }

  get height() {
    const { length } = this.state.cases;
    return Math.max(1, length) * (length <= 2 ? 56 : length <= 5 ? 34 : 24);
  }

  /** The period of the ticks [µs]: what takes longer would be late on a real robot. */
  get #period() {
    return 1e6 * Math.min(...this.state.run.cases.map((c) => c.tick));
  }

  /** The times: from the first to the last that was counted in any case, and the period. */
  get domain() {
    let min = Infinity;
    let max = -Infinity;
    for (const c of this.state.run.cases) {
      const { edges_us: edges, counts } = this.#of(c);
      counts.forEach((count, i) => {
        if (count === 0) return;
        min = Math.min(min, edges[i]);
        max = Math.max(max, edges[i + 1]);
      });
    }
    if (!(max > min)) return { min: 1, max: 1000 };
    return { min: Math.max(min, max * 1e-6), max: Math.max(max, this.#period * 1.2) * 1.05 };
  }

  get isEmpty() {
    return this.state.run.cases.every((c) => !this.#of(c).counts.some((count) => count > 0));
  }

  draw(painter, frame, palette = colours, sparse = false) {
    const { cases } = this.state;
    const most = Math.max(1, ...cases.flatMap((c) => this.#of(c).counts));
    this.drawLanes(painter, frame, palette, sparse, (c, top, height) => {
      const { edges_us: edges, counts } = this.#of(c);
      const x = (i) => frame.toX(Math.max(edges[i], frame.xMin * 1e-3));
      const colour = caseColour(c.index, palette);
      counts.forEach((count, i) => {
        if (count === 0) return;
        const size = (Math.log10(2 * count) / Math.log10(2 * most)) * (height - 4);
        painter.rect(x(i) + 0.5, top + height - 1 - size, Math.max(1, x(i + 1) - x(i) - 1), size, colour);
      });
    });
    const height = frame.height / Math.max(1, cases.length);
    const period = frame.toX(this.#period);
    const style = { colour: palette.limit, ...LIMIT_STYLES.limit };
    painter.segment(period, frame.top, period, frame.top + frame.height, style);
    cases.forEach((c, lane) => {
      const { late } = this.#of(c);
      const text = `${late || 'none'} over ${duration(this.#period)}`;
      const isRight = period < frame.left + frame.width - painter.textWidth(text, 10) - 8;
      painter.text(text, isRight ? period + 5 : period - 5, frame.top + lane * height + 9, {
        colour: late > 0 ? palette.text : palette.muted,
        size: 10,
        align: isRight ? 'left' : 'right',
        halo: palette.surface,
      });
    });
  }

  drawEdge(painter, frame, palette, top, height) {
    painter.rect(frame.left, top + height - 1, frame.width, 1, palette.line);
  }

  /** Per shown case the number of ticks in the class of a tick time. */
  values(time) {
    return this.state.cases.map((c) => {
      const { edges_us: edges, counts } = this.#of(c);
      const i = edges.findIndex((edge, k) => edge <= time && time < edges[k + 1]);
      return { c, values: [i < 0 ? '0' : `${counts[i]} at ${duration(edges[i])} to ${duration(edges[i + 1])}`] };
    });
  }

  valueTitle = 'ticks';
  jointName = '';
}

/** A limit as its label tells it. */
export const limitText = (value, unit) => `${String(Number(value.toPrecision(4))).replace('-', '−')} ${unit}`;

/** The line of a limit: a number, or samples. */
export function traceLimit(sink, value, frame) {
  if (typeof value !== 'number') return trace(sink, value, frame);
  sink.moveTo(frame.left, frame.toY(value));
  sink.lineTo(frame.left + frame.width, frame.toY(value));
}

/** Tints what is beyond a limit. */
export function drawBeyond(painter, frame, { side, value }, palette) {
  const edge = side === 'upper' ? frame.top : frame.top + frame.height;
  painter.area(
    (sink) => {
      traceLimit(sink, value, frame);
      sink.lineTo(frame.left + frame.width, edge);
      sink.lineTo(frame.left, edge);
    },
    { colour: palette.bad, alpha: palette.forbidden },
  );
}

/** The label of a limit that is at y: at the right end, beyond it where there is room and nothing else (`isInner`). */
export function drawLabel(painter, frame, side, y, text, { colour, halo, isInner = false, shift = 0 }) {
  const outward = side === 'upper' ? -1 : 1;
  const room = isInner ? 0 : side === 'upper' ? y - frame.top : frame.top + frame.height - y;
  const x = frame.left + frame.width - 5 - shift;
  painter.text(text, x, y + (room >= LABEL_HEIGHT ? 1 : -1) * outward * 7.5, { colour, size: 10, align: 'right', halo });
}

/** Room for what is to be seen, and for the text beyond limits. */
export function withLabels(reach, limits) {
  const [low, high] = pad(reach, 0.06);
  const margin = 0.15 * (reach[1] - reach[0]);
  return [Math.min(low, limits[0] - margin), Math.max(high, limits[1] + margin)];
}

export function pad([low, high], share) {
  if (!(low <= high)) return [-1, 1];
  const margin = (high - low) * share || Math.abs(high) * 0.1 || 1;
  return [low - margin, high + margin];
}
