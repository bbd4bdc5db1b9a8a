import { LineChart } from './charts.js';
import { save } from './dom.js';
import { duration, powers, tick, ticks } from './format.js';
import { CanvasPainter, SvgPainter, textWidth } from './painter.js';
import { quantitiesOf } from './quantities.js';
import { ALL_JOINTS } from './state.js';
import { caseColour, caseDash, printColours } from './theme.js';
import { legend } from './timeline.js';

const WIDTH = 900;
const MARGIN = { left: 62, right: 16 };
const HEAD = 28; // of the figure
const TITLE = 20; // of each plot, where there are several
const FOOT = 40; // the time axis
const ROW = 18; // of the legend

/**
 * What a figure shows: the charts below each other, in light colours, for documents.
 * @typedef {{charts: Array, view: {min: number, max: number}, width?: number, plotHeight?: number}} Figure
 */

/** Saves a figure as `format` ("png" or "svg"). */
export async function saveFigure(state, figure, format) {
  const [chart] = figure.charts;
  const names = [state.run.title, chart.jointName, figure.charts.length > 1 ? 'limits' : (chart.fileName ?? chart.id)];
  save(await makeFigure(state, figure, format), `${names.filter(Boolean).join(' ')}.${format}`);
}

async function makeFigure(state, figure, format) {
  const { width = WIDTH, charts } = figure;
  const layout = makeLayout(state, figure);
  if (format === 'svg') {
    const painter = new SvgPainter(`${charts[0].id}-${charts[0].joint ?? ''}-clip`);
    drawFigure(painter, state, figure, layout);
    return new Blob([painter.toString(width, layout.height)], { type: 'image/svg+xml' });
  }
  const canvas = document.createElement('canvas');
  canvas.width = 2 * width;
  canvas.height = 2 * layout.height;
  const context = canvas.getContext('2d');
  context.scale(2, 2);
  drawFigure(new CanvasPainter(context), state, figure, layout);
  return new Promise((resolve) => canvas.toBlob(resolve, 'image/png'));
}

/** The charts of the quantities with limits of joints, or of those named, of a joint. */
export function limitCharts(state, joint, ids = null) {
  return quantitiesOf(state.run)
    .filter(({ id, limit, ofArm }) => (ids ? ids.includes(id) : limit && !ofArm))
    .map((quantity) => new LineChart(state, quantity, joint === ALL_JOINTS ? 0 : joint));
}

/**
 * For scripts: a figure as SVG text, of any quantities, joint, cases (by name) and times, whatever the page shows.
 * @param {{quantities?: string[], joint?: number, cases?: string[], hidden?: string[], fitted?: string[], from?: number,
 *   to?: number, width?: number, plotHeight?: number, title?: string}} options
 */
export async function figureText(state, options = {}) {
  const { run } = state;
  const own = Object.create(state, {
    shown: { value: run.cases.map((c) => options.cases?.includes(c.name) ?? true) },
    focus: { value: null },
    hiddenKinds: { value: new Set([...state.hiddenKinds, ...(options.hidden ?? [])]) },
    fitted: { value: new Set(options.fitted) },
  });
  const figure = {
    ...options,
    charts: limitCharts(own, options.joint ?? 0, options.quantities),
    view: { min: options.from ?? run.tMin, max: options.to ?? run.tMax },
  };
  return (await makeFigure(own, figure, 'svg')).text();
}

function makeLayout(state, { charts, width = WIDTH, plotHeight = null }) {
  const rows = [[]];
  let x = MARGIN.left;
  for (const item of legendOf(state, charts[0])) {
    const size = 28 + textWidth(item.name) + 18;
    if (x > MARGIN.left && x + size > width - MARGIN.right) {
      rows.push([]);
      x = MARGIN.left;
    }
    rows.at(-1).push({ ...item, x });
    x += size;
  }
  const isOne = charts.length === 1;
  let y = HEAD + rows.length * ROW + 4;
  const plots = charts.map((chart) => {
    const top = y + (isOne ? 0 : TITLE);
    const height = chart.isLanes ? chart.height : (plotHeight ?? (isOne ? 230 : 130));
    y = top + height + (isOne ? 0 : 8);
    return { chart, top, height };
  });
  return { rows, plots, height: Math.round(y + FOOT) };
}

