import { limitsIn, STATUS } from './data.js';
import { caseColour, colours, limitColour } from './theme.js';

export const LANE_HEIGHT = 20;

/** A lane per shown case, below each other. */
export class Lanes {
  unit = '';
  beyond = [];
  isLanes = true;

  constructor(state) {
    this.state = state;
  }

  invalidate() {}

  range() {
    return [0, 1];
  }

  /** Draws each case's name, its lane by `drawLane(c, top, height)`, and the heir's edge of it. */
  drawLanes(painter, frame, palette, sparse, drawLane) {
    const { cases } = this.state;
    const height = frame.height / Math.max(1, cases.length);
    cases.forEach((c, lane) => {
      const top = frame.top + lane * height;
      drawLaneName(painter, c, frame.left - 4, top + height / 2, palette, sparse);
      painter.clip(frame.left, top, frame.width, height, () => drawLane(c, top, height));
      this.drawEdge(painter, frame, palette, top, height, lane);
    });
  }
}

/**
 * Which limit acted when: a lane per case. Its upper half shows upper limits, its lower half lower ones; a strip at
 * its foot shows what is more than a change of the torque: stops, returns, faults.
 */
export class LaneChart extends Lanes {
  id = 'interventions';
  title = 'Acting limits';

  constructor(state, joint) {
    super(state);
    this.joint = joint;
  }

  get jointName() {
    return this.state.run.joints[this.joint].name;
  }
  get height() {
    return Math.max(1, this.state.cases.length) * LANE_HEIGHT;
  }

  draw(painter, frame, palette = colours, sparse = false) {
    this.drawLanes(painter, frame, palette, sparse, (c, top, height) =>
      this.#drawLane(painter, frame, c, top, height, palette, sparse),
    );
  }

  drawEdge(painter, frame, palette, top, height, lane) {
    if (lane > 0) painter.rect(frame.left, top - 0.5, frame.width, 1, palette.line);
  }

  #drawLane(painter, frame, c, top, height, palette, sparse) {
    const strip = 3;
    const half = (height - strip - 3) / 2;
    painter.rect(frame.left, top + 1 + half, frame.width, 0.75, palette.grid);
    runs(c, c.active[this.joint], frame, (bits, x, width) => {
      for (const side of ['upper', 'lower']) {
        const names = limitsIn(bits).filter((name) => name.endsWith(side));
        const part = half / names.length;
        const begin = side === 'upper' ? top + 1.5 : top + 1.5 + half;
        names.forEach((name, i) => painter.rect(x, begin + i * part, width, part, limitColour(name, palette)));
      }
    });
    runs(c, c.status, frame, (code, x, width) => {
      if (code > 1) painter.rect(x, top + height - strip - 1, width, strip, palette.status[code] ?? palette.status[5]);
    });
    if (!c.stop) return;
    const x = frame.toX(c.stop.time_s);
    painter.rect(x - 1, top, 2, height, palette.bad);
    if (!sparse)
      painter.text('stopped', x + 5, top + half + 1, {
        colour: palette.bad,
        size: 10,
        weight: 600,
        halo: palette.surface,
      });
  }

  /** Per shown case what acts at a time. */
  values(time) {
    return this.state.cases.map((c) => {
      const bucket = c.bucketAt(time);
      if (bucket < 0) return { c, values: ['–'] };
      const status = c.status[bucket];
      const names = limitsIn(c.active[this.joint][bucket]).map((name) => name.replace('_', ' '));
      const acting = names.join(', ') || 'none';
      return { c, values: [status > 1 ? `${acting}; ${STATUS[status] ?? '?'}` : acting] };
    });
  }

  valueTitle = 'acting limit';

  get description() {
    return `Which limit of ${this.jointName} acted when`;
  }
}

/** The name of a case before its lane, as far as there is room, and its colour. */
function drawLaneName(painter, c, right, y, palette, sparse) {
  const room = 48;
  const size = 10;
  let { name } = c;
  if (painter.textWidth(name, size) > room) {
    while (name.length > 1 && painter.textWidth(`${name}…`, size) > room) name = name.slice(0, -1);
    name += '…';
  }
  painter.text(name, right - 4, y, { colour: sparse ? palette.muted : palette.text, size, align: 'right' });
  painter.rect(right - 1, y - 6, 3, 12, caseColour(c.index, palette));
}

/** Calls `draw` for each run of equal codes in view. What is narrower than a pixel is drawn a pixel wide. */
function runs(c, codes, { xMin, xMax, toX }, draw) {
  const first = Math.max(0, Math.floor((xMin - c.t0) / c.step));
  const last = Math.min(codes.length, Math.ceil((xMax - c.t0) / c.step));
  for (let i = first; i < last;) {
    const code = codes[i];
    const from = i;
    while (i < last && codes[i] === code) ++i;
    if (code === 0) continue;
    const x = toX(c.t0 + from * c.step);
    draw(code, x, Math.max(1, toX(c.t0 + i * c.step) - x));
  }
}

/** What the colours mean: of the limits, and of the states (with their codes) that occur in the run. */
export function legend(run) {
  const items = Object.keys(colours.limits).map((name) => ({ name, colour: `--limit-${name}`, code: 0 }));
  for (let code = 2; code < STATUS.length; ++code)
    if (run.cases.some((c) => c.status.includes(code)))
      items.push({ name: STATUS[code], colour: `--status-${code}`, code });
  return items;
}
