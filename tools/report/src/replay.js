import { limitsIn } from './data.js';
import { button, caseStyle, choice, el, iconButton, save, setPressed } from './dom.js';
import { fixed, inNewtons, number } from './format.js';
import { CanvasPainter } from './painter.js';
import { Picture } from './picture.js';
import { Arm, readSurfaces, Trail } from './scene.js';
import { ALL_CASES } from './state.js';
import { describeContact, ForceArrow, forceScale, NearestLine, Surroundings } from './surroundings.js';
import { caseColour, colours, limitColour } from './theme.js';

const TRAIL_S = 2;
/** The speed of a link is that of its way between two frames, and over no more than this. */
const SPEED_OVER_S = 0.01;
/** As often the speed of a run is looked at, to find the largest; what is faster in between is found when it is shown. */
const MOST_LOOKS = 5000;
const EXAGGERATIONS = [1, 10, 50];
/** What can be hidden, and the runs that have it. */
const PARTS = [
  {
    id: 'obstacles',
    label: 'obstacles',
    title: 'What stands around the arm',
    exists: (run) => run.environments.some(({ obstacles }) => obstacles.length > 0),
  },
  {
    id: 'stop',
    label: 'backup stop',
    title: 'Pale: where the arm would come to rest if the backup stop began now',
    exists: (run) => run.cases.some((c) => c.replay?.rest),
  },
  {
    id: 'nearest',
    label: 'nearest points',
    title: 'Where the arm, on its way through the tick and the stop after it, comes nearest to anything',
    exists: (run) => run.cases.some((c) => c.samples(0, 'clearance') !== null),
  },
  {
    id: 'contact',
    label: 'contact force',
    title: 'What presses on the real arm: an arrow from where it touches; with several forces their sum',
    exists: (run) => run.cases.some((c) => c.replay?.contact),
    legend: ({ perDecimetre }) => (perDecimetre > 0 ? `: 0.1 m is ${inNewtons(perDecimetre)}` : ''),
  },
];

/** Builds the 3D replay, or says why there is none. The rest of the page does not depend on it. */
export function createReplay(host, run, state) {
  const choice = caseChoice(run, state);
  const tools = el('span.tools');
  const stage = el('div.stage');
  host.append(el('div.replay-head', el('h3', { text: 'Replay' }), choice, el('span.push'), tools), stage);
  const hasReal = run.cases.some((c) => c.replay?.real);
  const tell = (text) => stage.replaceChildren(el('p.no-replay', { role: 'status', text }));
  const reason = whyNot(run);
  if (reason) {
    tell(reason);
    return null;
  }
  try {
    const replay = new Replay(stage, run, state);
    tools.append(
      button({ class: 'quiet', text: 'PNG', title: 'Save the picture as PNG', onclick: () => replay.savePicture() }),
      iconButton('home', 'Look at the arm from the start position', () => replay.resetCamera()),
    );
    const texts = [`line: tool, last ${TRAIL_S} s`];
    if (hasReal) texts.unshift('filled: nominal arm', 'coloured edge: real arm');
    host.append(
      el(
        'div.replay-foot',
        el('p.hint', { text: texts.join(' · ') }),
        linkColour(state, replay),
        hasReal ? exaggeration(state) : null,
      ),
    );
    const parts = PARTS.filter(({ exists }) => exists(run));
    if (parts.length > 0) host.append(el('div.chips', ...parts.map((part) => partButton(part, state, replay))));
    const notes = new Set([run.scene, ...run.environments].map((one) => one?.note).filter(Boolean));
    host.append(...[...notes].map((text) => el('p.hint', { role: 'note', text })));
    return replay;
  } catch (error) {
    tell(`The 3D replay does not work here: ${error.message}`);
    return null;
  }
}

/** Shows and hides a part of the replay. */
function partButton({ id, label, title, legend }, state, replay) {
  const text = el('span', { text: label });
  const key = el('span', { class: `key ${id}`, 'aria-hidden': 'true' });
  const chip = button({ class: 'chip', title, onclick: () => state.toggle('replay', state.hiddenParts, id) }, key, text);
  state.follow('replay cases', () => {
    setPressed(chip, !state.hiddenParts.has(id));
    if (legend) text.textContent = label + legend(replay);
    const colour = state.replayCase === ALL_CASES ? 'var(--muted)' : caseStyle(state.replayCase)['--case'];
    chip.style.setProperty('--case', colour); // of the arm's edge and of its stop
  });
  return chip;
}

