// The connection to the program: what comes and goes over the WebSocket of the page's own address.
import { Emitter } from '../emitter.js';
import { recall, remember } from '../storage.js';

const PROTOCOL = 'viable.1';
const STORE = 'viable-live-session';
const ALIVE_MS = 2000;
const AGAIN_MS = 1000;
const LATEST_AGAIN_MS = 30_000;
const FAILURES = 3; // in a row, until a page is told that it may not be let in
const SILENT_MS = 1500; // frames come all the while, also of an arm that is held
const LOOK_MS = 250;
const SILENT_LOOKS = 2; // in a row: where the page itself hung, what has come is read before the second one
const HAND_NUMBERS = 10;

const ASK = '(key a in its terminal, or “Invite” on a page that is in).';
const REFUSED = `The program does not let this page in: an address counts once, and until the program ends. Ask it for another one ${ASK}`;
const LOST =
  'The program has ended, or cannot be reached. If the arm still moves, use its own stop: this page cannot stop it. Trying again …';
// A browser does not tell a refusal from a dead network.
const UNREACHED =
  'Cannot be reached. If the arm still moves, use its own stop. If the program was started anew, ask it for another address ' + ASK;

/** What of a hand's motion counts, as in the message. */
export const PARTS = ['both', 'position', 'rotation'];

/**
 * Events: 'open', 'close' (`reason` says why), 'live' (`live`: what does not change), 'people', 'event', 'invitation',
 * 'watch', 'placed' (`placed`: the obstacles by hand), 'silence' (`isSilent`: it is open, and for a while there was no new tick),
 * 'frame' (`frame`: a function of a name to the numbers of that name).
 */
export class Link extends Emitter {
  live = null;
  people = { people: 0, operator: null };
  you = 0;
  event = null;
  invitation = '';
  watch = ''; // where programs such as Foxglove connect
  placed = [];
  reason = '';
  #socket = null;
  #secret;
  #fields = new Map();
  #wasOpen = false; // once, at least
  #failures = 0; // since then
  #echo = 0;
  #time_s = NaN; // of the arm, in the last frame
  #heard = 0; // when it was new [ms]
  #silentLooks = 0;

  constructor() {
    super();
    // The token of the address counts once: it must not stay where others see it.
    this.#secret = location.hash.slice(1) || (recall('sessionStorage', STORE) ?? '');
    if (location.hash) history.replaceState(null, '', location.pathname);
    setInterval(() => this.say('alive'), ALIVE_MS);
    this.#look();
  }

  get isOpen() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  get isSilent() {
    return this.isOpen && this.#silentLooks >= SILENT_LOOKS;
  }

  get isOperator() {
    return this.you !== 0 && this.people.operator === this.you;
  }

  open() {
    const reason = 'Open the address that the program prints, with all that stands behind the # sign.';
    if (!this.#secret) return this.set('close', { reason });
    const socket = new WebSocket(`wss://${location.host}/live`, [PROTOCOL, this.#secret]);
    socket.binaryType = 'arraybuffer';
    socket.onmessage = ({ data }) => (typeof data === 'string' ? this.#hear(JSON.parse(data)) : this.#see(data));
    socket.onclose = () => {
      this.you = 0;
      this.reason = !this.#wasOpen ? REFUSED : this.#failures < FAILURES ? LOST : UNREACHED;
      this.#tellSilence(0);
      this.emit('close');
      if (!this.#wasOpen) return;
      setTimeout(() => this.open(), Math.min(AGAIN_MS * 2 ** this.#failures, LATEST_AGAIN_MS));
      this.#failures += 1;
    };
    this.#socket = socket;
  }

  say(word) {
    if (this.isOpen) this.#socket.send(word);
  }

  /**
   * Sends a hand.
   * @param {{press: number, isPressed: boolean, isTracked: boolean, part: number, scale: number, position: number[],
   *   orientation: number[], joints: number[]}} hand orientation w x y z
   */
  sendHand({ press, isPressed, isTracked, part, scale, position, orientation, joints }) {
    if (!this.isOpen) return;
    const message = new DataView(new ArrayBuffer(8 + 8 * (HAND_NUMBERS + joints.length)));
    message.setUint8(0, 1);
    message.setUint8(1, (isPressed ? 1 : 0) | (isTracked && document.visibilityState === 'visible' ? 2 : 0));
    message.setUint8(2, part);
    message.setUint8(3, joints.length);
    message.setUint32(4, press, true);
    const numbers = [performance.now() / 1000, this.#echo, scale, ...position, ...orientation, ...joints];
    numbers.forEach((value, i) => message.setFloat64(8 + 8 * i, value, true));
    this.#socket.send(message.buffer);
  }

  /** A line that fails without a word leaves the last picture standing; so does a loop that hangs, whose last tick is sent again. */
  #look() {
    const isLate = this.frame !== undefined && performance.now() - this.#heard > SILENT_MS;
    this.#tellSilence(this.isOpen && isLate ? this.#silentLooks + 1 : 0);
    setTimeout(() => this.#look(), LOOK_MS);
  }

  #tellSilence(looks) {
    const wasSilent = this.#silentLooks >= SILENT_LOOKS;
    this.#silentLooks = looks;
    if (looks >= SILENT_LOOKS !== wasSilent) this.emit('silence');
  }

  #hear(message) {
    if (message.hello) {
      this.you = message.you;
      this.#secret = message.session;
      remember('sessionStorage', STORE, message.session); // else the page must be invited anew when it is loaded again
      this.#wasOpen = true;
      this.#failures = 0;
      this.#heard = performance.now();
      this.emit('open');
    } else if (message.format) {
      const isFirst = this.live === null;
      this.live = message;
      let at = 0;
      for (const [name, count] of message.fields) {
        this.#fields.set(name, [at, count]);
        at += count;
      }
      if (isFirst) this.emit('live');
    } else if ('people' in message) this.set('people', { people: message });
    else if (message.event) this.set('event', { event: message });
    else for (const key of ['placed', 'watch', 'invitation']) if (message[key]) this.set(key, { [key]: message[key] });
  }

  #see(bytes) {
    const numbers = new Float64Array(bytes);
    this.#echo = numbers[0];
    this.frame = (name) => {
      const [at, count] = this.#fields.get(name);
      return numbers.subarray(at, at + count);
    };
    if (!this.live) return;
    const [time_s] = this.frame('time_s');
    if (time_s !== this.#time_s) {
      this.#time_s = time_s;
      this.#heard = performance.now();
      this.#tellSilence(0);
    }
    this.emit('frame');
  }
}
