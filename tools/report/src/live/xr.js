// The arm in a headset: it stands in the room at its true size, and a controller whose trigger or grip is held moves the tool.
// Also a phone that shows the arm in its camera's picture: it is the hand itself while a finger is on it.
import { AxesHelper, CanvasTexture, Color, GridHelper, Group, Matrix4, Object3D, PerspectiveCamera, Quaternion, Sprite, SpriteMaterial, Vector3 } from 'three';
import { button, choice, el } from '../dom.js';
import { font } from '../painter.js';
import { colours } from '../theme.js';
import { limitsOf } from './limits.js';

const MODES = [
  ['immersive-vr', 'VR', 'The arm in a headset'],
  ['immersive-ar', 'AR', 'The arm in the room around you'],
];
const STANDS = ['behind the arm', 'at its right', 'in front of it', 'at its left'];
const BY = 'headset';
const SPACE = 'local-floor';
const CHEST_M = 1.2; // so high above the floor is the middle of an arm that does not reach up to there
const AWAY_M = 0.3; // from the arm's reach
const NEAR_M = 0.05;
const FAR_M = 50;
const RUMBLE_MS = 100;
const LINE_PX = 60;
/** From the room's axes (x right, y up, z backwards) to the base's (x forward, y left, z up). */
const TO_BASE = new Matrix4().makeBasis(new Vector3(0, -1, 0), new Vector3(0, 0, 1), new Vector3(-1, 0, 0));

export class Headset {
  /** Where the operator stands: quarter turns about the arm, counter-clockwise, from behind it. */
  stand = 0;
  #view;
  #hand;
  #link;
  #session = null;
  #space = null;
  #source = null; // what is pressed
  #isNew = false; // since the last picture
  #isLost = false; // until it is pressed anew
  #rig = new Object3D(); // the room, in the base's axes
  #eye = new PerspectiveCamera(60, 1, NEAR_M, FAR_M);
  #marks = new Group();
  #note = new Note();
  #rumbled = 0;
  #wasActing = false;
  #wasRefused = false;

  constructor(view, hand, link) {
    this.#view = view;
    this.#hand = hand;
    this.#link = link;
    this.#rig.add(this.#eye, this.#marks);
  }

  /** Buttons for what this browser has; none where it has no headset. */
  controls() {
    const row = el('span.buttons.headset', { hidden: true });
    const title = 'Where you stand in the headset';
    const stand = choice({ 'aria-label': title, title }, STANDS.map((text, value) => [value, text]), null, (value) => (this.stand = Number(value)));
    for (const [mode, text, tip] of MODES) {
      navigator.xr?.isSessionSupported(mode).then(
        (isSupported) => {
          if (!isSupported) return;
          row.append(button({ text, title: tip, onclick: () => this.enter(mode) }));
          row.append(stand); // after the last button
          row.hidden = false;
        },
        () => {}, // a browser that may not tell has none
      );
    }
    return row;
  }

