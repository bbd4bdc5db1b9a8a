import { AxesHelper, Mesh, MeshBasicMaterial, Object3D, Quaternion, SphereGeometry, Vector3 } from 'three';
import { TransformControls } from 'three/examples/jsm/controls/TransformControls.js';
import { el } from '../dom.js';
import { inNewtons } from '../format.js';
import { Picture } from '../picture.js';
import { Arm, readSurfaces } from '../scene.js';
import { describeContact, ForceArrow, forceScale, NearestLine, Surroundings } from '../surroundings.js';
import { colours, limitColour } from '../theme.js';
import { limitsOf } from './limits.js';
import { contactOf } from './panel.js';

const SLOW_MS = 40; // a picture that takes longer is made of fewer pixels
const LONGEST_GAP_MS = 250;
const LEAST_RATIO = 0.35;

/** The arm as it is, its stop, its real twin, what stands around it, and the frame by which a hand drags the tool. */
export class View extends Picture {
  #asked = false;
  #frame = null;
  #ratio = Math.min(devicePixelRatio, 2);
  #gap = 0; // before the next picture [ms]
  #eye = null; // of a headset, while it shows the arm
  took = 0; // one of the last pictures [ms]
  #isShown = { stop: true, obstacles: true, nearest: true, contact: true };
  #hardest = 0; // that the arm has pressed so far [N]

  /** @param {boolean} isSoftware without a graphics card: no smooth edges */
  constructor(stage, run, hand, isSoftware) {
    super(stage, run, 'The arm now. Drag to turn the view, wheel to zoom, drag the arrows to move the tool.', !isSoftware);
    this.hand = hand;
    const surfaces = readSurfaces(run);
    this.nominal = new Arm(run, surfaces);
    this.real = run.hasReal ? new Arm(run, surfaces, { outline: 0.008 * this.size }) : null;
    this.stop = new Arm(run, surfaces, { opacity: 0.34 });
    this.line = run.environment ? new NearestLine(stage, this.size) : null;
    this.arrow = run.hasContact ? new ForceArrow(stage, this.size) : null;
    this.text = el('p.nearest-text', { hidden: true });
    stage.append(this.text);
    for (const one of [this.nominal, this.real, this.stop, this.line, this.arrow]) if (one) this.scene.add(one.root);
    this.target = this.#makeTarget();
    this.#makeHandle();

    new ResizeObserver(() => this.#resize()).observe(stage);
  }

  /** Where the command is: a ball and three axes. */
  #makeTarget() {
    const target = new Object3D();
    this.ball = new Mesh(
      new SphereGeometry(0.012 * this.size, 24, 16),
      new MeshBasicMaterial({ transparent: true, opacity: 0.9, depthTest: false }),
    );
    this.ball.renderOrder = 7;
    const axes = new AxesHelper(0.09 * this.size);
    axes.material.depthTest = false;
    axes.renderOrder = 7;
    target.add(this.ball, axes);
    target.visible = false;
    this.scene.add(target);
    return target;
  }

