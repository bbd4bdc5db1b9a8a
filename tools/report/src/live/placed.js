import { Group, Mesh, MeshStandardMaterial, Vector3 } from 'three';
import { TransformControls } from 'three/examples/jsm/controls/TransformControls.js';
import { button, el, freeKeys } from '../dom.js';
import { fixed } from '../format.js';
import { placed, readShape } from '../scene.js';
import { colours } from '../theme.js';

const SEND_MS = 33;
const BALL_M = 0.06;
const BOX_M = [0.14, 0.14, 0.14];
const SIZES_M = [0.02, 0.5]; // a ball's diameter, a box's edges
const AHEAD_M = 0.35; // of the tool, where a new one appears

/** Boxes and balls that are put around the arm while it moves: a list, and in the view what is dragged. */
export class Placed {
  #ones = new Map(); // by place: {message, mesh}
  #chosen = 0;
  #sent = 0; // when [ms]
  #pending = null;
  #frame = null;

  constructor(host, run, link, view) {
    this.run = run;
    this.link = link;
    this.view = view;
    this.root = new Group();
    view.scene.add(this.root);
    this.control = new TransformControls(view.camera, view.renderer.domElement);
    this.control.setSize(0.7);
    view.scene.add(this.control.getHelper());
    this.control.addEventListener('change', () => view.ask());
    this.control.addEventListener('dragging-changed', ({ value }) => (view.orbit.enabled = !value));
    this.control.addEventListener('objectChange', () => this.#drag());
    this.control.addEventListener('axis-changed', ({ value }) => view.yieldDrag(value !== null));
    for (const event of ['pointercancel', 'lostpointercapture'])
      view.renderer.domElement.addEventListener(event, () => {
        this.control.dragging = false; // the controls know only of a pointer that goes up
        this.control.axis = null;
      });
    const title = 'Beside the tool; then drag it';
    this.buttons = [
      button({ text: 'Add a ball', title, onclick: () => this.add({ ball: BALL_M }) }),
      button({ text: 'Add a box', title, onclick: () => this.add({ box: BOX_M }) }),
    ];
    this.list = el('ul.placed');
    this.size = el('input', {
      type: 'range', min: SIZES_M[0], max: SIZES_M[1], step: 0.01, 'aria-label': 'Size',
      oninput: () => this.#resize(Number(this.size.value)),
    });
    freeKeys(this.size);
    host.append(
      el('div.card-head', el('h2', { text: 'Obstacles by hand' })),
      el('div.buttons', ...this.buttons),
      this.list,
      el('label.placed-size', 'Size ', this.size),
      el('p.hint', { text: 'The arm keeps clear of them as of all others, as far as it can still avoid it.' }),
    );
    host.hidden = false;
    link.on('placed', () => this.#take(link.placed));
    link.on('people open close', () => this.#update());
    this.#take(link.placed);
  }

  get mayPlace() {
    return this.link.isOpen && (this.link.isOperator || !this.run.moves);
  }

  show(frame) {
    this.#frame = frame;
  }

  /** @param {{ball?: number, box?: number[]}} shape */
  add(shape) {
    const place = Array.from({ length: this.run.places }, (_, i) => i + 1).find((one) => !this.#ones.has(one));
    if (!place || !this.mayPlace || !this.#frame) return;
    const tool = new Vector3(...this.#frame('tool'));
    const out = new Vector3(tool.x, tool.y, 0);
    if (!(out.length() > 1e-6)) out.set(1, 0, 0);
    this.#put({ place, ...shape, at: tool.add(out.setLength(AHEAD_M)).toArray() });
    this.#choose(place);
  }

  remove(place) {
    this.#ones.delete(place);
    this.#send({ place });
    this.#redraw();
  }

  #put(message) {
    this.#ones.set(message.place, message);
    this.#send(message);
    this.#redraw();
  }

  /** Not more often than it can be seen; the last one always. */
  #send(message) {
    const now = performance.now();
    if (this.#pending && this.#pending.place !== message.place) this.#flush();
    this.#pending = message;
    if (now - this.#sent >= SEND_MS) this.#flush();
    else setTimeout(() => this.#flush(), SEND_MS);
  }

  #flush() {
    if (!this.#pending) return;
    this.link.say(JSON.stringify(this.#pending));
    this.#sent = performance.now();
    this.#pending = null;
  }

  #drag() {
    const message = this.#ones.get(this.#chosen);
    const mesh = this.control.object;
    if (!message || !mesh || !this.control.dragging || !this.mayPlace) return;
    message.at = mesh.position.toArray();
    this.#send({ ...message });
  }

  #resize(size) {
    const message = this.#ones.get(this.#chosen);
    if (message && this.mayPlace) this.#put(message.ball ? { ...message, ball: size / 2 } : { ...message, box: [size, size, size] });
  }

  /** What the program says is there; what is being dragged stays with the hand. */
  #take(all) {
    const held = this.control.dragging ? this.#ones.get(this.#chosen) : null;
    this.#ones = new Map(all.map((message) => [message.place, message]));
    if (held) this.#ones.set(held.place, held);
    else this.#redraw();
  }

  #choose(place) {
    this.#chosen = this.#chosen === place ? 0 : place;
    this.#redraw();
  }

  #redraw() {
    if (!this.#ones.has(this.#chosen)) this.#chosen = 0;
    this.control.detach();
    for (const child of [...this.root.children]) {
      child.geometry.dispose();
      child.material.dispose();
      this.root.remove(child);
    }
    for (const [place, { ball, box, at, turn }] of this.#ones) {
      const pose = { xyz: at, quat: turn };
      const shape = ball ? { type: 'sphere', radius: ball, pose } : { type: 'box', size: box, pose };
      const read = readShape(this.run, shape, 'placed');
      const material = new MeshStandardMaterial({ roughness: 0.9, transparent: true, opacity: 0.62, color: colours.obstacle });
      const mesh = placed(new Mesh(read.geometry, material), read);
      this.root.add(mesh);
      if (place === this.#chosen && this.mayPlace) this.control.attach(mesh);
    }
    this.#update();
    this.view.ask();
  }

  #update() {
    const may = this.mayPlace;
    if (!may) this.control.detach();
    for (const one of this.buttons) one.disabled = !may || this.#ones.size >= this.run.places;
    const chosen = this.#ones.get(this.#chosen);
    this.size.disabled = !may || !chosen;
    if (chosen) this.size.value = chosen.ball ? 2 * chosen.ball : chosen.box[0];
    this.list.replaceChildren(
      ...[...this.#ones.values()].sort((a, b) => a.place - b.place).map(({ place, ball, box }) =>
        el(
          'li',
          button({
            'aria-pressed': String(place === this.#chosen), disabled: !may,
            text: `placed ${place}: ${ball ? `ball, ${fixed(200 * ball, 0)} cm` : `box, ${fixed(100 * box[0], 0)} cm`}`,
            onclick: () => this.#choose(place),
          }),
          button({ text: 'Remove', disabled: !may, onclick: () => this.remove(place) }),
        ),
      ),
    );
  }
}
