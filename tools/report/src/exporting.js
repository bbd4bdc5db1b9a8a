import { legend } from './timeline.js';
import { CanvasPainter, SvgPainter } from './painter.js';
import { powers, tick, ticks } from './format.js';
import { caseColour, printColours } from './theme.js';

const WIDTH = 900;
const MARGIN = { left: 62, right: 16, bottom: 40 };

/** Saves what a chart shows of the given times as `format` ("png" or "svg"), in light colours, for documents. */
export async function saveFigure(state, chart, view, format) {
  const height = chart.isLanes ? chart.height + 110 : 320;
  let blob;
  if (format === 'svg') {
    const painter = new SvgPainter(`${chart.id}-${chart.joint ?? ''}-clip`);
    drawFigure(painter, state, chart, view, height);
    blob = new Blob([painter.toString(WIDTH, height)], { type: 'image/svg+xml' });
  } else {
    const canvas = document.createElement('canvas');
    canvas.width = 2 * WIDTH;
    canvas.height = 2 * height;
    const context = canvas.getContext('2d');
    context.scale(2, 2);
    drawFigure(new CanvasPainter(context), state, chart, view, height);
    blob = await new Promise((resolve) => canvas.toBlob(resolve, 'image/png'));
  }
  save(blob, `${[state.run.title, chart.jointName, chart.id].filter(Boolean).join(' ')}.${format}`);
}

/** Hands a file to the reader. */
export function save(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name.replace(/[^\p{L}\p{N}._-]+/gu, '_').slice(-120);
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

function drawFigure(painter, state, chart, view, height) {
  const palette = printColours;
  painter.rect(0, 0, WIDTH, height, palette.surface);
  const unit = chart.unit && !chart.domain ? ` [${chart.unit}]` : '';
  const title = `${chart.title}${chart.jointName ? ` of ${chart.jointName}` : ''}${unit}`;
  painter.text(title, MARGIN.left, 18, { colour: palette.text, size: 14, weight: 600 });
  painter.text(state.run.title, WIDTH - MARGIN.right, 18, { colour: palette.muted, size: 11, align: 'right' });
  const top = drawLegend(painter, chart, state, 38, palette) + 14;

  const [yMin, yMax] = chart.range(view);
  const logarithmic = Boolean(chart.domain);
  const scale = logarithmic ? Math.log10 : (value) => value;
  const frame = {
    left: MARGIN.left,
    top,
    width: WIDTH - MARGIN.left - MARGIN.right,
    height: height - top - MARGIN.bottom,
    xMin: view.min,
    xMax: view.max,
  };
  const part = (value, min, max) => (scale(value) - scale(min)) / (scale(max) - scale(min));
  frame.toX = (x) => frame.left + frame.width * part(x, view.min, view.max);
  frame.toY = (y) => frame.top + frame.height * (1 - part(y, yMin, yMax));

  const bottom = frame.top + frame.height;
  const axis = (min, max, count) => (logarithmic ? { values: powers(min, max) } : ticks(min, max, count));
  const x = axis(view.min, view.max, 9);
  for (const value of x.values) {
    painter.rect(frame.toX(value) - 0.5, top, 1, frame.height, palette.grid);
    painter.text(tick(value, logarithmic ? value : x.increment), frame.toX(value), bottom + 13, {
      colour: palette.muted,
      align: 'center',
    });
  }
  if (!chart.isLanes) {
    const y = axis(yMin, yMax, 6);
    for (const value of y.values) {
      painter.rect(frame.left, frame.toY(value) - 0.5, frame.width, 1, palette.grid);
      painter.text(tick(value, logarithmic ? value : y.increment), frame.left - 7, frame.toY(value), {
        colour: palette.muted,
        align: 'right',
      });
    }
  }
  chart.draw(painter, frame, palette);
  painter.rect(frame.left - 0.5, top, 1, frame.height, palette.line);
  painter.rect(frame.left, bottom - 0.5, frame.width, 1, palette.line);
  painter.text(logarithmic ? 'tick time [µs]' : 'time [s]', frame.left + frame.width / 2, bottom + 29, {
    colour: palette.muted,
    align: 'center',
  });
}

/** The cases, and for lanes the limits, in as many rows as they need; returns the last row's middle. */
function drawLegend(painter, chart, state, y, palette) {
  const items = chart.isLanes
    ? legend(state.run).map(({ name, strip }) => [
        name,
        strip ? palette.status[statusCode(state, name)] : palette.limits[name],
      ])
    : state.cases.map((c) => [c.name, caseColour(c.index, palette)]);
  let x = MARGIN.left;
  for (const [name, colour] of items) {
    const width = 16 + painter.textWidth(name) + 18;
    if (x > MARGIN.left && x + width > WIDTH - MARGIN.right) {
      x = MARGIN.left;
      y += 17;
    }
    painter.rect(x, y - 2, 11, 4, colour);
    painter.text(name, x + 16, y, { colour: palette.text });
    x += width;
  }
  return y;
}

const statusCode = (state, name) =>
  legend(state.run)
    .find((item) => item.name === name)
    .colour.split('-')
    .pop();