  /** Shows the arm in the headset until the session ends; must be called by a gesture of the user. */
  async enter(mode) {
    if (this.#session) return;
    const session = await navigator.xr.requestSession(mode, { requiredFeatures: [SPACE] });
    this.#session = session;
    this.#place(mode === 'immersive-vr');
    for (const event of ['selectstart', 'squeezestart']) session.addEventListener(event, ({ inputSource }) => this.#press(inputSource));
    for (const event of ['selectend', 'squeezeend'])
      session.addEventListener(event, ({ inputSource }) => inputSource === this.#source && this.#release());
    session.addEventListener('inputsourceschange', ({ removed }) => [...removed].includes(this.#source) && this.#lose());
    session.addEventListener('visibilitychange', () => session.visibilityState !== 'visible' && this.#lose());
    session.addEventListener('end', () => this.#leave());
    try {
      this.#space = await this.#view.present(session, this.#eye, (frame) => this.#follow(frame));
    } catch (error) {
      await session.end();
      throw error;
    }
    this.#space.addEventListener('reset', () => this.#lose()); // what was here is elsewhere now
  }

  /** What the operator must know, in the headset too. */
  say(text) {
    if (this.#session) this.#note.write(text);
  }

  /** What it was told last. */
  get text() {
    return this.#note.text;
  }

  #leave() {
    this.#release();
    this.#session = null;
    this.#space = null;
    this.#view.scene.remove(this.#rig, this.#note.sprite);
    this.#view.scene.background = null;
  }

  #place(isOpaque) {
    const { bounds, scene } = this.#view;
    const turn = new Quaternion().setFromAxisAngle(new Vector3(0, 0, 1), (this.stand * Math.PI) / 2);
    const rig = this.#rig;
    rig.position.set(-(bounds.radius + AWAY_M), 0, -Math.max(0, CHEST_M - bounds.center.z)).applyQuaternion(turn);
    rig.quaternion.setFromRotationMatrix(TO_BASE).premultiply(turn);
    this.#marks.clear();
    rig.remove(...rig.children.filter((child) => child instanceof GridHelper));
    if (isOpaque) rig.add(new GridHelper(8, 16, colours.limit, colours.line));
    scene.background = isOpaque ? new Color(colours.background) : null;
    this.#note.sprite.position.copy(bounds.center).setZ(bounds.center.z + bounds.radius);
    scene.add(rig, this.#note.sprite);
  }

  #press(source) {
    if (this.#source && !this.#isLost) return;
    this.#hand.release(BY);
    this.#source = source;
    this.#isNew = true;
    this.#isLost = false;
  }

  #release() {
    this.#source = null;
    this.#hand.release(BY);
  }

  #lose() {
    this.#isLost = true;
    this.#hand.track(BY, { isTracked: false });
  }

  /** The pose of an input in the room; a finger on a screen has none, but the screen has. */
  #poseOf(frame, source) {
    if (source.targetRayMode === 'screen') return frame.getViewerPose(this.#space);
    return frame.getPose(source.gripSpace ?? source.targetRaySpace, this.#space);
  }

  /** Before each picture. */
  #follow(frame) {
    this.#rig.updateMatrixWorld(true);
    this.#mark(frame);
    this.#rumble();
    if (!this.#source || this.#isLost) return;
    const pose = this.#poseOf(frame, this.#source);
    const isTracked = Boolean(pose) && !pose.emulatedPosition && frame.session.visibilityState === 'visible';
    const hand = { isTracked };
    if (pose) {
      const { position, orientation } = pose.transform;
      hand.position = new Vector3().copy(position).applyMatrix4(this.#rig.matrixWorld);
      hand.orientation = new Quaternion().copy(orientation).premultiply(this.#rig.quaternion);
    }
    if (this.#isNew) {
      this.#isNew = false;
      if (!this.#hand.press(BY, { ...hand, isMeasured: true })) this.#source = null;
    } else this.#hand.track(BY, hand);
    if (!isTracked) this.#isLost = true;
  }

  /** Axes where the controllers are. */
  #mark(frame) {
    const poses = [...frame.session.inputSources]
      .filter(({ targetRayMode }) => targetRayMode !== 'screen')
      .map((source) => this.#poseOf(frame, source))
      .filter(Boolean);
    while (this.#marks.children.length < poses.length) this.#marks.add(new AxesHelper(0.06));
    this.#marks.children.forEach((mark, i) => {
      mark.visible = i < poses.length;
      if (!mark.visible) return;
      mark.position.copy(poses[i].transform.position);
      mark.quaternion.copy(poses[i].transform.orientation);
    });
  }

  /** A limit that acts is felt, strongest when it begins; so is a refusal. */
  #rumble() {
    const { frame } = this.#link;
    if (!frame || !this.#source) return;
    const isActing = limitsOf(frame, this.#view.run).some(Boolean);
    const isRefused = frame('hand')[0] === 3;
    const now = performance.now();
    if (isRefused && !this.#wasRefused) this.#pulse(1, 3 * RUMBLE_MS);
    else if (isActing && !isRefused && now - this.#rumbled >= RUMBLE_MS) {
      this.#pulse(this.#wasActing ? 0.3 : 0.8, RUMBLE_MS);
      this.#rumbled = now;
    }
    this.#wasActing = isActing;
    this.#wasRefused = isRefused;
  }

  #pulse(strength, duration) {
    const { gamepad } = this.#source;
    if (gamepad?.hapticActuators?.[0]?.pulse) gamepad.hapticActuators[0].pulse(strength, duration);
    else gamepad?.vibrationActuator?.playEffect?.('dual-rumble', { duration, strongMagnitude: strength, weakMagnitude: strength });
  }
}

/** A line of text above the arm, or two. */
class Note {
  text = '';
  #canvas = el('canvas', { width: 1280, height: 2 * LINE_PX + 32 });
  #texture = new CanvasTexture(this.#canvas);
  sprite = new Sprite(new SpriteMaterial({ map: this.#texture, depthTest: false, transparent: true }));

  constructor() {
    this.sprite.scale.set(this.#canvas.width / 1000, this.#canvas.height / 1000, 1);
    this.sprite.renderOrder = 9;
  }

  write(text) {
    if (text === this.text) return;
    this.text = text;
    const { width, height } = this.#canvas;
    const context = this.#canvas.getContext('2d');
    context.clearRect(0, 0, width, height);
    if (text) {
      context.font = font(44);
      const widthOf = (line) => context.measureText(line).width;
      const lines = widthOf(text) <= width - 48 ? [text] : halve(text, widthOf);
      const half = Math.min(width / 2, Math.max(...lines.map(widthOf)) / 2 + 24);
      const top = (height - lines.length * LINE_PX) / 2;
      context.fillStyle = colours.surface;
      context.globalAlpha = 0.85;
      context.fillRect(width / 2 - half, top - 8, 2 * half, lines.length * LINE_PX + 16);
      context.globalAlpha = 1;
      context.fillStyle = colours.text;
      context.textAlign = 'center';
      context.textBaseline = 'middle';
      lines.forEach((line, i) => context.fillText(line, width / 2, top + (i + 0.5) * LINE_PX, width - 24));
    }
    this.#texture.needsUpdate = true;
  }
}

/** A text in two lines that are about as long. */
function halve(text, widthOf) {
  const words = text.split(' ');
  const ways = words.slice(1).map((_, i) => [words.slice(0, i + 1).join(' '), words.slice(i + 1).join(' ')]);
  const longest = (lines) => Math.max(...lines.map(widthOf));
  return ways.reduce((best, way) => (longest(way) < longest(best) ? way : best), [text]);
}
