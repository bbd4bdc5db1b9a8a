const MINUS = '\u2212';

/** A number for people: `digits` significant digits, a true minus sign, no needless exponent. */
export function number(value, digits = 4) {
  if (!Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  if (size === 0) return '0';
  let text;
  if (size >= 1e6 || size < 1e-4) text = value.toExponential(Math.max(0, digits - 2)).replace('e+', 'e');
  else if (size >= 10 ** digits) text = value.toFixed(0);
  else text = value.toPrecision(digits);
  return text.replaceAll('-', MINUS);
}

/** A number with a given number of decimals; zero has no sign. */
export function fixed(value, decimals) {
  if (!Number.isFinite(value)) return '–';
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? text.replace('-', '') : text.replace('-', MINUS);
}

/** Least and largest value, as fine as a plot of `extent` can show; one number where they look the same in it. */
export function span([low, high], extent) {
  const decimals = Math.min(9, Math.max(0, 3 - Math.floor(Math.log10(extent))));
  const look = high - low < extent / 200 ? [(low + high) / 2, (low + high) / 2] : [low, high];
  const [a, b] = look.map((value) => fixed(value, decimals));
  return a === b ? a : `${a}\u2009…\u2009${b}`;
}

/** A value with its unit, where that reads better in thousandths, millionths, ... of the unit: 0.21 µrad. */
export function amount(value, unit, digits = 2) {
  if (!Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  const [prefix, factor] =
    size >= 0.01 || size === 0 ? ['', 1] : size >= 1e-5 ? ['m', 1e3] : size >= 1e-8 ? ['µ', 1e6] : ['n', 1e9];
  return `${number(value * factor, digits)} ${prefix}${unit}`;
}

/** How many decimals multiples of a number need: 1 for 2.5, 2 for 0.25. */
function decimalsOf(increment) {
  const least = Math.max(0, -Math.floor(Math.log10(increment) + 1e-9));
  const shifted = increment * 10 ** least;
  return Math.abs(shifted - Math.round(shifted)) < 1e-6 ? least : least + 1;
}

/** The value of an axis tick; `increment` is the distance of the ticks. */
export function tick(value, increment) {
  if (Math.abs(value) < increment * 1e-6) return '0';
  const size = Math.abs(value);
  if (size >= 1e4) return `${(value / 1e3).toFixed(decimalsOf(increment / 1e3))}k`.replace('-', MINUS);
  if (increment < 1e-4) return value.toExponential(1).replaceAll('-', MINUS);
  return value.toFixed(decimalsOf(increment)).replace('-', MINUS);
}

/** A duration in microseconds, in the unit that suits it: 20 µs, 5 ms, 1 s. */
export function duration(us) {
  const [unit, size] = us < 999.5 ? ['µs', 1] : us < 999.5e3 ? ['ms', 1e3] : ['s', 1e6];
  return `${Number((us / size).toPrecision(3))} ${unit}`;
}

/** A round step of about (max - min) / count: one of the factors times a power of ten. */
export function roundStep(min, max, count, factors) {
  const rough = (max - min) / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(rough));
  return factors.map((factor) => factor * power).find((step) => step >= rough * 0.999);
}

/** Round numbers between min and max, about `count` of them. */
export function ticks(min, max, count) {
  const increment = roundStep(min, max, count, [1, 2, 5, 10]);
  const values = [];
  for (let i = Math.ceil(min / increment - 1e-9); i * increment <= max + increment * 1e-9; ++i)
    values.push(i * increment);
  return { values, increment };
}

/** Round numbers between min and max of a logarithmic axis; of few decades 2 and 5, too, but with `onlyPowers`. */
export function powers(min, max, onlyPowers = false) {
  const values = [];
  for (let power = Math.floor(Math.log10(min)); power <= Math.log10(max); ++power)
    for (const factor of Math.log10(max / min) < 2.7 && !onlyPowers ? [1, 2, 5] : [1])
      if (factor * 10 ** power >= min && factor * 10 ** power <= max) values.push(factor * 10 ** power);
  return values;
}

export const inNewtons = (force) => `${number(force, 3)} N`;

/** When something was made, of its ISO 8601 text. */
export const moment = (text) => text.replace('T', ' ').replace(/Z$/, ' UTC');

/** A time with three decimals. */
export const seconds = (time) => fixed(time, 3);
