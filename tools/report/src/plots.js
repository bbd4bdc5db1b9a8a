import uPlot from 'uplot';
import { HistogramChart, LIMIT_STYLES, LineChart, TIMES } from './charts.js';
import { button, el, lineSample, setPressed, swatch } from './dom.js';
import { saveFigure } from './exporting.js';
import { duration, number, powers, tick } from './format.js';
import { listenToGestures } from './gestures.js';
import { CanvasPainter, font } from './painter.js';
import { anyHas, bandOf, quantitiesOf } from './quantities.js';
import { schedule, unschedule } from './schedule.js';
import { ALL_JOINTS } from './state.js';
import { colours } from './theme.js';
import { LaneChart, legend } from './timeline.js';

const SYNC = 'viable-time';
const AXIS_WIDTH = 60;
const AXIS_HEIGHT = 22;

/** One plot with its head (name, buttons), its read-out and the line of the scrubber. Draws only while it is visible. */
export class Panel {
  #plot = null;
  #stale = true;
  #visible = false;
  #pointerInside = false;
  #pressedAt = 0;

  constructor(state, chart, { compact = false, head = null } = {}) {
    this.state = state;
    this.chart = chart;
    this.compact = compact;
    this.shared = !chart.domain; // its x axis is the time that all plots share
    this.host = el('div.plot', { role: 'img' });
    this.readout = el('div.readout');
    this.note = el('span.note');
    this.name = el('h3');
    this.scrubLine = el('div.scrub-line', { 'aria-hidden': 'true' });
    this.root = el(
      'figure',
      { class: `panel${compact ? ' compact' : ''}`, 'data-quantity': chart.id },
      el(
        'figcaption',
        this.name,
        head,
        chart.hint ? el('span.hint', { text: chart.hint }) : null,
        this.note,
        el('span.push'),
        el('span.tools', this.#saveButton('png'), this.#saveButton('svg')),
      ),
      this.readout,
      this.host,
    );
    this.#reserve();
  }

  #saveButton(format) {
    const name = format.toUpperCase();
    const onclick = () => saveFigure(this.state, { charts: [this.chart], view: this.#domain() }, format);
    return button({ class: 'quiet', text: name, title: `Save what is in view as ${name}, in light colours`, onclick });
  }

  /** The cases that it shows: the chart's own, else those that are shown everywhere. */
  get #cases() {
    return this.chart.cases ?? this.state.cases;
  }

  #domain() {
    return this.shared ? this.state.view : this.chart.domain;
  }

