// The operator's hand: whatever moves it (a dragged frame, keys, a gamepad, sliders, a headset, a phone), one message tells
// it. It moves while a switch is held. Where it shall go it goes no faster than a hand; what a device measures goes out as it is.
import { Quaternion, Vector3 } from 'three';
import { Emitter } from '../emitter.js';

const PERIOD_MS = 16;
const FASTEST_MPS = 2;
const FASTEST_RADPS = 6;
const FASTEST_JOINT_RADPS = 3;
const KEY_MPS = 0.15;
const KEY_RADPS = 0.6;
const DEAD_ZONE = 0.12;
const RELEASES = 3; // a release is told so often

/** Which way a key moves the hand: axis, sign. */
const KEYS = {
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
  ArrowLeft: [1, 1],
  ArrowRight: [1, -1],
  PageUp: [2, 1],
  PageDown: [2, -1],
};
const SWITCH_BUTTON = 5; // of a gamepad: the right shoulder

/** Emits 'change' when the switch is pressed or released. */
export class Hand extends Emitter {
  scale = 1;
  part = 0;
  #link;
  #by = null; // what holds the switch
  #press = 0;
  #isAllowed = false;
  #isMeasured = false;
  #isTracked = true;
  #position = new Vector3();
  #orientation = new Quaternion();
  #joints;
  #goal = { position: new Vector3(), orientation: new Quaternion(), joints: [] };
  #keys = new Set();
  #turns = false;
  #last = 0;
  #isPadUp = false; // its switch was seen released: one that is merely still held is not pressed
  #releases = 0; // that are to be told once more

