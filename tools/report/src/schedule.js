/** Panels to be drawn before the next picture of the screen. */
const waiting = new Set();

/** Has `panel.refresh()` called once before that, however often it was asked for. */
export function schedule(panel) {
  if (waiting.size === 0)
    requestAnimationFrame(() => {
      const panels = [...waiting];
      waiting.clear();
      for (const each of panels) each.refresh();
    });
  waiting.add(panel);
}

/** `panel` is gone and must not be called. */
export function unschedule(panel) {
  waiting.delete(panel);
}
