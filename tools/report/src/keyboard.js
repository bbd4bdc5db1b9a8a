import { button, el } from './dom.js';
import { ALL_JOINTS } from './state.js';
import { toggleTheme } from './theme.js';

const HELP = [
  ['Space', 'play or pause'],
  ['← →', 'one step of the replay back or on; with Shift ten'],
  ['Home End', 'start or end of the run'],
  ['1 … 9', 'show or hide a case'],
  ['j k', 'next or previous joint'],
  ['a', 'all joints, or one'],
  ['+ −', 'zoom at the cursor'],
  ['0', 'show the whole run'],
  ['d', 'dark or light'],
  ['?', 'this list'],
];
const POINTER = [
  ['drag in a plot', 'zoom to these times, in all plots'],
  ['double click', 'show the whole run'],
  ['Ctrl + wheel', 'zoom at the mouse'],
  ['click in a plot', 'put the scrubber there'],
  ['point at a case', 'it stands out; double click on its button: it alone'],
  ['drag in the replay', 'turn; right button: move; wheel: zoom'],
];
const FINGERS = [
  ['two in a plot', 'zoom, in all plots'],
  ['one sideways', 'move the times in view'],
  ['tap in a plot', 'put the scrubber there'],
];

/** Fills the list of keys; returns what opens it. */
export function createHelp(dialog) {
  const keysOf = (text) => text.split(' ').map((part) => (part === '…' ? ' … ' : el('kbd', { text: part })));
  const list = (rows, show = (text) => [text]) =>
    el('dl', ...rows.flatMap(([key, text]) => [el('dt', ...show(key)), el('dd', { text })]));
  dialog.append(
    el('h2', { text: 'Keys' }),
    list(HELP, keysOf),
    el('h2', { text: 'Mouse' }),
    list(POINTER),
    el('h2', { text: 'Fingers' }),
    list(FINGERS),
    el('form', { method: 'dialog' }, button({ class: 'chip', text: 'Close', onclick: () => dialog.close() })),
  );
  dialog.addEventListener('click', ({ target }) => target === dialog && dialog.close());
  return () => dialog.showModal();
}

/** Connects the keys with what they do. */
export function listenToKeys(state, openHelp) {
  const step = (sign, event) => state.setTime(state.time + sign * state.run.frameStep * (event.shiftKey ? 10 : 1));
  let lastJoint = 0;
  const actions = {
    ' ': () => state.setPlaying(!state.playing),
    ArrowLeft: (event) => step(-1, event),
    ArrowRight: (event) => step(1, event),
    Home: () => state.setTime(state.run.tMin),
    End: () => state.setTime(state.run.tMax),
    j: () => state.stepJoint(1),
    k: () => state.stepJoint(-1),
    a: () => {
      if (state.joint !== ALL_JOINTS) lastJoint = state.joint;
      if (state.run.joints.length > 1) state.setJoint(state.joint === ALL_JOINTS ? lastJoint : ALL_JOINTS);
    },
    '+': () => state.zoom(0.5),
    '=': () => state.zoom(0.5),
    '-': () => state.zoom(2),
    0: () => state.resetView(),
    d: toggleTheme,
    '?': openHelp,
  };
  for (let digit = 1; digit <= 9; ++digit) actions[digit] = () => state.toggleCase(digit - 1);

  document.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector('dialog[open]')) return;
    const { target } = event;
    const isScrubber = target.id === 'scrubber';
    if (!isScrubber && target.closest?.('input, select, textarea')) return;
    if (event.key === ' ' && target.closest?.('button, summary, a')) return; // it presses the button
    if (event.key.startsWith('Arrow') && target.closest?.('.scroll, pre')) return; // it scrolls
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action(event);
  });
}
