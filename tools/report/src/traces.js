/** @typedef {import('./data.js').Samples} Samples */
/**
 * Where to draw, in CSS pixels, and how values become pixels.
 * @typedef {{left: number, top: number, width: number, height: number, xMin: number, xMax: number,
 *   toX: (x: number) => number, toY: (y: number) => number}} Frame
 */

/** The indices of the samples between two times and one beyond on each side. */
function inView({ x0, dx, y }, min, max) {
  return [Math.max(0, Math.floor((min - x0) / dx)), Math.min(y.length - 1, Math.ceil((max - x0) / dx))];
}

/** Adds the least and largest value between two times to a range. */
export function widen(range, samples, min, max) {
  const [first, last] = inView(samples, min, max);
  const { y } = samples;
  let [low, high] = range;
  for (let i = first; i <= last; ++i) {
    const value = y[i];
    if (value < low) low = value;
    if (value > high) high = value;
  }
  range[0] = low;
  range[1] = high;
}

/** True if so many samples are in view that a pixel column holds several. */
export function isDense(samples, { xMin, xMax, width }) {
  const [first, last] = inView(samples, xMin, xMax);
  return last - first > 3 * width;
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

/**
 * Draws the part of a series in view. Where a pixel column holds many samples, its first, least, largest and last are
 * drawn: the picture is the same, the work is bounded by the width. A NaN leaves a gap.
 */
export function trace(sink, samples, frame, stepped = false) {
  const [first, last] = inView(samples, frame.xMin, frame.xMax);
  const { x0, dx, y } = samples;
  const { toX } = frame;
  const low = frame.top - 20 * frame.height; // far outside is far enough, and endless lines are slow
  const high = frame.top + 21 * frame.height;
  const toY = (value) => Math.min(Math.max(frame.toY(value), low), high);

  if (!isDense(samples, frame)) {
    const valueAt = inOrder(samples);
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

  const perSample = toX(x0 + dx) - toX(x0);
  const start = toX(x0);
  let open = false;
  for (let i = first; i <= last;) {
    const column = Math.floor(start + i * perSample);
    let opened = NaN;
    let least = Infinity;
    let most = -Infinity;
    let final = NaN;
    for (; i <= last && Math.floor(start + i * perSample) === column; ++i) {
      const value = y[i];
      if (value !== value) continue;
      if (opened !== opened) opened = value;
      if (value < least) least = value;
      if (value > most) most = value;
      final = value;
    }
    if (opened !== opened) {
      open = false;
      continue;
    }
    const x = column + 0.5;
    if (open) sink.lineTo(x, toY(opened));
    else sink.moveTo(x, toY(opened));
    sink.lineTo(x, toY(least));
    sink.lineTo(x, toY(most));
    sink.lineTo(x, toY(final));
    open = true;
  }
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
