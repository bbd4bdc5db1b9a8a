/** @typedef {import('./data.js').Samples} Samples */
/**
 * Where to draw, in CSS pixels, and how values become pixels. `pixel`: how wide one of the screen's is (else 1).
 * @typedef {{left: number, top: number, width: number, height: number, xMin: number, xMax: number, pixel?: number,
 *   toX: (x: number) => number, toY: (y: number) => number}} Frame
 */

/** The indices of the samples between two times and one beyond on each side. */
function inView({ x0, dx, y }, min, max) {
  return [Math.max(0, Math.floor((min - x0) / dx)), Math.min(y.length - 1, Math.ceil((max - x0) / dx))];
}

/** Adds the least and largest value between two times to a range; returns how far the values go up and down in all. */
export function widen(range, samples, min, max) {
  const [first, last] = inView(samples, min, max);
  const { y } = samples;
  let [low, high] = range;
  let way = 0;
  let before = NaN;
  for (let i = first; i <= last; ++i) {
    const value = y[i];
    if (value < low) low = value;
    if (value > high) high = value;
    const step = Math.abs(value - before);
    if (step > 0) way += step;
    before = value;
  }
  range[0] = low;
  range[1] = high;
  return way;
}

/** True if so many samples are in view that a pixel column holds several. */
export function isDense(samples, { xMin, xMax, width, pixel = 1 }) {
  const [first, last] = inView(samples, xMin, xMax);
  return last - first > (3 * width) / pixel;
}

/** The value of a series that is in force at a time (of a bucket: the least), or undefined. */
function valueAt({ x0, dx, y, pairs }, time) {
  const at = (time - x0) / dx;
  return y[pairs ? 2 * Math.floor(at / 2 + 0.25) : Math.floor(at)];
}

/**
 * Lines that lie on each other take turns in being seen: none hides the others. Per line the times at which it is to be
 * drawn, as [from, to] pairs.
 * @param {Samples[]} lines in the order of drawing
 */
export function takeTurns(lines, frame) {
  const CELL = 20; // pixels of a turn
  const NEAR = 1.2; // pixels between lines that cannot be told apart
  const cell = ((frame.xMax - frame.xMin) / frame.width) * CELL;
  const parts = lines.map(() => []);
  for (let index = Math.floor(frame.xMin / cell); index * cell < frame.xMax; ++index) {
    const probes = [0.1, 0.5, 0.9].map((share) => (index + share) * cell);
    const heights = lines.map((samples) => probes.map((time) => frame.toY(valueAt(samples, time))));
    const groups = [];
    heights.forEach((own, i) => {
      const group = groups.find(([first]) => own.every((y, k) => Math.abs(y - heights[first][k]) < NEAR));
      if (group) group.push(i);
      else groups.push([i]);
    });
    for (const group of groups)
      group.forEach((line, i) => {
        if (((index % group.length) + group.length) % group.length !== i) return;
        const last = parts[line].at(-1);
        if (last && last[1] === index * cell) last[1] = (index + 1) * cell;
        else parts[line].push([index * cell, (index + 1) * cell]);
      });
  }
  return parts;
}

/**
 * The values in the order in which a smooth motion takes them: of a bucket that holds least and largest value, the
 * largest first where the buckets around it fall. (When in its bucket each was is not known.)
 */
function inOrder({ y, pairs }) {
  if (!pairs) return (i) => y[i];
  const last = y.length - 2;
  return (i) => {
    const bucket = i & ~1;
    const before = Math.max(0, bucket - 2);
    const after = Math.min(last, bucket + 2);
    return y[y[after] + y[after + 1] < y[before] + y[before + 1] ? i ^ 1 : i];
  };
}

/** Where a value is drawn: far outside is far enough, and endless lines are slow. */
const nearPlot = (value, { top, height, toY }) => Math.min(Math.max(toY(value), top - 20 * height), top + 21 * height);

/**
 * Draws the part of a series in view. Where a pixel column holds many samples, a line from its first to its last is
 * drawn, by its least and largest if these are further: the picture is the same, the work is bounded by the width. A
 * NaN leaves a gap.
 */