  get #height() {
    if (this.chart.isLanes) return this.chart.height + AXIS_HEIGHT + 8;
    return this.compact ? 128 : 168;
  }

  /** Keeps the place of the plot, drawn or not. */
  #reserve() {
    this.host.style.height = `${this.#height}px`;
    const { chart } = this;
    this.name.textContent = this.compact ? chart.jointName : `${chart.title}${chart.unit ? ` [${chart.unit}]` : ''}`;
    this.host.setAttribute(
      'aria-label',
      `${chart.description}; cases ${this.#cases.map((c) => c.name).join(', ') || 'none'}`,
    );
    this.#fillReadout();
  }

  setVisible(visible) {
    this.#visible = visible;
    if (visible) schedule(this);
  }

  drawForPrint() {
    const visible = this.#visible;
    this.#visible = true;
    this.refresh();
    this.#visible = visible;
  }

  /** What is drawn is not right any more. `contents`: the cases or the joint are others, not only the view. */
  invalidate(contents = true) {
    this.#stale = true;
    if (contents) {
      this.chart.invalidate();
      this.#reserve();
    }
    if (this.#visible) schedule(this);
  }

  setJoint(joint) {
    this.chart.joint = joint;
    this.invalidate();
  }

  refresh() {
    if (!this.#visible) return;
    const width = this.host.clientWidth;
    if (width === 0) return;
    if (!this.#plot) this.#create(width);
    else if (this.#stale || width !== this.#plot.width) this.#redraw(width);
    this.#stale = false;
    this.placeScrubLine();
    this.updateReadout();
  }

  #redraw(width) {
    const plot = this.#plot;
    const { min, max } = this.#domain();
    if (width !== plot.width || this.#height !== plot.height) plot.setSize({ width, height: this.#height });
    plot.batch(() => {
      plot.setScale('x', { min, max });
      plot.redraw(false, true);
    });
  }

  #create(width) {
    const { chart, shared } = this;
    const axis = {
      font: font(11),
      stroke: () => colours.muted,
      ticks: { show: false },
      grid: { stroke: () => colours.grid, width: 1 },
      border: { show: true, stroke: () => colours.line, width: 1 },
    };
    const own = shared ? {} : { splits: (_, __, min, max) => powers(min, max), filter: (_, splits) => splits };
    this.#plot = new uPlot(
      {
        width,
        height: this.#height,
        padding: [6, 20, 0, 0],
        legend: { show: false },
        scales: {
          x: { time: false, distr: shared ? 1 : 3, range: () => [this.#domain().min, this.#domain().max] },
          y: { range: () => this.#yRange() },
        },
        series: [{}, { scale: 'y', paths: () => null, points: { show: false } }],
        axes: [
          {
            ...axis,
            ...own,
            size: AXIS_HEIGHT,
            gap: 5,
            space: this.compact ? 52 : 70,
            values: (_, splits, __, ___, increment) =>
              splits.map((v) => (shared ? `${tick(v, increment)} s` : duration(v))),
          },
          chart.isLanes
            ? { ...axis, size: AXIS_WIDTH, grid: { show: false }, splits: () => [], values: () => [] }
            : {
                ...axis,
                size: AXIS_WIDTH,
                gap: 5,
                space: 28,
                values: (_, splits, __, ___, increment) => splits.map((v) => tick(v, increment)),
              },
        ],
        cursor: {
          y: false,
          points: { show: false },
          drag: { x: shared, y: false, setScale: false },
          sync: shared
            ? { key: SYNC, setSeries: false, scales: ['x', null], filters: { sub: () => this.#visible } }
            : undefined,
          bind: { dblclick: () => () => shared && this.state.resetView() },
        },
        hooks: {
          draw: [(plot) => this.#draw(plot)],
          setSelect: [(plot) => this.#select(plot)],
          setCursor: [(plot) => this.#hover(plot)],
        },
      },
      [[1, 2], [1, 1]],
      this.host,
    ); // the data is the chart's own; uPlot does axes, cursor and zoom
    this.#listen(this.#plot.over);
    if (!shared) return;
    this.#plot.over.append(this.scrubLine);
    listenToGestures(this.#plot.over, this.state);
  }

  #listen(over) {
    over.addEventListener('mouseenter', () => (this.#pointerInside = true));
    over.addEventListener('mouseleave', () => {
      this.#pointerInside = false;
      if (this.shared) this.state.setHover(null);
      else this.updateReadout();
    });
    over.addEventListener('mousedown', (event) => (this.#pressedAt = event.clientX));
    over.addEventListener('click', (event) => {
      if (event.pointerType === 'touch') this.state.setHover(null); // a finger does not hover
      if (!this.shared || Math.abs(event.clientX - this.#pressedAt) > 3) return;
      this.state.setTime(this.#plot.posToVal(event.clientX - over.getBoundingClientRect().left, 'x'));
    });
  }

  #select(plot) {
    const { left, width } = plot.select;
    if (width === 0) return;
    if (this.#pointerInside && width > 3)
      this.state.setView(plot.posToVal(left, 'x'), plot.posToVal(left + width, 'x'));
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  }

  #hover(plot) {
    if (!this.#pointerInside) return;
    if (this.shared) this.state.setHover(plot.cursor.left >= 0 ? plot.posToVal(plot.cursor.left, 'x') : null);
    else this.updateReadout();
  }

  #yRange() {
    const range = this.chart.range(this.#domain());
    const notes = this.chart.beyond.slice(0, 3).map(([c, [low, high]]) => {
      const title = `${c.name} leaves the plot; the button "y" fits the axis to it`;
      const farthest = number(range[0] - low > high - range[1] ? low : high, 3);
      return el('span', { title }, swatch(c.index), `${c.name} reaches ${farthest}`);
    });
    this.note.replaceChildren(...notes);
    return range;
  }

  #draw(plot) {
    const ratio = uPlot.pxRatio;
    const { left, top, width, height } = plot.bbox;
    const { x, y } = plot.scales;
    const context = plot.ctx;
    context.save();
    context.scale(ratio, ratio);
    this.chart.draw(
      new CanvasPainter(context),
      {
        left: left / ratio,
        top: top / ratio,
        width: width / ratio,
        height: height / ratio,
        pixel: 1 / ratio,
        xMin: x.min,
        xMax: x.max,
        toX: this.#toPixels(plot, 'x', ratio, left, width),
        toY: this.#toPixels(plot, 'y', ratio, top, height),
      },
      colours,
      this.compact,
    );
    context.restore();
    this.placeScrubLine(); // uPlot knows its scales only now
    this.root.dataset.view = `${x.min} ${x.max}`;
    this.root.dataset.range = `${y.min} ${y.max}`;
  }

  /** A quick way from a value to CSS pixels; uPlot's own, where the scale is logarithmic. */
  #toPixels(plot, key, ratio, start, extent) {
    if (!this.shared) return (value) => plot.valToPos(value, key, true) / ratio;
    const { min, max } = plot.scales[key];
    const factor = ((key === 'x' ? 1 : -1) * extent) / (max - min) / ratio;
    const origin = (key === 'x' ? start : start + extent) / ratio;
    return (value) => origin + (value - min) * factor;
  }

  /** Puts the line of the scrubber where its time is. */
  placeScrubLine() {
    if (!this.#plot || !this.shared || !this.#visible) return;
    const { time, view } = this.state;
    const inView = time >= view.min && time <= view.max;
    this.scrubLine.hidden = !inView;
    if (inView) this.scrubLine.style.transform = `translateX(${this.#plot.valToPos(time, 'x').toFixed(1)}px)`;
  }

  /** Room for a case's values: fixed, so that nothing moves when numbers get longer. */
  #cellWidth(withName) {
    if (this.compact) return this.chart.isLanes ? 130 : 120;
    const name = withName ? Math.min(20, Math.max(0, ...this.#cases.map((c) => c.name.length))) : 0;
    return 24 + 7.2 * name + (this.chart.isLanes ? 150 : 16 + 62 * (this.chart.kindCount ?? 1));
  }

  #fillReadout() {
    this.cells = this.#cases.map((c) => el('output', { 'aria-live': 'off', 'data-case': c.index }));
    this.readout.style.setProperty('--cell', `${this.#cellWidth(true)}px`);
    this.readout.style.setProperty('--short-cell', `${this.#cellWidth(false)}px`);
    this.readout.classList.toggle('many', this.#cases.length > 3);
    this.readout.replaceChildren(
      ...this.#cases.map((c, i) =>
        el(
          'span.value',
          {
            title: `${c.name}: ${this.chart.valueTitle}`,
            onpointerenter: (event) => this.state.setFocus(event.pointerType === 'mouse' ? c.index : null),
            onpointerleave: () => this.state.setFocus(null),
          },
          swatch(c.index),
          this.compact ? null : el('span.value-name', { text: c.name }),
          this.cells[i],
        ),
      ),
    );
  }

  updateReadout() {
    if (!this.#visible) return;
    let at = this.state.cursorTime;
    if (!this.shared) {
      if (!this.#plot) return;
      this.readout.classList.toggle('off', !this.#pointerInside);
      at = this.#plot.posToVal(this.#plot.cursor.left, 'x');
    }
    this.chart.values(at).forEach(({ values }, i) => {
      const text = (this.compact ? values.slice(0, 1) : values).join('  |  ');
      if (this.cells[i] && this.cells[i].textContent !== text) this.cells[i].textContent = text;
    });
  }

  destroy() {
    this.#visible = false;
    unschedule(this);
    this.#plot?.destroy();
    this.#plot = null;
  }
}

/**
 * Has the panels that `list` returns follow the page: its size, the time in view, print, and the `events` that leave their
 * contents as they are. Returns what tells them whether they are visible, as soon as it observes their roots.
 */
export function followPage(list, host, state, events) {
  const all = (action) => list().forEach(action);
  let timer = null;
  new ResizeObserver(() => all((panel) => panel.invalidate(false))).observe(host);
  addEventListener('beforeprint', () => all((panel) => panel.drawForPrint()));
  state.on(events, () => all((panel) => panel.invalidate(false)));
  state.on('time', () => all((panel) => panel.placeScrubLine()));
  // Numbers that change faster than they can be read cost time and tell nothing.
  const update = () => {
    timer = null;
    all((panel) => panel.updateReadout());
  };
  state.on('time hover', () => (timer ??= setTimeout(update, state.playing ? 120 : 16)));
  const tell = ({ target, isIntersecting }) => list().find(({ root }) => root === target)?.setVisible(isIntersecting);
  return new IntersectionObserver((entries) => entries.forEach(tell), { rootMargin: '150px 0px' });
}

/** All plots of the page: of one joint below each other, or of every quantity a small one per joint. */
export class PlotArea {
  #panels = [];
  #isWhole = false; // all joints

  constructor(host, state) {
    this.host = host;
    this.state = state;
    this.quantities = quantitiesOf(state.run);
    this.observer = followPage(() => this.#panels, host, state, 'view theme focus');
    this.#build();
    state.on('joint', () => this.#setJoint());
    state.on('cases', () => this.#all((panel) => panel.invalidate()));
    state.on('kinds', () => {
      this.#updateHeads();
      this.#all((panel) => panel.invalidate());
    });
  }

  #all(action) {
    this.#panels.forEach(action);
  }

  #setJoint() {
    if (this.#isWhole !== (this.state.joint === ALL_JOINTS)) this.#build();
    else this.#all((panel) => panel.shared && panel.setJoint(this.state.joint));
  }

  #build() {
    this.#all((panel) => panel.destroy());
    this.observer.disconnect();
    this.#panels = [];
    this.heads = [];
    this.#isWhole = this.state.joint === ALL_JOINTS;
    this.host.replaceChildren(
      ...(this.#isWhole ? this.#buildAll() : this.#buildOne(this.state.joint)),
      ...this.#buildTimes(),
    );
    this.#updateHeads();
    for (const { root } of this.#panels) this.observer.observe(root);
  }

  #add(panel) {
    this.#panels.push(panel);
    return panel.root;
  }

  #buildOne(joint) {
    const { state } = this;
    return [
      this.#add(new Panel(state, new LaneChart(state, joint), { head: this.#legend() })),
      ...this.quantities.map((quantity) => this.#buildPanel(quantity, joint)),
    ];
  }

  #buildPanel(quantity, joint) {
    return this.#add(new Panel(this.state, new LineChart(this.state, quantity, joint), { head: this.#head(quantity) }));
  }

  #buildAll() {
    const { state } = this;
    const group = (title, head, makeChart) =>
      el(
        'section.group',
        { 'aria-label': title },
        el('div.group-head', el('h2', { text: title }), head),
        el(
          'div.multiples',
          ...state.run.joints.map((_, j) => this.#add(new Panel(state, makeChart(j), { compact: true }))),
        ),
      );
    return [
      group('Acting limits', this.#legend(), (j) => new LaneChart(state, j)),
      ...this.quantities.map((quantity) =>
        quantity.ofArm
          ? this.#buildPanel(quantity, 0)
          : group(
              `${quantity.title} [${this.#units(quantity)}]`,
              this.#head(quantity),
              (j) => new LineChart(state, quantity, j),
            ),
      ),
    ];
  }

  #units({ units }) {
    const { joints } = this.state.run;
    const used = units.filter((_, i) => joints.some((joint) => Number(joint.linear) === i));
    return used.join(', ');
  }

  #buildTimes() {
    return TIMES.map((times) => new HistogramChart(this.state, times))
      .filter((chart) => !chart.isEmpty)
      .map((chart) => this.#add(new Panel(this.state, chart)));
  }

  #legend() {
    const items = legend(this.state.run);
    return el(
      'span.legend',
      { title: 'The upper half of a lane: upper limits; the lower half: lower ones' },
      ...items.map(({ name, colour, code }) =>
        el(
          'span.legend-item',
          el('span', { class: code ? 'key strip' : 'key', style: { '--key': `var(${colour})` } }),
          name,
        ),
      ),
      items.length < 6 ? el('span.hint', { text: 'upper half: upper limit' }) : null,
    );
  }

  /** Buttons of a quantity: which of its lines are drawn, and what its y axis is fitted to. */
  #head(quantity) {
    const { state } = this;
    const toggle = (key, properties, ...content) => {
      const chip = button({ class: 'chip', onclick: () => state.toggleKind(key), ...properties }, ...content);
      this.heads.push(() => setPressed(chip, !state.hiddenKinds.has(key)));
      return chip;
    };
    const kinds = quantity.kinds.length < 2 ? [] : quantity.kinds;
    const buttons = kinds.map((kind) => toggle(kind.key, {}, lineSample(kind.style), kind.label));
    const hasBound = quantity.bound && anyHas(state.run, quantity.bound);
    if (hasBound && !quantity.isError) {
      const title = 'A band around the nominal line: how far the real joint may be from it at most';
      buttons.push(toggle(bandOf(quantity), { text: '± bound', title }));
    }
    if (quantity.limit || (quantity.isError && hasBound)) {
      const title = 'What the y axis shows: the limits, with what is near them, or all data and nothing else';
      const chip = button({ class: 'chip', title, onclick: () => state.toggle('kinds', state.fitted, quantity.id) });
      this.heads.push(() => (chip.textContent = state.fitted.has(quantity.id) ? 'y: all data' : 'y: limits'));
      buttons.push(chip);
    }
    return el('span.chips', ...buttons, this.#limitLegend(quantity));
  }

  /** Which line is whose limit, where the real joint has others than the nominal arm. */
  #limitLegend({ realLimit }) {
    const has = ['lower', 'upper'].some((side) => anyHas(this.state.run, `${realLimit}_${side}`));
    if (!has) return null;
    const item = (kind, name) => el('span.legend-item.hint', lineSample(LIMIT_STYLES[kind]), name);
    return el('span.legend', item('limit', 'limit of nominal'), item('real', 'limit of real joint'));
  }

  #updateHeads() {
    for (const update of this.heads) update();
  }
}