/** From rest to the fastest. */
const speedColours = () => [colours.arm, ...colours.speeds];

/** What the colours of the links tell. */
function linkColour(state, replay) {
  const scale = el('span.speed-scale', { hidden: true });
  const meanings = [['limits', 'a limit acts'], ['speed', 'speed']];
  const select = choice({ 'aria-label': 'Colour of the links' }, meanings, state.linkColour, (value) => state.set('replay', { linkColour: value }));
  const show = () => {
    scale.hidden = state.linkColour !== 'speed';
    if (scale.hidden) return;
    scale.textContent = `to ${number(replay.fastest, 3)} m/s`;
    scale.style.backgroundImage = `linear-gradient(90deg, ${speedColours().join(', ')})`;
  };
  state.on('replay cases theme', show);
  replay.onFaster = show;
  return el('label.hint', 'coloured link ', select, scale);
}

/** How far the real arm is drawn from the nominal one: a thousandth of a radian is not seen. */
function exaggeration(state) {
  const title = 'The real arm is drawn so many times as far from the nominal one as it was';
  const factors = EXAGGERATIONS.map((factor) => [factor, `${factor} ×`]);
  const choose = (value) => state.set('replay', { exaggeration: Number(value) });
  const select = choice({ 'aria-label': 'Deviation of the real arm', title }, factors, state.exaggeration, choose);
  return el('label.hint', 'deviation ', select);
}

function whyNot(run) {
  if (!run.scene?.links?.length) return 'There is no description of the robot to show.';
  if (!run.cases.some((c) => c.replay)) return 'The run has no motion to replay.';
  const context = document.createElement('canvas').getContext('webgl2');
  if (!context)
    return 'The 3D replay needs WebGL 2, which this browser does not offer. Plots and tables work without it.';
  context.getExtension('WEBGL_lose_context')?.loseContext();
  return null;
}

function caseChoice(run, state) {
  const options = run.cases.filter((c) => c.replay).map((c) => [c.index, c.name]);
  if (run.cases.length > 1) options.push([ALL_CASES, 'all shown cases']);
  const choose = (value) => state.set('replay', { replayCase: Number(value) });
  const select = choice({ 'aria-label': 'Whose arm the replay shows' }, options, state.replayCase, choose);
  state.on('replay', () => (select.value = String(state.replayCase)));
  return select;
}

class Replay extends Picture {
  #arms = new Map(); // case index to { nominal, real, trail, stop, line, arrow }
  #surroundings = new Map(); // environment to Surroundings
  #visible = true;
  #frameAsked = false;
  #fastest = new Map(); // case index to the speed of its fastest point in the run [m/s]
  #speeds = []; // of the links, of each case that is shown
  onFaster = () => {};

  constructor(stage, run, state) {
    super(stage, run, 'The arm at the time of the scrubber. Drag to turn, wheel to zoom.');
    this.state = state;
    this.surfaces = readSurfaces(run);
    this.pose = new Float32Array(run.joints.length);
    this.realPose = new Float32Array(run.joints.length);
    this.text = el('div.nearest-text');

    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    const canvas = this.renderer.domElement;
    canvas.addEventListener('webglcontextlost', (event) => {
      event.preventDefault();
      stage.dataset.lost = 'true';
    });
    canvas.addEventListener('webglcontextrestored', () => {
      delete stage.dataset.lost;
      this.ask();
    });
    stage.append(this.text);

    this.#findBounds();
    this.#choose();
    this.#paint();
    this.resetCamera();

    new ResizeObserver(() => this.#resize()).observe(stage);
    new IntersectionObserver((entries) => {
      this.#visible = entries.at(-1).isIntersecting;
      if (this.#visible) this.ask();
    }).observe(stage);
    state.on('time', () => this.ask());
    state.on('replay cases', () => {
      this.#choose();
      this.#paint();
    });
    state.on('theme', () => this.#paint());
  }

  /** The cases whose arms are shown. */
  get #cases() {
    const { replayCase } = this.state;
    return this.run.cases.filter(
      (c) => c.replay && (replayCase === ALL_CASES ? this.state.shown[c.index] : c.index === replayCase),
    );
  }

  #choose() {
    for (const { root } of this.#surroundings.values()) root.visible = false;
    for (const { nominal, real, trail, stop, line, arrow } of this.#arms.values()) {
      for (const object of [nominal, real, trail, stop]) if (object) object.root.visible = false;
      line?.hide();
      arrow?.hide();
    }
    this.#cases.forEach((c, layer) => {
      const { nominal, real, trail } = this.#armOf(c);
      nominal.setLayer(layer);
      for (const object of [nominal, real, trail]) if (object) object.root.visible = true;
      const surroundings = this.#surroundingsOf(c);
      if (surroundings) surroundings.root.visible = !this.#isHidden('obstacles');
    });
    this.ask();
  }