function drawFigure(painter, state, { charts, view, width = WIDTH, title = null }, { rows, plots, height }) {
  const palette = printColours;
  painter.rect(0, 0, width, height, palette.surface);
  const [first] = charts;
  const joint = first.jointName;
  const head =
    title ?? (charts.length > 1 ? `${state.run.title}: ${joint}` : `${titleOf(first)}${joint ? `, ${joint}` : ''}`);
  painter.text(head, MARGIN.left, 16, { colour: palette.text, size: 14, weight: 600 });
  if (charts.length === 1 && title === null)
    painter.text(state.run.title, width - MARGIN.right, 16, { colour: palette.muted, size: 11, align: 'right' });
  rows.forEach((row, i) => {
    const y = HEAD + (i + 0.5) * ROW;
    for (const { name, colour, dash, isLine, alpha = 1, x } of row) {
      if (isLine) painter.segment(x, y, x + 22, y, { colour, dash, alpha, width: 2.2 });
      else painter.rect(x + 5, y - 4, 12, 8, colour, alpha);
      painter.text(name, x + 28, y, { colour: palette.text });
    }
  });
  plots.forEach(({ chart, top, height: own }, i) => {
    if (charts.length > 1) painter.text(titleOf(chart), MARGIN.left, top - 9, { colour: palette.text, weight: 600 });
    const place = { left: MARGIN.left, top, width: width - MARGIN.left - MARGIN.right, height: own };
    drawPlot(painter, chart, place, view, i === plots.length - 1);
  });
}

const titleOf = ({ title, unit }) => `${title}${unit ? ` [${unit}]` : ''}`;

function drawPlot(painter, chart, place, view, isLast) {
  const palette = printColours;
  const [yMin, yMax] = chart.range(view);
  const logarithmic = Boolean(chart.domain);
  const scale = logarithmic ? Math.log10 : (value) => value;
  const part = (value, min, max) => (scale(value) - scale(min)) / (scale(max) - scale(min));
  const frame = {
    ...place,
    xMin: view.min,
    xMax: view.max,
    pixel: 0.5,
    toX: (x) => place.left + place.width * part(x, view.min, view.max),
    toY: (y) => place.top + place.height * (1 - (y - yMin) / (yMax - yMin)),
  };
  const bottom = frame.top + frame.height;
  const x = logarithmic ? { values: powers(view.min, view.max) } : ticks(view.min, view.max, 9);
  const below = { colour: palette.muted, align: 'center' };
  for (const value of x.values) {
    painter.rect(frame.toX(value) - 0.5, frame.top, 1, frame.height, palette.grid);
    const text = logarithmic ? duration(value) : tick(value, x.increment);
    if (isLast) painter.text(text, frame.toX(value), bottom + 13, below);
  }
  if (!chart.isLanes) {
    const y = ticks(yMin, yMax, frame.height / 30);
    const beside = { colour: palette.muted, align: 'right' };
    for (const value of y.values) {
      painter.rect(frame.left, frame.toY(value) - 0.5, frame.width, 1, palette.grid);
      painter.text(tick(value, y.increment), frame.left - 7, frame.toY(value), beside);
    }
  }
  chart.draw(painter, frame, palette);
  painter.rect(frame.left - 0.5, frame.top, 1, frame.height, palette.line);
  painter.rect(frame.left, bottom - 0.5, frame.width, 1, palette.line);
  if (isLast) painter.text(logarithmic ? 'tick time' : 'time [s]', frame.left + frame.width / 2, bottom + 29, below);
}

/** The cases, or for the acting limits what their colours mean. */
function legendOf(state, chart) {
  const palette = printColours;
  if (chart.legend) return chart.legend(palette);
  if (chart.id === 'interventions')
    return legend(state.run).map(({ name, code }) => ({
      name,
      colour: code ? palette.status[code] : palette.limits[name],
      isLine: false,
    }));
  return state.cases.map((c) => ({
    name: c.name,
    colour: caseColour(c.index, palette),
    dash: caseDash(c.index),
    isLine: !chart.isLanes,
  }));
}
