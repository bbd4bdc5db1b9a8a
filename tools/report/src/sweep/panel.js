import { el } from '../dom.js';
import { CanvasPainter } from '../painter.js';
import { schedule } from '../schedule.js';
import { colours } from '../theme.js';

const tell = ({ target, isIntersecting }) => target.panel.setVisible(isIntersecting);
const observer = new IntersectionObserver((entries) => entries.forEach(tell), { rootMargin: '200px 0px' });
const sizes = new ResizeObserver((entries) => entries.forEach(({ target }) => target.panel.invalidate()));

/** A figure with a head and a canvas; draws only while it is in view. `draw(painter, size)` is the heir's. */
export class Panel {
  #visible = false;
  #stale = true;

  constructor(name, height, ...head) {
    this.height = height;
    this.canvas = el('canvas', { role: 'img' });
    this.stage = el('div.sweep-stage', { style: { height: `${height}px` } }, this.canvas);
    this.root = el('figure.panel', { 'data-name': name }, el('figcaption', ...head), this.stage);
    this.root.panel = this;
    this.stage.panel = this;
    observer.observe(this.root);
    sizes.observe(this.stage);
    addEventListener('beforeprint', () => {
      this.#stale = true;
      this.#visible = true;
      this.refresh();
    });
  }

  setVisible(visible) {
    this.#visible = visible;
    if (visible && this.#stale) schedule(this);
  }

  invalidate() {
    this.#stale = true;
    if (this.#visible) schedule(this);
  }

  drawNothing(painter, width, height) {
    painter.text('no values', width / 2, height / 2, { colour: colours.muted, align: 'center' });
  }

  refresh() {
    const width = this.stage.clientWidth;
    if (!this.#visible || !this.#stale || width === 0) return;
    this.#stale = false;
    const ratio = devicePixelRatio || 1;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    const context = this.canvas.getContext('2d');
    context.scale(ratio, ratio);
    this.draw(new CanvasPainter(context), { width, height: this.height });
    this.root.dataset.drawn = String(1 + Number(this.root.dataset.drawn ?? 0));
  }
}
