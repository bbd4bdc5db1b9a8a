/**
 * Fingers and wheel on a plot over time. Two fingers zoom, one moves the time in view where it is zoomed; up and down
 * scrolls the page as ever (the style sheet says so: touch-action). The wheel zooms with Ctrl, which is what a touch pad
 * sends for two fingers, and moves sideways.
 */
export function listenToGestures(over, state) {
  const fingers = new Map(); // pointer id to x in the plot
  let grip = null; // what the fingers hold: the view, and where in it, when they came down
  let moved = false;

  const place = (event) => event.clientX - over.getBoundingClientRect().left;
  const timeAt = (x, { min, max }) => min + (x / over.clientWidth) * (max - min);

  function take() {
    const view = { ...state.view };
    grip = { times: [...fingers.values()].map((x) => timeAt(x, view)), width: view.max - view.min };
  }

  /** Puts the times that the fingers hold below the fingers. */
  function follow() {
    const [x1, x2] = fingers.values();
    let { width } = grip;
    if (fingers.size > 1) {
      const apart = Math.max(20, Math.abs(x2 - x1));
      width = (Math.abs(grip.times[1] - grip.times[0]) / apart) * over.clientWidth;
      if (Math.abs(grip.times[1] - grip.times[0]) * over.clientWidth < 20 * grip.width) return; // too close to tell
    }
    const middle = fingers.size > 1 ? (x1 + x2) / 2 : x1;
    const held = fingers.size > 1 ? (grip.times[0] + grip.times[1]) / 2 : grip.times[0];
    const min = held - (middle / over.clientWidth) * width;
    state.setView(min, min + width);
  }

  over.addEventListener('pointerdown', (event) => {
    if (event.pointerType !== 'touch' || fingers.size >= 2) return;
    if (fingers.size === 0) moved = false;
    fingers.set(event.pointerId, place(event));
    take();
  });
  over.addEventListener('pointermove', (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = fingers.get(event.pointerId);
    const x = place(event);
    if (!moved && fingers.size < 2 && Math.abs(x - before) < 6) return; // a tap trembles
    fingers.set(event.pointerId, x);
    moved = true;
    if (fingers.size > 1 || state.isZoomed) follow();
  });
  for (const end of ['pointerup', 'pointercancel'])
    over.addEventListener(end, (event) => {
      if (!fingers.delete(event.pointerId)) return;
      if (fingers.size > 0) take();
      // Some browsers send no click soon after a move.
      else if (!moved && end === 'pointerup') state.setTime(timeAt(place(event), state.view));
    });
  const swallow = (event) => event.pointerType === 'touch' && moved && event.stopImmediatePropagation();
  over.addEventListener('click', swallow, { capture: true });

  function turn(event) {
    const { min, max } = state.view;
    if (event.ctrlKey) {
      event.preventDefault();
      const held = timeAt(place(event), state.view);
      const factor = Math.min(Math.max(Math.exp(event.deltaY * 0.01), 0.5), 2);
      state.setView(held - (held - min) * factor, held + (max - held) * factor);
    } else if (state.isZoomed && Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      event.preventDefault();
      const shift = (event.deltaX / over.clientWidth) * (max - min);
      state.setView(min + shift, max + shift);
    }
  }
  over.addEventListener('wheel', turn, { passive: false });
}