export function trace(sink, samples, frame, stepped = false) {
  const [first, last] = inView(samples, frame.xMin, frame.xMax);
  const { x0, dx, y } = samples;
  const { toX } = frame;
  const toY = (value) => nearPlot(value, frame);
  const valueAt = inOrder(samples);

  if (!isDense(samples, frame)) {
    let open = false;
    let before = 0;
    for (let i = first; i <= last; ++i) {
      const value = valueAt(i);
      if (value !== value) {
        open = false;
        continue;
      }
      const x = toX(x0 + i * dx);
      const at = toY(value);
      if (!open) sink.moveTo(x, at);
      else if (stepped) sink.lineTo(x, before);
      sink.lineTo(x, at);
      if (stepped && i === last) sink.lineTo(toX(x0 + (i + 1) * dx), at);
      open = true;
      before = at;
    }
    return;
  }

  const { pixel = 1 } = frame;
  const perSample = (toX(x0 + dx) - toX(x0)) / pixel; // in columns
  const start = toX(x0) / pixel;
  let open = false;
  for (let i = first; i <= last;) {
    const column = Math.floor(start + i * perSample);
    let opened = -1;
    let final = -1;
    let least = Infinity;
    let most = -Infinity;
    for (; i <= last && Math.floor(start + i * perSample) === column; ++i) {
      const value = y[i];
      if (value !== value) continue;
      if (opened < 0) opened = i;
      if (value < least) least = value;
      if (value > most) most = value;
      final = i;
    }
    if (opened < 0) {
      open = false;
      continue;
    }
    const from = toY(valueAt(opened));
    const to = toY(valueAt(final));
    const x = column * pixel;
    if (open) sink.lineTo(x, from);
    else sink.moveTo(x, from);
    const top = toY(most);
    const bottom = toY(least);
    if (Math.min(from, to) - top > 0.5 || bottom - Math.max(from, to) > 0.5) {
      // it goes further than from one end to the other
      sink.lineTo(x + 0.5 * pixel, from > to ? bottom : top);
      sink.lineTo(x + 0.5 * pixel, from > to ? top : bottom);
    }
    sink.lineTo(x + pixel, to);
    open = true;
  }
}

/** Goes round all that is at most `reach` from a series in view; a NaN leaves a gap. */
export function band(sink, samples, reach, frame) {
  const { x0, dx, y } = samples;
  goRound(sink, inView(samples, frame.xMin, frame.xMax), (i) => [x0 + i * dx, y[i] - reach, y[i] + reach], frame);
}

/** Goes round all that is between the least and the largest values of a series of pairs. */
export function envelope(sink, samples, frame) {
  const { x0, dx, y } = samples;
  const buckets = inView(samples, frame.xMin, frame.xMax).map((i) => i >> 1);
  goRound(sink, buckets, (i) => [x0 + (2 * i + 0.5) * dx, y[2 * i], y[2 * i + 1]], frame);
}

/** Goes round what is between two lines; `at` gives time, lower and upper value of each index from first to last. */
function goRound(sink, [first, last], at, frame) {
  const { pixel = 1 } = frame;
  let edge = []; // per pixel column, or per sample if these are fewer: x, lower and upper end
  const close = () => {
    edge.forEach(([x, , upper], i) => (i === 0 ? sink.moveTo(x, upper) : sink.lineTo(x, upper)));
    for (const [x, lower] of edge.reverse()) sink.lineTo(x, lower);
    edge = [];
  };
  for (let i = first; i <= last; ++i) {
    const [time, least, most] = at(i);
    if (least !== least || most !== most) {
      close();
      continue;
    }
    const x = frame.toX(time);
    const lower = nearPlot(least, frame);
    const upper = nearPlot(most, frame);
    const column = edge.at(-1);
    if (column && x - column[0] < pixel) {
      column[1] = Math.max(column[1], lower);
      column[2] = Math.min(column[2], upper);
    } else edge.push([x, lower, upper]);
  }
  close();
}

/** True if two series (or constants) are the same. */
export function same(a, b) {
  if (a === b) return true;
  if (a === null || b === null || typeof a === 'number' || typeof b === 'number') return false;
  if (a.x0 !== b.x0 || a.dx !== b.dx || a.y.length !== b.y.length) return false;
  for (let i = 0; i < a.y.length; ++i)
    if (a.y[i] !== b.y[i] && !(Number.isNaN(a.y[i]) && Number.isNaN(b.y[i]))) return false;
  return true;
}