  #isHidden(part) {
    return this.state.hiddenParts.has(part);
  }

  #surroundingsOf({ environment }) {
    if (environment && !this.#surroundings.has(environment)) {
      const surroundings = new Surroundings(this.run, environment, this.bounds);
      this.scene.add(surroundings.root);
      this.#surroundings.set(environment, surroundings);
    }
    return this.#surroundings.get(environment);
  }

  #armOf(c) {
    if (!this.#arms.has(c.index)) {
      const nominal = new Arm(this.run, this.surfaces);
      const real = c.replay.real ? new Arm(this.run, this.surfaces, { outline: 0.008 * this.size }) : null;
      const trail = new Trail();
      const stop = c.replay.rest ? new Arm(this.run, this.surfaces, { opacity: 0.34 }) : null;
      const line = c.replay.nearest ? new NearestLine(this.stage, this.size) : null;
      const arrow = c.replay.contact ? new ForceArrow(this.stage, this.size) : null;
      for (const object of [nominal, real, trail, stop, line, arrow]) if (object) this.scene.add(object.root);
      this.#arms.set(c.index, { nominal, real, trail, stop, line, arrow });
    }
    return this.#arms.get(c.index);
  }

  /** What a tenth of a metre of the arrows is [N], by the arms that are shown; 0: none touches anything. */
  get perDecimetre() {
    return forceScale(Math.max(0, ...this.#cases.map((c) => c.contact?.peak ?? 0)), this.size);
  }

  #contactOf(c, time) {
    return this.#isHidden('contact') ? null : c.contactAt(time);
  }

  /** The ball that holds the arm in all its poses, nearly, and what stands beside it. */
  #findBounds() {
    const c = this.#cases[0] ?? this.run.cases.find((each) => each.replay);
    const { nominal } = this.#armOf(c);
    const { nominal: q, n } = c.replay;
    const poses = Array.from({ length: 12 }, (_, i) => () => nominal.pose(q, Math.floor((i / 12) * n) * this.run.joints.length));
    const box = this.bound(nominal, poses);
    const beside = box.clone().expandByScalar(0.25 * this.bounds.radius);
    const surroundings = this.#surroundingsOf(c);
    if (surroundings) box.union(surroundings.partOf(beside)).getBoundingSphere(this.bounds);
  }

  resetCamera() {
    this.lookFrom([0.62, -0.92, 0.42], 0.92);
  }

  #paint() {
    const several = this.#cases.length > 1;
    for (const surroundings of this.#surroundings.values()) surroundings.paint(colours.obstacle);
    for (const [index, { nominal, real, trail, stop, arrow }] of this.#arms) {
      const colour = caseColour(index);
      arrow?.paint(several ? colour : colours.force);
      stop?.paint(colour, colour);
      nominal.paint(several ? colour : null, colours.arm);
      real?.paint(colour, colour);
      trail.paint(colour);
    }
    this.paintFloor();
  }

  #resize() {
    if (this.fit()) this.#draw(); // a canvas of a new size is empty
  }

  ask() {
    if (this.#frameAsked || !this.#visible) return;
    this.#frameAsked = true;
    requestAnimationFrame(() => this.#draw());
  }

  #draw() {
    this.#frameAsked = false;
    const { time } = this.state;
    for (const [environment, surroundings] of this.#surroundings) {
      const stops = this.#cases.map((c) => (c.environment === environment ? c.nearestAt(time)?.stop : 0));
      surroundings.show(time, Math.max(0, ...stops.filter(Number.isFinite)));
    }
    for (const c of this.#cases) {
      const { nominal, real, trail, stop, line, arrow } = this.#armOf(c);
      const poseAt = (at) => {
        if (this.#read(c.replay.nominal, c, at, this.pose)) nominal.pose(this.pose);
      };
      trail.show(nominal, Math.max(c.t0, Math.min(time, c.end) - TRAIL_S), Math.min(time, c.end), poseAt);
      if (real && this.#read(c.replay.real, c, time, this.realPose)) {
        const factor = this.state.exaggeration;
        for (let j = 0; j < this.pose.length; ++j)
          this.realPose[j] = this.pose[j] + factor * (this.realPose[j] - this.pose[j]);
        real.pose(this.realPose);
      }
      if (this.state.linkColour === 'speed') this.#tintBySpeed(c, nominal, time);
      else this.#tintByLimits(c, nominal, time);
      if (stop) {
        stop.root.visible = !this.#isHidden('stop') && this.#readRest(c, time, this.realPose);
        if (stop.root.visible) stop.pose(this.realPose);
      }
      line?.show(this.#isHidden('nearest') ? null : c.nearestAt(time));
      line?.paint(isTooNear(c, time) ? colours.bad : colours.text);
      arrow?.show(this.#contactOf(c, time), this.perDecimetre);
    }
    this.renderer.render(this.scene, this.camera);
    this.#write(time);
    this.stage.dataset.time = time.toFixed(4);
  }

  #tintByLimits(c, nominal, time) {
    const bucket = c.bucketAt(time);
    nominal.tint((joint) => {
      const [name] = bucket < 0 ? [] : limitsIn(c.active[joint][bucket]);
      return name ? limitColour(name) : null;
    });
  }

  #tintBySpeed(c, nominal, time) {
    const { fastest } = this;
    const speeds = this.#speedsAt(c, nominal, time);
    this.#speeds[c.index] = speeds;
    if (Math.max(...speeds) > fastest) {
      this.#fastest.set(c.index, Math.max(...speeds));
      this.onFaster();
      this.ask(); // with the new scale
    }
    nominal.colourByShares(
      speeds.map((speed) => (fastest > 0 ? speed / fastest : 0)),
      this.#cases.length > 1 ? [caseColour(c.index), ...colours.speeds] : speedColours(),
    );
  }

  /** Of each link of the nominal arm [m/s]; it is left in its pose at that time. */
  #speedsAt(c, nominal, time) {
    const half = Math.min(c.replay.step / 2, SPEED_OVER_S / 2);
    const [from, to] = [Math.max(c.t0, time - half), Math.min(c.end, time + half)];
    const [before, after] = [new Float32Array(this.pose.length), new Float32Array(this.pose.length)];
    const isKnown = to > from && this.#read(c.replay.nominal, c, from, before) && this.#read(c.replay.nominal, c, to, after);
    const speeds = isKnown ? nominal.speeds(before, after, to - from) : this.run.scene.links.map(() => 0);
    if (this.#read(c.replay.nominal, c, time, this.pose)) nominal.pose(this.pose);
    return speeds;
  }

  /** The speed of the fastest point of the arms that are shown, in the whole run [m/s]. */
  get fastest() {
    return Math.max(
      0,
      ...this.#cases.map((c) => {
        if (!this.#fastest.has(c.index)) {
          const { nominal } = this.#armOf(c);
          let most = 0;
          const looks = Math.min(c.replay.n, MOST_LOOKS);
          for (let i = 0; i < looks; ++i)
            most = Math.max(most, ...this.#speedsAt(c, nominal, c.t0 + ((c.end - c.t0) * (i + 0.5)) / looks));
          this.#fastest.set(c.index, most);
        }
        return this.#fastest.get(c.index);
      }),
    );
  }

  /** Tells in words what is nearest; the distance beside its line, where only one is drawn. */
  #write(time) {
    const cases = this.#cases.filter((c) => c.replay.nearest);
    for (const c of cases) {
      const { line } = this.#armOf(c);
      this.label(line, cases.length === 1 ? inMillimetres(c.nearestAt(time)) : '');
      line.label.classList.toggle('bad', isTooNear(c, time));
    }
    for (const c of this.#cases)
      this.label(this.#armOf(c).arrow, this.#cases.length === 1 ? inNewtons(c.contactAt(time)?.pressing) : '');
    const of = (c) => (this.#cases.length > 1 ? `${c.name}: ` : '');
    const texts = this.#cases.flatMap((c) => {
      const contact = this.#contactOf(c, time);
      const told = [contact && describeContact(contact), !this.#isHidden('nearest') && describe(c.nearestAt(time))].filter(Boolean);
      return this.#cases.length > 1 && told.length > 0 ? [of(c) + told.join(', ')] : told;
    });
    if (this.state.linkColour === 'speed')
      for (const c of this.#cases) {
        const speeds = this.#speeds[c.index];
        const link = speeds.reduce((best, speed, i) => (speed > speeds[best] ? i : best), 0);
        texts.push(`${of(c)}fastest: ${this.run.scene.links[link].name}, ${number(speeds[link], 3)} m/s`);
      }
    this.text.hidden = texts.length === 0;
    if (this.text.textContent !== texts.join('')) this.text.replaceChildren(...texts.map((text) => el('p', { text })));
  }

  /** Where the backup stop ends, on straight lines through the frames; false where it ends nowhere. */
  #readRest(c, time, pose) {
    const { n, step, rest } = c.replay;
    const at = Math.min(Math.max((time - c.t0) / step, 0), n - 1);
    const frame = Math.min(Math.floor(at), Math.max(0, n - 2));
    const next = Math.min(frame + 1, n - 1);
    for (let j = 0; j < pose.length; ++j) {
      const [from, to] = [rest[frame * pose.length + j], rest[next * pose.length + j]];
      pose[j] = from + (at - frame) * (to - from);
    }
    return n > 0 && pose.every(Number.isFinite);
  }

  /** The joint positions at a time, on a smooth curve (Catmull-Rom) through the frames; false where there are none. */
  #read(q, c, time, pose) {
    const { n, step } = c.replay;
    const joints = pose.length;
    const at = Math.min(Math.max((time - c.t0) / step, 0), n - 1);
    const frame = Math.min(Math.floor(at), Math.max(0, n - 2));
    const s = at - frame;
    const value = (i, j) => q[Math.min(Math.max(i, 0), n - 1) * joints + j];
    for (let j = 0; j < joints; ++j) {
      const [p0, p1, p2, p3] = [-1, 0, 1, 2].map((k) => value(frame + k, j));
      pose[j] = p1 + 0.5 * s * (p2 - p0 + s * (2 * p0 - 5 * p1 + 4 * p2 - p3 + s * (3 * (p1 - p2) + p3 - p0)));
    }
    return pose.every(Number.isFinite);
  }

  savePicture() {
    this.#draw();
    const picture = document.createElement('canvas');
    picture.width = this.renderer.domElement.width;
    picture.height = this.renderer.domElement.height;
    const context = picture.getContext('2d');
    context.drawImage(this.renderer.domElement, 0, 0);
    const ratio = picture.width / this.stage.clientWidth;
    context.scale(ratio, ratio);
    for (const label of this.stage.querySelectorAll('.nearest-label:not([hidden])'))
      new CanvasPainter(context).text(label.textContent, label.offsetLeft + 8, label.offsetTop, {
        colour: colours.text,
        size: 12,
        weight: 600,
        halo: colours.surface,
      });
    picture.toBlob((blob) => save(blob, `${this.run.title} replay ${this.state.time.toFixed(3)} s.png`));
  }
}

const inMillimetres = (nearest) =>
  Number.isFinite(nearest?.distance) ? `${number(1000 * nearest.distance, 3)} mm` : '';

/** "link3 – table: 34 mm, stop in 0.21 s". */
function describe(nearest) {
  if (!nearest) return '';
  const { distance, link, other, stop } = nearest;
  const near = distance === Infinity ? 'nothing near' : `${link} – ${other}: ${inMillimetres(nearest)}`;
  const texts = [Number.isFinite(stop) ? `stop in ${fixed(stop, 2)} s` : 'no stop'];
  if (!Number.isNaN(distance)) texts.unshift(near);
  return texts.join(', ');
}

/** Whether the arm comes nearer to anything than it should. */
const isTooNear = (c, time) => c.nearestAt(time)?.distance < c.environment?.safety_distance_m;