  /** The frame at the tool that can be dragged; while nobody does it follows the tool. */
  #makeHandle() {
    this.handle = new Object3D();
    this.scene.add(this.handle);
    this.drag = new TransformControls(this.camera, this.renderer.domElement);
    this.drag.setSpace('world');
    this.drag.setSize(0.85);
    this.scene.add(this.drag.getHelper());
    this.drag.addEventListener('change', () => this.ask());
    const { position, quaternion: orientation } = this.handle;
    this.drag.addEventListener('mouseDown', () => {
      this.orbit.enabled = false;
      this.hand.press('drag', { position, orientation });
    });
    this.drag.addEventListener('objectChange', () => this.hand.move('drag', { position, orientation }));
    const letGo = () => {
      this.orbit.enabled = true;
      this.hand.release('drag');
    };
    this.drag.addEventListener('mouseUp', letGo);
    // A finger or a pen that the system takes away lets go, too.
    for (const event of ['pointercancel', 'lostpointercapture'])
      this.renderer.domElement.addEventListener(event, () => {
        this.#endDrag();
        letGo();
      });
    this.allowDrag(false);
  }

  /** A headset shows the arm: nobody sees the page. */
  get isWorn() {
    return this.#eye !== null;
  }

  /** The frame is not held any more: disabled during a drag, the controls would go on with it later. */
  #endDrag() {
    this.drag.dragging = false;
    this.drag.axis = null;
  }

  allowDrag(isAllowed) {
    if (isAllowed === (this.drag.object !== undefined)) return;
    if (isAllowed) this.drag.attach(this.handle);
    else this.drag.detach();
    this.drag.enabled = isAllowed;
    if (!isAllowed) this.#endDrag();
    this.ask();
  }

  /** The pointer is on a handle of something else: the tool is not dragged along. */
  yieldDrag(isTaken) {
    if (!this.drag.dragging) this.drag.enabled = !isTaken && this.drag.object !== undefined;
  }

  /** 'translate' or 'rotate'. */
  setMode(mode) {
    this.drag.setMode(mode);
  }

  togglePart(part) {
    this.#isShown[part] = !this.#isShown[part];
    this.ask();
    return this.#isShown[part];
  }

  show(frame) {
    const isFirst = this.#frame === null;
    this.#frame = frame;
    if (isFirst) {
      this.#pose();
      this.#findBounds();
      this.paint();
      this.resetCamera();
    }
    this.ask();
  }

  #findBounds() {
    this.bound(this.nominal);
    this.bounds.radius *= 1.15;
    if (!this.run.environment) return;
    this.surroundings = new Surroundings(this.run, this.run.environment, this.bounds);
    this.scene.add(this.surroundings.root);
  }

  resetCamera() {
    this.lookFrom([0.72, -0.86, 0.4], 1 / Math.min(1, this.camera.aspect));
  }

  paint() {
    if (!this.bounds) return;
    this.surroundings?.paint(colours.obstacle);
    this.nominal.paint(null, colours.arm);
    this.real?.paint(colours.accent, colours.accent);
    this.stop.paint(colours.accent, colours.accent);
    this.arrow?.paint(colours.force);
    this.ball.material.color.set(colours.cases[1]);
    this.paintFloor();
  }

  #resize() {
    if (this.#eye || this.stage.clientWidth * this.stage.clientHeight === 0) return;
    this.renderer.setPixelRatio(this.#ratio);
    if (this.fit()) this.ask();
  }

  /** A picture soon; where pictures take long, as long again is left for all else. */
  ask() {
    if (this.#asked || this.#eye) return;
    this.#asked = true;
    const draw = () => {
      const asked = performance.now();
      requestAnimationFrame(() => {
        this.#asked = false;
        if (this.#eye) return;
        this.#draw();
        setTimeout(() => this.#adapt(performance.now() - asked)); // with what the browser does after it
      });
    };
    if (this.#gap > 0) setTimeout(draw, this.#gap);
    else draw();
  }

  #pose() {
    const frame = this.#frame;
    this.nominal.pose(frame('q'));
    const has = (values) => values.every(Number.isFinite);
    if (this.real) {
      this.real.root.visible = has(frame('real_q'));
      if (this.real.root.visible) this.real.pose(frame('real_q'));
    }
    this.stop.root.visible = this.#isShown.stop && has(frame('rest_q'));
    if (this.stop.root.visible) this.stop.pose(frame('rest_q'));
    const place = (object, [x, y, z, w, i, j, k]) => {
      object.position.set(x, y, z);
      object.quaternion.copy(new Quaternion(i, j, k, w));
    };
    this.target.visible = this.run.moves === 'tool' && has(frame('target'));
    if (this.target.visible) place(this.target, frame('target'));
    if (!this.drag.dragging) place(this.handle, frame('tool'));
  }

  #draw() {
    if (!this.#frame) return;
    this.#pose();
    const acting = limitsOf(this.#frame, this.run);
    this.nominal.tint((joint) => (acting[joint] ? limitColour(acting[joint]) : null));
    if (this.surroundings) {
      this.surroundings.root.visible = this.#isShown.obstacles;
      this.surroundings.show(this.#frame('time_s')[0]);
    }
    this.#drawNearest();
    this.#drawContact();
    this.renderer.render(this.scene, this.#eye ?? this.camera);
    if (this.stage.dataset.pictures === undefined) this.stage.dataset.firstPicture = performance.now().toFixed(0);
    this.stage.dataset.pictures = String(Number(this.stage.dataset.pictures ?? 0) + 1);
  }

  #drawNearest() {
    if (!this.line) return;
    const distance = this.#frame('clearance')[0];
    const isKnown = this.#isShown.nearest && Number.isFinite(distance);
    this.line.show(
      isKnown ? { distance, onArm: [...this.#frame('on_arm')], onObstacle: [...this.#frame('on_obstacle')] } : null,
    );
    const isNear = distance < this.run.environment.safety_distance_m;
    this.line.paint(isNear ? colours.bad : colours.text);
    this.label(this.line, isKnown ? `${Math.round(1000 * distance)} mm` : '');
    this.line.label.classList.toggle('bad', isNear);
  }

  #drawContact() {
    const contact = this.arrow && this.#isShown.contact ? contactOf(this.#frame, this.run) : null;
    this.#hardest = Math.max(this.#hardest, contact?.pressing ?? 0);
    const perDecimetre = forceScale(this.#hardest, this.size);
    this.arrow?.show(contact, perDecimetre);
    this.label(this.arrow, contact ? inNewtons(contact.pressing) : '');
    this.text.hidden = !contact;
    if (contact) this.text.textContent = `${describeContact(contact)}; arrow: 0.1 m is ${inNewtons(perDecimetre)}`;
  }

  #adapt(took) {
    this.took += 0.2 * (took - this.took);
    this.#gap = this.took > SLOW_MS ? Math.min(2 * this.took, LONGEST_GAP_MS) : 0;
    if (this.took < SLOW_MS || this.#ratio <= LEAST_RATIO) return;
    this.#ratio = Math.max(LEAST_RATIO, this.#ratio * 0.8);
    this.#resize();
    if (!this.#eye) this.#draw(); // a canvas whose size changes is empty until then
  }

  /**
   * Shows the arm in a headset instead, until the session ends.
   * @param eye a camera whose parent is the room
   * @param onFrame called with the XRFrame before each picture
   * @returns the reference space of the room
   */
  async present(session, eye, onFrame) {
    const { xr } = this.renderer;
    const onPage = [this.drag.getHelper(), this.floor].filter(Boolean);
    xr.enabled = true;
    session.addEventListener('end', () => {
      this.renderer.setAnimationLoop(null);
      xr.enabled = false;
      this.#eye = null;
      for (const one of onPage) one.visible = true;
      this.#resize();
    });
    await xr.setSession(session);
    for (const one of onPage) one.visible = false;
    this.#eye = eye;
    this.renderer.setAnimationLoop((_, frame) => {
      if (!frame || !this.#eye) return;
      onFrame(frame);
      this.#draw();
    });
    return xr.getReferenceSpace();
  }

  /** Where a point of the base frame is in the window, for tests and scripts. */
  project(point) {
    const { x, y } = new Vector3(...point).project(this.camera);
    const { left, top, width, height } = this.renderer.domElement.getBoundingClientRect();
    return { x: left + ((1 + x) / 2) * width, y: top + ((1 - y) / 2) * height };
  }
}