  constructor(link, joints) {
    super();
    this.#link = link;
    this.#joints = new Array(joints).fill(0);
    this.#goal.joints = [...this.#joints];
    setInterval(() => this.#step(), PERIOD_MS);
    // Whoever does not see the arm does not move it.
    document.addEventListener('visibilitychange', () => this.release());
    document.addEventListener('freeze', () => this.release());
    for (const event of ['pagehide', 'blur']) addEventListener(event, () => this.release());
    addEventListener('keydown', (event) => this.#keyDown(event));
    addEventListener('keyup', (event) => this.#keyUp(event));
    link.on('close', () => this.release());
  }

  get isPressed() {
    return this.#by !== null;
  }

  isPressedBy(by) {
    return this.#by === by;
  }

  /** Only an operator of a running arm has a hand. */
  allow(isAllowed) {
    this.#isAllowed = isAllowed;
    if (!isAllowed) this.release();
  }

  /**
   * Takes the switch for `by`; false where another thing holds it or nothing may.
   * @param isMeasured track() follows, not move()
   */
  press(by, { position = null, orientation = null, joints = null, isMeasured = false, isTracked = true } = {}) {
    if (!this.#isAllowed || (this.#by !== null && this.#by !== by)) return false;
    if (this.#by === by) return true;
    this.#by = by;
    this.#press += 1;
    this.#isMeasured = isMeasured;
    this.#isTracked = isTracked;
    if (position) this.#position.copy(position);
    if (orientation) this.#orientation.copy(orientation);
    if (joints) this.#joints = [...joints];
    this.move(by, { position: this.#position, orientation: this.#orientation, joints: this.#joints });
    this.#last = performance.now();
    this.#send();
    this.emit('change');
    return true;
  }

  /** Where the hand shall go. */
  move(by, { position = null, orientation = null, joints = null }) {
    if (this.#by !== by) return;
    if (position) this.#goal.position.copy(position);
    if (orientation) this.#goal.orientation.copy(orientation);
    if (joints) this.#goal.joints = [...joints];
  }

  /** What a device measures. A hand that it lost stays lost until the next press. */
  track(by, { position = null, orientation = null, isTracked }) {
    if (this.#by !== by) return;
    if (position) this.#position.copy(position);
    if (orientation) this.#orientation.copy(orientation);
    this.#isTracked &&= isTracked;
    this.#send();
  }

  /** Lets go; without `by` whatever holds the switch. */
  release(by = this.#by) {
    if (this.#by === null || this.#by !== by) return;
    this.#by = null;
    this.#keys.clear();
    this.#send();
    this.#releases = RELEASES - 1;
    this.emit('change');
  }

  #step() {
    const now = performance.now();
    const dt = Math.min((now - this.#last) / 1000, 0.1);
    this.#last = now;
    this.#readKeys(dt);
    this.#readGamepad(dt);
    if (!this.isPressed) {
      if (this.#releases > 0) this.#send();
      this.#releases = Math.max(0, this.#releases - 1);
      return;
    }
    if (this.#isMeasured) return;
    const way = this.#goal.position.clone().sub(this.#position);
    this.#position.add(way.clampLength(0, FASTEST_MPS * dt));
    this.#orientation.rotateTowards(this.#goal.orientation, FASTEST_RADPS * dt);
    this.#joints = this.#joints.map((value, i) => {
      const step = FASTEST_JOINT_RADPS * dt;
      return value + Math.min(step, Math.max(-step, this.#goal.joints[i] - value));
    });
    this.#send();
  }

  #send() {
    const { x, y, z, w } = this.#orientation;
    this.#link.sendHand({
      press: this.#press,
      isPressed: this.isPressed,
      isTracked: this.#isTracked,
      part: this.part,
      scale: this.scale,
      position: this.#position.toArray(),
      orientation: [w, x, y, z],
      joints: this.#joints,
    });
  }

  #keyDown(event) {
    const { target, key } = event;
    if (!KEYS[key] || event.ctrlKey || event.metaKey || event.altKey) return;
    if (target instanceof HTMLElement && target.closest('input, select, textarea')) return;
    if (this.#joints.length > 0 || !this.#isAllowed) return;
    event.preventDefault(); // the page does not scroll meanwhile
    this.#turns = event.shiftKey;
    if (event.repeat && !this.#keys.has(key)) return; // held since before it counted
    this.#keys.add(key);
    this.press('keys');
  }

  #keyUp({ key, shiftKey }) {
    this.#turns = shiftKey;
    if (this.#keys.delete(key) && this.#keys.size === 0) this.release('keys');
  }

  /** Moves the goal at a velocity. */
  #drive(by, velocity, turn, dt) {
    if (this.#by !== by) return;
    this.#goal.position.addScaledVector(velocity, dt);
    const angle = turn.length() * dt;
    if (angle > 0) this.#goal.orientation.premultiply(new Quaternion().setFromAxisAngle(turn.clone().normalize(), angle));
  }

  #readKeys(dt) {
    if (this.#keys.size === 0) return;
    const way = new Vector3();
    for (const key of this.#keys) {
      const [axis, sign] = KEYS[key];
      way.setComponent(axis, way.getComponent(axis) + sign);
    }
    const none = new Vector3();
    if (this.#turns) this.#drive('keys', none, way.clone().multiplyScalar(KEY_RADPS), dt);
    else this.#drive('keys', way.multiplyScalar(KEY_MPS), none, dt);
  }

  /** Left stick: forward and sideways; right stick: up and about the vertical; while the right shoulder is held. */
  #readGamepad(dt) {
    const pad = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.connected && one.axes.length >= 4);
    const isHeld = Boolean(pad?.buttons[SWITCH_BUTTON]?.pressed) && this.#joints.length === 0;
    const wasUp = this.#isPadUp;
    this.#isPadUp = Boolean(pad) && !isHeld;
    if (!isHeld) return this.release('gamepad');
    if (this.#by !== 'gamepad' && !(wasUp && this.press('gamepad'))) return;
    const [x, y, turn, up] = pad.axes.map((value) => (Math.abs(value) < DEAD_ZONE ? 0 : value));
    const velocity = new Vector3(-y, -x, -up).multiplyScalar(KEY_MPS);
    this.#drive('gamepad', velocity, new Vector3(0, 0, -turn * KEY_RADPS), dt);
  }
}
