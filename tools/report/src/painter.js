// One way to draw, two places to draw on: a canvas (the page, PNG) and an SVG text. Lengths are CSS pixels.

/** @typedef {{colour: string, width?: number, dash?: number[], alpha?: number}} LineStyle */

const FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans", sans-serif';

export const font = (size = 11, weight = 400) => `${weight} ${size}px ${FONT}`;

const ruler = document.createElement('canvas').getContext('2d');

/** How wide a text is. */
export function textWidth(text, size = 11, weight = 400) {
  ruler.font = font(size, weight);
  return ruler.measureText(text).width;
}

/** What can be drawn by what an heir draws. */
class Painter {
  /** Draws a straight line; the style is that of line(). */
  segment(x1, y1, x2, y2, style) {
    this.line((sink) => {
      sink.moveTo(x1, y1);
      sink.lineTo(x2, y2);
    }, style);
  }

  textWidth(text, size = 11, weight = 400) {
    return textWidth(text, size, weight);
  }
}

export class CanvasPainter extends Painter {
  constructor(context) {
    super();
    this.context = context;
  }

  clip(x, y, width, height, draw) {
    const { context } = this;
    context.save();
    context.beginPath();
    context.rect(x, y, width, height);
    context.clip();
    draw();
    context.restore();
  }

  /** Draws the line that `build` makes with moveTo and lineTo. */
  line(build, { colour, width = 1, dash = [], alpha = 1 }) {
    const { context } = this;
    context.beginPath();
    build(context);
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.lineJoin = 'bevel'; // the quickest
    context.globalAlpha = alpha;
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  /** Fills what the line that `build` makes goes round. */
  area(build, { colour, alpha = 1 }) {
    const { context } = this;
    context.beginPath();
    build(context);
    context.globalAlpha = alpha;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 1;
  }

  rect(x, y, width, height, colour, alpha = 1) {
    this.context.globalAlpha = alpha;
    this.context.fillStyle = colour;
    this.context.fillRect(x, y, width, height);
    this.context.globalAlpha = 1;
  }

  text(text, x, y, { colour, size = 11, weight = 400, align = 'left', baseline = 'middle', halo = null }) {
    const { context } = this;
    context.font = font(size, weight);
    context.textAlign = align;
    context.textBaseline = baseline;
    if (halo) {
      context.strokeStyle = halo;
      context.lineWidth = 3;
      context.lineJoin = 'round';
      context.strokeText(text, x, y);
    }
    context.fillStyle = colour;
    context.fillText(text, x, y);
  }
}

export class SvgPainter extends Painter {
  #parts = [];
  #clips = 0;
  #prefix;

  /** @param {string} prefix of the names in the drawing, unlike those of others in the same page */
  constructor(prefix) {
    super();
    this.#prefix = prefix;
  }

  clip(x, y, width, height, draw) {
    const id = `${this.#prefix}-${this.#clips++}`;
    this.#parts.push(
      `<clipPath id="${id}"><rect x="${r(x)}" y="${r(y)}" width="${r(width)}" height="${r(height)}"/></clipPath>`,
      `<g clip-path="url(#${id})">`,
    );
    draw();
    this.#parts.push('</g>');
  }

  line(build, { colour, width = 1, dash = [], alpha = 1 }) {
    const path = pathOf(build);
    if (!path) return;
    this.#parts.push(
      `<path d="${path}" fill="none" stroke="${colour}" stroke-width="${width}" stroke-linejoin="round"` +
        `${dash.length ? ` stroke-dasharray="${dash.join(' ')}"` : ''}` +
        `${alpha < 1 ? ` stroke-opacity="${r(alpha)}"` : ''}/>`,
    );
  }

  area(build, { colour, alpha = 1 }) {
    const path = pathOf(build);
    if (path) this.#parts.push(`<path d="${path}Z" fill="${colour}" fill-opacity="${alpha}"/>`);
  }

  rect(x, y, width, height, colour, alpha = 1) {
    this.#parts.push(
      `<rect x="${r(x)}" y="${r(y)}" width="${r(width)}" height="${r(height)}" fill="${colour}"` +
        `${alpha < 1 ? ` fill-opacity="${alpha}"` : ''}/>`,
    );
  }

  text(text, x, y, { colour, size = 11, weight = 400, align = 'left', baseline = 'middle', halo = null }) {
    const anchor = { left: 'start', center: 'middle', right: 'end' }[align];
    const shift = { top: 0.8, middle: 0.35, bottom: -0.2, alphabetic: 0 }[baseline] * size;
    this.#parts.push(
      `<text x="${r(x)}" y="${r(y + shift)}" fill="${colour}" font-size="${size}" font-weight="${weight}"` +
        `${halo ? ` stroke="${halo}" stroke-width="3" stroke-linejoin="round" paint-order="stroke"` : ''}` +
        ` text-anchor="${anchor}">${escapeXml(text)}</text>`,
    );
  }

  toString(width, height) {
    return (
      `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" ` +
      `font-family='${FONT}'>\n${this.#parts.join('\n')}\n</svg>\n`
    );
  }
}

function pathOf(build) {
  const commands = [];
  build({ moveTo: (x, y) => commands.push(`M${r(x)} ${r(y)}`), lineTo: (x, y) => commands.push(`L${r(x)} ${r(y)}`) });
  return commands.join('');
}

const r = (value) => String(Math.round(value * 100) / 100);

const escapeXml = (text) =>
  text
    .replace(/[&<>"']/g, (c) => `&#${c.charCodeAt(0)};`)
    .replace(/[\u0000-\u0008\u000b\u000c\u000e-\u001f\ufffe\uffff]/g, '\ufffd');
