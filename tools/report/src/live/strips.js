import { choice, el } from '../dom.js';
import { font } from '../painter.js';
import { colours } from '../theme.js';

const SPAN_S = 20;
const SAMPLES = 1200; // more than come in that time
const PERIOD_MS = 30; // from one strip to the next
const REST = 6; // times as long as a strip takes, for all else
/** What is drawn, each as its share of the limits: the name of the numbers and of their limits. */
const QUANTITIES = [
  ['position', 'q', 'position'],
  ['velocity', 'qd', 'velocity'],
  ['acceleration', 'qdd', 'acceleration'],
  ['jerk', 'jerk', 'jerk_limit'],
];

/** The last 20 s of every joint as a share of its limits: the edges of each strip are the limits. */
export class Strips {
  #times = new Float64Array(SAMPLES);
  #values;
  #count = 0;
  #next = 0;
  #took = 0; // a strip [ms]
  #asked = false;
  #chosen = -1;
  /** Nobody sees it: what comes is kept, not drawn. */
  rests = false;

  constructor(host, run) {
    this.run = run;
    const n = run.joints.length;
    this.#values = QUANTITIES.map(() => new Float32Array(SAMPLES * n));
    const options = [[-1, 'all joints'], ...run.joints.map(({ name }, i) => [i, name])];
    const select = choice({ 'aria-label': 'Joint that stands out' }, options, null, (value) => {
      this.#chosen = Number(value);
      this.ask();
    });
    this.canvases = QUANTITIES.map(([title]) =>
      el('canvas.strip', { role: 'img', 'aria-label': `${title} of the joints, share of the limits, last 20 s` }),
    );
    host.append(
      el(
        'div.card-head',
        el('h2', { text: `Last ${SPAN_S} s` }),
        el('span.hint', { text: 'each joint between its limits' }),
        el('span.push'),
        select,
      ),
      el(
        'div.strip-grid',
        ...QUANTITIES.map(([title], i) => el('figure', el('figcaption', { text: title }), this.canvases[i])),
      ),
    );
    new ResizeObserver(() => this.ask()).observe(host);
  }

  add(frame) {
    const n = this.run.joints.length;
    const at = this.#count % SAMPLES;
    this.#times[at] = frame('time_s')[0];
    QUANTITIES.forEach(([, name, limit], k) => {
      const [value, lower, upper] = [frame(name), frame(`${limit}_lower`), frame(`${limit}_upper`)];
      for (let i = 0; i < n; ++i) {
        const half = (upper[i] - lower[i]) / 2;
        this.#values[k][at * n + i] = Number.isFinite(half) ? (value[i] - (upper[i] + lower[i]) / 2) / half : NaN;
      }
    });
    this.#count += 1;
    this.ask();
  }

  /** Draws anew, soon. */
  ask() {
    if (this.#asked || this.rests) return;
    this.#asked = true;
    setTimeout(() => requestAnimationFrame(() => this.#draw()), Math.max(PERIOD_MS, REST * this.#took));
  }

  /** One strip after the other: all at once would hold up the hand where there is no graphics card. */
  #draw() {
    const begin = performance.now();
    const k = this.#next;
    this.#next = (k + 1) % this.canvases.length;
    this.#drawOne(this.canvases[k], this.#values[k]);
    setTimeout(() => {
      this.#took = performance.now() - begin; // with what the browser does after it
      this.#asked = false;
    });
  }

  #drawOne(canvas, values) {
    const { clientWidth: width, clientHeight: height } = canvas;
    if (width === 0) return;
    const ratio = Math.min(devicePixelRatio, 2);
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const context = canvas.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const [top, bottom] = [8, height - 8];
    const y = (share) => (top + bottom) / 2 - (Math.max(-1.15, Math.min(1.15, share)) * (bottom - top)) / 2;
    context.fillStyle = colours.bad;
    context.globalAlpha = colours.forbidden;
    context.fillRect(0, 0, width, top);
    context.fillRect(0, bottom, width, height - bottom);
    context.globalAlpha = 1;
    for (const [share, colour] of [[1, colours.limit], [-1, colours.limit], [0, colours.grid]]) {
      context.fillStyle = colour;
      context.fillRect(0, Math.round(y(share)), width, 1);
    }
    const from = Math.max(0, this.#count - SAMPLES);
    if (this.#count === 0) return;
    const now = this.#times[(this.#count - 1) % SAMPLES];
    const n = this.run.joints.length;
    for (let i = 0; i < n; ++i) {
      if (values.every((_, at) => at >= n || Number.isNaN(values[at * n + i]))) continue;
      const isChosen = this.#chosen === i;
      context.strokeStyle = colours.cases[i % colours.cases.length];
      context.globalAlpha = this.#chosen < 0 || isChosen ? 1 : 0.18;
      context.lineWidth = isChosen ? 2 : 1.25;
      context.beginPath();
      let isDown = false;
      let column = -1;
      let last = 0;
      for (let s = from; s < this.#count; ++s) {
        const at = s % SAMPLES;
        const x = width * (1 - (now - this.#times[at]) / SPAN_S);
        if (x < -5) continue;
        const place = y(values[at * n + i]);
        if (!isDown) context.moveTo(x, place);
        else if (Math.floor(x) !== column || s === this.#count - 1 || Math.abs(place - last) > 1) context.lineTo(x, place);
        else continue;
        isDown = true;
        column = Math.floor(x);
        last = place;
      }
      context.stroke();
    }
    context.globalAlpha = 1;
    context.font = font(10);
    context.fillStyle = colours.muted;
    context.textAlign = 'left';
    context.fillText(`\u2212${SPAN_S} s`, 3, bottom - 4);
  }
}
