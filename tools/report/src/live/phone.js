// A phone that is turned: while a finger holds the pad, the tool turns as the phone does.
import { Euler, Quaternion, Vector3 } from 'three';
import { button, el } from '../dom.js';

const BY = 'phone';
const PERIOD_MS = 16;
const UP = new Vector3(0, 0, 1);
const RADIAN = Math.PI / 180;

/** Where a device is turned to, in axes east, north, up, or null where it has no sensor. */
const orientationOf = ({ alpha, beta, gamma }) =>
  [alpha, beta, gamma].includes(null) ? null : new Quaternion().setFromEuler(new Euler(beta * RADIAN, gamma * RADIAN, alpha * RADIAN, 'ZXY'));

/** Which way something looks from above [rad]. */
const headingOf = ({ x, y }) => Math.atan2(y, x);

/** A pad for phones; null for what is no phone. */
export function phonePad(view, hand) {
  if (!('DeviceOrientationEvent' in globalThis) || !matchMedia('(pointer: coarse)').matches) return null;
  let orientation = null; // now
  let toBase = new Quaternion(); // since the pad is held
  let timer = 0;
  const note = el('p.hint', { role: 'status', text: 'The tool turns as the phone does, seen in the picture above.' });
  const enable = button({ text: 'Turn it with this phone', onclick: () => begin() });
  const pad = button({ class: 'pad', text: 'Hold, and turn the phone', hidden: true });

  async function begin() {
    // iOS asks the user, and only when a gesture did; others just tell.
    const answer = await DeviceOrientationEvent.requestPermission?.().catch(() => 'denied');
    if (answer !== undefined && answer !== 'granted') {
      note.textContent = 'This browser does not tell how the phone is turned: allow it in its settings, and load the page again.';
      return;
    }
    addEventListener('deviceorientation', (event) => (orientation = orientationOf(event)));
    enable.hidden = true;
    pad.hidden = false;
  }

  /** What lies ahead on the screen lies ahead in the picture, however the phone is held and wherever north is. */
  function findAxes() {
    const turned = (screen.orientation?.angle ?? 0) * RADIAN;
    const ahead = new Vector3(0, 1, -1).applyAxisAngle(UP, -turned).applyQuaternion(orientation);
    const seen = view ? view.camera.getWorldDirection(new Vector3()) : new Vector3(1, 0, 0);
    toBase.setFromAxisAngle(UP, headingOf(seen) - headingOf(ahead));
  }

  const measure = () => ({ isTracked: orientation !== null, ...(orientation && { orientation: toBase.clone().multiply(orientation) }) });

  pad.addEventListener('pointerdown', (event) => {
    pad.setPointerCapture(event.pointerId);
    if (orientation) findAxes();
    else note.textContent = 'This phone has not told yet how it is turned.';
    if (hand.press(BY, { ...measure(), isMeasured: true })) timer ||= setInterval(() => hand.track(BY, measure()), PERIOD_MS);
  });
  for (const event of ['pointerup', 'pointercancel', 'lostpointercapture']) pad.addEventListener(event, () => hand.release(BY));
  pad.addEventListener('contextmenu', (event) => event.preventDefault()); // a long touch
  hand.on('change', () => {
    pad.classList.toggle('held', hand.isPressedBy(BY));
    if (hand.isPressedBy(BY)) return;
    clearInterval(timer);
    timer = 0;
  });
  return el('div.controls.phone', enable, pad, note);
}
